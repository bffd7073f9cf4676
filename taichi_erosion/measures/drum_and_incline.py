"""Angles of moving grains: dynamic angle of repose in a rotating drum, sliding angle on a tilted plate.

Reference: Hao et al. (2022), figure 3: friction coefficients from an inclinometer, mu = tan(angle).
"""

from collections.abc import Sequence
from math import atan, degrees, nan, sqrt

import numpy as np

from taichi_erosion.core.setup import Triple
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.heap import median_diameter_by_volume, why_snapshot_unmeasurable
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.measures.shortfalls import tilt_shortfalls

MIDDLE_SHARE = 0.5  # of the drum radius: the surface is straight there; the ends curve at the wall [1]
FEWEST_BINS = 3  # that carry a line [1]
EARLY = 0.1  # of that distance, after which the turn counts as a lag [1]
SLIDING_SHARE = 0.5  # of a diameter: far beyond elastic settling, and passed at once by a moving grain [1]


def why_frames_unmeasurable(frames: Sequence[Snapshot]) -> str | None:
    return next(filter(None, map(why_snapshot_unmeasurable, frames)), None) if frames else "no frames"


def dynamic_angle(
    frames: Sequence[Snapshot],
    drum_radius: float,
    centre: Triple = (0.0, 0.0, 0.0),
    axis: Triple = (0.0, 1.0, 0.0),
) -> Measurement:
    """Mean slope of the surface over frames of the steady state [deg].

    Per frame a straight line is fitted to the height of the surface across the middle half of the drum, in
    bins of one grain diameter. `sd` is the standard deviation over frames: frames of one run are not repeats,
    so n is 1. `centre` is a point of the axis [m], `axis` a horizontal unit vector, gravity acts along -z.
    The value is the magnitude of the mean; `details` hold the signed angle of each frame, positive where the
    surface rises along `axis` x z.
    """
    name = "dynamic_angle"
    if reason := why_frames_unmeasurable(frames):
        return no_measurement(name, "deg", reason)
    angles = [surface_angle(frame, drum_radius, centre, axis) for frame in frames]
    measured = [angle for angle in angles if angle is not None]
    if not measured:
        return no_measurement(name, "deg", f"no surface {FEWEST_BINS} diameters wide in mid-drum")
    sd = float(np.std(measured, ddof=1)) if len(measured) > 1 else nan
    missing = len(angles) - len(measured)
    notes = (f"{missing} of {len(angles)} frames show no surface",) if missing else ()
    return Measurement(name, abs(float(np.mean(measured))), sd, "deg", 1, notes, {"frame_angles": measured})


def surface_angle(frame: Snapshot, drum_radius: float, centre: Triple, axis: Triple) -> float | None:
    """Slope of the surface in one frame [deg], None where fewer than three bins are filled.

    The surface of a bin is the mean over slices of the drum, one diameter thick, of the highest top of a
    touching grain: grains in flight do not belong to the surface.
    """
    diameter = median_diameter_by_volume(frame)
    across = np.cross(axis, (0.0, 0.0, 1.0))
    offset = frame.position - np.asarray(centre)
    column = np.floor(offset @ across / diameter).astype(np.int64)
    chosen = (np.abs((column + 0.5) * diameter) <= MIDDLE_SHARE * drum_radius) & (frame.contacts > 0)
    if not chosen.any():
        return None
    slice_ = np.floor(offset @ np.asarray(axis) / diameter).astype(np.int64)[chosen]
    column, slice_ = column[chosen] - column[chosen].min(), slice_ - slice_.min()
    tops = np.full((int(column.max()) + 1, int(slice_.max()) + 1), -np.inf)
    np.maximum.at(tops, (column, slice_), (offset[:, 2] + frame.radius)[chosen])
    filled = np.isfinite(tops)
    bins = np.flatnonzero(filled.any(axis=1))
    if bins.size < FEWEST_BINS:
        return None
    surface = np.where(filled, tops, 0.0)[bins].sum(axis=1) / filled[bins].sum(axis=1)
    return degrees(atan(np.polyfit(bins * diameter, surface, 1)[0]))


def angle_at_which_grains_slide(
    frames: Sequence[Snapshot], tilts: Sequence[float], share: float = SLIDING_SHARE
) -> Measurement:
    """Inclination at which the median grain has moved by `share` of a diameter [deg].

    `tilts` [rad] is the inclination at each frame, never decreasing; displacements count from the first
    frame; between frames they are interpolated linearly. `sd` is that of a uniform distribution over the
    interval between the two frames. The angle lags behind the true onset by the turn made while the grain
    covers that distance: tilt slowly. `details`: displacement [d] at each frame and friction = tan(angle).
    """
    name = "sliding_angle"
    if reason := why_frames_unmeasurable(frames):
        return no_measurement(name, "deg", reason)
    displacements, first, diameter = list[float](), frames[0], median_diameter_by_volume(frames[0])
    for frame in frames:
        _, one, two = np.intersect1d(first.ident, frame.ident, return_indices=True)
        shift = np.linalg.norm(frame.position[two] - first.position[one], axis=1)
        displacements.append(float(np.median(shift)) / diameter)
    if max(displacements) < share:
        return no_measurement(name, "deg", f"nothing slid up to {degrees(tilts[-1]):.2f} deg")
    k = int(np.argmax(np.asarray(displacements) >= share))
    reached = np.maximum.accumulate(displacements[: k + 1])  # of a median that may go back a little
    early, angle = np.interp([EARLY * share, share], reached, tilts[: k + 1])
    sd = degrees(tilts[k] - tilts[k - 1]) / sqrt(12.0)
    details = {"displacements": displacements, "friction": float(np.tan(angle))}
    lacking = tuple(tilt_shortfalls(degrees(angle - early)))
    return Measurement(name, degrees(angle), sd, "deg", details=details, shortfalls=lacking)
