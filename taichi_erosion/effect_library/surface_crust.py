"""Surface crust: a cement that sets once between grains at rest, and that a grain loses for good.

    F_i = -sigma pi (b R)^2 u / s_b,    |u| < s_b = x R,    R = 2 R_i R_j / (R_i + R_j), of a wall 2 R_i
    F_i = 0 from |u| = s_b on, and where a grain is loose
    u   = (x_i - x_j) - (h_i - h_j), of a wall x_i - h_i

with F_i the force on grain i [N], of which j gets the opposite, x_i the centres now and h_i where they were
when their cement had set [m], sigma the tensile strength of the cement [Pa], b the radius of the neck over R
[1] and x the strain at which it breaks [1]. A bond is a spring that holds two grains as they lay, against
pull and shear alike, with its full strength just before it breaks. Bonds are between grains, and walls at
rest, that were nearer than s_b when they set.

The state of every grain is its place h: where it has lain still, slower than v_0, for the time t_s,
and that once. A grain that has moved from there by more than y R_i has broken out and is loose for good: it
sticks to nothing where it lands, and nothing sticks to it. A bond that opens while both its grains keep their
places holds again when they are back.

Strength multiplies sigma. Holds for thin necks, b well below 1, for y above x, and for time steps that
resolve the stiffness of a bond, sigma pi b^2 R / x, as they do where it is not above that of the contacts.
The places have directions: a flake that turns by more than about x breaks, and the cement turns no grain.

Reference: Rice & McEwan (2001), Earth Surf. Process. Landforms 26, 721 (strength of crusts, 1e3 to 1e5 Pa);
Potyondy & Cundall (2004), Int. J. Rock Mech. Min. Sci. 41, 1329, eq. (15) (bonds of a neck's cross-section,
which do not heal).
"""

from dataclasses import dataclass, replace
from math import pi

from taichi_erosion.core.effect import Check, Checks, Conditions, Constants, Probe, effect_of, quantity
from taichi_erosion.core.ti import nearest_image, ti

LOOSE = -1.0  # of State.calm


@dataclass(frozen=True)
class Params:
    tensile_strength: float = quantity(1e4, "Pa", "of the cement", low=0.0, high=1e7)
    neck: float = quantity(0.1, "1", "radius of a neck over R", low=1e-3, high=0.5)
    strain: float = quantity(0.01, "1", "gap over R at which a bond breaks", low=1e-4, high=0.2)
    rupture: float = quantity(0.5, "1", "way over its radius that frees a grain for good", low=1e-3, high=2.0)
    setting: float = quantity(0.005, "s", "time at rest after which the cement has set", low=1e-5, high=1e6)
    still: float = quantity(2e-3, "m s-1", "speed below which a grain is at rest", low=1e-6, high=0.1)


@dataclass(frozen=True)
class State:
    calm: float = quantity(0.0, "s", "time at rest, as long as the cement needs; -1: loose for good")
    x: float = quantity(0.0, "m", "place where the cement set")
    y: float = quantity(0.0, "m", "likewise across")
    z: float = quantity(0.0, "m", "likewise upwards")


def constants(params: Params, strength: float, conditions: Conditions) -> Constants:
    stress = strength * params.tensile_strength * pi * params.neck**2  # full force over R^2 [Pa]
    others = {name: getattr(params, name) for name in ("strain", "rupture", "setting", "still")}
    return {"stress": stress} | others


@ti.func
def rest_position(state):
    """Where a grain was when its cement set [m]; zeros for a wall."""
    return ti.Vector([state.x, state.y, state.z])


@ti.func
def update_state(constants, grain, state):
    """Wait until the grain has lain still; then watch whether it has left its place."""
    after = state
    if state.calm >= constants.setting:
        shift = nearest_image(grain.position - rest_position(state), grain.period).norm()
        if shift > constants.rupture * grain.radius:
            after.calm = LOOSE
    elif state.calm > LOOSE:
        after.calm = ti.select(grain.velocity.norm() < constants.still, state.calm + grain.interval, 0.0)
        after.x = grain.position[0]
        after.y = grain.position[1]
        after.z = grain.position[2]
    return after


@ti.func
def bond(constants, pair, state_i, state_j):
    """Force on grain i [N]; a wall never breaks out."""
    radius = 2.0 * pair.radius_effective
    longest = constants.strain * radius
    force = 0.0 * pair.normal
    if state_i.calm >= constants.setting and (pair.radius_j == 0.0 or state_j.calm >= constants.setting):
        away = nearest_image(pair.offset - (rest_position(state_i) - rest_position(state_j)), pair.period)
        if away.norm() < longest and pair.gap - away.dot(pair.normal) < longest:
            force = -(constants.stress * radius * radius / longest) * away
    return force


def reach(constants: Constants, radius: float) -> float:
    """Longest bond, of the largest grain with a wall [m]."""
    return 2.0 * constants["strain"] * radius


