"""Angle of repose from a photograph: binarise, find the base line, extract the boundary, fit both flanks.

Uneven light is divided out and a tilted picture turned before the fit. What cannot be trusted is refused: an
outline that depends on the threshold, flanks that differ or that the outline leaves, a heap too flat for one.

The base line, of the plate beside the heap or of the heap's lower edge, is found by a Hough transform over
small tilts: of all lines below which hardly any point of the outline lies, the one with most points on it.
Its tilt is that of the camera about its line of sight, or of the plate.

Reference: Hao et al. (2022), angle of repose test; outline and fit are those of simulated silhouettes. Duda &
Hart (1972), Commun. ACM 15, 11 (lines in pictures by angle and distance).
"""

from dataclasses import dataclass, replace
from math import atan, cos, degrees, hypot, inf, radians, sin
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy
from numpy.typing import NDArray
from PIL import Image, ImageOps

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import require_regular_file
from taichi_erosion.core.setup import Floats
from taichi_erosion.measures import silhouette
from taichi_erosion.measures.result import Measurement, as_record
from taichi_erosion.measures.silhouette import Flank, Outline

Grey = NDArray[np.float64]  # [rows, columns], 0 black to 1 white
Mask = NDArray[np.bool_]  # [rows, columns]
Background = Literal["auto", "dark", "light"]
Box = tuple[int, int, int, int]  # left, top, right, bottom [px], right and bottom excluded

GREY_LEVELS, DEEPEST = 256, 65_535  # levels of 8 bits, white of 16 bits
SEPARATION_AT_LEAST = 0.7  # between-class over total variance; one Gaussian halved has 2 / pi = 0.64 [1]
PLATE_SHARE = 0.97  # of the widest foreground row: the highest row so wide lies on the plate [1]
SMALLEST_SIDE = 32  # px, of a picture or crop
LOWEST_HEAP = 16  # px, height below which edges of one pixel matter
SHORTEST_FLANK = 8  # px of outline that carry a line
TILT_SEEN = 0.25  # deg, of a base line, from which the picture is turned
BORDER_SAMPLES = 20_000  # of the border, to which the light is fitted
LIGHT_GAIN = 0.01  # of the separation, from which uneven light is divided out [1]
FRAME_ROWS, FRAME_COLUMNS = 0.2, 0.1  # of the height and width at the border: background above the heap [1]
DARKEST = 0.05  # level of a background that is divided out [1]
THRESHOLD_SHIFT = 0.2  # of the distance between the classes, by which the threshold is moved to and fro [1]
STEADY = 3.0  # deg by which the angle may change with the threshold; 5 times the sd of repeats (lab_C)
MOST_DIFFERENCE = 12.0  # deg between the flanks; one pile poured from above has both within 5 (lab_C)
LEAST_ANGLE = 8.0  # deg; spheres without rolling friction heap at 18
MOST_DEVIATION = 0.12  # rms distance of outline and lines over the height [1]; round tops stay below 0.05
DRAWN_POINTS = 200  # of an outline
LARGEST_TILT = 15.0  # deg; beyond it a base line is not told from a flat flank
TILT_STEP = 0.25  # deg, of the search
NEAR = 1.5  # px from the line within which a point lies on it
BELOW = 3.0  # px under the line from which a point lies below it
BELOW_SHARE = 0.03  # of the columns that may lie below: dust, corners
LEAST_SHARE = 0.03  # of the columns that must lie on a line of the plate
LOWER_PLATE_SHARE = 0.1  # the same where a lower edge is seen: a foot alone looks like a short plate
LOWER_EDGE_SHARE = 0.5  # of the columns that must lie on a line of the lower edge
PARALLEL = 2.0  # deg between plate and lower edge, within which they are one object
FRAME_SHARE = 0.5  # of the columns that reach the frame, from which the lower edge is that of the picture
SENTENCES = {
    "curved": "flank not straight: its angle changes from shoulder to foot",
    "one_flank": "one flank is too short; the value is the other alone",
    "flat_top": "truncated cone: the flanks would meet well above the top",
    "cut_by_frame": "the heap touches the edge of the picture",
}


