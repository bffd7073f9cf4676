"""Angle of repose of a simulated heap: from side silhouettes, as a camera sees it, and from the height map.

The grain diameter d is the volume median. Lengths in m, angles in deg; a plate is centred on the z axis.
"""

from dataclasses import dataclass
from math import atan, degrees, isfinite, nan, pi, sqrt
from typing import Any

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures import silhouette
from taichi_erosion.measures.heap import defect, grain_diameter, pile_height, ring_heights, ring_sectors
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.measures.silhouette import Flank

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


@dataclass(frozen=True)
class View:
    """Silhouette and flanks of one azimuth."""

    azimuth: float  # deg
    height: float  # m, top of the silhouette
    axis: float  # m, along the horizontal of the picture, from the origin
    flanks: tuple[Flank | None, Flank | None]  # left, right

    @property
    def found(self) -> list[Flank]:
        """Flanks long enough for a line."""
        return [flank for flank in self.flanks if flank is not None]


def repose_angle(
    snapshot: Snapshot, plate_radius: float | None = None, base_height: float = 0.0, azimuths: int = 12
) -> Measurement:
    """Angle of repose from side silhouettes [deg].

    Silhouettes from `azimuths` equal steps of half a turn; per azimuth a straight line through either flank
    from max(0.15 H, 1.25 d) to 0.75 H, H its top; value: mean of the sides, then of the azimuths. `sd` is the
    standard error within this one pile (`spread`), not the scatter of repeats.

    `details`: per azimuth the angle; lines as [azimuth deg, u, z, u, z] with u [m] along the horizontal of
    the picture and z [m] above the base; residual [rms, in d]; bend [deg]; flags, each explained in the
    notes.
    """
    name = "repose_angle"
    if reason := defect(snapshot):
        return no_measurement(name, "deg", reason)
    on_plate = snapshot.position[:, 2] > base_height
    if not on_plate.any():
        return no_measurement(name, "deg", "no grains above the base")
    grain = grain_diameter(snapshot)
    position, radius = snapshot.position[on_plate], snapshot.radius[on_plate]
    turns = np.arange(azimuths) * 180.0 / azimuths
    views = [view_heap(position, radius, turn, base_height, grain) for turn in turns]
    angles = [float(np.mean([f.angle for f in view.found])) for view in views if view.found]
    if not angles:
        height = float(np.mean([view.height for view in views])) / grain
        return no_measurement(
            name, "deg", f"no heap: {height:.1f} diameters high, no flank of three diameters"
        )
    details = describe(views, angles, grain)
    details["rim_grains"] = rim_grains(position, grain, plate_radius) if plate_radius else 0
    details["fallen_grains"] = int(np.sum(~on_plate))
    details["flags"] = raise_flags(details, grain, plate_radius)
    notes = tuple(SENTENCES[flag] for flag in details["flags"])
    return Measurement(name, float(np.mean(angles)), details["standard_error"], "deg", 1, notes, details)


def view_heap(position: Floats, radius: Floats, azimuth: float, base_height: float, grain: float) -> View:
    """Draw the heap from one azimuth [deg] and fit its flanks."""
    picture = silhouette.draw_silhouette(position, radius, float(np.radians(azimuth)), base_height, grain)
    outline = silhouette.extract_outline(silhouette.largest_body(picture.image), picture.pixel)
    axis = picture.left + 0.5 * picture.pixel - float(outline.position[0])
    flanks = silhouette.fit_flanks(outline, grain, SHORTEST_FLANK * grain)
    return View(float(azimuth), float(outline.height.max()), axis, flanks)


def spread(values: list[float]) -> float:
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


