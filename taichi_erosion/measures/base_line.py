"""Base line of a heap in a binary picture: the plate beside the heap, or the lower edge of the heap.

The line is found by a Hough transform over small tilts: of all lines below which hardly any point of the
outline lies, the one with most points on it. Its tilt is that of the camera about its line of sight, or of
the plate.

Reference: Duda & Hart (1972), Commun. ACM 15, 11 (lines in pictures by angle and distance).
"""

from dataclasses import dataclass, replace
from math import atan, cos, degrees, radians, sin

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Floats
from taichi_erosion.measures.silhouette import Image

LARGEST_TILT = 15.0  # deg; beyond it a base line is not told from a flat flank
TILT_STEP = 0.25  # deg, of the search
NEAR = 1.5  # px from the line within which a point lies on it
BELOW = 3.0  # px under the line from which a point lies below it
BELOW_SHARE = 0.03  # of the columns that may lie below: dust, corners
LEAST_SHARE = 0.03  # of the columns that must lie on a line of the plate
PLATE_SHARE = 0.1  # the same where a lower edge is seen: the foot of a heap alone looks like a short plate
LOWER_EDGE_SHARE = 0.5  # of the columns that must lie on a line of the lower edge
PARALLEL = 2.0  # deg between plate and lower edge, within which they are one object
FRAME_SHARE = 0.5  # of the columns that reach the frame, from which the lower edge is that of the picture


@dataclass(frozen=True)
class BaseLine:
    """Straight line in a picture: row = middle row + tan(tilt) (column - middle column)."""

    tilt: float  # deg; positive: falls to the right
    row: float  # px, at the middle column
    columns: int  # of the outline that lie on it
    error: float  # deg, of the tilt: NEAR over the length of the line


def find_base_line(scene: Image) -> BaseLine | None:
    """Base line of the largest foreground body; None where neither plate nor lower edge is seen.

    Where both are seen and are parallel, the level is that of the plate, the tilt that of the longer line.
    """
    columns = np.flatnonzero(scene.any(axis=0))
    if columns.size == 0:
        return None
    across = columns + 0.5 - 0.5 * scene.shape[1]
    bottom = (scene.shape[0] - np.argmax(scene[::-1, columns], axis=0)).astype(float)
    is_cut = np.mean(bottom >= scene.shape[0]) > FRAME_SHARE
    lower = None if is_cut else best_line(across, bottom, LOWER_EDGE_SHARE)
    top = np.argmax(scene[:, columns], axis=0).astype(float)
    plate = best_line(across, top, LEAST_SHARE if lower is None else PLATE_SHARE)
    if plate is None or lower is None or plate.columns >= lower.columns:
        return plate or lower
    return (
        replace(plate, tilt=lower.tilt, error=lower.error)
        if abs(plate.tilt - lower.tilt) < PARALLEL
        else lower
    )


def best_line(across: Floats, row: Floats, least_share: float) -> BaseLine | None:
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


@dataclass(frozen=True)
class Turn:
    """Rotation of a picture about its middle, by which a base line of this tilt becomes horizontal."""

    tilt: float  # deg
    shape: tuple[int, int]  # rows and columns

    @property
    def matrix(self) -> Floats:
        """Row and column in the picture from row and column in the turned one, both from the middle."""
        c, s = cos(radians(self.tilt)), sin(radians(self.tilt))
        return np.array([[c, s], [-s, c]])

    def picture(self, grey: Floats) -> Floats:
        """The turned picture; its corners repeat the nearest pixel."""
        from scipy.ndimage import affine_transform

        if not self.tilt:
            return grey
        middle = 0.5 * (np.array(self.shape) - 1.0)
        offset = middle - self.matrix @ middle
        turned = affine_transform(grey, self.matrix, offset.tolist(), order=1, mode="nearest")  # pyright: ignore[reportArgumentType]
        return np.asarray(turned)

    def back(self, points: Floats) -> Floats:
        """Points (column, row) of the picture from points of the turned one [..., 2]."""
        middle = 0.5 * np.array(self.shape[::-1])
        turned = (points - middle)[..., ::-1] @ self.matrix.T
        return turned[..., ::-1] + middle

    def level(self, line: BaseLine) -> float:
        """Row of a base line of this tilt in the turned picture."""
        rise = line.row - 0.5 * self.shape[0]
        return 0.5 * self.shape[0] + rise * cos(radians(self.tilt)) if self.tilt else line.row
