"""Which grains lie still: they fill most of a recording and need to be written only now and then."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.snapshot import Snapshot

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]
Mask = NDArray[np.bool_]

FRAMES_BETWEEN = 20  # frames after which the bed is written again and takes in what came to rest [1]
CREEP = 0.02  # displacement of a resting grain that is not worth a new bed, over its radius [1]


@dataclass(frozen=True)
class Bed:
    """Resting grains as they were last written."""

    ident: Integers  # [k] rows of the GrainTable, ascending
    position: Floats  # [k, 3] m
    age: int  # frames since

    @staticmethod
    def empty() -> "Bed":
        """No grain at rest; due at once."""
        return Bed(np.empty(0, dtype=np.int32), np.empty((0, 3)), FRAMES_BETWEEN)


def update_bed(bed: Bed, snapshot: Snapshot, moving_speed: float) -> tuple[Bed, bool]:
    """The bed at this snapshot, and whether it must be written.

    Every grain is in the bed or mobile, never both. A grain leaves the bed as soon as it is faster than
    `moving_speed` [m s-1] or has crept CREEP radii, and enters it only every FRAMES_BETWEEN frames: a quiet
    heap costs next to nothing.
    """
    slow = np.linalg.norm(snapshot.velocity, axis=1) <= moving_speed
    if bed.age + 1 >= FRAMES_BETWEEN:
        return Bed(snapshot.ident[slow], snapshot.position[slow], 0), True
    rows = np.searchsorted(snapshot.ident, bed.ident)
    crept = np.linalg.norm(snapshot.position[rows] - bed.position, axis=1)
    stays = slow[rows] & (crept <= CREEP * snapshot.radius[rows])
    if stays.all():
        return Bed(bed.ident, bed.position, bed.age + 1), False
    return Bed(bed.ident[stays], snapshot.position[rows[stays]], bed.age + 1), True


def lies_in(bed: Bed, snapshot: Snapshot) -> Mask:
    """Which grains of the snapshot the bed holds."""
    return np.isin(snapshot.ident, bed.ident)
