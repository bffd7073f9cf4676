"""V27: flow between plates, driven by a pressure gradient (Poiseuille) or by the upper plate (Couette).

    Poiseuille:  u = G z (H - z) / (2 nu),      Couette:  u = U z / H

Couette flow is linear, which the grid holds exactly. Poiseuille's parabola is found with an error of dz^2:
with half a cell to the wall the discrete solution lies above it by G dz^2 / (8 nu) everywhere. Plates normal
to y work through ghosts and explicit diffusion, plates normal to z through the implicit sweep; both are
tried. Replicas of one ensemble are Couette and Poiseuille flow on equal and on stretched cells.
"""

from collections.abc import Iterator

import numpy as np

from taichi_erosion.air.column import advance_columns
from taichi_erosion.air.observe import face_velocities
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.air_setup import AirModel, AirSetup, AirSide, both_faces, even_faces
from taichi_erosion.core.setup import Floats
from taichi_erosion.verification.air_bench import LAMINAR, STILL, aired, box, centres, order, sides
from taichi_erosion.verification.claim import Outcome, below

LAYERS = 32
GRIDS = (16, 32)
LONG = 1e6  # s: a step so long that one gives the steady state
STEADY_STEPS = 3
WALL, LID = AirSide("wall"), AirSide("wall", (1.0, 0.0, 0.0))
SIDEWAYS_LAYERS, SIDEWAYS_STEP, SIDEWAYS_STEPS = (
    16,
    0.4,
    1000,
)  # 1, dy^2 / nu, 1: 1.6 H^2 / nu, 16 decay times


def plates(layers: int, lid: AirSide, gradient: float, stretched: bool, model: AirModel = STILL) -> AirSetup:
    """A column of air between plates one metre apart."""
    faces = both_faces(0.0, 1.0, layers, 0.3 / layers) if stretched else even_faces(0.0, 1.0, layers)
    return box(
        (1, 1, layers),
        (1.0, 1.0, 1.0),
        faces_z=faces,
        sides=sides(z_low=WALL, z_high=lid),
        driving_gradient=(gradient, 0.0, 0.0),
        implicitness=1.0,
        time_step=LONG,
        model=model,
    )


def ensemble(layers: int) -> list[AirSetup]:
    """Couette flow, then Poiseuille flow with largest speed 1 m/s; each on equal, then on stretched cells."""
    flows = ((LID, 0.0), (WALL, -8.0))
    return [
        plates(layers, lid, gradient, stretched) for lid, gradient in flows for stretched in (False, True)
    ]


def exact(setups: list[AirSetup]) -> list[Floats]:
    """The flows of `ensemble` in closed form at the centres of the cells."""
    z = [centres(setup.faces_z) for setup in setups]
    return [z[0], z[1], 4.0 * z[2] * (1.0 - z[2]), 4.0 * z[3] * (1.0 - z[3])]


def errors(layers: int, whole_grid: bool) -> list[float]:
    """Largest error of the steady u(z) of every flow of `ensemble` [m s-1]."""
    setups = ensemble(layers)
    air = aired(setups)
    if whole_grid:
        advance_air(air, STEADY_STEPS)
    else:
        advance_columns(STEADY_STEPS, air)
    found = [face_velocities(air, replica)[0][0, 0, :] for replica in range(len(setups))]
    return [float(np.abs(u - want).max()) for u, want in zip(found, exact(setups), strict=True)]


def between_side_walls() -> float:
    """Largest error of Poiseuille flow between walls normal to y, over its maximum."""
    n = SIDEWAYS_LAYERS
    setup = box(
        (2, n, 2),
        (1.0, 1.0, 1.0),
        sides=sides(y_low=WALL, y_high=WALL),
        driving_gradient=(-8.0, 0.0, 0.0),
        time_step=SIDEWAYS_STEP / n**2,
        model=LAMINAR,
    )
    air = aired([setup])
    advance_air(air, SIDEWAYS_STEPS)
    y = centres(even_faces(0.0, 1.0, n))
    parabola = 4.0 * y * (1.0 - y) + 1.0 / n**2
    return float(np.abs(face_velocities(air, 0)[0][0, :, 0] - parabola).max())


def plane_flows() -> Iterator[Outcome]:
    """V27."""
    for words, whole_grid in (("grid", True), ("column", False)):
        even, stretched, parabola, _ = errors(LAYERS, whole_grid)
        yield below(f"Couette, {words}, equal cells: error over the lid's speed", even, 1e-9, "f64")
        yield below(f"Couette, {words}, stretched cells: error over the lid's speed", stretched, 1e-9, "f64")
        name = f"Poiseuille, {words}, {LAYERS} cells: error over the largest speed"
        yield below(name, parabola, 1.0 / LAYERS**2 * (1.0 + 1e-6), "f64")
    found = order([errors(layers, False)[3] for layers in GRIDS])
    yield Outcome("Poiseuille, stretched cells: order in space", found, 2.0, 0.15, "f64")
    name = "Poiseuille between side walls: off the discrete parabola, over the largest speed"
    yield below(name, between_side_walls(), 1e-5, "f64")
