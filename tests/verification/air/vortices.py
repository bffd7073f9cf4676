"""V25, V26: the lid-driven cavity and decaying vortices.

V25. The cavity against the tables of Ghia, Ghia & Shin. The steady state is approached on a coarse grid and
carried to the next finer one: the slow turning of the core is over before the cells are small. The gates are
those of 128 x 128 cells.

V26. Decaying vortices of Taylor and Green, in a vertical plane between slip walls.

    u = sin x cos z e^(-2 nu t),    w = -cos x sin z e^(-2 nu t)

Space: grids are refined together with the step, whose own error is of the same order. Time: on one grid, each
step against one eight times shorter than the shortest; these errors are 1e-8 to 1e-7 of the velocity, so the
pressure is found to 1e-12. Without viscosity, kinetic energy must not grow: the central scheme gives none and
three stages take a little.
"""

from collections.abc import Iterator

import numpy as np
from scipy.interpolate import make_interp_spline

from taichi_erosion.air.pressure.conjugate_gradient import TOLERANCE
from taichi_erosion.air.readback import face_velocities, set_velocities
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.air_setup import AirSetup, AirSide, equal_cell_faces, faces_fine_at_both_ends
from taichi_erosion.core.setup import Floats
from taichi_erosion.verification.claims import Outcome, below
from tests.verification.reference import published
from tests.verification.small_scenes import air_of, box, centres, order, sides

LIMITS = {100: 0.01, 400: 0.01, 1000: 0.02}  # of the lid's speed
STAGES = ((32, 60.0), (64, 12.0), (128, 4.0))  # cells along a side, and time spent there [side / lid speed]
LID_COURANT = 1.0  # of the lid's speed; the scheme allows 1.7
VISCOUS = 0.5  # explicit diffusion along x: largest step over dx^2 / nu [1]

Faces = tuple[Floats, Floats, Floats]


def cavity(reynolds: int, cells: int) -> AirSetup:
    """A square box one metre wide; the lid moves at 1 m/s."""
    wall = AirSide("wall")
    walls = sides(x_low=wall, x_high=wall, z_low=wall, z_high=AirSide("wall", (1.0, 0.0, 0.0)))
    viscosity = 1.0 / reynolds
    step = min(LID_COURANT / cells, VISCOUS / (viscosity * cells**2))
    return box((cells, 1, cells), (1.0, 1.0 / cells, 1.0), sides=walls, viscosity=viscosity, time_step=step)


def refined(values: Floats, axis: int) -> Floats:
    """Face velocities of a grid [n + 1 or n, n or n + 1] on the one twice as fine; `axis` counts faces."""
    for k, count in enumerate(values.shape):
        fine = 2 * count - 1 if k == axis else 2 * count
        old, new = (np.linspace(0, 1, n) if k == axis else (np.arange(n) + 0.5) / n for n in (count, fine))
        values = make_interp_spline(old, values, k=1, axis=k)(new)
    return values


def settled() -> list[Faces]:
    """Face velocities of all Reynolds numbers on the finest grid."""
    found: list[Faces] = []
    for cells, duration in STAGES:
        setups = [cavity(reynolds, cells) for reynolds in LIMITS]
        air = air_of(setups)
        for replica, (u, _, w) in enumerate(found):
            across = np.zeros((cells, 2, cells))
            finer = refined(u[:, 0, :], 0)[:, None, :], across, refined(w[:, 0, :], 1)[:, None, :]
            set_velocities(air, replica, finer)
        advance_air(air, round(duration / min(setup.time_step for setup in setups)))
        found = [face_velocities(air, replica) for replica in range(len(setups))]
    return found


