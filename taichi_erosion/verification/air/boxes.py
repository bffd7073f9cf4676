"""Boxes of air for the ladder: sides by kind, a device, and errors of what comes out."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichi_erosion.air.grid import Air, allocate_air
from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup, AirSide, even_faces
from taichi_erosion.core.device import start_device
from taichi_erosion.core.setup import Floats, Numerics

LAMINAR = AirModel()
STILL = AirModel(advection="none", scheme="euler")  # nothing is carried: parallel flow, any step


def sides(**given: AirSide) -> dict[str, AirSide]:
    """The named sides, symmetry along z, and periods elsewhere."""
    flat = {name: AirSide("symmetry") for name in ("z_low", "z_high")}
    return {name: AirSide() for name in SIDES} | flat | given


def box(cells: tuple[int, int, int], size: tuple[float, float, float], **words: Any) -> AirSetup:
    """A box of air from the origin, of density 1 and equal cells unless stated otherwise."""
    usual: dict[str, Any] = {
        "faces_z": even_faces(0.0, size[2], cells[2]),
        "sides": sides(),
        "density": 1.0,
        "viscosity": 1.0,
        "time_step": 1.0,
        "model": LAMINAR,
        "implicitness": 0.5,
    }
    return AirSetup(cells=cells, low=(0.0, 0.0, 0.0), high=size, **usual | words)


def aired(setups: Sequence[AirSetup], threads: int = 0) -> Air:
    """The boxes on the CPU."""
    start_device(Numerics(threads=threads))
    return allocate_air(setups)


def centres(faces: Floats) -> Floats:
    """Middles between faces."""
    return 0.5 * (faces[1:] + faces[:-1])


def order(errors: Sequence[float], refinement: float = 2.0) -> float:
    """Observed order of convergence from the last two of a series of errors [1]."""
    return float(np.log(errors[-2] / errors[-1]) / np.log(refinement))
