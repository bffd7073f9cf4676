"""Small scenes of grains in a column of air: one grain, a regular bed, a bed that was poured."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup, AirSide
from taichi_erosion.core.setup import Coupling, GrainTable, PrimitiveTable, Setup
from taichi_erosion.verification.bench_setup import Touch, contact_table, sphere_setup, spheres

Floats = NDArray[np.float64]
Patch = tuple[float, float]  # m, periods downwind and across

GRAVITY = (0.0, 0.0, -9.81)  # m s-2


def still_air(faces: Floats, patch: Patch, density: float, viscosity: float) -> AirSetup:
    """A column of air at rest that nothing but grains can move; `viscosity` is dynamic [Pa s].

    Its floor is smooth and its lid without stress: what the air gains, grains have lost.
    """
    ends = {"z_low": AirSide("symmetry"), "z_high": AirSide("stress")}
    return AirSetup(
        cells=(1, 1, len(faces) - 1),
        low=(0.0, 0.0, float(faces[0])),
        high=(*patch, float(faces[-1])),
        faces_z=faces,
        sides={name: ends.get(name, AirSide("periodic")) for name in SIDES},
        density=density,
        viscosity=viscosity / density,
        time_step=1.0,
        model=AirModel(closure="none", advection="none", scheme="euler", exchange=True),
    )


def in_air(setup: Setup, air: AirSetup, coupling: Coupling, headroom: float) -> Setup:
    """The same grains in a periodic patch; they may rise `headroom` [m] above the lid."""
    low = (0.0, 0.0, air.faces_z[0] - headroom)
    high = (air.high[0], air.high[1], air.high[2] + headroom)
    return replace(
        setup, air=air, coupling=coupling, domain=(low, high), period=(air.high[0], air.high[1], 0.0)
    )


def grains_in_air(
    grains: GrainTable, air: AirSetup, time_step: float, touch: Touch, walls: PrimitiveTable | None = None
) -> Setup:
    """Grains without weight in a periodic patch of air."""
    setup = sphere_setup(grains, contact_table(touch, touch), time_step, walls)
    return in_air(setup, air, Coupling(look_steps=1), 1.0)


def regular_bed(diameter: float, density: float, void: float, cells: tuple[int, int, int]) -> GrainTable:
    """A face-centred cubic lattice of spheres from the origin that leaves `void` of its volume free."""
    edge = lattice_edge(diameter, void)
    base = edge * np.array([(0.25, 0.25, 0.25), (0.75, 0.75, 0.25), (0.25, 0.75, 0.75), (0.75, 0.25, 0.75)])
    corner = edge * np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1).reshape(-1, 1, 3)
    place = (corner + base).reshape(-1, 3)
    return spheres(place, 0.0, 0.0, diameter / 2.0, density * np.pi / 6.0 * diameter**3)


def lattice_edge(diameter: float, void: float) -> float:
    """Edge of a face-centred cubic cell, which holds four spheres [m]."""
    return float((4.0 * np.pi / 6.0 / (1.0 - void)) ** (1.0 / 3.0) * diameter)
