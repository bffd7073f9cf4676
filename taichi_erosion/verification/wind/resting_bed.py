"""The wind over a bed of grains at rest, and where a grain lands on it.

A bed of sand is smooth to a wind whose viscous sublayer covers its grains, and rough to one of which they
stick out: at u* d / nu = 3 the wind differs little from that over a plane, at 10 it is slower by some u*.
The air is that of the simulator, a column that the bed's own grains slow down; no grain flies in it.
"""

from collections.abc import Callable, Sequence
from math import exp, log

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.scene import Scene
from taichi_erosion.simulation import Simulation, snapshot
from taichi_erosion.simulation.wind_driver import air_profile, spin_up_wind
from taichi_erosion.verification.reference.hopping import CENTRE, KARMAN, Blow, Sand
from taichi_erosion.verification.small_scenes import played_out

DROPS = 2000  # places on a bed where a grain is laid down
SEED = 1


def winds_over_beds(scenes: Sequence[Scene], sands: Sequence[Sand]) -> list[Callable[[float], Blow]]:
    """The wind of a friction velocity [m s-1] over the bed that each scene comes to."""
    sim = played_out(scenes, SEED).sim
    return [bed_wind(sim, k, sand.diameter) for k, sand in enumerate(sands)]


def roughness(blow: Blow, friction: float, height: float) -> float:
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


def bed_wind(sim: Simulation, replica: int, diameter: float) -> Callable[[float], Blow]:
    """The steady wind of a friction velocity over a bed at rest, by the height over where it begins.

    It begins `CENTRE` diameters below where centres of grains land in the mean, as over a flat bed; above
    the lid it is logarithmic.
    """
    extent = np.array(sim.setups[replica].period[:2])
    landing = float(landing_heights(snapshot(sim, replica), extent, diameter).mean())

    def over(friction: float) -> Blow:
        spin_up_wind(sim, replica, friction)
        profile = air_profile(sim, replica)
        height = 0.5 * (profile.face[1:] + profile.face[:-1]) - landing + CENTRE * diameter
        speed = profile.velocity[:, 0]

        def blow(z: float) -> float:
            beyond = friction / KARMAN * log(max(z / height[-1], 1.0))
            return float(np.interp(z, height, speed)) + beyond

        return blow

    return over
