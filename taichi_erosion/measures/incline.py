"""Sliding angle: the inclination at which grains on a slowly tilted plate let go.

Reference: Hao et al. (2022), figure 3: friction coefficients from an inclinometer, mu = tan(angle).
"""

from collections.abc import Sequence
from math import degrees, sqrt

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.heap import defect, grain_diameter
from taichi_erosion.measures.result import Measurement, no_measurement

LET_GO_SHARE = 0.5  # of a diameter: elastic settling stays far below, a moving grain is past it at once [1]


def sliding_angle(
    frames: Sequence[Snapshot], tilts: Sequence[float], share: float = LET_GO_SHARE
) -> Measurement:
    """Inclination at which the median grain has moved by `share` of a diameter [deg].

    `tilts` [rad] is the inclination at each frame, never decreasing; displacements count from the first
    frame; between frames they are interpolated linearly. `sd` is that of a uniform distribution over the
    interval between the two frames. The angle lags behind the true onset by the turn made while the grain
    covers that distance: tilt slowly. `details`: displacement [d] at each frame and friction = tan(angle).
    """
    name = "sliding_angle"
    if len(frames) != len(tilts):
        raise ValueError(f"one tilt per frame is needed, got {len(tilts)} for {len(frames)} frames")
    reasons = [reason for frame in frames if (reason := defect(frame))]
    if reasons or not frames:
        return no_measurement(name, "deg", reasons[0] if reasons else "no frames")
    moved = [median_displacement(frames[0], frame) / grain_diameter(frames[0]) for frame in frames]
    beyond = np.flatnonzero(np.asarray(moved) >= share)
    if beyond.size == 0:
        return no_measurement(name, "deg", f"nothing slid up to {degrees(tilts[-1]):.2f} deg")
    k = int(beyond[0])
    part = (share - moved[k - 1]) / (moved[k] - moved[k - 1])
    angle = tilts[k - 1] + part * (tilts[k] - tilts[k - 1])
    sd = degrees(tilts[k] - tilts[k - 1]) / sqrt(12.0)
    details = {"displacements": moved, "friction": float(np.tan(angle))}
    return Measurement(name, degrees(angle), sd, "deg", details=details)


def median_displacement(before: Snapshot, after: Snapshot) -> float:
    """Median over grains present in both snapshots of the distance moved [m]."""
    rows: NDArray[np.int64]
    _, rows, rows_after = np.intersect1d(before.ident, after.ident, return_indices=True)
    return float(np.median(np.linalg.norm(after.position[rows_after] - before.position[rows], axis=1)))