@dataclass(frozen=True)
class Detection:
    """Foreground above the base line, with its outline and flanks."""

    body: Mask  # last row just above the base line
    threshold: float  # grey level between heap and background [1]
    background: Literal["dark", "light"]
    base: Literal["seen", "not seen"]  # whether a base line was found
    tilt: float  # deg, by which the picture was turned so that its base line became horizontal
    outline: Outline
    flanks: tuple[Flank | None, Flank | None]

    @property
    def fitted_flanks(self) -> list[Flank]:
        return [flank for flank in self.flanks if flank is not None]

    @property
    def mean_flank_angle(self) -> float:
        """Their mean [deg]."""
        return float(np.mean([flank.angle for flank in self.fitted_flanks]))

    @property
    def axis_column(self) -> float:
        """Column of the axis in the turned picture [px]."""
        return 0.5 - float(self.outline.position[0])


def measure_photograph(
    path: str | Path, crop: Box | None = None, background: Background = "auto"
) -> dict[str, Any]:
    """Angle of repose of a heap photographed from the side [deg], as a JSON-able record.

    `crop` is (left, top, right, bottom) in pixels; without a visible plate its lower edge is the base. The
    angles are those to the base line. `sd` joins the errors of both fits, the difference of the flanks and
    the change by other thresholds: hypot(hypot(e_l, e_r) / 2, |left - right| / 2, (max - min) / 2). Raises
    BadInput where the picture shows no heap, or where the detection is not certain.
    """
    path = Path(path)
    grey = read_grey_picture(path)
    left, top, right, bottom = box = check_crop(path, grey, crop)
    calm = remove_uneven_light(scipy.ndimage.median_filter(grey[top:bottom, left:right], size=3))
    detection = detect_heap(path, calm, background)
    steadiness = angle_range_over_thresholds(path, calm, detection)
    refuse_uncertain_detection(path, detection, steadiness)
    record = as_record(angle_measurement(detection, steadiness))
    record["details"] |= {
        "height_pixels": int(detection.outline.height.max()),
        "base_row": top + detection.body.shape[0],
        "axis_column": left + detection.axis_column,
        "threshold": detection.threshold,
        "background": detection.background,
        "base_line": detection.base,
        "tilt": detection.tilt,
        "crop": list(box),
        "drawing": detected_lines(detection, calm.shape, (left, top)),
    }
    return record


def angle_range_over_thresholds(path: Path, calm: Grey, detection: Detection) -> tuple[float, float]:
    """Least and largest angle with thresholds to either side of the chosen one; infinite where one fails."""
    dark = float(np.mean(calm[calm <= detection.threshold]))
    light = float(np.mean(calm[calm > detection.threshold]))
    angles = [detection.mean_flank_angle]
    for side in (-THRESHOLD_SHIFT, THRESHOLD_SHIFT):
        threshold = detection.threshold + side * (light - dark)
        try:
            angles.append(detect_heap(path, calm, detection.background, threshold).mean_flank_angle)
        except BadInput:
            angles.append(inf)
    return min(angles), max(angles)


def refuse_uncertain_detection(path: Path, detection: Detection, steadiness: tuple[float, float]) -> None:
    """Raise BadInput for a detection that cannot be trusted, with the reason."""
    angles, (low, high) = [flank.angle for flank in detection.fitted_flanks], steadiness
    reason = ""
    if high - low > STEADY:
        span = f"{low:.0f} to {high:.0f} deg" if high < inf else "a heap is lost"
        reason = f"the outline depends on the threshold ({span}): uneven light or a weak contrast"
    elif abs(angles[0] - angles[-1]) > MOST_DIFFERENCE:
        causes = "a shadow, another object, or a tilted camera"
        reason = f"the flanks differ, {angles[0]:.0f} and {angles[-1]:.0f} deg: {causes}"
    elif detection.mean_flank_angle < LEAST_ANGLE:
        reason = f"{detection.mean_flank_angle:.1f} deg is flatter than any heap of grains"
    elif (share := rms_outline_deviation(detection)) > MOST_DEVIATION:
        reason = f"the outline leaves the lines by {share:.0%} of the height: no heap from the side"
    if reason:
        raise BadInput(f"{path}: the detection is not certain: {reason}; give --crop around the heap alone")


def rms_outline_deviation(detection: Detection) -> float:
    """Rms distance of outline and fitted lines above the foot, over the height [1]."""
    height = float(detection.outline.height.max())
    gaps = []
    for side, flank in zip((-1.0, 1.0), detection.flanks, strict=True):
        if flank is not None:
            on_side = side * detection.outline.position >= 0.0
            distance, outline = np.abs(detection.outline.position[on_side]), detection.outline.height[on_side]
            line = np.clip(flank.at(distance), 0.0, height)
            above = np.maximum(line, outline) > silhouette.FOOT_SHARE * height
            gaps.append(outline[above] - line[above])
    return float(np.sqrt(np.mean(np.concatenate(gaps) ** 2))) / height