def middle_lines(faces: Faces) -> tuple[Floats, Floats]:
    """Velocities: u on the vertical middle line at Ghia's heights, w on the horizontal one at his places."""
    u, _, w = faces
    cells = u.shape[2]
    centre = np.concatenate([[0.0], (np.arange(cells) + 0.5) / cells, [1.0]])
    upright = np.concatenate([[0.0], u[cells // 2, 0], [1.0]])
    level = np.concatenate([[0.0], w[:, 0, cells // 2], [0.0]])
    return np.interp(published.Y, centre, upright), np.interp(published.X, centre, level)


def lid_cavity() -> Iterator[Outcome]:
    """V25."""
    for (reynolds, limit), faces in zip(LIMITS.items(), settled(), strict=True):
        u, w = middle_lines(faces)
        off = np.concatenate([u - published.U[reynolds], w - published.V[reynolds]])
        name = f"cavity, Re = {reynolds}: velocities on the middle lines off Ghia's, over the lid's speed"
        yield below(name, off[np.isfinite(off)], limit, "f64")


SIDE = np.pi  # m, height of the box; it is twice as long
VISCOSITY = 0.1  # m2 s-1
DURATION = 0.5  # s
GRIDS = (8, 16, 32)
SQUEEZED = 0.5  # finest cell of the stretched grid over the mean one [1]
TIME_GRID, STEPS = 16, (4, 8, 16)
EXACT = 1e-12  # air that may appear in a cell in one step over its volume, for errors of the step [1]
REFINED = 8  # steps of the reference for one of the finest series
ENERGY_STEPS, COURANT = 120, 0.8


def vortices(cells: int, steps: int, viscosity: float, squeezed: float = 1.0) -> AirSetup:
    even = equal_cell_faces(0.0, SIDE, cells)
    faces = even if squeezed == 1.0 else faces_fine_at_both_ends(0.0, SIDE, cells, squeezed * SIDE / cells)
    x = SIDE / cells * np.arange(2 * cells)
    start = np.zeros((3, 2 * cells, 1, cells))
    start[0, :, 0, :] = np.sin(x)[:, None] * np.cos(centres(faces))
    start[2, :, 0, :] = -np.cos(x + 0.5 * SIDE / cells)[:, None] * np.sin(faces[:-1])
    shape, extents, step = (2 * cells, 1, cells), (2.0 * SIDE, 1.0, SIDE), DURATION / steps
    return box(shape, extents, faces_z=faces, viscosity=viscosity, time_step=step, start=start)


def horizontal(setup: AirSetup, steps: int, tolerance: float = TOLERANCE) -> Floats:
    """Horizontal velocity after so many steps [m s-1]."""
    air = air_of([setup])
    advance_air(air, steps, tolerance)
    return face_velocities(air, 0)[0][:-1, 0, :]


def space_error(cells: int, squeezed: float) -> float:
    """Root mean square error of u over that of u [1]."""
    setup = vortices(cells, cells, VISCOSITY, squeezed)
    assert setup.start is not None
    exact = setup.start[0, :, 0, :] * np.exp(-2.0 * VISCOSITY * DURATION)
    share = np.diff(setup.faces_z)
    return float(np.sqrt((share * (horizontal(setup, cells) - exact) ** 2).sum() / (share * exact**2).sum()))


def energy_rise() -> float:
    """Largest rise of the kinetic energy from step to step over the first energy, without viscosity."""
    cells = GRIDS[-1]
    air = air_of([vortices(cells, round(DURATION / (COURANT * SIDE / cells)), 0.0)])
    sums = []
    for _ in range(ENERGY_STEPS + 1):
        sums.append(sum(float((v[: 2 * cells, :, :cells] ** 2).sum()) for v in face_velocities(air, 0)))
        advance_air(air, 1)
    return float(np.diff(sums).max() / sums[0])


def taylor_green() -> Iterator[Outcome]:
    """V26: orders of at least 1.9, in time against short steps; no growth of energy beyond rounding."""
    counts = (*STEPS, STEPS[-1] * REFINED)
    *flows, reference = (horizontal(vortices(TIME_GRID, n, VISCOSITY), n, EXACT) for n in counts)
    for words, errors in (
        (", equal cells: order in space", [space_error(cells, 1.0) for cells in GRIDS]),
        (", stretched cells: order in space", [space_error(cells, SQUEEZED) for cells in GRIDS]),
        (": order in time", [float(np.sqrt(((u - reference) ** 2).mean())) for u in flows]),
    ):
        found = order(errors)
        name = f"Taylor-Green{words} {found:.2f} falls short of 1.9 by"
        yield Outcome(name, max(1.9 - found, 0.0), 0.0, 0.0, "f64")
    rise = max(energy_rise(), 0.0)
    yield below("Taylor-Green at nu = 0: largest rise of kinetic energy in a step", rise, 1e-12, "f64")
