"""V36: sand of one material and several diameters starts, blows and comes to rest as saltation does.

Patches of a few hundred grains without adhesion, lift or gusts, all in one ensemble: two diameters whose
transport is slowed down until it ceases, four beds each, one bed from rest, and four winds over the smallest
grains. What is asked for are the signatures that do not hang on a fitted number: the impact threshold goes
with the root of the diameter, lies below the wind that starts a bed from rest, the flux is linear in the
stress, and grains take from the air near the bed all but about the stress of the threshold (Owen).

Near its threshold a patch of this size carries a handful of grains, and when the last one comes to rest is
chance: single beds of fine grains cease at winds that scatter by a third. The threshold is therefore where
the straight line of the flux of all beds together, against the stress, meets zero; the standard error of that
line stands in the claim.

Reference: Bagnold (1941), The Physics of Blown Sand; Owen (1964), J. Fluid Mech. 20, 225; Creyssels et al.
(2009), J. Fluid Mech. 625, 47; Duran, Andreotti & Claudin (2012), Phys. Fluids 24, 103306.
"""

from collections.abc import Iterator, Sequence
from math import nan, sqrt
from typing import Any

import numpy as np

from taichi_erosion.core.setup import Numerics
from taichi_erosion.measures.threshold import Bracket, flux_intercept
from taichi_erosion.run.play import Play, play
from taichi_erosion.run.stages import Actor
from taichi_erosion.scene import Scene, build_setup, laws, parse_scene
from taichi_erosion.simulation import assemble
from taichi_erosion.verification.claim import Outcome, below, holds, relative

SMALLEST = 0.25e-3  # m
DIAMETERS = (1.0, 2.0)  # over the smallest [1]
WINDS = (0.28, 0.36, 0.44, 0.52)  # u* over the smallest grains [m s-1]
AIR = 1.225  # kg m-3
COUNT, LENGTH, WIDTH = 500, 16.0, 8.0  # grains, diameters, diameters
MODULUS = 2e5  # Pa, of the smallest; with the diameter: as soft for all. Half of it is crushed at 0.5 m/s
SEED = 1
BEDS = range(SEED, SEED + 4)  # seeds whose transport is slowed down
SETTLE = {"name": "settle", "duration_max": 0.1, "duration_min": 0.02, "rest_energy": 1e-3}
START = {"name": "start", "until": "time", "duration_max": 0.12, "friction_velocity": 0.65}
ADJUSTMENTS, ADJUST = 4, 0.1  # times that the air finds its steady profile, and s between them
BLOW = 2.0  # s over which the steady flux is averaged
HUNT = {"name": "hunt", "until": "threshold", "duration_max": 8.0}


def sand(diameter: float, stages: list[dict[str, Any]], more: dict[str, Any]) -> Scene:
    """A periodic patch of sand under wind; times and winds of its stages are for the smallest grains."""
    size = diameter / SMALLEST
    sizes = {"median": diameter, "low": 0.8 * diameter, "high": 1.25 * diameter}
    touch = {"restitution": 0.7, "friction_sliding": 0.5}
    solid = {"density": 2650.0, "shear_modulus": MODULUS * size, "poisson_ratio": 0.25}
    softening = {"softening": {"rule": "bond_number", "true_modulus": 3e10}}
    column = {
        "length_d": LENGTH,
        "width_d": WIDTH,
        "height_d": 200.0,
        "density": AIR,
        "growth": 1.2,
        "look_steps": 20,
    }
    table = {
        "scene": {"kind": "saltation"},
        "run": {"time_step_fraction": 0.25, "check_interval": 5e-3, "overlap_limit": 0.9},
        "grains": {
            "count": COUNT,
            "material": "sand",
            "size": {"law": "lognormal", "sigma_log": 0.1, **sizes},
        },
        "materials": {"sand": solid | softening},
        "contact": {"sand-sand": touch},
        "geometry": {"ground": {"shape": "plane", "material": "sand"}},
        "wind": column | {"drag": "two_limits", "cell_d": 0.25},
        "fill": {"law": "layers", "pitch_d": 1.32, "jitter_d": 0.03, "first_height_d": 1.0},
        "stages": [scaled(stage, size) for stage in stages],
    }
    return parse_scene(table | more)


def scaled(stage: dict[str, Any], size: float) -> dict[str, Any]:
    """The stage for grains that are `size` times as large.

    Winds go with the root, as the threshold does; times with the size itself, as about does the time in which
    drag gives a grain the speed of the air.
    """
    factors = {"duration_max": size, "duration_min": size, "friction_velocity": sqrt(size)}
    return stage | {name: factor * stage[name] for name, factor in factors.items() if name in stage}


