"""Observables of a heap beside its angle, each by the definition that the laboratory set lab_C states.

d is the grain diameter, H the pile height, N the number of spheres; the axis of a heap is (median x, median
y) of the centres; a top is z + r. The members of a clump count as grains of their own.

Reference: README of the laboratory set lab_C, section "Observables".
"""

from collections.abc import Callable
from math import atan, degrees, nan, pi

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.measures.silhouette import fit_window

HIGHEST_GRAINS = 5  # averaged for the pile height [1]
COLUMN_TOP_SHARE = 0.05  # of the grains, averaged for the column height [1]
RADIUS_SHARE = 0.9  # of the grains inside radius_90 [1]
OUTLINE_AZIMUTHS = np.radians(np.arange(0.0, 180.0, 15.0))
OUTLINE_BINS = 3  # fewest that carry a line [1]


def defect(snapshot: Snapshot) -> str | None:
    """Why nothing can be measured on this snapshot, if so."""
    if snapshot.radius.size == 0:
        return "no grains"
    if not np.isfinite(snapshot.position).all():
        return "a coordinate is not finite"
    return None


def grain_diameter(snapshot: Snapshot) -> float:
    """Diameter d that halves the volume of the grains [m]: the sieve median."""
    radius = np.sort(snapshot.radius)
    volume = np.cumsum(radius**3)
    return 2.0 * float(radius[np.searchsorted(volume, 0.5 * volume[-1])])


def heap_axis(position: Floats) -> Floats:
    """(median x, median y) of the centres [m]."""
    return np.median(position[:, :2], axis=0)


def mean_top(snapshot: Snapshot, count: int, base_height: float) -> float:
    """Mean top of the `count` highest grains above the base [m]."""
    return float(np.sort(snapshot.position[:, 2] + snapshot.radius)[-count:].mean()) - base_height


def single_value(name: str, unit: str, snapshot: Snapshot, value: Callable[[Snapshot], float]) -> Measurement:
    """Measurement of one number without a spread, or the defect of the snapshot."""
    if reason := defect(snapshot):
        return no_measurement(name, unit, reason)
    return Measurement(name, value(snapshot), nan, unit)


def pile_height(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Mean top of the five highest grains [m]."""
    return single_value("pile_height", "m", snapshot, lambda s: mean_top(s, HIGHEST_GRAINS, base_height))


def centroid_height(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Mean height of all grain centres [m]: the observable with the best signal-to-noise ratio."""
    return single_value(
        "centroid_height", "m", snapshot, lambda s: float(s.position[:, 2].mean()) - base_height
    )


def radius_90(snapshot: Snapshot) -> Measurement:
    """Radius about the axis with 90 % of the grains [m]: int(0.9 N)-th smallest distance, counted from 0."""

    def radius(state: Snapshot) -> float:
        distance = np.sort(np.linalg.norm(state.position[:, :2] - heap_axis(state.position), axis=1))
        return float(distance[int(RADIUS_SHARE * distance.size)])

    return single_value("radius_90", "m", snapshot, radius)


def column_height(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Mean top of the highest 5 % of the grains [m], for the settled column before its release."""
    count = max(1, int(COLUMN_TOP_SHARE * snapshot.radius.size))
    return single_value("column_height", "m", snapshot, lambda s: mean_top(s, count, base_height))


def ring_heights(snapshot: Snapshot, base_height: float = 0.0) -> Floats:
    """Mean height of each ring about the axis [m]; ring k, one diameter wide, has mid-radius (k + 1/2) d.

    A ring of mid-radius r is cut into max(1, int(pi r / d)) equal sectors from azimuth 0; a sector is as high
    as its highest grain top, an empty one 0.
    """
    diameter = grain_diameter(snapshot)
    offset = snapshot.position[:, :2] - heap_axis(snapshot.position)
    ring = (np.linalg.norm(offset, axis=1) / diameter).astype(np.int64)
    sectors = ring_sectors(int(ring.max()) + 1)
    turn = np.arctan2(offset[:, 1], offset[:, 0]) / (2.0 * pi) % 1.0
    sector = np.minimum((turn * sectors[ring]).astype(np.int64), sectors[ring] - 1)
    cells = np.zeros(int(sectors.sum()))
    first = np.cumsum(sectors) - sectors
    np.maximum.at(cells, first[ring] + sector, snapshot.position[:, 2] + snapshot.radius - base_height)
    return np.add.reduceat(cells, first) / sectors


def ring_sectors(rings: int) -> NDArray[np.int64]:
    """Sector counts of the first rings [1]."""
    return np.maximum((pi * (np.arange(rings) + 0.5)).astype(np.int64), 1)


def runout_radius(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Outermost radius where the ring height falls through one diameter, linear between mid-radii [m]."""
    if reason := defect(snapshot):
        return no_measurement("runout_radius", "m", reason)
    diameter = grain_diameter(snapshot)
    height = np.append(ring_heights(snapshot, base_height), 0.0)
    falls = np.flatnonzero((height[:-1] >= diameter) & (height[1:] < diameter))
    if falls.size == 0:
        return no_measurement("runout_radius", "m", "no ring is one diameter high")
    k = int(falls[-1])
    share = (height[k] - diameter) / (height[k] - height[k + 1])
    return Measurement("runout_radius", float((k + 0.5 + share) * diameter), nan, "m")


def angle_of_repose_outline(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Angle of repose from binned outlines, by the definition of lab_C [deg].

    12 azimuths 0, 15, .., 165 deg. Per azimuth and side, bins of one diameter are counted outward from the
    axis; the outline is the highest top in a bin. The flank ends before the first bin below max(0.15 H, 1.25
    d); a line through the flank bins not above 0.75 H (at least 3) gives the angle. Value: mean of the sides,
    then of the azimuths.
    """
    name = "angle_of_repose"
    if reason := defect(snapshot):
        return no_measurement(name, "deg", reason)
    diameter = grain_diameter(snapshot)
    offset = snapshot.position[:, :2] - heap_axis(snapshot.position)
    top = snapshot.position[:, 2] + snapshot.radius - base_height
    window = fit_window(mean_top(snapshot, HIGHEST_GRAINS, base_height), diameter)
    angles = []
    for azimuth in OUTLINE_AZIMUTHS:
        across = offset @ (np.cos(azimuth), np.sin(azimuth))
        sides = (binned_angle(side, top, diameter, window) for side in (across, -across))
        angles.append([angle for angle in sides if angle is not None])
    means = [float(np.mean(sides)) for sides in angles if sides]
    if not means:
        return no_measurement(name, "deg", f"no flank of {OUTLINE_BINS} diameters")
    missing = 2 * len(angles) - sum(map(len, angles))
    notes = (f"{missing} of {2 * len(angles)} flanks too short",) if missing else ()
    return Measurement(
        name, float(np.mean(means)), nan, "deg", notes=notes, details={"azimuth_angles": means}
    )


def binned_angle(across: Floats, top: Floats, diameter: float, window: tuple[float, float]) -> float | None:
    """Angle of the side with across >= 0 [deg], None where fewer than 3 bins carry it."""
    bins = (across[across >= 0.0] / diameter).astype(np.int64)
    outline = np.zeros(int(bins.max(initial=0)) + 2)
    np.maximum.at(outline, bins, top[across >= 0.0])
    flank = outline[: int(np.argmax(outline < window[0]))]
    chosen = np.flatnonzero(flank <= window[1])
    if chosen.size < OUTLINE_BINS:
        return None
    slope = np.polyfit((chosen + 0.5) * diameter, flank[chosen], 1)[0]
    return degrees(atan(-slope))
