"""Angle of repose from a photograph: binarise, find the plate, extract the boundary, fit both flanks.

Reference: Hao et al. (2022), angle of repose test; outline and fit are those of simulated silhouettes.
"""

from dataclasses import dataclass
from math import hypot
from pathlib import Path
from typing import Any, Literal

import imageio.v3 as imageio
import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import regular_file
from taichi_erosion.measures import silhouette
from taichi_erosion.measures.result import Measurement, as_record
from taichi_erosion.measures.silhouette import Flank

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
    """Foreground above the plate."""

    body: NDArray[np.bool_]  # last row just above the plate
    threshold: float  # grey level between heap and background [1]
    background: Literal["dark", "light"]


def measure_photograph(
    path: str | Path, crop: Box | None = None, background: Background = "auto", grain: float = 0.0
) -> dict[str, Any]:
    """Angle of repose of a heap photographed from the side [deg], as a JSON-able record.

    `crop` is (left, top, right, bottom) in pixels; without a visible plate its lower edge is the base.
    `grain` is the diameter in pixels, if known: it keeps a monolayer of rolled-off grains out of the fit. The
    value is the mean of the flanks, which cancels a camera tilted about its line of sight; `sd` joins the
    errors of both fits with the difference of the flanks, hypot(hypot(e_l, e_r) / 2, |left - right| / 2).
    """
    grey = read_grey(Path(path))
    left, top, right, bottom = box = checked_crop(Path(path), grey, crop)
    heap = find_heap(Path(path), grey[top:bottom, left:right], background)
    outline = silhouette.extract_outline(heap.body, 1.0)
    flanks = silhouette.fit_flanks(outline, grain, max(SHORTEST_FLANK, 3.0 * grain))
    if not any(flanks):
        raise BadInput(f"{path}: no flank found; give --crop around the heap or --background dark|light")
    flags = raise_flags(heap, flanks, float(outline.height.max()), grain)
    record = as_record(summarise(flanks, flags))
    record["details"] |= {
        "height_pixels": int(outline.height.max()),
        "base_row": top + heap.body.shape[0],
        "axis_column": left - float(outline.position[0]) + 0.5,
        "threshold": heap.threshold,
        "background": heap.background,
        "crop": list(box),
    }
    return record


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


def find_heap(path: Path, grey: Grey, background: Background) -> Heap:
    """Binarise, find the plate and keep the largest body above it."""
    calm = scipy.ndimage.median_filter(grey, size=3)
    threshold, separation = otsu_threshold(calm)
    if separation < SEPARATION_AT_LEAST:
        raise BadInput(f"{path}: no heap: nothing stands out from the background")
    side = border_side(calm, threshold) if background == "auto" else background
    foreground = calm > threshold if side == "dark" else calm <= threshold
    scene = silhouette.largest_body(
        np.asarray(
            scipy.ndimage.binary_opening(foreground, structure=silhouette.EIGHT_NEIGHBOURS), dtype=bool
        )
    )
    base = plate_row(scene)
    if base < LOWEST_HEAP:
        raise BadInput(f"{path}: no heap: the foreground is as wide at its top as at its foot")
    body = silhouette.largest_body(scene[:base])
    height = base - int(np.argmax(body.any(axis=1)))
    if not body.any() or height < LOWEST_HEAP:
        raise BadInput(f"{path}: no heap: nothing rises {LOWEST_HEAP} pixels above the base at row {base}")
    return Heap(body, threshold, side)


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


def summarise(flanks: tuple[Flank | None, Flank | None], flags: list[str]) -> Measurement:
    """One angle from the flanks that were found."""
    found = [flank for flank in flanks if flank is not None]
    angles = [flank.angle for flank in found]
    errors = hypot(*(flank.error for flank in found)) / len(found)
    difference = angles[0] - angles[-1]
    details = {
        "left": flanks[0].angle if flanks[0] else None,
        "right": flanks[1].angle if flanks[1] else None,
        "residual_pixels": float(np.sqrt(np.mean([flank.residual**2 for flank in found]))),
        "flags": flags,
    }
    notes = tuple(SENTENCES[flag] for flag in flags)
    return Measurement(
        "repose_angle", float(np.mean(angles)), hypot(errors, 0.5 * difference), "deg", 1, notes, details
    )
