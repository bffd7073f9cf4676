"""What each effect does in scenes whose answer is known: one effect at one place of its axis in a row.

A threshold is given as a ratio to that of the bare model, other quantities as they are. `expected` comes from
a balance of forces, from a formula, or from SciPy; NaN where there is none. `law` is what the literature
gives for whole beds, where it does: an answer that the simple scene need not share.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import cos, nan, radians, sin, sqrt, tan
from pathlib import Path

import numpy as np

from doe.common.tables import update_table
from doe.effects.flight import (
    DROPS,
    PUSHES,
    SLOPES,
    expected_bounces,
    expected_hop,
    simulated_bounces,
    simulated_hops,
    steepest_rest,
)
from doe.effects.pocket import (
    FASTEST,
    HALVINGS,
    SLOWEST,
    Pocket,
    expected_threshold,
    measured_thresholds,
    saddle_ratio,
)
from taichi_erosion.effect_library import load_library
from taichi_erosion.execution.result import apply_instruments
from taichi_erosion.measures.result import Measurement
from taichi_erosion.scene.change import sample_scene
from taichi_erosion.scene.preparation.sizes import nominal_diameter

MILLIMETRES = 1e3  # per metre
GRAVITY = 9.81  # m s-2
SIZES = (7.5e-5, 1e-4, 1.5e-4, 2e-4, 2.5e-4, 3.5e-4, 5e-4, 1e-3)  # m
BARE = Pocket()
MOISTURES = (0.002, 0.005, 0.0165, 0.05)  # kg kg-1
TILTS = (-15.0, -8.0, 8.0, 15.0)  # deg
FRONTS = (0.01, 0.02, 0.05, 0.1)  # frontal area of obstacles over ground [1]
ALTITUDES = (1100.0, 3000.0, 5000.0)  # m
DENSITIES = (1500.0, 2130.0, 4000.0)  # kg m-3
CEMENT = 2e3  # Pa: a stronger one holds the grain in winds that throw it out of the patch
MEMORIES = (1e-3, 0.02, 0.1)  # s, of gusts
SEEDS = range(1, 9)  # of gusts
ANGULARITIES = (0.25, 0.5, 1.0)  # 1
RATIO, POCKET = "u*_t over bare", "grain in a pocket"
HOP_PARTS = {"height": "height of a hop [m]", "length": "way to its top [m]", "spin": "spin there [s-1]"}
HALF_BRACKET = 0.5 * np.log(FASTEST / SLOWEST) / 2**HALVINGS  # of ln u*, that a bisection leaves [1]
SAMPLE_SIZE = nominal_diameter(sample_scene().grains)  # m
READINGS = {  # instrument -> observable, value, unit
    "camera_threshold": ("threshold_u_star", 0.25, "m s-1"),
    "friction_velocity_calibration": ("threshold_u_star", 0.25, "m s-1"),
    "trap_efficiency": ("flux", 0.02, "kg m-1 s-1"),
    "finite_fetch": ("flux", 0.02, "kg m-1 s-1"),
    "repose_method": ("repose_angle", 33.0, "deg"),
}


@dataclass(frozen=True)
class Answer:
    """One row of the table."""

    effect: str
    quantity: str  # what `value` is
    axis: str  # what was varied, with its unit; empty where nothing was
    place: float  # on the axis
    bare: float  # without the effect
    value: float
    error: float  # standard error over seeds, or half of what the method resolves
    expected: float
    n: int  # runs behind the value
    scene: str
    law: float = nan  # of the literature, for whole beds


def pocket_cases() -> Iterator[tuple[str, float, Pocket]]:
    """Axis, place and case of every threshold with a closed form."""
    for size in SIZES:
        for name in ("dry_adhesion", "shear_lift"):
            yield "diameter [mm]", MILLIMETRES * size, replace(BARE, effect=name, diameter=size)
    for name, axis, condition, values in (
        ("liquid_bridge", "moisture [kg kg-1]", "moisture", MOISTURES),
        ("bed_slope", "slope [deg]", "slope", TILTS),
        ("drag_partition", "lambda [1]", "roughness_density", FRONTS),
        ("surface_roughness", "lambda [1]", "roughness_density", FRONTS),
        ("air_density", "altitude [m]", "altitude", ALTITUDES),
    ):
        for value in values:
            yield axis, value, replace(BARE, effect=name, conditions=((condition, value),))
    for density in DENSITIES:
        entries = (("strength", 1.0), ("solid_density", density))
        yield "density [kg m-3]", density, replace(BARE, effect="grain_density", entries=entries)
    cement = (("strength", 1.0), ("tensile_strength", CEMENT))
    yield "tensile strength [kPa]", 1e-3 * CEMENT, replace(BARE, effect="surface_crust", entries=cement)
    for name in ("image_charge", "electric_field"):
        yield "", nan, replace(BARE, effect=name)


def gusty_cases() -> list[Pocket]:
    """The pocket in gusts of every memory, once for every seed."""
    return [
        Pocket(effect="turbulent_gusts", entries=(("strength", 1.0), ("timescale", memory)), seed=seed)
        for memory in MEMORIES
        for seed in SEEDS
    ]


Values = tuple[float, float, float, float]  # bare, value, error, expected
NOWHERE = ("", nan)  # the axis, and the place on it, of what was not varied


def pocket_answers() -> Iterator[Answer]:
    """Thresholds of a grain in a pocket; all are replicas of one ensemble, whose kernels are built once."""
    cases = list(pocket_cases())
    bare = [replace(BARE, diameter=size) for size in SIZES]
    found = measured_thresholds([*bare, *(case for _, _, case in cases), *gusty_cases()])
    base = {case.diameter: float(value) for case, value in zip(bare, found, strict=False)}
    known = {case.diameter: expected_threshold(case) for case in bare}
    for (axis, place, case), value in zip(cases, found[len(bare) :], strict=False):
        before, ratio = base[case.diameter], float(value) / base[case.diameter]
        wanted = expected_threshold(case) / known[case.diameter]
        values = (before, ratio, ratio * HALF_BRACKET, wanted)
        law = LAWS[case.effect](place) if case.effect in LAWS else nan
        yield Answer(case.effect, RATIO, axis, place, *values, 1, POCKET, law)
    gusts = found[-len(MEMORIES) * len(SEEDS) :].reshape(len(MEMORIES), -1) / base[BARE.diameter]
    for memory, ratios in zip(MEMORIES, gusts, strict=True):
        error = float(ratios.std(ddof=1) / np.sqrt(len(ratios)))
        values = (base[BARE.diameter], float(ratios.mean()), error, nan)
        yield Answer("turbulent_gusts", RATIO, "memory [s]", memory, *values, len(ratios), POCKET)


def flight_answers() -> Iterator[Answer]:
    """Height, way to the top and spin there of a grain that hops, beside SciPy's."""
    names = list(PUSHES)
    (bare, *hops), wind = simulated_hops(["", *names])
    for name, hop in zip(names, hops, strict=True):
        wanted = expected_hop(name, wind)
        for part, quantity in HOP_PARTS.items():
            before, value, right = (float(getattr(one, part)) for one in (bare, hop, wanted))
            if value != before:
                yield Answer(name, quantity, *NOWHERE, before, value, 0.0, right, 1, "a hop in the wind")