def slowed(size: float) -> Scene:
    """Grains that blow while the wind falls; every wind lasts about ten hops."""
    order = {"transport": 0.3 * sqrt(size), "fall": 0.07, "spin_up": 0.4 * size}
    order["fall_hold"] = 0.4 * sqrt(size)
    measured = {"impact_threshold": {}}
    return sand(size * SMALLEST, [SETTLE, START, HUNT], {"threshold": order, "measure": measured})


def from_rest() -> Scene:
    """A bed at rest under winds that grow."""
    order = {"first": 0.2, "levels": 1}
    settle = SETTLE | {"duration_max": 0.3, "rest_energy": 1e-5, "rest_contact_share": 0.5}
    return sand(SMALLEST, [settle, HUNT], {"threshold": order, "measure": {"fluid_threshold": {}}})


def steady(wind: float) -> Scene:
    """Grains that blow in one wind [m s-1]."""
    change = {"until": "time", "friction_velocity": wind}
    adjust = [change | {"name": f"adjust_{k}", "duration_max": ADJUST} for k in range(ADJUSTMENTS)]
    stages = [SETTLE, START, *adjust, change | {"name": "blow", "duration_max": BLOW}]
    measured = {"flux": {"every": 5e-3}, "bed_stress": {"every": 5e-3}}
    return sand(SMALLEST, stages, {"measure": measured})


def played(scenes: list[tuple[Scene, int]]) -> list[Actor]:
    """All scenes with their seeds as one ensemble, to their ends."""
    setups = [build_setup(scene, seed) for scene, seed in scenes]
    sim = assemble(setups, laws(scenes[0][0]), Numerics())
    whole = Play([scene for scene, _ in scenes], sim, [Actor(seed) for _, seed in scenes])
    play(whole, [])
    return whole.actors


def impact_threshold(beds: Sequence[Actor]) -> Bracket:
    """Where the line of the flux of all beds against the stress meets zero [m s-1]; NaN without a line.

    A bed that has come to rest carries nothing in the weaker winds that the others still meet.
    """
    carried: dict[float, float] = {}
    for bed in beds:
        for trial in bed.hunt.trials if bed.hunt else ():
            if trial["phase"] == "fall":
                wind = trial["friction_velocity"]
                carried[wind] = carried.get(wind, 0.0) + trial["flux"] / len(beds)
    return flux_intercept(list(carried.items())) or Bracket(nan, nan)


def saltation() -> Iterator[Outcome]:
    """V36."""
    falling = [(slowed(size), seed) for size in DIAMETERS for seed in BEDS]
    actors = played([*falling, (from_rest(), SEED), *((steady(wind), SEED) for wind in WINDS)])
    values = [{name: m.value for name, m in actor.measurements.items()} for actor in actors]
    beds = len(BEDS)
    first, *others = [impact_threshold(actors[k * beds : (k + 1) * beds]) for k in range(len(DIAMETERS))]
    for size, found in zip(DIAMETERS[1:], others, strict=True):
        ends = [f"{line.middle:.3f} ({line.low:.3f} to {line.high:.3f})" for line in (found, first)]
        claim = f"impact threshold of {size:g} times the diameter, {ends[0]} m/s, over that of "
        claim += f"{1e3 * SMALLEST:g} mm, {ends[1]} m/s"
        yield relative(claim, found.middle / first.middle, sqrt(size), 0.1, "f32")
    fluid = values[len(falling)].get("fluid_threshold", np.nan)
    yield holds(
        f"the bed starts from rest at {fluid:.3f} m/s, transport ceases at {first.middle:.3f} m/s",
        bool(first.middle < fluid),
        "f32",
    )
    yield from steady_outcomes(values[len(falling) + 1 :], AIR * first.middle**2)


def steady_outcomes(values: list[dict[str, float]], threshold: float) -> Iterator[Outcome]:
    """Flux against stress, and the stress that is left to the air, over that of the threshold [Pa]."""
    flux = np.array([found.get("flux", np.nan) for found in values])
    stress = AIR * np.array(WINDS) ** 2
    correlation = float(np.corrcoef(stress, flux)[0, 1])
    yield below(
        "flux against stress: share of its variance off a straight line", 1.0 - correlation**2, 0.05, "f32"
    )
    for wind, found in zip(WINDS, values, strict=True):
        left = found.get("bed_stress", np.nan)
        claim = f"stress of the air at the bed under u* = {wind:g} m/s over that of the threshold"
        yield relative(claim, left / threshold, 1.0, 0.2, "f32")
