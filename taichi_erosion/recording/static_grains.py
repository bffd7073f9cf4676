"""Grains at rest: the bulk of a recording, written only now and then."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.snapshot import Snapshot

REWRITE_INTERVAL = 20  # frames after which the resting grains are chosen and written anew [1]
CREEP = 0.02  # displacement of a resting grain that is not worth writing, over its radius [1]


@dataclass(frozen=True)
class StaticGrains:
    """Resting grains as they were last written."""

    ident: NDArray[np.int32]  # [k] rows of the GrainTable, ascending
    position: NDArray[np.float64]  # [k, 3] m
    age: int  # frames since

    @staticmethod
    def empty() -> "StaticGrains":
        """No grain at rest; due at once."""
        return StaticGrains(np.empty(0, dtype=np.int32), np.empty((0, 3)), REWRITE_INTERVAL)


def update_static_grains(
    before: StaticGrains, snapshot: Snapshot, moving_speed: float
) -> tuple[StaticGrains, bool]:
    """The resting grains at this snapshot, and whether they must be written.

    Every grain is static or mobile, never both. A grain becomes mobile as soon as it is faster than
    `moving_speed` [m s-1] or has crept CREEP radii, and static only every REWRITE_INTERVAL frames: a quiet
    heap costs next to nothing.
    """
    slow = np.linalg.norm(snapshot.velocity, axis=1) <= moving_speed
    if before.age + 1 >= REWRITE_INTERVAL:
        return StaticGrains(snapshot.ident[slow], snapshot.position[slow], 0), True
    rows = np.searchsorted(snapshot.ident, before.ident)
    crept = np.linalg.norm(snapshot.position[rows] - before.position, axis=1)
    stays = slow[rows] & (crept <= CREEP * snapshot.radius[rows])
    if stays.all():
        return StaticGrains(before.ident, before.position, before.age + 1), False
    return StaticGrains(before.ident[stays], snapshot.position[rows[stays]], before.age + 1), True


def is_static(grains: StaticGrains, snapshot: Snapshot) -> NDArray[np.bool_]:
    """Mask of the grains of the snapshot that are static."""
    return np.isin(snapshot.ident, grains.ident)
