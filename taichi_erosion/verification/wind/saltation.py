"""V36: sand of one material and two diameters starts, blows and comes to rest as saltation does.

Patches of sand without adhesion, lift or gusts, all in one ensemble: four steady winds over each of two
diameters, and one bed at rest under winds that grow. Tested are the signatures that do not depend on
a fitted number: the flux is linear in the stress, grains take from the air near the bed all but about the
stress of the impact threshold (Owen), that threshold goes with the root of the diameter, and it lies below
the wind that starts a bed from rest.

The impact threshold u*_t is that of saturated transport, extrapolated to none. What vanishes there and is
known best is the stress that grains carry at the bed,

    tau_g = tau - rho u*_t^2,

with tau [Pa] that of the wind: its line meets zero within a few percent, where that of the flux, whose means
over seconds scatter by a tenth, leaves tau_t open. A wind that falls until the last grain rests needs more
patience than a check has: where it is 5 to 15 percent too weak one grain hops on for a second or two
(`reference.hopping.time_to_rest`), and a wind that falls faster reads too low a threshold.

What the air keeps at the bed is judged by a threshold in which no grain is ejected or caught: that of one
grain that hops by a measured law of bounces (`reference.hopping`) in the wind over the bed at rest
(`bed_wind`). So is the way in which the threshold goes with the diameter: with its root where the bed
stays as rough, faster where, as here, coarser grains stick out of the viscous sublayer. Weak winds blow over
larger patches, that some ten grains fly in each: of one or two, all may come to rest by chance, or one may
gather the whole momentum of the wind high above the bed.

A bed of sand is smooth to a wind whose viscous sublayer covers its grains, and rough to one of which they
stick out: at u* d / nu = 3 the wind differs little from that over a plane, at 10 it is slower by some u*.
The wind over a bed at rest is that of the simulator, a column that the bed's own grains slow down.

What these limits do not test: a ratio of thresholds within 10 % of the root of two holds for every power of
the diameter between 0.35 and 0.64. A flux that goes with any power between 1/2 and 2 of the excess stress, or
with u*^3, leaves less than 5 % of its variance off a line through these four winds. The threshold from rest
is only required to exceed the impact threshold. A stress within 20 % holds for every threshold within 10 %.
No number is compared with a measurement; `docs/threshold.md` does that.

Reference: Bagnold (1941), The Physics of Blown Sand; Owen (1964), J. Fluid Mech. 20, 225; Creyssels et al.
(2009), J. Fluid Mech. 625, 47 (extrapolation); Duran, Andreotti & Claudin (2012), Phys. Fluids 24, 103306;
Pahtz & Duran (2018), Phys. Rev. Fluids 3, 104302 (stress of the grains).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import exp, isnan, log, nan, sqrt
from typing import Any

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.threshold import Bracket, vanishing_wind
from taichi_erosion.scene import Scene, parse_scene
from taichi_erosion.simulation import Simulation, snapshot
from taichi_erosion.simulation.wind_driver import air_profile, spin_up_wind
from taichi_erosion.verification.claim import Outcome, below, holds, relative
from taichi_erosion.verification.reference.hopping import CENTRE, KARMAN, Sand, WindProfile, hopping_threshold
from taichi_erosion.verification.small_scenes import run_to_end

DROPS = 2000  # places on a bed where a grain is laid down
SEED = 1


def winds_over_beds(scenes: Sequence[Scene], sands: Sequence[Sand]) -> list[Callable[[float], WindProfile]]:
    """The wind of a friction velocity [m s-1] over the bed that each scene comes to."""
    sim = run_to_end(scenes, SEED).sim
    return [bed_wind(sim, k, sand.diameter) for k, sand in enumerate(sands)]


def roughness(blow: WindProfile, friction: float, height: float) -> float:
    """Roughness length z0 [m] of u = (u* / kappa) ln(z / z0), as seen from a height [m] far above the bed."""
    return height * exp(-KARMAN * blow(height) / friction)


def landing_heights(bed: Snapshot, extent: Floats, diameter: float) -> Floats:
    """Heights of the centre of a grain laid down at random places of a periodic bed [m].

    `extent` [2] and `diameter` in metres.
    """
    places = np.random.default_rng(SEED).uniform(size=(DROPS, 2)) * extent
    apart = bed.position[:, :2] - places[:, None]
    apart -= extent * np.round(apart / extent)
    reach = (bed.radius + 0.5 * diameter) ** 2 - (apart**2).sum(axis=2)
    touching = bed.position[:, 2] + np.sqrt(np.maximum(reach, 0.0))
    return np.where(reach > 0.0, touching, 0.5 * diameter).max(axis=1)


def bed_wind(sim: Simulation, replica: int, diameter: float) -> Callable[[float], WindProfile]:
    """The steady wind of a friction velocity over a bed at rest, by the height over where it begins.

    It begins `CENTRE` diameters below where centres of grains land in the mean, as over a flat bed; above
    the lid it is logarithmic.
    """
    extent = np.array(sim.setups[replica].period[:2])
    landing = float(landing_heights(snapshot(sim, replica), extent, diameter).mean())

    def over(friction: float) -> WindProfile:
        spin_up_wind(sim, replica, friction)
        profile = air_profile(sim, replica)
        height = 0.5 * (profile.face[1:] + profile.face[:-1]) - landing + CENTRE * diameter
        speed = profile.velocity[:, 0]

        def blow(z: float) -> float:
            beyond = friction / KARMAN * log(max(z / height[-1], 1.0))
            return float(np.interp(z, height, speed)) + beyond

        return blow

    return over


SMALLEST = 0.25e-3  # m
DIAMETERS = (1.0, 2.0)  # over the smallest [1]
DENSITY, AIR = 2650.0, 1.225  # kg m-3
REST_WIND = 0.2  # u* over the smallest grains from which on a bed at rest is tried [m s-1]
GRAINS = 4.0  # on the square of a diameter: a bed three and a half diameters deep
MODULUS = 1e5  # Pa, of the smallest; with the diameter: as soft for all. About k = 1e4 m g / d
SLEEP = 1e-3  # s at rest after which deep grains of the smallest are held
SETTLE = {"name": "settle", "duration_max": 0.15, "duration_min": 0.02, "rest_energy": 1e-3}
REST = SETTLE | {"duration_max": 0.3, "rest_energy": 1e-5, "rest_contact_share": 0.5}
START = {"name": "start", "until": "time", "duration_max": 0.1, "friction_velocity": 0.6}
ADJUSTMENTS, ADJUST = 4, 0.1  # times that the air finds its steady profile, and s between them
BLOW = 2.0  # s over which the steady flux is averaged
MEASURED = ("flux", "bed_stress", "grain_stress")


@dataclass(frozen=True)
class Patch:
    """A steady wind over the smallest grains, and the patch of which it lifts some ten grains."""

    wind: float  # u* [m s-1]
    length: float  # diameters
    width: float  # diameters


STEADY = (Patch(0.28, 28.0, 16.0), Patch(0.36, 28.0, 8.0), Patch(0.44, 16.0, 8.0), Patch(0.52, 16.0, 8.0))
RESTING = Patch(0.0, 16.0, 8.0)


def sand(size: float, patch: Patch, stages: list[dict[str, Any]], more: dict[str, Any]) -> Scene:
    """A periodic patch of sand under wind; times and winds of its stages are for the smallest grains."""
    diameter = size * SMALLEST
    sizes = {"median": diameter, "low": 0.8 * diameter, "high": 1.25 * diameter}
    solid = {"density": DENSITY, "shear_modulus": MODULUS * size, "poisson_ratio": 0.25}
    softening = {"softening": {"rule": "bond_number", "true_modulus": 3e10}}
    column = {
        "height_d": 200.0,
        "growth": 1.2,
        "cell_d": 0.25,
        "look_steps": 20,
        "sleep_after": SLEEP * sqrt(size),
    }
    extent = {"length_d": patch.length, "width_d": patch.width, "density": AIR, "drag": "two_limits"}
    table = {
        "scene": {"kind": "saltation"},
        "run": {"time_step_fraction": 0.25, "check_interval": 5e-3, "overlap_limit": 0.9},
        "grains": {
            "count": int(GRAINS * patch.length * patch.width),
            "material": "sand",
            "size": {"law": "lognormal", "sigma_log": 0.1, **sizes},
        },
        "materials": {"sand": solid | softening},
        "contact": {"sand-sand": {"restitution": 0.7, "friction_sliding": 0.5}},
        "geometry": {"ground": {"shape": "plane", "material": "sand"}},
        "wind": column | extent,
        "fill": {"law": "layers", "pitch_d": 1.32, "jitter_d": 0.03, "first_height_d": 1.0},
        "stages": [scaled(stage, size) for stage in stages],
    }
    return parse_scene(table | more)


def scaled(stage: dict[str, Any], size: float) -> dict[str, Any]:
    """The stage for grains that are `size` times as large: winds and the times of hops go with the root."""
    scales = ("duration_max", "duration_min", "friction_velocity")
    return stage | {name: sqrt(size) * stage[name] for name in scales if name in stage}


def from_rest() -> Scene:
    """A bed at rest under winds that grow."""
    order = {"first": REST_WIND, "levels": 1}
    search = {"name": "hunt", "until": "threshold", "duration_max": 8.0}
    more = {"threshold": order, "measure": {"fluid_threshold": {}}}
    return sand(1.0, RESTING, [REST, search], more)


def at_rest(size: float) -> Scene:
    """A bed that comes to rest."""
    return sand(size, RESTING, [REST], {"measure": {}})


def steady(size: float, patch: Patch) -> Scene:
    """Grains that blow in one wind."""
    change = {"until": "time", "friction_velocity": patch.wind}
    adjust = [change | {"name": f"adjust_{k}", "duration_max": ADJUST} for k in range(ADJUSTMENTS)]
    stages = [SETTLE, START, *adjust, change | {"name": "blow", "duration_max": BLOW}]
    return sand(size, patch, stages, {"measure": {name: {"every": 1e-2} for name in MEASURED}})


def measured(scenes: Sequence[Scene]) -> list[dict[str, float]]:
    """Final measurements by name of every scene, run as one ensemble."""
    replicas = run_to_end(scenes, SEED).states
    return [{name: m.value for name, m in replica.measurements.items()} for replica in replicas]


def of_winds(values: Sequence[dict[str, float]], name: str) -> Any:
    """One measure of all steady winds; NaN where there is none."""
    return np.array([found.get(name, nan) for found in values])


def stresses(values: Sequence[dict[str, float]]) -> Any:
    """Stress of air and grains together at the bed, wind by wind [Pa].

    In the mean over many seconds that of the lid; in between the air above stores momentum and gives it back.
    """
    return of_winds(values, "bed_stress") + of_winds(values, "grain_stress")


def vanishing(values: Sequence[dict[str, float]], name: str) -> Bracket:
    """Wind in which a measure of saturated transport, extrapolated along a line, vanishes [m s-1]."""
    left, borne, measure = (of_winds(values, one) for one in ("bed_stress", "grain_stress", name))
    return vanishing_wind(left, borne, measure, AIR) or Bracket(nan, nan)


def ends(line: Bracket) -> str:
    """A threshold and its standard error, in words."""
    return "no wind" if isnan(line.middle) else f"{line.middle:.3f} ({line.low:.3f} to {line.high:.3f}) m/s"


def saltation() -> Iterator[Outcome]:
    """V36."""
    scenes = [steady(size, patch) for size in DIAMETERS for patch in STEADY]
    *blown, rest = measured([*scenes, from_rest()])
    small, large = blown[: len(STEADY)], blown[len(STEADY) :]
    first, second = vanishing(small, "grain_stress"), vanishing(large, "grain_stress")
    claim = f"impact threshold of {DIAMETERS[1]:g} times the diameter, {ends(second)}, over that of "
    claim += f"{1e3 * SMALLEST:g} mm, {ends(first)}"
    ratio = second.middle / first.middle
    yield relative(claim, ratio, sqrt(DIAMETERS[1]), 0.1, "f32")
    sands = [Sand(size * SMALLEST, DENSITY, AIR) for size in DIAMETERS]
    winds = winds_over_beds([at_rest(size) for size in DIAMETERS], sands)
    alone = [hopping_threshold(sand, over) for sand, over in zip(sands, winds, strict=True)]
    claim = "the same over that of winds in which one grain goes on over either bed"
    yield relative(claim, ratio / (alone[1] / alone[0]), 1.0, 0.1, "f32")
    fluid = rest.get("fluid_threshold", nan)
    yield holds(
        f"the bed starts from rest at {fluid:.3f} m/s, transport vanishes at {first.middle:.3f} m/s",
        bool(first.middle < fluid),
        "f32",
    )
    for size, values, hopping in zip(DIAMETERS, (small, large), alone, strict=True):
        yield from steady_outcomes(size, values, hopping)


def steady_outcomes(size: float, values: Sequence[dict[str, float]], hopping: float) -> Iterator[Outcome]:
    """Flux against stress, and the stress left to the air over that of u* = `hopping` [m s-1]."""
    grain = f"{1e3 * size * SMALLEST:g} mm"
    correlation = float(np.corrcoef(stresses(values), of_winds(values, "flux"))[0, 1])
    yield below(
        f"flux of {grain} against stress, a line that meets zero at {ends(vanishing(values, 'flux'))}: share "
        "of its variance off that line",
        1.0 - correlation**2,
        0.05,
        "f32",
    )
    for patch, left in zip(STEADY, of_winds(values, "bed_stress"), strict=True):
        claim = (
            f"stress of the air at the bed of {grain} under u* = {sqrt(size) * patch.wind:.3g} m/s over that "
        )
        claim += f"of {hopping:.3f} m/s, in which one grain goes on"
        yield relative(claim, left / (AIR * hopping**2), 1.0, 0.2, "f32")
