"""Surface crust: a cement that sets once between grains at rest, and that a grain loses for good.

    F = sigma pi (b R)^2 s / s_b,    0 < s < s_b = x R,    R = 2 R_i R_j / (R_i + R_j), of a wall 2 R_i
    F = 0 once the gap s has reached s_b, and where a grain is loose

with sigma the tensile strength of the cement [Pa], b the radius of the neck over R [1] and x the strain at
which it breaks [1]. The bond neither pulls nor pushes at s = 0 and holds with its full strength just before
it breaks.

Of every grain is remembered the place where its cement has set: where it has lain still, slower than v_0,
for the time t_s. Bonds are between grains that touched there. A grain that has moved from its place by more
than y R_i has broken out and is loose for good: it sticks to nothing where it lands, and what it left does
not stick to others. A bond that opens while both its grains keep their places closes again where they meet.

Strength multiplies sigma. Holds for thin necks, b well below 1, for s_b longer than the way that grains go in
one time step, and for y above both x and what the softened contacts of a simulation yield; a flake that moves
as a whole by more than y R_i falls apart.

Reference: Rice & McEwan (2001), Earth Surf. Process. Landforms 26, 721 (strength of crusts, 1e3 to 1e5 Pa);
Potyondy & Cundall (2004), Int. J. Rock Mech. Min. Sci. 41, 1329, eq. (15) (bonds of a neck's cross-section,
which do not heal).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import pi

from taichi_erosion.core.effect import Check, Conditions, Constants, Effect, Probe
from taichi_erosion.core.quantity import quantity
from taichi_erosion.core.ti import ti

LOOSE = -1.0  # of Memory.calm


@dataclass(frozen=True)
class Params:
    tensile_strength: float = quantity(1e4, "Pa", "of the cement", low=0.0, high=1e7)
    neck: float = quantity(0.1, "1", "radius of a neck over R", low=1e-3, high=0.5)
    strain: float = quantity(0.01, "1", "gap over R at which a bond breaks", low=1e-4, high=0.2)
    rupture: float = quantity(
        0.1, "1", "way over its radius by which a grain has broken out", low=1e-3, high=2.0
    )
    setting: float = quantity(0.005, "s", "time at rest after which the cement has set", low=1e-5, high=1e6)
    still: float = quantity(2e-3, "m s-1", "speed below which a grain is at rest", low=1e-6, high=0.1)


@dataclass(frozen=True)
class Memory:
    calm: float = quantity(0.0, "s", "time at rest, as long as the cement needs; -1: loose for good")
    x: float = quantity(0.0, "m", "place where the cement set")
    y: float = quantity(0.0, "m", "likewise across")
    z: float = quantity(0.0, "m", "likewise upwards")


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica."""
    return {
        "stress": strength * params.tensile_strength * pi * params.neck**2,  # full force over R^2 [Pa]
        "strain": params.strain,
        "rupture": params.rupture,
        "setting": params.setting,
        "still": params.still,
    }


@ti.func
def way(grain, memory):
    """Distance of a grain from its place, across the edges of a periodic box [m]."""
    away = grain.position - ti.Vector([memory.x, memory.y, memory.z])
    for k in ti.static(range(3)):
        if grain.period[k] > 0.0:
            away[k] -= grain.period[k] * ti.round(away[k] / grain.period[k])
    return away.norm()


@ti.func
def remember(constants, grain, memory):
    """Wait until the grain has lain still; then watch whether it has left its place."""
    after = memory
    if memory.calm >= constants.setting:
        if way(grain, memory) > constants.rupture * grain.radius:
            after.calm = LOOSE
    elif memory.calm > LOOSE:
        after.calm = ti.select(grain.velocity.norm() < constants.still, memory.calm + grain.interval, 0.0)
        after.x = grain.position[0]
        after.y = grain.position[1]
        after.z = grain.position[2]
    return after


