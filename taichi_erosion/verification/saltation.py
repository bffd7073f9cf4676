"""V36: sand of one material and several diameters starts, blows and comes to rest as saltation does.

Patches of a few hundred grains without adhesion, lift or gusts, all in one ensemble: two diameters whose
transport is slowed down until it ceases, one bed from rest, and four winds over the smallest grains. What is
asked for are the signatures that do not hang on a fitted number: the impact threshold goes with the root of
the diameter, lies below the wind that starts a bed from rest, the flux is linear in the stress, and grains
take from the air near the bed all but about the stress of the threshold (Owen).

Reference: Bagnold (1941), The Physics of Blown Sand; Owen (1964), J. Fluid Mech. 20, 225; Creyssels et al.
(2009), J. Fluid Mech. 625, 47; Duran, Andreotti & Claudin (2012), Phys. Fluids 24, 103306.
"""

from collections.abc import Iterator
from math import sqrt
from typing import Any

import numpy as np

from taichi_erosion.core.setup import Numerics
from taichi_erosion.measures.threshold import flux_intercept
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
    """Grains that blow while the wind falls."""
    order = {"transport": 0.36 * sqrt(size), "fall": 0.07, "spin_up": 0.4 * size, "fall_hold": 0.4 * size}
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


def played(scenes: list[Scene]) -> list[Actor]:
    """All scenes as one ensemble, to their ends."""
    setups = [build_setup(scene, SEED) for scene in scenes]
    sim = assemble(setups, laws(scenes[0]), Numerics())
    whole = Play(scenes, sim, [Actor(SEED) for _ in scenes])
    play(whole, [])
    return whole.actors


def saltation() -> Iterator[Outcome]:
    """V36."""
    actors = played([*map(slowed, DIAMETERS), from_rest(), *map(steady, WINDS)])
    sizes = len(DIAMETERS)
    values = [{name: m.value for name, m in actor.measurements.items()} for actor in actors]
    impact = np.array([found.get("impact_threshold", np.nan) for found in values[:sizes]])
    named = zip(DIAMETERS[1:], impact[1:] / impact[0], strict=True)
    for size, ratio in named:
        claim = f"impact threshold of {size:g} times the diameter over that of {1e3 * SMALLEST:g} mm"
        yield relative(claim, float(ratio), sqrt(size), 0.1, "f32")
    fluid = values[sizes].get("fluid_threshold", np.nan)
    yield holds(
        f"the bed starts from rest at {fluid:.3f} m/s, transport ceases at {impact[0]:.3f} m/s",
        bool(impact[0] < fluid),
        "f32",
    )
    yield from steady_outcomes(values[sizes + 1 :])


def steady_outcomes(values: list[dict[str, float]]) -> Iterator[Outcome]:
    """Flux against stress, and the stress that is left to the air."""
    flux = np.array([found.get("flux", np.nan) for found in values])
    stress = AIR * np.array(WINDS) ** 2
    correlation = float(np.corrcoef(stress, flux)[0, 1])
    yield below(
        "flux against stress: share of its variance off a straight line", 1.0 - correlation**2, 0.05, "f32"
    )
    line = flux_intercept(list(zip(WINDS, flux.tolist(), strict=True)))
    threshold = AIR * line.middle**2 if line is not None else np.nan
    for wind, found in zip(WINDS, values, strict=True):
        left = found.get("bed_stress", np.nan)
        claim = f"stress of the air at the bed under u* = {wind:g} m/s over that of the threshold"
        yield relative(claim, left / threshold, 1.0, 0.2, "f32")
