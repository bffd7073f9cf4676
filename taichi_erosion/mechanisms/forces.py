"""Mechanisms that are forces: between pairs of grains, of the air on a grain, or of no stated origin."""

from collections.abc import Iterator
from functools import partial
from math import pi
from typing import Any

from taichi_erosion.core.effect import Check, Conditions, Constants, Probe
from taichi_erosion.core.ti import ti
from taichi_erosion.effect_library import turbulent_gusts
from taichi_erosion.mechanisms.factors import HALF, dose_factor

GRAVITY = 9.81  # m s-2
DIAMETER_OVER_EFFECTIVE = 4.0  # d / R* of two equal spheres [1]
SAFFMAN = 1.615  # coefficient of Saffman's lift [1]
WIDEST = 1e6  # deviation over u* that no wind reaches: the intensity alone limits the gusts [1]
PAIR = {"radius_i": 1e-4, "radius_j": 1e-4, "radius_effective": 5e-5, "mass_i": 1e-8, "mass_j": 1e-8}
WALL = PAIR | {"radius_j": 0.0, "radius_effective": 1e-4, "mass_j": 0.0}


def pull_constants(length: float, params: Any, strength: float, conditions: Conditions) -> Constants:
    """Numbers of one replica; `length` is what the range counts, over R* [1]."""
    return {"pull": strength * params.dose * GRAVITY, "range": length * params.range}


@ti.func
def pull(constants, pair):
    """Attraction [N]."""
    mass = pair.mass_i
    if pair.mass_j > 0.0:
        mass = 2.0 * pair.mass_i * pair.mass_j / (pair.mass_i + pair.mass_j)
    remainder = 1.0 - ti.max(pair.gap, 0.0) / (constants.range * pair.radius_effective)
    return constants.pull * mass * ti.max(remainder, 0.0)


def reach(constants: Constants, radius: float) -> float:
    """Gap at which the largest grains have let go of a wall [m]."""
    return constants["range"] * radius


def pull_checks(length: float, share: float, params: Any, probe: Probe) -> Iterator[Check]:
    """Checks with a range of `share`; `length` as in `pull_constants`."""
    ends = length * share * PAIR["radius_effective"]  # m, gap of two grains at which the pull ends

    def force(gap: float, strength: float = 1.0, **members: float) -> float:
        return probe(params(dose=4.0, range=share), {}, strength=strength, **(PAIR | {"gap": gap} | members))

    yield Check("touching grains pull with D times their weight", force(0.0), 3.924e-7)
    yield Check("half the strength is half the pull", force(-1e-8, 0.5), 1.962e-7)
    yield Check("half way through the range the pull is half", force(0.5 * ends), 1.962e-7, rtol=1e-4)
    yield Check("beyond the range there is none", force(1.2 * ends), 0.0)
    yield Check("of a grain three times as heavy 1.5 times", force(0.0, mass_j=3e-8), 5.886e-7)
    yield Check("a wall pulls with the weight of the grain", force(0.0, **WALL), 3.924e-7)
    yield Check("a wall counts as a grain of twice the diameter", force(ends, **WALL), 1.962e-7, rtol=1e-4)


@ti.func
def push_upwards(constants, grain):
    """Force [N] and torque [N m]."""
    force = 0.0 * grain.velocity
    force[2] = constants.acceleration * grain.mass
    return force, 0.0 * force


def vertical_checks(params: Any, probe: Probe) -> Iterator[Check]:
    def force(axis: int, mass: float = 1e-8, strength: float = 1.0) -> float:
        return probe(params(dose=0.5), {}, strength=strength, mass=mass)[0][axis]

    yield Check("half the weight, upwards", force(2), 4.905e-8)
    yield Check(HALF, force(2, strength=0.5), 2.4525e-8)
    yield Check("a heavier grain is pushed more", force(2, 2e-8), 9.81e-8)
    yield Check("nothing along the wind", force(0), 0.0)


@ti.func
def drag_factor(constants, grain):
    """Factor of the drag [1]."""
    return 1.0 + constants.more


@ti.func
def no_push(constants, grain):
    """No force besides the drag [N], and no torque [N m]."""
    return 0.0 * grain.velocity, 0.0 * grain.velocity


def drag_checks(params: Any, probe: Probe) -> Iterator[Check]:
    # probes have creeping flow, drag 3 pi mu d u
    air = {"air_density": 1.2, "air_viscosity": 1.8e-5, "radius": 1e-4, "air_velocity": (0.5, 0.0, 0.0)}
    stokes = 3.0 * pi * 1.8e-5 * 2e-4 * 0.5

    def added_drag(dose: float, strength: float = 1.0) -> float:
        return probe(params(dose=dose), {}, strength=strength, **air)[0][0] / stokes

    yield Check("a dose of 0.5 adds half the drag", added_drag(0.5), 0.5)
    yield Check(HALF, added_drag(0.5, 0.5), 0.25)
    yield Check("a negative dose takes drag away", added_drag(-0.4), -0.4)


