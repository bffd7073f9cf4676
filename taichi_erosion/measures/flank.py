"""The flank of a heap: a straight line through its outline, and whether that line is deserved.

Simulated silhouettes and photographs share these functions; lengths are in the unit of the outline (m or
pixels).
"""

from dataclasses import dataclass
from math import atan, degrees, inf, sqrt

import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_erosion.core.setup import Floats

FOOT_SHARE = 0.15  # of the height H: below it lies the foot [1]; lab_C
FOOT_GRAINS = 1.25  # grain diameters: below it lies a monolayer of rolled-off grains, not flank [1]; lab_C
SHOULDER_SHARE = 0.75  # of the height H: above it lies the rounded top [1]; lab_C
BEND_LIMIT = 5.0  # deg: a flank that bends less has one angle within a few sd of repeats (0.6 deg, lab_C)
BEND_ERRORS = 3.0  # standard errors a bend must exceed to be believed [1]
FLAT_TOP_SHARE = 0.2  # of the height at which the flanks would meet: more missing is no rounding [1]
FLAT_TOP_GRAINS = 1.5  # diameters: a cone of grains lacks one by its graininess alone [1]


@dataclass(frozen=True)
class Outline:
    """Upper edge of a silhouette, column by column."""

    position: Floats  # of the column centres, from the axis (median column of the silhouette)
    height: Floats  # of the highest foreground above the base, 0 where there is none
    pixel: float  # width of a column


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


@dataclass(frozen=True)
class Polynomial:
    """Least-squares polynomial sum_k c_k t^k."""

    coefficients: Floats
    errors: Floats  # standard errors, widened for neighbouring columns that show the same grain
    residual: float  # rms


def fit_window(height: float, grain: float) -> tuple[float, float]:
    """Heights between which a flank is fitted: max(0.15 H, 1.25 d) and 0.75 H; d = 0 where unknown."""
    return max(FOOT_SHARE * height, FOOT_GRAINS * grain), SHOULDER_SHARE * height


def fit_flanks(outline: Outline, grain: float, least_length: float) -> tuple[Flank | None, Flank | None]:
    """Left and right flank of an outline; None where less than `least_length` of it lies in the window."""
    left, right = outline.position < 0.0, outline.position >= 0.0
    window = fit_window(float(outline.height.max()), grain)
    bridge = max(1, round(grain / outline.pixel))
    sides = (
        (-outline.position[left][::-1], outline.height[left][::-1]),
        (outline.position[right], outline.height[right]),
    )
    least = max(4, round(least_length / outline.pixel))
    chosen = [flank_columns(distance, height, window, bridge) for distance, height in sides]
    flanks = [
        fit_flank(distance[columns], height[columns]) if columns.sum() >= least else None
        for (distance, height), columns in zip(sides, chosen, strict=True)
    ]
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


def meeting_height(left: Flank, right: Flank) -> float:
    """Height at which the two lines meet: the apex the heap would have, were it a cone up to its top."""
    fall_left, fall_right = np.tan(np.radians((left.angle, right.angle)))
    return float((left.apex * fall_right + right.apex * fall_left) / (fall_left + fall_right))


def is_bent(bend: float, error: float) -> bool:
    """Whether a flank is curved beyond doubt and by a size that matters; not where the error is NaN."""
    return abs(bend) > BEND_LIMIT and abs(bend) > BEND_ERRORS * error


def is_flat_topped(height: float, meeting: float, grain: float) -> bool:
    """Whether the heap is a truncated cone: its flanks would meet well above its top."""
    return meeting - height > max(FLAT_TOP_SHARE * meeting, FLAT_TOP_GRAINS * grain)
