"""V29: air is neither made nor lost, whatever the grid; the pressure solve costs the same on every grid.

A gusty wind blows through a box with rough floor, slip lid and walls beside. What remains of div u in a cell
is the tolerance of the solve; what enters leaves. The number of iterations is counted for a random flow that
is projected on grids from 8 x 8 to 64 x 64 columns, with cells stretched by 100 from floor to lid.
"""

from collections.abc import Iterator

import numpy as np

from taichi_erosion.air.grid import Air
from taichi_erosion.air.readback import face_velocities
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.air_setup import AirModel, AirSetup, AirSide, InletTurbulence, stretched_faces
from taichi_erosion.core.setup import Floats
from taichi_erosion.verification.air.boxes import aired, box, sides
from taichi_erosion.verification.claim import Outcome, below, holds

SPEED = 5.0  # m s-1
CELLS, SIZE, LOWEST = (24, 8, 16), (1.2, 0.4, 0.4), 4e-3  # 1, m, m
STEPS, STEP = 20, 5e-3  # 1, s
TIGHT = 1e-13  # of a cell in a step: tolerance for the balance of the whole box [1]
GRIDS = (8, 16, 32, 64)  # columns along x and along y
LAYERS = 16
MORE = 2  # iterations that the finest grid may take more than the coarsest


def gusty_box() -> AirSetup:
    """Wind with gusts through a box."""
    rough, wall = AirSide("rough", roughness=1e-4), AirSide("wall")
    around = sides(
        x_low=AirSide("inlet", (SPEED, 0.0, 0.0)),
        x_high=AirSide("outlet"),
        y_low=wall,
        y_high=wall,
        z_low=rough,
    )
    return box(
        CELLS,
        SIZE,
        faces_z=stretched_faces(0.0, SIZE[2], CELLS[2], LOWEST),
        sides=around,
        density=1.2,
        viscosity=1.5e-5,
        time_step=STEP,
        model=AirModel(closure="smagorinsky"),
        turbulence=InletTurbulence((0.5, 0.3, 0.3), 0.1, seed=1),
        start=np.full(CELLS[2], SPEED),
    )


def divergence(air: Air, setup: AirSetup, replica: int) -> Floats:
    """Largest |div u| of a cell times its length over the wind [1]."""
    u, v, w = face_velocities(air, replica)
    dx, dy = setup.high[0] / setup.cells[0], setup.high[1] / setup.cells[1]
    total = np.diff(u, axis=0) / dx + np.diff(v, axis=1) / dy
    return (total + np.diff(w, axis=2) / np.diff(setup.faces_z)) * dx / SPEED


def imbalance(air: Air, setup: AirSetup) -> float:
    """Air that enters less air that leaves, over the former [1]."""
    u = face_velocities(air, 0)[0]
    heights = np.diff(setup.faces_z)
    entering, leaving = (float((u[place] * heights).sum()) for place in (0, -1))
    return (entering - leaving) / entering


def random_flow(columns: int) -> AirSetup:
    """A periodic box whose first flow does not conserve air at all."""
    start = np.random.default_rng(columns).normal(size=(3, columns, columns, LAYERS))
    return box(
        (columns, columns, LAYERS),
        (1.0, 1.0, 1.0),
        faces_z=stretched_faces(0.0, 1.0, LAYERS, 2e-3),
        time_step=0.1 / columns,
        viscosity=1e-3,
        model=AirModel(advection="none", scheme="euler"),
        start=start,
    )


def iterations() -> list[int]:
    """Iterations of one pressure solve on every grid."""
    return [advance_air(aired([random_flow(columns)]), 1) for columns in GRIDS]


def mass() -> Iterator[Outcome]:
    """V29."""
    setup = gusty_box()
    air = aired([setup])
    advance_air(air, STEPS)
    yield below("gusty box: |div u| dx / U", divergence(air, setup, 0), 1e-6, "f64")
    advance_air(air, 1, tolerance=TIGHT)
    yield below("gusty box, tight solve: air in less air out, relative", imbalance(air, setup), 1e-10, "f64")
    again = []
    for threads in (1, 0):
        air = aired([setup], threads)
        advance_air(air, STEPS)
        again.append(face_velocities(air, 0)[0])
    yield holds("gusty box: one thread and all give the same bits", np.array_equal(*again), "f64")
    counts = iterations()
    words = ", ".join(f"{count} on {n} x {n}" for count, n in zip(counts, GRIDS, strict=True))
    more = float(max(counts[-1] - counts[0], 0))
    yield Outcome(f"pressure solve ({words}): iterations more on the finest grid", more, 0.0, MORE, "f64")