@ti.func
def push_across(constants, grain):
    """Force [N] and torque [N m]."""
    slip = grain.air_velocity - grain.velocity
    force = 0.0 * slip
    root = ti.sqrt(grain.air_density * grain.air_viscosity * ti.abs(grain.air_shear))
    size = constants.coefficient * 4.0 * grain.radius * grain.radius * root
    signed = ti.select(grain.air_shear >= 0.0, size, -size)
    force[0] = -signed * slip[2]
    force[2] = signed * slip[0]
    return force, 0.0 * force


def lift_checks(params: Any, probe: Probe) -> Iterator[Check]:
    air = {"air_density": 1.2, "air_viscosity": 1.8e-5, "radius": 1e-4}

    def force(axis: int, shear: float, wind: tuple[float, float, float], strength: float = 1.0) -> float:
        members = air | {"air_velocity": wind, "air_shear": shear}
        return probe(params(dose=2.0), {}, strength=strength, **members)[0][axis]

    saffman = 1.615 * 4e-8 * (1.2 * 1.8e-5 * 300.0) ** 0.5
    yield Check("twice Saffman's lift", force(2, 300.0, (0.3, 0.0, 0.0)), 2.0 * saffman * 0.3)
    yield Check(HALF, force(2, 300.0, (0.3, 0.0, 0.0), 0.5), saffman * 0.3)
    yield Check("rising air pushes upstream", force(0, 300.0, (0.0, 0.0, 0.2)), -2.0 * saffman * 0.2)
    yield Check("a shear that falls upwards presses down", force(2, -300.0, (0.3, 0, 0)), -2 * saffman * 0.3)


def gust_constants(params: Any, strength: float, conditions: Conditions) -> Constants:
    gusts = turbulent_gusts.constants(turbulent_gusts.Params(timescale=params.timescale), 1.0, conditions)
    along = {"deviation": WIDEST, "intensity": strength * params.dose}
    return gusts | along | {"upward": 0.0, "wall_upward": 0.0}


def gust_checks(params: Any, probe: Probe) -> Iterator[Check]:
    # probes have creeping flow, drag 3 pi mu d s; the grain is carried by the air
    air = {"air_density": 1e-6, "air_viscosity": 1.0, "radius": 1e-4, "chance": 0.375}
    stokes = 3.0 * pi * 2e-4
    lognormal = turbulent_gusts.gust_over_mean

    def gust(time: float, strength: float = 1.0, wind: float = 4.0) -> float:
        carried = {"air_velocity": (wind, 0.0, 0.0), "velocity": (wind, 0.0, 0.0), "friction_velocity": 0.2}
        gusty = params(dose=0.2, timescale=0.05)
        return probe(gusty, {}, strength=strength, time=time, **air, **carried)[0][0] / stokes

    yield Check("a gust has the deviation D |u|", gust(0.03), 4.0 * lognormal(0.2, 0.03), rtol=3e-3)
    yield Check("later it is another", gust(0.09), 4.0 * lognormal(0.2, 0.09), rtol=3e-3)
    yield Check(HALF, gust(0.09, 0.5), 4.0 * lognormal(0.1, 0.09), rtol=3e-3)
    half_wind = gust(0.09, wind=2.0)
    yield Check("half the wind has half the gust", half_wind, 2.0 * lognormal(0.2, 0.09), rtol=3e-3)


def pull_mechanism(length: float, share: float) -> tuple[Any, Any, dict[str, Any]]:
    """Row of a pull between grains; arguments as those of `pull_checks`."""
    members = {"constants": partial(pull_constants, length), "reach": reach}
    return pull, partial(pull_checks, length, share), members


def dose_constant_members(name: str, unit: float) -> dict[str, Any]:
    """Members of a row whose one constant is the dose in this unit."""
    return {"constants": lambda params, strength, _: {name: strength * params.dose * unit}}


DRAG = {"constants": lambda p, s, _: {"more": dose_factor(s, p.dose) - 1.0}, "drag": drag_factor}
GUSTS = {"constants": gust_constants, "gust": turbulent_gusts.gust}
FORCES = {  # mechanism -> act, checks, other members
    "contact_pull": pull_mechanism(1.0, 0.01),
    "gap_pull": pull_mechanism(DIAMETER_OVER_EFFECTIVE, 0.2),
    "vertical_force": (push_upwards, vertical_checks, dose_constant_members("acceleration", GRAVITY)),
    "drag": (no_push, drag_checks, DRAG),
    "lift": (push_across, lift_checks, dose_constant_members("coefficient", SAFFMAN)),
    "gustiness": (turbulent_gusts.push, gust_checks, GUSTS),
}
