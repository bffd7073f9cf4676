"""V25: the lid-driven cavity against the tables of Ghia, Ghia & Shin.

All Reynolds numbers run as one ensemble. The steady state is approached on a coarse grid, carried to the next
finer one and left to settle there: the slow turning of the core is over before the cells are small. The gates
are those of 128 x 128 cells: 0.01 at Re 100 and 400, 0.02 at 1000.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from taichi_erosion.air.observe import face_velocities, set_velocities
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.air_setup import AirSetup, AirSide
from taichi_erosion.core.setup import Floats
from taichi_erosion.verification.air_bench import aired, box, sides
from taichi_erosion.verification.claim import Outcome, below
from taichi_erosion.verification.reference import ghia

LIMITS = {100: 0.01, 400: 0.01, 1000: 0.02}  # of the lid's speed
STAGES = ((32, 60.0), (64, 12.0), (128, 4.0))  # cells along a side, and time spent there [side / lid speed]
COURANT = 1.0  # of the lid's speed; the scheme allows 1.7
VISCOUS = 0.5  # explicit diffusion along x: largest step over dx^2 / nu [1]

EXTRAPOLATE: Any = None  # fill value by which the interpolator goes on beyond the outermost points

Faces = tuple[Floats, Floats, Floats]


def cavity(reynolds: int, cells: int) -> AirSetup:
    """A square box one metre wide; the lid moves at 1 m/s."""
    wall = AirSide("wall")
    walls = sides(x_low=wall, x_high=wall, z_low=wall, z_high=AirSide("wall", (1.0, 0.0, 0.0)))
    viscosity = 1.0 / reynolds
    step = min(COURANT / cells, VISCOUS / (viscosity * cells**2))
    size = (1.0, 1.0 / cells, 1.0)
    return box((cells, 1, cells), size, sides=walls, viscosity=viscosity, time_step=step)


def refined(values: Floats, axis: int) -> Floats:
    """Face velocities of a grid [n + 1 or n, n or n + 1] on the one twice as fine; `axis` counts faces."""
    cells = values.shape[1 - axis]
    places = [
        np.linspace(0.0, 1.0, n) if k == axis else (np.arange(n) + 0.5) / n
        for k, n in enumerate(values.shape)
    ]
    finer = [2 * n - 1 if k == axis else 2 * cells for k, n in enumerate(values.shape)]
    wanted = [
        np.linspace(0.0, 1.0, n) if k == axis else (np.arange(n) + 0.5) / n for k, n in enumerate(finer)
    ]
    field = RegularGridInterpolator(places, values, bounds_error=False, fill_value=EXTRAPOLATE)
    return field(np.stack(np.meshgrid(*wanted, indexing="ij"), axis=-1))


def settled() -> list[Faces]:
    """Face velocities of all Reynolds numbers on the finest grid."""
    found: list[Faces] = []
    for cells, duration in STAGES:
        setups = [cavity(reynolds, cells) for reynolds in LIMITS]
        air = aired(setups)
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
    return np.interp(ghia.Y, centre, upright), np.interp(ghia.X, centre, level)


def lid_cavity() -> Iterator[Outcome]:
    """V25."""
    for (reynolds, limit), faces in zip(LIMITS.items(), settled(), strict=True):
        u, w = middle_lines(faces)
        off = np.concatenate([u - ghia.U[reynolds], w - ghia.V[reynolds]])
        name = f"cavity, Re = {reynolds}: velocities on the middle lines off Ghia's, over the lid's speed"
        yield below(name, off[np.isfinite(off)], limit, "f64")