def describe(views: list[View], angles: list[float], grain: float) -> dict[str, Any]:
    """Figures of all views together, as plain numbers and lists."""
    flanks = [flank for view in views for flank in view.found]
    bends = [float(np.mean([flank.bend for flank in view.found])) for view in views if view.found]
    falling = [[flank for flank in view.found if flank.angle > 0.0] for view in views]
    meetings = [silhouette.meeting_height(*both) for both in falling if len(both) == 2]
    return {
        "azimuth_angles": [[view.azimuth, *(f.angle if f else None for f in view.flanks)] for view in views],
        "azimuth_sd": float(np.std(angles, ddof=1)) if len(angles) > 1 else nan,
        "standard_error": spread(angles),
        "residual": float(np.sqrt(np.mean([flank.residual**2 for flank in flanks]))) / grain,
        "bend": float(np.mean(bends)),
        "bend_error": spread(bends),
        "height": float(np.median([view.height for view in views])),
        "meeting_height": float(np.median(meetings)) if meetings else nan,
        "short_flanks": 2 * len(views) - len(flanks),
        "flanks_seen": 2 * len(views),
        "lines": [line for view in views for line in drawn_lines(view)],
        "grain_diameter": grain,
    }


def drawn_lines(view: View) -> list[list[float]]:
    """Fitted lines as [azimuth deg, u, z, u, z], in m."""
    lines = []
    for side, flank in zip((-1.0, 1.0), view.flanks, strict=True):
        if flank is not None:
            fall = float(np.tan(np.radians(flank.angle)))
            ends = [(view.axis + side * r, flank.apex - fall * r) for r in (flank.start, flank.end)]
            lines.append([view.azimuth, *ends[0], *ends[1]])
    return lines


def rim_grains(position: Floats, grain: float, plate_radius: float) -> int:
    """How many grains lie within one diameter of the rim of a round plate about the z axis."""
    return int(np.sum(np.linalg.norm(position[:, :2], axis=1) > plate_radius - grain))


def raise_flags(details: dict[str, Any], grain: float, plate_radius: float | None) -> list[str]:
    """Flags of the angle; the keys of SENTENCES."""
    lined = details["rim_grains"] * grain / (2.0 * pi * plate_radius) if plate_radius else 0.0
    raised = {
        "few_points": details["short_flanks"] > FEW_FLANKS_SHARE * details["flanks_seen"],
        "curved": silhouette.is_bent(details["bend"], details["bend_error"]),
        "flat_top": silhouette.is_flat_topped(details["height"], details["meeting_height"], grain),
        "truncated_by_plate": lined > RIM_SHARE,
    }
    return [flag for flag, is_raised in raised.items() if is_raised]


def cone_angle(snapshot: Snapshot, base_height: float = 0.0) -> Measurement:
    """Slope of the cone that fits the height map [deg].

        z(r) = z_0 - tan(angle) r

    fitted to the mean heights of rings about the axis (`ring_heights`) from 0.75 H down to
    max(0.15 H, 1.25 d), apex z_0 and slope free; each ring weighs as many times as it has sectors. `sd`: the
    standard error of the fit.
    """
    name = "cone_angle"
    if reason := defect(snapshot):
        return no_measurement(name, "deg", reason)
    grain = grain_diameter(snapshot)
    height = np.append(ring_heights(snapshot, base_height), 0.0)
    low, high = silhouette.fit_window(pile_height(snapshot, base_height).value, grain)
    flank = height[: int(np.argmax(height < low))]
    ring = np.flatnonzero(flank <= high)
    if ring.size < SHORTEST_FLANK:
        return no_measurement(name, "deg", "no flank of three rings")
    radius = (ring.astype(float) + 0.5) * grain
    fit = silhouette.fit_polynomial(
        radius, flank[ring], 1, weight=ring_sectors(flank.size)[ring].astype(float)
    )
    slope = float(fit.coefficients[1])
    error = degrees(float(fit.errors[1]) / (1.0 + slope**2))
    details = {"apex": float(fit.coefficients[0]), "residual": fit.residual / grain, "rings": int(ring.size)}
    return Measurement(name, degrees(atan(-slope)), error if isfinite(error) else nan, "deg", details=details)
