"""Small setups of grains in air for the tests of coupling."""

from dataclasses import replace
from typing import Any

import numpy as np
from grain_worlds import NONE, PLATE, RADIUS, grains, setup

from taichi_erosion.core.air_setup import AirModel, AirSetup, AirSide, SideKind, bed_faces
from taichi_erosion.core.setup import Coupling, Floats, Setup
from taichi_erosion.simulation import Simulation, advance, spin_up_wind
from tests.verification.small_scenes import in_air, sides, still_air

SIDE = 7e-3  # m, period of the patch
ACROSS = 6  # grains along a period
LID, HEADROOM = 20e-3, 0.1  # m
SURFACE = 3e-3  # m
DENSITY, VISCOSITY = 1.225, 1.46e-5  # kg m-3, m2 s-1


def air(faces: Floats, floor: SideKind = "wall", **rest: Any) -> AirSetup:
    still = still_air(faces, (SIDE, SIDE), DENSITY, VISCOSITY * DENSITY)
    ends = sides(z_low=AirSide(floor), z_high=AirSide("stress"))
    model = AirModel("mixing_length", "none", "euler", exchange=True)
    return replace(still, **{"sides": ends, "model": model, "time_step": 1e-4} | rest)


def bed(seed: int, layers: int = 3, speed: float = 0.05) -> Setup:
    """Loose layers of grains, of random velocities [m s-1], that fall on a plate under wind."""
    rng = np.random.default_rng(seed)
    across = (np.arange(ACROSS) + 0.5) * SIDE / ACROSS
    x, y = (grid.ravel() for grid in np.meshgrid(across, across, indexing="ij"))
    rows = [np.column_stack([x, y, np.full(ACROSS**2, (1.0 + 2.1 * k) * RADIUS)]) for k in range(layers)]
    place = np.concatenate(rows) + rng.uniform(-0.04, 0.04, (ACROSS**2 * layers, 3)) * RADIUS
    table = setup(grains(place, speed * rng.standard_normal(place.shape)), PLATE)
    over = air(bed_faces(0.0, SURFACE + 2.0 * RADIUS, LID, 0.5 * RADIUS, 1.3))
    return in_air(table, over, Coupling(look_steps=5, surface=SURFACE, seed=seed), HEADROOM)


def weightless(place: Any, over: AirSetup, look_steps: int) -> Setup:
    """Grains at rest without weight, far from each other and from walls, in a column of air.

    No plate lies under them: one grain is centred on the floor of the air, where a plate would have no
    direction to push it.
    """
    table = setup(grains(place), NONE, gravity=(0.0, 0.0, 0.0))
    return in_air(table, over, Coupling(look_steps=look_steps), HEADROOM)


def set_in(sim: Simulation, wind: float, begins: float, ends: float) -> None:
    """Run all replicas without wind, then from a time [s] to another under a friction velocity [m s-1]."""
    count = len(sim.setups)
    advance(sim, [begins] * count)
    for r in range(count):
        spin_up_wind(sim, r, wind)
    advance(sim, [ends] * count)