def detected_lines(detection: Detection, shape: tuple[int, ...], corner: tuple[int, int]) -> dict[str, Any]:
    """What was detected, in pixels (column, row) of the photograph: outline, base line, fitted lines.

    `shape` is that of the crop, (column, row) of whose upper left is `corner`.
    """
    base, axis, position = detection.body.shape[0], detection.axis_column, detection.outline.position
    middle, c, s = 0.5 * np.array(shape[1::-1]), cos(radians(detection.tilt)), sin(radians(detection.tilt))

    def to_photo(points: Any) -> list[list[float]]:
        turned = (np.asarray(points, dtype=float) - middle) @ np.array([[c, s], [-s, c]])
        return (turned + middle + np.array(corner)).round(2).tolist()

    covered = np.flatnonzero(detection.outline.height > 0.0)
    chosen = covered[:: max(1, covered.size // DRAWN_POINTS)]
    lines = {}
    for name, side, flank in zip(("left", "right"), (-1.0, 1.0), detection.flanks, strict=True):
        if flank is not None:
            lines[name] = to_photo([(axis + side * r, base - flank.at(r)) for r in (flank.start, flank.end)])
    width = detection.body.shape[1]
    outline = np.column_stack([axis + position[chosen], base - detection.outline.height[chosen]])
    return {"outline": to_photo(outline), "base": to_photo([(0.0, base), (width, base)])} | lines


def read_grey_picture(path: Path) -> Grey:
    """Luminance of a picture, 0 to 1, turned upright."""
    try:
        with Image.open(require_regular_file(path)) as opened:
            picture = ImageOps.exif_transpose(opened)
            if picture.mode.startswith("I"):  # 16 bits
                return np.asarray(picture, dtype=float) / DEEPEST
            return np.asarray(picture.convert("L")) / (GREY_LEVELS - 1.0)
    except FileNotFoundError as error:
        raise BadInput(f"{path}: no such file") from error
    except Exception as error:  # decoders raise whatever a damaged file makes them raise
        raise BadInput(f"{path}: not a readable PNG or JPEG picture") from error


def check_crop(path: Path, grey: Grey, crop: Box | None) -> Box:
    """The crop, or the whole picture, after asking whether a heap fits in it."""
    rows, columns = grey.shape
    left, top, right, bottom = crop or (0, 0, columns, rows)
    if not (0 <= left < right <= columns and 0 <= top < bottom <= rows):
        raise BadInput(f"{path}: crop {left},{top},{right},{bottom} is not a box within 0,0,{columns},{rows}")
    if min(right - left, bottom - top) < SMALLEST_SIDE:
        size = f"{right - left} x {bottom - top} pixels"
        raise BadInput(f"{path}: {size} to look at; at least {SMALLEST_SIDE} each way")
    return left, top, right, bottom


def detect_heap(path: Path, grey: Grey, background: Background, threshold: float | None = None) -> Detection:
    """Binarise, find the base line, turn the picture by its tilt, keep the body above, fit its flanks.

    Otsu's threshold unless one is given. Raises BadInput where there is no heap.
    """
    chosen, separation = otsu_threshold(grey)
    if separation < SEPARATION_AT_LEAST:
        raise BadInput(f"{path}: no heap: nothing stands out from the background")
    threshold = chosen if threshold is None else threshold
    side = background_is_dark_or_light(grey, threshold) if background == "auto" else background
    scene = largest_foreground_body(grey, threshold, side)
    line, tilt = find_base_line(scene), 0.0
    if line is not None and abs(line.tilt) > max(TILT_SEEN, line.error):
        tilt = line.tilt
        turned = scipy.ndimage.rotate(grey, tilt, reshape=False, order=1, mode="nearest")
        scene = largest_foreground_body(turned, threshold, side)
        line = find_base_line(scene)
    if line is None:  # the widest row is the foot, at most 3 % of the height too high
        width = scene.sum(axis=1)
        base = int(np.argmax(width >= PLATE_SHARE * width.max()))
    else:
        base = round(line.row)
    base = min(max(base, 1), scene.shape[0])
    body = silhouette.largest_connected_body(scene[:base])
    height = base - int(np.argmax(body.any(axis=1)))
    if not body.any() or height < LOWEST_HEAP:
        raise BadInput(f"{path}: no heap: nothing rises {LOWEST_HEAP} pixels above the base at row {base}")
    outline = silhouette.extract_outline(body, 1.0)
    flanks = silhouette.fit_flanks(outline, 0.0, SHORTEST_FLANK)
    if not any(flanks):
        raise BadInput(f"{path}: no flank found; give --crop around the heap or --background dark|light")
    return Detection(body, threshold, side, "seen" if line else "not seen", tilt, outline, flanks)


@dataclass(frozen=True)
class BaseLine:
    """Straight line in a picture: row = middle row + tan(tilt) (column - middle column)."""

    tilt: float  # deg; positive: falls to the right
    row: float  # px, at the middle column
    columns: int  # of the outline that lie on it
    error: float  # deg, of the tilt: NEAR over the length of the line


def find_base_line(scene: Mask) -> BaseLine | None:
    """Base line of the largest foreground body; None where neither plate nor lower edge is seen.

    Where both are seen and are parallel, the level is that of the plate, the tilt that of the longer line.
    """
    columns = np.flatnonzero(scene.any(axis=0))
    if columns.size == 0:
        return None
    across = columns + 0.5 - 0.5 * scene.shape[1]
    bottom = (scene.shape[0] - np.argmax(scene[::-1, columns], axis=0)).astype(float)
    is_cut = np.mean(bottom >= scene.shape[0]) > FRAME_SHARE
    lower = None if is_cut else fit_base_line(across, bottom, LOWER_EDGE_SHARE)
    top = np.argmax(scene[:, columns], axis=0).astype(float)
    plate = fit_base_line(across, top, LEAST_SHARE if lower is None else LOWER_PLATE_SHARE)
    if plate is None or lower is None or plate.columns >= lower.columns:
        return plate or lower
    parallel = abs(plate.tilt - lower.tilt) < PARALLEL
    return replace(plate, tilt=lower.tilt, error=lower.error) if parallel else lower


def fit_base_line(across: Floats, row: Floats, least_share: float) -> BaseLine | None:
    """Line that most points lie on and hardly any below; refined by least squares through these points."""
    best = np.zeros(row.size, dtype=bool)
    for tilt in np.arange(-LARGEST_TILT, LARGEST_TILT + 0.5 * TILT_STEP, TILT_STEP):
        on = points_on_line(row * cos(radians(tilt)) - across * sin(radians(tilt)))
        best = on if on.sum() > best.sum() else best
    if best.sum() < max(least_share * row.size, 2.0):
        return None
    slope, middle = np.polyfit(across[best], row[best], 1)
    error = degrees(NEAR / float(np.ptp(across[best])))
    return BaseLine(degrees(atan(float(slope))), float(middle), int(best.sum()), error)


def points_on_line(level: Floats) -> NDArray[np.bool_]:
    """Points within NEAR of the level that most points have, of levels that hardly any point lies below.

    Levels count downwards: the lowest points of the outline have the largest.
    """
    lowest = float(np.quantile(level, 1.0 - BELOW_SHARE))
    counts, edges = np.histogram(level, bins=max(int(np.ceil(np.ptp(level))), 1))
    middle = 0.5 * (edges[1:] + edges[:-1])
    counts = np.where(middle >= lowest - BELOW, counts, 0)
    return np.asarray(np.abs(level - middle[int(np.argmax(counts))]) <= NEAR)


def quadratic_terms(column: Grey, row: Grey) -> tuple[Any, ...]:
    return 1.0, column, row, column**2, row**2, row * column


def largest_foreground_body(grey: Grey, threshold: float, side: Literal["dark", "light"]) -> Mask:
    """Largest body that differs from the background, without specks."""
    different = grey > threshold if side == "dark" else grey <= threshold
    opened = scipy.ndimage.binary_opening(different, structure=silhouette.EIGHT_NEIGHBOURS)
    return silhouette.largest_connected_body(np.asarray(opened, dtype=bool))


def remove_uneven_light(grey: Grey) -> Grey:
    """The picture with uneven light divided out, where that separates the classes better.

    The background is a quadratic in column and row through the upper border of the picture and the sides of
    its upper half, fitted twice, the second time without what is far off (other objects).
    """
    row, column = (np.arange(n) / n for n in grey.shape)
    row, column = row[:, np.newaxis], column[np.newaxis, :]
    outer = np.abs(column - 0.5) > 0.5 - FRAME_COLUMNS
    at = np.nonzero((row < FRAME_ROWS) | (outer & (row < 0.5)))
    at = tuple(index[:: max(1, at[0].size // BORDER_SAMPLES)] for index in at)
    samples = np.column_stack(np.broadcast_arrays(*quadratic_terms(column[0, at[1]], row[at[0], 0])))
    level, inliers = grey[at], np.ones(at[0].size, dtype=bool)
    coefficients = np.zeros(samples.shape[1])
    for _ in range(2):
        coefficients = np.linalg.lstsq(samples[inliers], level[inliers], rcond=None)[0]
        gap = np.abs(level - samples @ coefficients)
        inliers = gap <= 3.0 * max(float(np.median(gap)), 1.0 / GREY_LEVELS)
    light = sum(c * power for c, power in zip(coefficients, quadratic_terms(column, row), strict=True))
    even = np.clip(grey / np.maximum(light, DARKEST) * float(np.median(level[inliers])), 0.0, 1.0)
    return even if otsu_threshold(even)[1] - otsu_threshold(grey)[1] > LIGHT_GAIN else grey


def otsu_threshold(grey: Grey) -> tuple[float, float]:
    """Grey level that separates two classes best, and how well.

    Maximises the between-class variance

        s_B^2(k) = [m_T w(k) - m(k)]^2 / {w(k) [1 - w(k)]}

    with w(k) the share of pixels up to level k, m(k) their first moment, m_T the mean of all; the separation
    is s_B^2 / s_T^2, from 0 to 1.

    Reference: Otsu (1979), IEEE Trans. Syst. Man Cybern. 9, 62, eq. (18) and (15).
    """
    counts, edges = np.histogram(grey, bins=GREY_LEVELS, range=(0.0, 1.0))
    chance, level = counts / grey.size, 0.5 * (edges[1:] + edges[:-1])
    share, moment = np.cumsum(chance), np.cumsum(chance * level)
    within = share * (1.0 - share)
    gap = moment[-1] * share - moment
    between = np.divide(gap**2, within, out=np.zeros(GREY_LEVELS), where=within > 0.0)
    variance = float(chance @ (level - moment[-1]) ** 2)
    best = np.flatnonzero(between >= between.max() * (1.0 - 1e-9))
    # empty levels between two clean classes all serve alike: the middle one leaves room on both sides
    return float(edges[1:][best].mean()), float(between.max()) / variance if variance > 0.0 else 0.0


def background_is_dark_or_light(grey: Grey, threshold: float) -> Literal["dark", "light"]:
    """Background by the upper half of the frame: plate and foot of the heap may fill the lower."""
    upper = grey[: grey.shape[0] // 2]
    frame = np.concatenate([grey[0], upper[:, 0], upper[:, -1]])
    return "dark" if np.median(frame) <= threshold else "light"


def flags_of_detection(detection: Detection) -> list[str]:
    """Flags of the angle; the keys of SENTENCES."""
    flanks, body = detection.fitted_flanks, detection.body
    falling = [flank for flank in flanks if flank.angle > 0.0]
    height = float(detection.outline.height.max())
    raised = {
        "curved": any(silhouette.is_flank_curved(flank.bend, flank.bend_error) for flank in flanks),
        "one_flank": len(flanks) == 1,
        "flat_top": len(falling) == 2
        and silhouette.is_flat_topped(height, silhouette.apex_height_of_flank_lines(*falling), 0.0),
        "cut_by_frame": bool(body[0].any() or body[:, 0].any() or body[:, -1].any()),
    }
    return [flag for flag, is_raised in raised.items() if is_raised]


def angle_measurement(detection: Detection, steadiness: tuple[float, float]) -> Measurement:
    """One angle from the flanks that were found."""
    flanks, flags, tilt = detection.fitted_flanks, flags_of_detection(detection), detection.tilt
    notes = [SENTENCES[flag] for flag in flags]
    if detection.base == "not seen":
        notes.insert(0, "no base line is seen: the lower edge counts as horizontal, a tilt is not corrected")
    if tilt:
        side = "right" if tilt > 0.0 else "left"
        notes.insert(0, f"the base line falls by {abs(tilt):.1f} deg to the {side}: corrected")
    details = {
        "left": detection.flanks[0].angle if detection.flanks[0] else None,
        "right": detection.flanks[1].angle if detection.flanks[1] else None,
        "residual_pixels": float(np.sqrt(np.mean([flank.residual**2 for flank in flanks]))),
        "flags": flags,
    }
    errors = hypot(*(flank.error for flank in flanks)) / len(flanks)
    difference = 0.5 * (flanks[0].angle - flanks[-1].angle)
    sd = hypot(errors, difference, 0.5 * (steadiness[1] - steadiness[0]))
    return Measurement("repose_angle", detection.mean_flank_angle, sd, "deg", 1, tuple(notes), details)
