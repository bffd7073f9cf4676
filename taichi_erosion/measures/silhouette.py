"""Side silhouette of a heap of spheres, as a distant camera sees it, and the outline of any silhouette.

The published procedure binarises an image, extracts the boundary and fits the edge; here the image is drawn
from the snapshot, and everything after it serves photographs alike.

Reference: Hao et al. (2022), angle of repose test (binarisation, boundary extraction, edge fitting).
"""

from dataclasses import dataclass
from math import cos, sin, sqrt

import numpy as np
import scipy
from numpy.typing import NDArray

from taichi_erosion.core.setup import Floats
from taichi_erosion.measures.flank import Outline

Image = NDArray[np.bool_]  # [rows, columns], first row on top, lower edge of the last row on the base

PIXELS_PER_GRAIN = 8  # across one diameter: an edge is off by at most d / 8 [1]
FRAME_RADII = 2.0  # half width of the picture over the 90 % quantile of distance; a cone ends at 1.55 [1]
PIXELS_AT_MOST = 4_000_000  # a larger picture is drawn with larger pixels [1]
EIGHT_NEIGHBOURS = np.ones((3, 3), dtype=bool)


@dataclass(frozen=True)
class Silhouette:
    """Binary picture of a heap."""

    image: Image
    pixel: float  # m
    left: float  # m, left edge of the picture, along its horizontal, from the origin


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


def largest_body(image: Image) -> Image:
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
