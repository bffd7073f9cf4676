"""How far a grain may move before the lists are rebuilt.

    h = clip(|v| t, m R, h_most)

Fast grains get a wide margin, resting grains a narrow one, so that a few flying grains do not force the
settled ones to search again. Adjacent cells hold all partners of a grain with R + h <= L, the grasp of the
cells. A wide grain, R + h > L, looks at all others instead. That costs little while such grains are few; in a
crowd they have to make do with h = max(m R, L - R).
"""

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.state import side_block

WIDE_MOST = 150  # wide grains in a crowd: in a dense bed a grain looks at about as many in adjacent cells


@ti.func
def margin_wanted(replicas: ti.template(), r, radius, speed):
    """Distance that a grain should be able to move before its list is stale [m]."""
    least = replicas.margin_least[r] * radius
    return ti.min(ti.max(least, speed * replicas.margin_time[r]), replicas.margin_most[r])


@ti.func
def margin(replicas: ti.template(), r, radius, speed):
    """Distance that a grain may move before its list is stale [m]; in a crowd no more than cells allow."""
    allowed = margin_wanted(replicas, r, radius, speed)
    if replicas.crowded[r] == 1:
        least = replicas.margin_least[r] * radius
        allowed = ti.min(allowed, ti.max(least, replicas.grasp_most[r] - radius))
    return allowed


@ti.func
def count_wide(world_out: ti.template(), r):
    """Note whether more grains than `WIDE_MOST` would reach beyond adjacent cells."""
    grains, replicas_out = ti.static((world_out.grains, world_out.replicas))
    base = side_block(grains, r, replicas_out.side[r])
    wide = 0
    for i in range(base, base + replicas_out.released[r]):
        wanted = margin_wanted(replicas_out, r, grains.radius[i], grains.velocity[i].norm())
        wide += ti.cast(grains.radius[i] + wanted > replicas_out.grasp_most[r], ti.i32)
    replicas_out.crowded[r] = ti.cast(wide > WIDE_MOST, ti.i32)


@ti.func
def is_wide(world: ti.template(), r, i):
    """Whether the grain at place i reaches beyond adjacent cells."""
    (grains,) = ti.static((world.grains,))
    return grains.extent[i] > world.replicas.grasp_most[r]
