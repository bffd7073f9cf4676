"""Side silhouette of a heap, its outline, and the straight flanks fitted to the outline.

The published procedure binarises an image, extracts the boundary and fits the edge. Here the image is drawn
from a snapshot, as a distant camera sees it; everything after that serves photographs alike, and lengths are
in the unit of the outline (m or pixels).

Reference: Hao et al. (2022), angle of repose test (binarisation, boundary extraction, edge fitting).
"""

from dataclasses import dataclass
from math import atan, cos, degrees, inf, sin, sqrt

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from taichi_erosion.core.setup import Floats

Image = NDArray[np.bool_]  # [rows, columns], first row on top, lower edge of the last row on the base

PIXELS_PER_GRAIN = 8  # across one diameter: an edge is off by at most d / 8 [1]
FRAME_RADII = 2.0  # half width of the picture over the 90 % quantile of distance; a cone ends at 1.55 [1]
PIXELS_AT_MOST = 4_000_000  # a larger picture is drawn with larger pixels [1]
EIGHT_NEIGHBOURS = np.ones((3, 3), dtype=bool)
FOOT_SHARE = 0.15  # of the height H: below it lies the foot [1]; lab_C
FOOT_GRAINS = 1.25  # grain diameters: below it lies a monolayer of rolled-off grains, not flank [1]; lab_C
SHOULDER_SHARE = 0.75  # of the height H: above it lies the rounded top [1]; lab_C
BEND_LIMIT = 5.0  # deg: a flank that bends less has one angle within a few sd of repeats (0.6 deg, lab_C)
BEND_ERRORS = 3.0  # standard errors a bend must exceed to be believed [1]
FLAT_TOP_SHARE = 0.2  # of the height at which the flanks would meet: more missing is no rounding [1]
FLAT_TOP_GRAINS = 1.5  # diameters: a cone of grains lacks one by its graininess alone [1]


@dataclass(frozen=True)
class Silhouette:
    """Binary picture of a heap."""

    image: Image
    pixel: float  # m
    left: float  # m, left edge of the picture, along its horizontal, from the origin


@dataclass(frozen=True)
class Outline:
    """Upper edge of a silhouette, column by column."""

    position: Floats  # of the column centres, from the axis (median column of the silhouette)
    height: Floats  # of the highest foreground above the base, 0 where there is none
    pixel: float  # width of a column


def draw_silhouette(
    position: Floats, radius: Floats, azimuth: float, base_height: float, grain: float
) -> Silhouette:
    """Project spheres on the vertical plane through the horizontal direction (cos azimuth, sin azimuth).

    `position` [n, 3] and `radius` [n] in m, `azimuth` in rad, `grain` the diameter in m that sets the pixel
    (d / 8). The picture frames the heap: grains that ran far away are out of sight.
    """
    across = position[:, 0] * cos(azimuth) + position[:, 1] * sin(azimuth)
    height = position[:, 2] - base_height
    middle = float(np.median(across))
    half_width = FRAME_RADII * float(np.quantile(np.abs(across - middle), 0.9)) + grain
    top = max(float((height + radius).max()), grain)
    pixel = max(grain / PIXELS_PER_GRAIN, sqrt(2.0 * half_width * top / PIXELS_AT_MOST))
    shape = (int(np.ceil(top / pixel)) + 1, int(np.ceil(2.0 * half_width / pixel)))
    left = middle - 0.5 * shape[1] * pixel
    discs = np.stack([across - left, height, radius]) / pixel
    return Silhouette(fill_discs(discs, shape)[::-1], pixel, left)


