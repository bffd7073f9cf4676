"""Angle of repose from a photograph: binarise, find the base line, extract the boundary, fit both flanks.

Uneven light is divided out and a tilted picture turned before the fit. What cannot be trusted is refused: an
outline that depends on the threshold, flanks that differ or that the outline leaves, a heap too flat for one.

Reference: Hao et al. (2022), angle of repose test; outline and fit are those of simulated silhouettes.
"""

from dataclasses import dataclass
from math import hypot, inf
from pathlib import Path
from typing import Any, Literal

import imageio.v3 as imageio
import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import regular_file
from taichi_erosion.measures import silhouette
from taichi_erosion.measures.base_line import Turn, find_base_line
from taichi_erosion.measures.result import Measurement, as_record
from taichi_erosion.measures.silhouette import Flank, Outline

Grey = NDArray[np.float64]  # [rows, columns], 0 black to 1 white
Background = Literal["auto", "dark", "light"]
Box = tuple[int, int, int, int]  # left, top, right, bottom [px], right and bottom excluded

LUMINANCE = (0.299, 0.587, 0.114)  # of red, green, blue; ITU-R BT.601
GREY_LEVELS = 256
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
SENTENCES = {
    "curved_left": "left flank not straight",
    "curved_right": "right flank not straight",
    "no_left_flank": "left flank too short; the value is the right flank alone",
    "no_right_flank": "right flank too short; the value is the left flank alone",
    "flat_top": "truncated cone: the flanks would meet well above the top",
    "cut_by_frame": "the heap touches the edge of the picture",
}


@dataclass(frozen=True)
class Heap:
    """Foreground above the base line."""

    body: NDArray[np.bool_]  # last row just above the base line
    threshold: float  # grey level between heap and background [1]
    background: Literal["dark", "light"]
    base: Literal["seen", "not seen"]  # whether a base line was found
    turn: Turn  # of the picture, by which its base line became horizontal


@dataclass(frozen=True)
class Detection:
    """A heap with its outline and flanks."""

    heap: Heap
    outline: Outline
    flanks: tuple[Flank | None, Flank | None]

    @property
    def angle(self) -> float:
        """Mean of the flanks that were found [deg]."""
        return float(np.mean([flank.angle for flank in self.flanks if flank is not None]))

    @property
    def axis(self) -> float:
        """Column of the axis in the turned picture [px]."""
        return 0.5 - float(self.outline.position[0])


def measure_photograph(
    path: str | Path, crop: Box | None = None, background: Background = "auto", grain: float = 0.0
) -> dict[str, Any]:
    """Angle of repose of a heap photographed from the side [deg], as a JSON-able record.

    `crop` is (left, top, right, bottom) in pixels; without a visible plate its lower edge is the base.
    `grain` is the diameter in pixels, if known: it keeps a monolayer of rolled-off grains out of the fit. The
    angles are those to the base line. `sd` joins the errors of both fits, the difference of the flanks and
    the change by other thresholds: hypot(hypot(e_l, e_r) / 2, |left - right| / 2, (max - min) / 2). Raises
    BadInput where the picture shows no heap, or where the detection is not certain.
    """
    path = Path(path)
    grey = read_grey(path)
    left, top, right, bottom = box = checked_crop(path, grey, crop)
    calm = evened(scipy.ndimage.median_filter(grey[top:bottom, left:right], size=3))
    found = detect(path, calm, background, grain)
    steadiness = steadiness_of(path, calm, found, grain)
    refuse_uncertain(path, found, steadiness)
    flags = raise_flags(found.heap, found.flanks, float(found.outline.height.max()), grain)
    record = as_record(summarise(found, flags, steadiness))
    record["details"] |= {
        "height_pixels": int(found.outline.height.max()),
        "base_row": top + found.heap.body.shape[0],
        "axis_column": left + found.axis,
        "threshold": found.heap.threshold,
        "background": found.heap.background,
        "base_line": found.heap.base,
        "tilt": found.heap.turn.tilt,
        "crop": list(box),
        "drawing": drawing(found, left, top),
    }
    return record


def detect(
    path: Path, calm: Grey, background: Background, grain: float, threshold: float | None = None
) -> Detection:
    """Heap, outline and flanks; Otsu's threshold unless one is given. Raises BadInput where there is none."""
    heap = find_heap(path, calm, background, threshold)
    outline = silhouette.extract_outline(heap.body, 1.0)
    flanks = silhouette.fit_flanks(outline, grain, max(SHORTEST_FLANK, 3.0 * grain))
    if not any(flanks):
        raise BadInput(f"{path}: no flank found; give --crop around the heap or --background dark|light")
    return Detection(heap, outline, flanks)