@ti.func
def pull(constants, pair, mine, other):
    """Attraction [N]; a wall never breaks out."""
    radius = 2.0 * pair.radius_effective
    longest = constants.strain * radius
    fast = mine.calm >= constants.setting and (pair.radius_j == 0.0 or other.calm >= constants.setting)
    attraction = 0.0
    if fast and pair.met > 0.0 and pair.gap > 0.0 and pair.gap < longest:
        attraction = constants.stress * radius * radius * pair.gap / longest
    return attraction


def reach(constants: Constants, radius: float) -> float:
    """Longest bond, of the largest grain with a wall [m]."""
    return 2.0 * constants["strain"] * radius


CRUST = Params(tensile_strength=2e4, neck=0.05, strain=0.02, rupture=0.2, setting=0.01, still=1e-3)
SET, SETTING, BROKEN = (Memory(calm=time, x=0.01) for time in (0.0101, 0.0099, LOOSE))
FULL = 2e4 * pi * (0.05 * 1e-4) ** 2  # two grains of 0.1 mm radius: R = 0.1 mm [N]


def checks(probe: Probe) -> Iterator[Check]:
    def force(gap: float, radius_j: float = 1e-4, met: float = 1.0, **memories: Memory) -> float:
        effective = 1e-4 if radius_j == 0.0 else 1e-4 * radius_j / (1e-4 + radius_j)
        members = {"gap": gap, "radius_i": 1e-4, "radius_j": radius_j, "radius_effective": effective}
        return probe(CRUST, {}, met=met, **members, **({"mine": SET, "other": SET} | memories))

    yield Check("half way to breaking a bond holds with half its strength", force(1e-6), 0.5 * FULL)
    yield Check("just before it breaks it holds with all of it", force(1.999e-6), 0.9995 * FULL)
    yield Check("a broken bond holds nothing", force(2.001e-6), 0.0)
    yield Check("grains that never met are not cemented", force(1e-6, met=0.0), 0.0)
    yield Check("touching grains feel no bond", force(-1e-7), 0.0)
    yield Check("the neck to a wall has four times the section", force(3.998e-6, 0.0), 3.998 * FULL, 1e-4)
    yield Check("a loose grain sticks to no other", force(1e-6, mine=BROKEN), 0.0)
    yield Check("nor does another to a loose one", force(1e-6, other=BROKEN), 0.0)
    yield Check("nor a loose one to a wall", force(1e-6, 0.0, mine=BROKEN), 0.0)
    yield Check("a cement that has not set holds nothing", force(1e-6, other=SETTING), 0.0)
    yield from memory_checks(probe)


def memory_checks(probe: Probe) -> Iterator[Check]:
    def after(before: Memory | None, speed: float = 0.0, x: float = 0.01, **members: object) -> Memory:
        moving = {"position": (x, 0.0, 0.0), "velocity": (0.0, speed, 0.0), "interval": 1e-3}
        return probe(CRUST, {}, before=before, radius=1e-4, **(moving | members))

    yield Check("a grain that enters waits", after(None).calm, 1e-3)
    yield Check("at rest it waits on", after(SETTING, 0.95e-3).calm, 0.0109)
    yield Check("a stir begins the time anew", after(SETTING, 1.05e-3).calm, 0.0)
    yield Check("its place is where it lay last", after(SETTING, x=0.02).x, 0.02)
    yield Check("in its place it stays cemented", after(SET, x=0.01 + 1.9e-5).calm, 0.0101)
    yield Check("out of it it is loose", after(SET, x=0.01 + 2.1e-5).calm, LOOSE)
    yield Check("and its place is kept", after(SET, x=0.01 + 1.9e-5).x, 0.01)
    yield Check("loose for good, even at rest", after(BROKEN).calm, LOOSE)
    across = after(SET, x=0.03, period=(0.02, 0.0, 0.0))
    yield Check("the same place of a periodic box is the same", across.calm, 0.0101)


EFFECT = Effect(
    name="surface_crust",
    title="crust of cemented grains",
    doc=__doc__,
    place="pair",
    params=Params,
    act=pull,
    checks=checks,
    constants=constants,
    reach=reach,
    memory=Memory,
    remember=remember,
    expected={"threshold_u_star": 1, "flux": -1, "repose_angle": 1},
)