def fill_discs(discs: Floats, shape: tuple[int, int]) -> Image:
    """Pixels covered by any disc, row 0 low; rows of `discs`: horizontal and vertical centre, radius [px].

    Each column of a disc is a vertical span. Spans enter as +1 at their foot and -1 above their head, and a
    running sum upwards fills them all at once, so the cost is the perimeter of the discs, not their area.
    """
    rows, columns = shape
    across, up, radius = discs
    first = np.maximum(np.ceil(across - radius - 0.5).astype(np.int64), 0)
    last = np.minimum(np.floor(across + radius - 0.5).astype(np.int64), columns - 1)
    count = np.maximum(last - first + 1, 0)
    disc = np.repeat(np.arange(count.size), count)
    column = np.arange(disc.size) - np.repeat(np.cumsum(count) - count, count) + first[disc]
    chord = np.sqrt(np.maximum(radius[disc] ** 2 - (column + 0.5 - across[disc]) ** 2, 0.0))
    foot = np.clip(np.floor(up[disc] - chord).astype(np.int64), 0, rows)
    head = np.clip(np.ceil(up[disc] + chord).astype(np.int64), 0, rows)
    cells = (rows + 1) * columns
    steps = np.bincount(foot * columns + column, minlength=cells).astype(np.int32)
    steps -= np.bincount(head * columns + column, minlength=cells).astype(np.int32)
    return np.cumsum(steps.reshape(rows + 1, columns)[:rows], axis=0) > 0


def largest_connected_body(image: Image) -> Image:
    """Largest connected foreground with holes filled: detached specks and flying grains are not heap."""
    filled = scipy.ndimage.binary_fill_holes(image)
    labels = np.zeros(image.shape, dtype=np.int32)
    scipy.ndimage.label(filled, structure=EIGHT_NEIGHBOURS, output=labels)
    sizes = np.bincount(labels.ravel(), minlength=2)
    return labels == 1 + int(np.argmax(sizes[1:]))


def extract_outline(body: Image, pixel: float) -> Outline:
    """Highest foreground pixel of every column, about the median column of the foreground."""
    rows, columns = body.shape
    covered = body.sum(axis=0)
    height = np.where(covered > 0, rows - np.argmax(body, axis=0), 0).astype(float)
    axis = float(np.searchsorted(np.cumsum(covered), 0.5 * covered.sum())) + 0.5
    return Outline((np.arange(columns) + 0.5 - axis) * pixel, height * pixel, pixel)


@dataclass(frozen=True)
class Flank:
    """Straight line height = apex - tan(angle) distance, `distance` counted outward from the axis."""

    angle: float  # deg
    error: float  # deg, standard error of the angle from the scatter about the line
    apex: float  # height of the line at the axis
    start: float  # distance of the innermost column used
    end: float  # distance of the outermost column used
    residual: float  # rms distance in height between outline and line
    bend: float  # deg, inner minus outer end angle of the parabola through the same columns; > 0: concave
    bend_error: float  # deg

    def at(self, distance: ArrayLike) -> Floats:
        """Height of the line at distances from the axis."""
        return self.apex - np.tan(np.radians(self.angle)) * np.asarray(distance)


@dataclass(frozen=True)
class Polynomial:
    """Least-squares polynomial sum_k c_k t^k."""

    coefficients: Floats
    errors: Floats  # standard errors, widened for neighbouring columns that show the same grain
    residual: float  # rms


def heights_of_fit_window(height: float, grain: float) -> tuple[float, float]:
    """Heights between which a flank is fitted: max(0.15 H, 1.25 d) and 0.75 H; d = 0 where unknown."""
    return max(FOOT_SHARE * height, FOOT_GRAINS * grain), SHOULDER_SHARE * height


def fit_flanks(outline: Outline, grain: float, least_length: float) -> tuple[Flank | None, Flank | None]:
    """Left and right flank of an outline; None where less than `least_length` of it lies in the window."""
    left, right = outline.position < 0.0, outline.position >= 0.0
    window = heights_of_fit_window(float(outline.height.max()), grain)
    bridge = max(1, round(grain / outline.pixel))
    x, z = outline.position, outline.height
    sides = (-x[left][::-1], z[left][::-1]), (x[right], z[right])
    least = max(4, round(least_length / outline.pixel))
    flanks = []
    for distance, height in sides:
        columns = flank_columns(distance, height, window, bridge)
        flanks.append(fit_flank(distance[columns], height[columns]) if columns.sum() >= least else None)
    return flanks[0], flanks[1]