def steadiness_of(path: Path, calm: Grey, found: Detection, grain: float) -> tuple[float, float]:
    """Least and largest angle with thresholds to either side of the chosen one; infinite where one fails."""
    dark = float(np.mean(calm[calm <= found.heap.threshold]))
    light = float(np.mean(calm[calm > found.heap.threshold]))
    angles = [found.angle]
    for side in (-THRESHOLD_SHIFT, THRESHOLD_SHIFT):
        moved = found.heap.threshold + side * (light - dark)
        try:
            angles.append(detect(path, calm, found.heap.background, grain, moved).angle)
        except BadInput:
            angles.append(inf)
    return min(angles), max(angles)


def refuse_uncertain(path: Path, found: Detection, steadiness: tuple[float, float]) -> None:
    """Raise BadInput for a detection that cannot be trusted, with the reason."""
    angles = [flank.angle for flank in found.flanks if flank is not None]
    low, high = steadiness
    reason = ""
    if high - low > STEADY:
        span = f"{low:.0f} to {high:.0f} deg" if high < inf else "a heap is lost"
        reason = f"the outline depends on the threshold ({span}): uneven light or a weak contrast"
    elif abs(angles[0] - angles[-1]) > MOST_DIFFERENCE:
        reason = f"the flanks differ, {angles[0]:.0f} and {angles[-1]:.0f} deg: a shadow, or another object"
    elif found.angle < LEAST_ANGLE:
        reason = f"{found.angle:.1f} deg is flatter than any heap of grains"
    elif (share := deviation(found)) > MOST_DEVIATION:
        reason = f"the outline leaves the lines by {share:.0%} of the height: no heap from the side"
    if reason:
        raise BadInput(f"{path}: the detection is not certain: {reason}; give --crop around the heap alone")


def deviation(found: Detection) -> float:
    """Rms distance of outline and fitted lines above the foot, over the height [1]."""
    height = float(found.outline.height.max())
    gaps = []
    for side, flank in zip((-1.0, 1.0), found.flanks, strict=True):
        if flank is None:
            continue
        own = side * found.outline.position >= 0.0
        distance, outline = np.abs(found.outline.position[own]), found.outline.height[own]
        line = np.clip(flank.apex - np.tan(np.radians(flank.angle)) * distance, 0.0, height)
        above = np.maximum(line, outline) > silhouette.FOOT_SHARE * height
        gaps.append(outline[above] - line[above])
    return float(np.sqrt(np.mean(np.concatenate(gaps) ** 2))) / height


