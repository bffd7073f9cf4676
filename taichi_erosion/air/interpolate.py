"""Between a grid of the pressure and the next coarser one.

Corrections are interpolated linearly, 3/4 and 1/4; restriction is the transpose of that.

Reference: Trottenberg, Oosterlee & Schueller (2001), Multigrid, section 2.8.
"""

from taichi_erosion.air.levels import column_of
from taichi_erosion.core.ti import ti

real = ti.f64


@ti.func
def share(place, coarse, fine_cells, merged, is_round: ti.template()):
    """Weight of a coarse cell in the interpolation to the fine cell at a place [1].

    The fine cell may lie beyond an end: round a period it is another one, else it is none.
    """
    weight = real(1.0)
    if merged == 2:
        inside = place // 2 == coarse
        weight = ti.select(inside, real(0.75), real(0.25))
        if ti.static(not is_round):
            if place < 0 or place >= fine_cells:
                weight = 0.0
            elif inside and (place == 0 or place == fine_cells - 1):
                weight = 1.0
    return weight


@ti.func
def restrict_to_line(grids_out: ti.template(), level, r, i, j):
    """Gather the rest of a grid in one line of the next coarser one."""
    layers = ti.static(grids_out.right.shape[2])
    fine_x, fine_y = grids_out.shape[level, 1], grids_out.shape[level, 2]
    by_x, by_y = grids_out.shape[level, 3], grids_out.shape[level, 4]
    c = column_of(grids_out, level + 1, i, j)
    for k in range(layers):
        grids_out.right[r, c, k] = 0.0
    # a coarse cell reaches the fine cells inside it and one beyond each of its ends
    for a in range(3 * by_x - 2):
        for b in range(3 * by_y - 2):
            x, y = by_x * i + 1 - by_x + a, by_y * j + 1 - by_y + b
            weight = share(x, i, fine_x, by_x, grids_out.round_x)
            weight *= share(y, j, fine_y, by_y, grids_out.round_y)
            fine = column_of(grids_out, level, x, y)
            for k in range(layers):
                more = weight * grids_out.rest[r, fine, k]
                grids_out.right[r, c, k] = grids_out.right[r, c, k] + more


@ti.kernel
def restrict(
    # parameters
    level: ti.i32,
    # out
    grids_out: ti.template(),
):
    """Hand the rest of a grid to the next coarser one."""
    nx, ny = grids_out.shape[level + 1, 1], grids_out.shape[level + 1, 2]
    for r, i, j in ti.ndrange(grids_out.right.shape[0], nx, ny):
        restrict_to_line(grids_out, level, r, i, j)


@ti.func
def partner(place, cells, merged, is_round: ti.template()):
    """The second coarse cell that a fine cell is interpolated from; at a closed end the first again."""
    other = place // merged
    if merged == 2:
        other += 2 * (place % 2) - 1
        if ti.static(is_round):
            other = (other + cells) % cells
        else:
            other = ti.min(ti.max(other, 0), cells - 1)
    return other


@ti.func
def prolong_to_line(grids_out: ti.template(), level, r, i, j):
    """Add to one line of a grid the solution of the next coarser one, interpolated linearly."""
    fine_x, fine_y = grids_out.shape[level, 1], grids_out.shape[level, 2]
    by_x, by_y = grids_out.shape[level, 3], grids_out.shape[level, 4]
    c = column_of(grids_out, level, i, j)
    east = partner(i, fine_x // by_x, by_x, grids_out.round_x)
    north = partner(j, fine_y // by_y, by_y, grids_out.round_y)
    west, south = i // by_x, j // by_y
    own = column_of(grids_out, level + 1, west, south)
    beside = column_of(grids_out, level + 1, east, south)
    ahead = column_of(grids_out, level + 1, west, north)
    corner = column_of(grids_out, level + 1, east, north)
    for k in range(grids_out.right.shape[2]):
        near = 0.75 * grids_out.solution[r, own, k] + 0.25 * grids_out.solution[r, beside, k]
        far = 0.75 * grids_out.solution[r, ahead, k] + 0.25 * grids_out.solution[r, corner, k]
        grids_out.solution[r, c, k] = grids_out.solution[r, c, k] + 0.75 * near + 0.25 * far


@ti.kernel
def prolong(
    # parameters
    level: ti.i32,
    # out
    grids_out: ti.template(),
):
    """Add to a grid the solution of the next coarser one, interpolated linearly."""
    for r, i, j in ti.ndrange(grids_out.right.shape[0], grids_out.shape[level, 1], grids_out.shape[level, 2]):
        prolong_to_line(grids_out, level, r, i, j)