def flank_columns(
    distance: Floats, height: Floats, window: tuple[float, float], bridge: int
) -> NDArray[np.bool_]:
    """Columns of one side, given from the axis outward, that belong to its flank.

    The flank ends where the outline first falls below the window, gaps narrower than `bridge` columns (one
    grain) excepted. The final choice asks for the height of the fitted line, not of the column itself:
    columns chosen by their own noisy height flatten a fit of that height.
    """
    low, high = window
    below = np.flatnonzero(scipy.ndimage.grey_closing(height, size=bridge) < low)
    attached = np.arange(height.size) < (below[0] if below.size else height.size)
    chosen = attached & (height >= low) & (height <= high)
    if chosen.sum() < 2:
        return chosen
    slope, apex = np.polyfit(distance[chosen], height[chosen], 1)
    line = apex + slope * distance
    return attached & (line >= low) & (line <= high)


def fit_flank(distance: Floats, height: Floats) -> Flank:
    """Line and parabola through the columns of one flank."""
    middle, half = 0.5 * (distance[0] + distance[-1]), 0.5 * (distance[-1] - distance[0])
    t = (distance - middle) / half
    line, parabola = fit_polynomial(t, height, 1), fit_polynomial(t, height, 2)
    slope = line.coefficients[1] / half
    _, b, c = parabola.coefficients / half
    narrowing = 1.0 / (1.0 + slope**2)  # d(atan s) = ds / (1 + s^2)
    return Flank(
        angle=degrees(atan(-slope)),
        error=degrees(line.errors[1] / half * narrowing),
        apex=float(line.coefficients[0] - slope * middle),
        start=float(distance[0]),
        end=float(distance[-1]),
        residual=line.residual,
        bend=degrees(atan(-(b - 2.0 * c)) - atan(-(b + 2.0 * c))),
        bend_error=degrees(4.0 * parabola.errors[2] / half * narrowing),
    )


def fit_polynomial(t: Floats, height: Floats, degree: int, weight: Floats | None = None) -> Polynomial:
    """Weighted least squares with errors for serially correlated residuals; each point weighs 1 unless told.

    Neighbouring columns show the same grain. With lag-one correlation r of the residuals, n columns are worth
    m = n (1 - r) / (1 + r) independent ones, and

        cov(c) = RSS / (m - degree - 1) (V^T W V)^-1

    with V the matrix of powers of t, W the weights (mean 1) and RSS the weighted sum of squared residuals;
    infinite where m leaves no freedom.

    Reference: Bayley & Hammersley (1946), J. R. Stat. Soc. Suppl. 8, 184 (effective number of a first-order
    autoregressive series).
    """
    root = np.ones(t.size) if weight is None else np.sqrt(weight / np.mean(weight))
    powers = np.vander(t, degree + 1, increasing=True) * root[:, np.newaxis]
    coefficients = np.asarray(np.linalg.lstsq(powers, height * root, rcond=None)[0], dtype=float)
    residual = height * root - powers @ coefficients
    squares = float(residual @ residual)
    correlation = max(0.0, float(residual[1:] @ residual[:-1]) / squares) if squares > 0.0 else 0.0
    freedom = t.size * (1.0 - correlation) / (1.0 + correlation) - degree - 1
    variance = squares / freedom if freedom > 0.0 else inf
    spread = np.sqrt(np.diag(np.linalg.inv(powers.T @ powers)))
    return Polynomial(coefficients, sqrt(variance) * spread, sqrt(squares / t.size))


def apex_height_of_flank_lines(left: Flank, right: Flank) -> float:
    """Height at which the two lines meet: the apex the heap would have, were it a cone up to its top."""
    fall_left, fall_right = np.tan(np.radians((left.angle, right.angle)))
    return float((left.apex * fall_right + right.apex * fall_left) / (fall_left + fall_right))


def is_flank_curved(bend: float, error: float) -> bool:
    """Whether a flank is curved beyond doubt and by a size that matters; not where the error is NaN."""
    return abs(bend) > BEND_LIMIT and abs(bend) > BEND_ERRORS * error


def is_flat_topped(height: float, meeting: float, grain: float) -> bool:
    """Whether the heap is a truncated cone: its flanks would meet well above its top."""
    return meeting - height > max(FLAT_TOP_SHARE * meeting, FLAT_TOP_GRAINS * grain)