def drawing(found: Detection, left: int, top: int) -> dict[str, Any]:
    """What was detected, in pixels (column, row) of the photograph: outline, base line, fitted lines."""
    base, axis, position = found.heap.body.shape[0], found.axis, found.outline.position

    def there(points: Any) -> list[list[float]]:
        placed = found.heap.turn.back(np.asarray(points, dtype=float)) + np.array([left, top])
        return [[round(float(column), 2), round(float(row), 2)] for column, row in placed]

    covered = np.flatnonzero(found.outline.height > 0.0)
    drawn = covered[:: max(1, covered.size // DRAWN_POINTS)]
    lines = {}
    for name, side, flank in zip(("left", "right"), (-1.0, 1.0), found.flanks, strict=True):
        if flank is not None:
            fall = float(np.tan(np.radians(flank.angle)))
            ends = [(axis + side * r, base - flank.apex + fall * r) for r in (flank.start, flank.end)]
            lines[name] = there(ends)
    width = found.heap.body.shape[1]
    outline = np.column_stack([axis + position[drawn], base - found.outline.height[drawn]])
    return {"outline": there(outline), "base": there([(0.0, base), (width, base)])} | lines


def read_grey(path: Path) -> Grey:
    """Luminance of a picture, 0 to 1, turned upright; its opacity where the picture is partly transparent."""
    try:
        picture = np.asarray(imageio.imread(regular_file(path), plugin="pillow", index=0, rotate=True))
    except FileNotFoundError as error:
        raise BadInput(f"{path}: no such file") from error
    except Exception as error:  # decoders raise whatever a damaged file makes them raise
        raise BadInput(f"{path}: not a readable PNG or JPEG picture") from error
    return grey_levels(picture)


def grey_levels(picture: NDArray[Any]) -> Grey:
    """One channel between 0 and 1 from grey, grey with opacity, colour, or colour with opacity."""
    full = 1.0 if picture.dtype.kind in "bf" else float(np.iinfo(picture.dtype).max)
    levels = picture.astype(float) / full
    if levels.ndim == 2:
        return levels
    channels = levels.shape[2]
    if channels in (2, 4) and levels[..., -1].min() < levels[..., -1].max():
        return levels[..., -1]
    return levels[..., 0] if channels <= 2 else levels[..., :3] @ np.asarray(LUMINANCE)


def checked_crop(path: Path, grey: Grey, crop: Box | None) -> Box:
    """The crop, or the whole picture, after asking whether a heap fits in it."""
    rows, columns = grey.shape
    left, top, right, bottom = crop or (0, 0, columns, rows)
    if not (0 <= left < right <= columns and 0 <= top < bottom <= rows):
        raise BadInput(f"{path}: crop {left},{top},{right},{bottom} is not a box within 0,0,{columns},{rows}")
    if min(right - left, bottom - top) < SMALLEST_SIDE:
        raise BadInput(
            f"{path}: {right - left} x {bottom - top} pixels to look at; at least {SMALLEST_SIDE} each way"
        )
    return left, top, right, bottom


def find_heap(path: Path, grey: Grey, background: Background, threshold: float | None = None) -> Heap:
    """Binarise, find the base line, turn the picture by its tilt, and keep the body above the line."""
    chosen, separation = otsu_threshold(grey)
    if separation < SEPARATION_AT_LEAST:
        raise BadInput(f"{path}: no heap: nothing stands out from the background")
    threshold = chosen if threshold is None else threshold
    side = border_side(grey, threshold) if background == "auto" else background
    scene = foreground(grey, threshold, side)
    line, turn = find_base_line(scene), Turn(0.0, grey.shape)
    if line is not None and abs(line.tilt) > max(TILT_SEEN, line.error):
        turn = Turn(line.tilt, grey.shape)
        scene = foreground(turn.picture(grey), threshold, side)
        line = find_base_line(scene)
    base = plate_row(scene) if line is None else min(max(round(line.row), 1), scene.shape[0])
    if base < LOWEST_HEAP:
        raise BadInput(f"{path}: no heap: the foreground is as wide at its top as at its foot")
    body = silhouette.largest_body(scene[:base])
    height = base - int(np.argmax(body.any(axis=1)))
    if not body.any() or height < LOWEST_HEAP:
        raise BadInput(f"{path}: no heap: nothing rises {LOWEST_HEAP} pixels above the base at row {base}")
    return Heap(body, threshold, side, "not seen" if line is None else "seen", turn)


def powers_of(column: Grey, row: Grey) -> tuple[Any, ...]:
    """Terms of a quadratic in column and row."""
    return 1.0, column, row, column**2, row**2, row * column


def foreground(grey: Grey, threshold: float, side: Literal["dark", "light"]) -> NDArray[np.bool_]:
    """Largest body that differs from the background, without specks."""
    different = grey > threshold if side == "dark" else grey <= threshold
    opened = scipy.ndimage.binary_opening(different, structure=silhouette.EIGHT_NEIGHBOURS)
    return silhouette.largest_body(np.asarray(opened, dtype=bool))


def evened(grey: Grey) -> Grey:
    """The picture with uneven light divided out, where that separates the classes better.

    The background is a quadratic in column and row through the upper border of the picture and the sides of
    its upper half, fitted twice, the second time without what is far off (other objects).
    """
    rows, columns = grey.shape
    row, column = np.arange(rows)[:, np.newaxis] / rows, np.arange(columns)[np.newaxis, :] / columns
    outer = (column < FRAME_COLUMNS) | (column > 1.0 - FRAME_COLUMNS)
    at = np.nonzero((row < FRAME_ROWS) | (outer & (row < 0.5)))
    at = tuple(index[:: max(1, at[0].size // BORDER_SAMPLES)] for index in at)
    samples, level = (
        np.stack(np.broadcast_arrays(*powers_of(at[1] / columns, at[0] / rows)), axis=-1),
        grey[at],
    )
    kept = np.ones(level.size, dtype=bool)
    coefficients = np.zeros(samples.shape[-1])
    for _ in range(2):
        coefficients = np.linalg.lstsq(samples[kept], level[kept], rcond=None)[0]
        gap = np.abs(level - samples @ coefficients)
        kept = gap <= 3.0 * max(float(np.median(gap)), 1.0 / GREY_LEVELS)
    light = np.maximum(
        sum(c * power for c, power in zip(coefficients, powers_of(column, row), strict=True)), DARKEST
    )
    even = np.clip(grey / light * float(np.median(level[kept])), 0.0, 1.0)
    gain = otsu_threshold(even)[1] - otsu_threshold(grey)[1]
    return even if gain > LIGHT_GAIN else grey


def otsu_threshold(grey: Grey) -> tuple[float, float]:
    """Grey level that separates two classes best, and how well.

    Maximises the between-class variance

        s_B^2(k) = [m_T w(k) - m(k)]^2 / {w(k) [1 - w(k)]}

    with w(k) the share of pixels up to level k, m(k) their first moment, m_T the mean of all; the separation
    is s_B^2 / s_T^2, from 0 to 1.

    Reference: Otsu (1979), IEEE Trans. Syst. Man Cybern. 9, 62, eq. (18) and (15).
    """
    counts, edges = np.histogram(grey, bins=GREY_LEVELS, range=(0.0, 1.0))
    level = 0.5 * (edges[1:] + edges[:-1])
    share = np.cumsum(counts) / grey.size
    moment = np.cumsum(counts * level) / grey.size
    within = share * (1.0 - share)
    between = np.divide(
        (moment[-1] * share - moment) ** 2, within, out=np.zeros(GREY_LEVELS), where=within > 0.0
    )
    variance = float(np.sum(counts * (level - moment[-1]) ** 2)) / grey.size
    best = np.flatnonzero(between >= between.max() * (1.0 - 1e-9))
    # empty levels between two clean classes all serve alike: the middle one leaves room on both sides
    threshold = float(edges[1:][best].mean())
    return threshold, float(between.max()) / variance if variance > 0.0 else 0.0


def border_side(grey: Grey, threshold: float) -> Literal["dark", "light"]:
    """Background by the upper half of the frame: plate and foot of the heap may fill the lower."""
    upper = grey[: grey.shape[0] // 2]
    frame = np.concatenate([grey[0], upper[:, 0], upper[:, -1]])
    return "dark" if np.median(frame) <= threshold else "light"


def plate_row(scene: NDArray[np.bool_]) -> int:
    """Row just below the foot of the heap: the highest one almost as wide as the widest.

    A plate or table that belongs to the foreground is wider than the heap at once; without one the widest row
    is the foot itself, and the base lies 3 % of the height too high, which moves only the limits of the fit.
    """
    width = scene.sum(axis=1)
    return int(np.argmax(width >= PLATE_SHARE * width.max()))


def raise_flags(
    heap: Heap, flanks: tuple[Flank | None, Flank | None], height: float, grain: float
) -> list[str]:
    """Flags of the angle; the keys of SENTENCES."""
    left, right = flanks
    raised = {
        "curved_left": left is not None and silhouette.is_bent(left.bend, left.bend_error),
        "curved_right": right is not None and silhouette.is_bent(right.bend, right.bend_error),
        "no_left_flank": left is None,
        "no_right_flank": right is None,
        "flat_top": left is not None
        and right is not None
        and min(left.angle, right.angle) > 0.0
        and silhouette.is_flat_topped(height, silhouette.meeting_height(left, right), grain),
        "cut_by_frame": bool(heap.body[0].any() or heap.body[:, 0].any() or heap.body[:, -1].any()),
    }
    return [flag for flag, is_raised in raised.items() if is_raised]


def summarise(found: Detection, flags: list[str], steadiness: tuple[float, float]) -> Measurement:
    """One angle from the flanks that were found."""
    flanks = [flank for flank in found.flanks if flank is not None]
    angles = [flank.angle for flank in flanks]
    errors = hypot(*(flank.error for flank in flanks)) / len(flanks)
    spread = 0.5 * (steadiness[1] - steadiness[0])
    details = {
        "left": found.flanks[0].angle if found.flanks[0] else None,
        "right": found.flanks[1].angle if found.flanks[1] else None,
        "residual_pixels": float(np.sqrt(np.mean([flank.residual**2 for flank in flanks]))),
        "flags": flags,
    }
    tilt = found.heap.turn.tilt
    turned = f"the base line falls by {abs(tilt):.1f} deg to the {'right' if tilt > 0 else 'left'}: corrected"
    notes = [turned] if tilt else []
    if found.heap.base == "not seen":
        notes.append("no base line is seen: the lower edge counts as horizontal, and a tilt is not corrected")
    notes += [SENTENCES[flag] for flag in flags]
    sd = hypot(errors, 0.5 * (angles[0] - angles[-1]), spread)
    return Measurement("repose_angle", found.angle, sd, "deg", 1, tuple(notes), details)
