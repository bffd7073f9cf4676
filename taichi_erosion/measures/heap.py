"""A heap: its angle of repose, from side silhouettes and from the height map, and its other observables.

d is the grain diameter, the volume median; H the pile height, N the number of spheres; the axis of a heap is
(median x, median y) of the centres; a top is z + r. The members of a clump count as grains of their own.
Lengths in m, angles in deg; a plate is centred on the z axis.

Reference: README of the laboratory set lab_C, section "Observables", for all but the silhouettes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import atan, degrees, isfinite, nan, pi, sqrt

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures import silhouette
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.measures.silhouette import Flank, heights_of_fit_window

HIGHEST_GRAINS = 5  # averaged for the pile height [1]
COLUMN_TOP_SHARE = 0.05  # of the grains, averaged for the column height [1]
RADIUS_SHARE = 0.9  # of the grains inside radius_90 [1]
OUTLINE_AZIMUTHS = np.radians(np.arange(0.0, 180.0, 15.0))
OUTLINE_BINS = 3  # fewest that carry a line [1]
SHORTEST_FLANK = 3.0  # diameters of outline that carry a line [1]; lab_C asks for three bins of one diameter
FEW_FLANKS_SHARE = 0.25  # of the flanks too short: the value rests on a selection [1]
INDEPENDENT_TURN = 60.0  # deg of azimuth between silhouettes that share no grains; see `spread`
RIM_SHARE = 0.1  # of the plate's rim lined with grains: the plate, not the grains, ends the pile [1]
SENTENCES = {
    "few_points": "few points: more than a quarter of the flanks are shorter than three diameters",
    "curved": "flank not straight: its angle changes from shoulder to foot",
    "flat_top": "truncated cone: its flanks would meet above its top",
    "truncated_by_plate": "pile reaches the rim of the plate",
}


def why_snapshot_unmeasurable(snapshot: Snapshot) -> str | None:
    if snapshot.radius.size == 0:
        return "no grains"
    return None if np.isfinite(snapshot.position).all() else "a coordinate is not finite"


def select_grains(snapshot: Snapshot, chosen: NDArray[np.bool_]) -> Snapshot:
    """The snapshot of some grains alone, without what no measure of a heap reads."""
    names = ("position", "velocity", "spin", "radius", "mass", "contacts", "ident")
    columns = {name: getattr(snapshot, name)[chosen] for name in names}
    kind = None if snapshot.kind is None else snapshot.kind[chosen]
    return replace(snapshot, **columns, kind=kind, effect_state={}, force=None)


def inside_surface_of_revolution(rows: Floats, position: Floats) -> NDArray[np.bool_]:
    """Positions inside a surface of revolution: rows of axis point, axis, radius and height of both ends."""
    inside = np.zeros(len(position), bool)
    for row in rows:
        arm = position - row[:3]
        height = arm @ row[3:6]
        radius = np.linalg.norm(arm - height[:, np.newaxis] * row[3:6], axis=1)
        inside |= radius < np.interp(height, row[[7, 9]], row[[6, 8]], left=0.0, right=0.0)
    return inside


def median_diameter_by_volume(snapshot: Snapshot) -> float:
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


def single_length(name: str, snapshot: Snapshot, value: Callable[[Snapshot], float]) -> Measurement:
    """Measurement of one length [m] without a spread, or the defect of the snapshot."""
    if reason := why_snapshot_unmeasurable(snapshot):
        return no_measurement(name, "m", reason)
    return Measurement(name, value(snapshot), nan, "m")


def pile_height(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Mean top of the five highest grains [m]."""
    return single_length("pile_height", snapshot, lambda s: mean_top(s, HIGHEST_GRAINS, base_height))