def bounce_answers() -> Iterator[Answer]:
    """Restitution against speed."""
    bare, lossy = simulated_bounces()
    for speed, before, value, wanted in zip(DROPS, bare, lossy, expected_bounces(), strict=True):
        values: Values = (float(before), float(value), 0.0, float(wanted))
        yield Answer(
            "restitution_speed", "restitution", "speed [m s-1]", speed, *values, 1, "drop on a plate"
        )


def rolling_answers() -> Iterator[Answer]:
    """Steepest slope on which a grain stays; a sphere without the effect rolls at any."""
    params, step = load_library()["rolling_resistance"].params(), float(SLOPES[1] - SLOPES[0])
    for angularity in ANGULARITIES:
        wanted = params.friction_rolling * angularity
        half = 0.5 * step * wanted
        values: Values = (0.0, steepest_rest(angularity) + half, half, wanted)
        quantity = "tan of the steepest slope at rest"
        yield Answer("rolling_resistance", quantity, "angularity [1]", angularity, *values, 1, "tilted plane")


def reading_answers() -> Iterator[Answer]:
    """What instruments make of a true value, at their default numbers."""
    library = load_library()
    for name, (observable, true, unit) in READINGS.items():
        scene = sample_scene(effects={name: {"strength": 1.0}})
        shown = apply_instruments({observable: Measurement(observable, true, 0.0, unit)}, scene, library)
        values: Values = (true, shown[observable].value, 0.0, READ[name](library[name].params()) * true)
        yield Answer(name, f"{observable} as read [{unit}]", *NOWHERE, *values, 1, "a reading")


# ratio of thresholds over a bed by place on the axis [1]: Shao & Lu (2000) with gamma = 3e-4 N m-1; Fecan et
# al. (1999) without clay; Iversen & Rasmussen (1994) at the groove's angle; Raupach et al. (1993); the root
# of the density in the standard atmosphere (ISO 2533, exponent 4.256); Bagnold (1941)
LAWS: dict[str, Callable[[float], float]] = {
    "dry_adhesion": lambda size: sqrt(1.0 + 3e-4 / (BARE.density * GRAVITY * (size / MILLIMETRES) ** 2)),
    "liquid_bridge": lambda moisture: sqrt(1.0 + 1.21 * (100.0 * moisture) ** 0.68),
    "bed_slope": lambda slope: sqrt(saddle_ratio(slope)),
    "drag_partition": lambda front: sqrt((1.0 - 0.5 * front) * (1.0 + 50.0 * front)),
    "air_density": lambda altitude: (288.15 / (288.15 - 0.0065 * altitude)) ** 2.128,
    "grain_density": lambda density: sqrt(density / BARE.density),
}


def bed_law(effect: str, place: float, flowing: float) -> float:
    """Ratio of thresholds over a small bed [1]; `flowing` is the slope at which that bed flows [deg]."""
    if effect == "bed_slope":
        return sqrt(cos(radians(place)) + sin(radians(place)) / tan(radians(flowing)))
    return LAWS[effect](place)


READ = {  # factor by the formula of each page at its defaults [1]
    "camera_threshold": lambda p: float(np.exp(np.log(p.criterion) / p.exponent)),
    "friction_velocity_calibration": lambda p: p.ratio,
    "trap_efficiency": lambda p: 1.0 - p.loss,
    "finite_fetch": lambda p: float(-np.expm1(-p.fetch / (p.saturation * SAMPLE_SIZE * p.density_ratio))),
    "repose_method": lambda p: p.ratio,
}

GROUPS = {
    "pocket": pocket_answers,
    "flight": flight_answers,
    "bounce": bounce_answers,
    "rolling": rolling_answers,
    "reading": reading_answers,
}


def write_answers(path: Path, rows: Sequence[Answer]) -> None:
    """Write the table; rows of the same effects and scenes that stand there already are replaced."""
    update_table(path, Answer, rows, lambda row: (row.effect, row.scene), digits=6, none="nan")