CRUST = Params(tensile_strength=2e4, neck=0.05, strain=0.02, rupture=0.2, setting=0.01, still=1e-3)
SET, SETTING, BROKEN = (State(calm=time, x=0.01) for time in (0.0101, 0.0099, LOOSE))
WALL = State()
FULL = 2e4 * pi * (0.05 * 1e-4) ** 2  # two grains of 0.1 mm radius: R = 0.1 mm [N]


def checks(probe: Probe) -> Checks:
    second = replace(SET, x=0.01 - 2e-4)  # of two grains that touched when they set

    def force(
        x: float, y: float, along: int, state_i: State = SET, state_j: State = second, **rest: object
    ) -> float:
        """Force on grain i that is (x, y) from its place, against that displacement."""
        members = {"radius_i": 1e-4, "radius_j": 1e-4, "radius_effective": 5e-5, "normal": (1.0, 0.0, 0.0)}
        members |= {"gap": x, "offset": (2e-4 + x, y, 0.0)}
        return -probe(CRUST, {}, state_i=state_i, state_j=state_j, **(members | rest))[along]

    def to_wall(x: float, state_i: State = SET) -> float:
        at = {"offset": (0.01 + x, 0.0, 0.0), "radius_j": 0.0, "radius_effective": 1e-4}
        return force(x, 0.0, 0, state_i, WALL, **at)

    loose = {"rtol": 1e-3}  # places of f32, of a millionth of a millimetre
    half = force(1e-6, 0.0, 0)
    yield Check("half way to breaking a bond holds with half its strength", half, 0.5 * FULL, **loose)
    yield Check("sideways too", force(0.0, 1e-6, 1), 0.5 * FULL, **loose)
    yield Check("and against compression", force(-1e-6, 0.0, 0), -0.5 * FULL, **loose)
    most = force(1.99e-6, 0.0, 0)
    yield Check("just before it breaks it holds with all of it", most, 0.995 * FULL, **loose)
    yield Check("a broken bond holds nothing", force(2.01e-6, 0.0, 0), 0.0)
    yield Check("sideways neither", force(1.5e-6, 1.5e-6, 1), 0.0)
    yield Check("in their places the bond is without force", force(0.0, 0.0, 0), 0.0, atol=1e-3 * FULL)
    yield Check("grains that lay apart are not cemented", force(1e-6, 0.0, 0, gap=3.1e-6), 0.0)
    across = force(1e-6, 0.0, 0, offset=(0.0202 + 1e-6, 0.0, 0.0), period=(0.02, 0.0, 0.0))
    yield Check("a bond reaches across the edge of a periodic box", across, 0.5 * FULL, **loose)
    yield Check("the neck to a wall has four times the section", to_wall(3.98e-6), 3.98 * FULL, **loose)
    yield Check("a loose grain sticks to no other", force(1e-6, 0.0, 0, BROKEN), 0.0)
    yield Check("nor does another to a loose one", force(1e-6, 0.0, 0, SET, replace(second, calm=LOOSE)), 0.0)
    yield Check("nor a loose one to a wall", to_wall(1e-6, BROKEN), 0.0)
    yield Check("a cement that has not set holds nothing", force(1e-6, 0.0, 0, SETTING), 0.0)
    yield from memory_checks(probe)


def memory_checks(probe: Probe) -> Checks:
    def state_after(before: State | None, speed: float = 0.0, x: float = 0.01, **members: object) -> State:
        moving = {"position": (x, 0.0, 0.0), "velocity": (0.0, speed, 0.0), "interval": 1e-3}
        return probe(CRUST, {}, state_before=before, radius=1e-4, **(moving | members))

    yield Check("a grain that enters waits", state_after(None).calm, 1e-3)
    yield Check("at rest it waits on", state_after(SETTING, 0.95e-3).calm, 0.0109)
    yield Check("a stir begins the time anew", state_after(SETTING, 1.05e-3).calm, 0.0)
    yield Check("its place is where it lay last", state_after(SETTING, x=0.02).x, 0.02)
    yield Check("in its place it stays cemented", state_after(SET, x=0.01 + 1.9e-5).calm, 0.0101)
    yield Check("out of it it is loose", state_after(SET, x=0.01 + 2.1e-5).calm, LOOSE)
    yield Check("and its place is kept", state_after(SET, x=0.01 + 1.9e-5).x, 0.01)
    yield Check("loose for good, even at rest", state_after(BROKEN).calm, LOOSE)
    across = state_after(SET, x=0.03, period=(0.02, 0.0, 0.0))
    yield Check("the same place of a periodic box is the same", across.calm, 0.0101)


EFFECT = effect_of(
    __name__,
    "crust of cemented grains",
    "pair",
    bond,
    vector=True,
    grain_state=State,
    expected={"threshold_u_star": 1, "flux": -1, "repose_angle": 1},
)