def centroid_height(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Mean height of all grain centres [m]: the observable with the best signal-to-noise ratio."""
    return single_length("centroid_height", snapshot, lambda s: float(s.position[:, 2].mean()) - base_height)


def radius_90(snapshot: Snapshot) -> Measurement:
    """Radius about the axis with 90 % of the grains [m]: int(0.9 N)-th smallest distance, counted from 0."""

    def radius_of_90_percent(state: Snapshot) -> float:
        distance = np.sort(np.linalg.norm(state.position[:, :2] - heap_axis(state.position), axis=1))
        return float(distance[int(RADIUS_SHARE * distance.size)])

    return single_length("radius_90", snapshot, radius_of_90_percent)


def settled_column_height(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Mean top of the highest 5 % of the grains [m], for the settled column before its release."""
    count = max(1, int(COLUMN_TOP_SHARE * snapshot.radius.size))
    return single_length("column_height", snapshot, lambda s: mean_top(s, count, base_height))


def mean_ring_heights(snapshot: Snapshot, base_height: float = 0.0) -> Floats:
    """Mean height of each ring about the axis [m]; ring k, one diameter wide, has mid-radius (k + 1/2) d.

    A ring of mid-radius r is cut into max(1, int(pi r / d)) equal sectors from azimuth 0; a sector is as high
    as its highest grain top, an empty one 0.
    """
    diameter = median_diameter_by_volume(snapshot)
    offset = snapshot.position[:, :2] - heap_axis(snapshot.position)
    ring = (np.linalg.norm(offset, axis=1) / diameter).astype(np.int64)
    sectors = sector_count_of_rings(int(ring.max()) + 1)
    turn = np.arctan2(offset[:, 1], offset[:, 0]) / (2.0 * pi) % 1.0
    sector = np.minimum((turn * sectors[ring]).astype(np.int64), sectors[ring] - 1)
    cells = np.zeros(int(sectors.sum()))
    first = np.cumsum(sectors) - sectors
    np.maximum.at(cells, first[ring] + sector, snapshot.position[:, 2] + snapshot.radius - base_height)
    return np.add.reduceat(cells, first) / sectors


def sector_count_of_rings(rings: int) -> NDArray[np.int64]:
    return np.maximum((pi * (np.arange(rings) + 0.5)).astype(np.int64), 1)


def runout_radius(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Outermost radius where the ring height falls through one diameter, linear between mid-radii [m]."""
    if reason := why_snapshot_unmeasurable(snapshot):
        return no_measurement("runout_radius", "m", reason)
    diameter = median_diameter_by_volume(snapshot)
    height = np.append(mean_ring_heights(snapshot, base_height), 0.0)
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
    if reason := why_snapshot_unmeasurable(snapshot):
        return no_measurement(name, "deg", reason)
    diameter = median_diameter_by_volume(snapshot)
    offset = snapshot.position[:, :2] - heap_axis(snapshot.position)
    top = snapshot.position[:, 2] + snapshot.radius - base_height
    window = heights_of_fit_window(mean_top(snapshot, HIGHEST_GRAINS, base_height), diameter)
    angles = []
    for azimuth in OUTLINE_AZIMUTHS:
        across = offset @ (np.cos(azimuth), np.sin(azimuth))
        sides = (side_angle(side, top, diameter, window) for side in (across, -across))
        angles.append([angle for angle in sides if angle is not None])
    means = [float(np.mean(sides)) for sides in angles if sides]
    if not means:
        return no_measurement(name, "deg", f"no flank of {OUTLINE_BINS} diameters")
    missing = 2 * len(angles) - sum(map(len, angles))
    notes = (f"{missing} of {2 * len(angles)} flanks too short",) if missing else ()
    details = {"azimuth_angles": means}
    return Measurement(name, float(np.mean(means)), nan, "deg", notes=notes, details=details)


def side_angle(across: Floats, top: Floats, diameter: float, window: tuple[float, float]) -> float | None:
    """Angle of the side with across >= 0 [deg], None where fewer than 3 bins carry it."""
    bins = (across[across >= 0.0] / diameter).astype(np.int64)
    outline = np.zeros(int(bins.max(initial=0)) + 2)
    np.maximum.at(outline, bins, top[across >= 0.0])
    flank = outline[: int(np.argmax(outline < window[0]))]
    chosen = np.flatnonzero(flank <= window[1])
    if chosen.size < OUTLINE_BINS:
        return None
    return degrees(atan(-np.polyfit((chosen + 0.5) * diameter, flank[chosen], 1)[0]))


@dataclass(frozen=True)
class View:
    """Silhouette and flanks of one azimuth."""

    azimuth: float  # deg
    height: float  # m, top of the silhouette
    axis: float  # m, along the horizontal of the picture, from the origin
    flanks: tuple[Flank | None, Flank | None]  # left, right

    def fitted_line_ends(self) -> list[list[float]]:
        """Both ends of every fitted line, u, z, u, z [m]."""
        sides = zip((-1.0, 1.0), self.flanks, strict=True)
        return [
            [number for r in (f.start, f.end) for number in (self.axis + side * r, float(f.at(r)))]
            for side, f in sides
            if f is not None
        ]

    @property
    def usable_flanks(self) -> list[Flank]:
        """Flanks long enough for a line."""
        return [flank for flank in self.flanks if flank is not None]


def repose_angle(
    snapshot: Snapshot, plate_radius: float | None = None, base_height: float = 0.0, azimuths: int = 12
) -> Measurement:
    """Angle of repose from side silhouettes [deg].

    Silhouettes from `azimuths` equal steps of half a turn; per azimuth a straight line through either flank
    from max(0.15 H, 1.25 d) to 0.75 H, H its top; value: mean of the sides, then of the azimuths. `sd` is the
    standard error within this one pile (`spread`), not the scatter of repeats.

    `details`: per azimuth the angles; lines as [azimuth deg, u, z, u, z] with u [m] along the horizontal of
    the picture and z [m] above the base; residual [rms, in d]; bend [deg]; height [m]; numbers of short
    flanks and of grains below the base; flags, each explained in the notes.
    """
    name = "repose_angle"
    if reason := why_snapshot_unmeasurable(snapshot):
        return no_measurement(name, "deg", reason)
    on_plate = snapshot.position[:, 2] > base_height
    if not on_plate.any():
        return no_measurement(name, "deg", "no grains above the base")
    grain = median_diameter_by_volume(snapshot)
    position, radius = snapshot.position[on_plate], snapshot.radius[on_plate]
    turns = np.arange(azimuths) * 180.0 / azimuths
    views = [fit_view(position, radius, turn, base_height, grain) for turn in turns]
    angles = [float(np.mean([f.angle for f in view.usable_flanks])) for view in views if view.usable_flanks]
    if not angles:
        height = float(np.mean([view.height for view in views])) / grain
        return no_measurement(name, "deg", f"no heap: no flank of three diameters, {height:.1f} high")
    flags = flags_of_repose_angle(views, grain)
    beyond = np.linalg.norm(position[:, :2], axis=1) > (plate_radius or np.inf) - grain
    if plate_radius and float(beyond.sum()) * grain / (2.0 * pi * plate_radius) > RIM_SHARE:  # of the rim
        flags.append("truncated_by_plate")
    flanks = [flank for view in views for flank in view.usable_flanks]
    details = {
        "azimuth_angles": [[view.azimuth, *(f.angle if f else None for f in view.flanks)] for view in views],
        "residual": float(np.sqrt(np.mean([flank.residual**2 for flank in flanks]))) / grain,
        "bend": float(np.mean(flank_bends(views))),
        "height": float(np.median([view.height for view in views])),
        "short_flanks": 2 * len(views) - len(flanks),
        "lines": [[view.azimuth, *end] for view in views for end in view.fitted_line_ends()],
        "fallen_grains": int(np.sum(~on_plate)),
        "flags": flags,
    }
    notes = tuple(SENTENCES[flag] for flag in flags)
    return Measurement(name, float(np.mean(angles)), standard_error(angles), "deg", 1, notes, details)


def fit_view(position: Floats, radius: Floats, azimuth: float, base_height: float, grain: float) -> View:
    """Draw the heap from one azimuth [deg] and fit its flanks."""
    picture = silhouette.draw_silhouette(position, radius, float(np.radians(azimuth)), base_height, grain)
    outline = silhouette.extract_outline(silhouette.largest_connected_body(picture.image), picture.pixel)
    axis = picture.left + 0.5 * picture.pixel - float(outline.position[0])
    flanks = silhouette.fit_flanks(outline, grain, SHORTEST_FLANK * grain)
    return View(float(azimuth), float(outline.height.max()), axis, flanks)


def standard_error(values: list[float]) -> float:
    """Standard error of the mean over azimuths of one pile, NaN for a single one.

        e = s / sqrt(k),   k = min(number of values, 180 deg / 60 deg) = 3 from three azimuths on

    Neighbouring azimuths share grains: the silhouette of a cone at distance u from the axis is made by grains
    within a depth of sqrt(2 u d / tan(angle)), about 30 deg of turn to either side for u = 15 d. With k = 3
    the sd over azimuths of one pile (3.6, 2.0, 1.2, 0.8 deg for 500, 1000, 2000, 4000 grains) gives 2.1, 1.2,
    0.7, 0.5 deg, where repeated piles scattered by 1.24, 1.26, 0.58, 0.57 deg.

    Reference: the makers of the laboratory set lab_C, repeats of one test with 500 to 4000 grains.
    """
    if len(values) < 2:
        return nan
    independent = min(len(values), 180.0 / INDEPENDENT_TURN)
    return float(np.std(values, ddof=1)) / sqrt(independent)


def flank_bends(views: Sequence[View]) -> list[float]:
    """Mean bend of the flanks of every azimuth that has any [deg]."""
    return [float(np.mean([f.bend for f in view.usable_flanks])) for view in views if view.usable_flanks]


def flags_of_repose_angle(views: Sequence[View], grain: float) -> list[str]:
    """Flags of the angle; keys of SENTENCES."""
    bends, height = flank_bends(views), float(np.median([view.height for view in views]))
    falling = [[flank for flank in view.usable_flanks if flank.angle > 0.0] for view in views]
    meetings = [silhouette.apex_height_of_flank_lines(*both) for both in falling if len(both) == 2]
    short = 2 * len(views) - sum(len(view.usable_flanks) for view in views)
    raised = {
        "few_points": short > FEW_FLANKS_SHARE * 2 * len(views),
        "curved": silhouette.is_flank_curved(float(np.mean(bends)), standard_error(bends)),
        "flat_top": bool(meetings) and silhouette.is_flat_topped(height, float(np.median(meetings)), grain),
    }
    return [flag for flag, is_raised in raised.items() if is_raised]


def cone_angle(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Slope of the cone that fits the height map [deg].

        z(r) = z_0 - tan(angle) r

    fitted to the mean heights of rings about the axis (`mean_ring_heights`) from 0.75 H down to
    max(0.15 H, 1.25 d), apex z_0 and slope free; each ring weighs as many times as it has sectors. `sd`: the
    standard error of the fit.
    """
    name = "cone_angle"
    if reason := why_snapshot_unmeasurable(snapshot):
        return no_measurement(name, "deg", reason)
    grain = median_diameter_by_volume(snapshot)
    height = np.append(mean_ring_heights(snapshot, base_height), 0.0)
    low, high = heights_of_fit_window(pile_height(snapshot, base_height).value, grain)
    flank = height[: int(np.argmax(height < low))]
    ring = np.flatnonzero(flank <= high)
    if ring.size < SHORTEST_FLANK:
        return no_measurement(name, "deg", "no flank of three rings")
    radius = (ring.astype(float) + 0.5) * grain
    sectors = sector_count_of_rings(flank.size)[ring].astype(float)
    fit = silhouette.fit_polynomial(radius, flank[ring], 1, weight=sectors)
    slope = float(fit.coefficients[1])
    error = degrees(float(fit.errors[1]) / (1.0 + slope**2))
    details = {"apex": float(fit.coefficients[0]), "residual": fit.residual / grain, "rings": int(ring.size)}
    return Measurement(name, degrees(atan(-slope)), error if isfinite(error) else nan, "deg", details=details)
