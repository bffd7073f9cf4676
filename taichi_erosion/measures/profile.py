"""Heaps of scanned profiles: heights over a plate against the distance from the axis, or along a line.

The angle of repose, the height and the radius of 90 % of the volume have the definitions of a simulated heap
(`heap`), so that each profile becomes a row of a table for `study new`. Lengths in the unit of the profile.
"""

import csv
import io
from collections.abc import Iterator, Sequence
from math import atan, degrees, isnan, nan
from pathlib import Path

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import mark_toml, write_atomic
from taichi_erosion.core.setup import Floats
from taichi_erosion.measures.heap import OUTLINE_BINS, RADIUS_SHARE
from taichi_erosion.measures.silhouette import SHOULDER_SHARE, fit_polynomial, heights_of_fit_window
from taichi_erosion.scene.schema.units import conversion_factor, parse_unit
from taichi_erosion.tables.cell_numbers import read_cell
from taichi_erosion.tables.headings import read_heading
from taichi_erosion.tables.number_words import heading, plain
from taichi_erosion.tables.spreadsheet import Cells, read_table_cells

PLACES = ("radius", "distance", "position", "r", "x")  # headings of the column along the profile
HEIGHTS = ("height", "elevation", "h", "z")
MEASURES = ("angle of repose", "pile height", "radius of 90 %")


def sides_of_profile(place: Floats, height: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Distance from the axis and height, outward: one side where the profile begins at its top, or both.

    The axis of a line across the heap is where it halves the area below it.
    """
    order = np.argsort(place)
    place, height = place[order], np.maximum(height[order], 0.0)
    if place[0] >= 0.0 and height[0] > SHOULDER_SHARE * height.max():
        yield place, height
        return
    area = np.append(0.0, np.cumsum(0.5 * (height[1:] + height[:-1]) * np.diff(place)))
    distance = place - np.interp(0.5 * area[-1], area, place)
    for side in (distance[::-1] * -1.0, distance):
        outward = side >= 0.0
        yield side[outward], (height if side is distance else height[::-1])[outward]


def angle_height_and_radius(place: Floats, height: Floats, grain: float = 0.0) -> tuple[float, float, float]:
    """Angle of repose [deg], height, and radius of 90 % of the volume; mean of the sides.

    A line through the points of a side below its top, between max(0.15 H, 1.25 d) and 0.75 H, gives its
    angle. Raises BadInput where no side has three points there, or one ends above them, without a foot.
    """
    low, high = heights_of_fit_window(float(height.max()), grain)
    angles, radii = list[float](), list[float]()
    for distance, heights in sides_of_profile(place, height):
        attached = np.cumsum(heights < low) == 0
        if attached.all():
            raise BadInput(f"ends {heights[-1]:.3g} m above 0; heights count from the plate down to the foot")
        flank = attached & (heights <= high) & (np.arange(heights.size) >= np.argmax(heights))
        if flank.sum() >= OUTLINE_BINS:
            angles.append(degrees(atan(-fit_polynomial(distance[flank], heights[flank], 1).coefficients[1])))
        ring = 0.5 * (heights[1:] * distance[1:] + heights[:-1] * distance[:-1]) * np.diff(distance)
        volume = np.append(0.0, np.cumsum(ring))
        radii.append(float(np.interp(RADIUS_SHARE * volume[-1], volume, distance)))
    if not angles:
        raise BadInput(f"no flank has {OUTLINE_BINS} points between {low:.3g} and {high:.3g}")
    return float(np.mean(angles)), float(height.max()), float(np.mean(radii))


def measure_heap_table(
    path: Path, place: str | None = None, height: str | None = None, grain: float = 0.0
) -> tuple[list[str], list[list[str]]]:
    """Headings and rows of a table with a row for each heap: rows of one heap are alike in all other columns.

    `place` and `height` are headings, `grain` a diameter [m]. Raises BadInput.
    """
    faults = list[str]()
    cells = read_table_cells(path, path.name, faults)
    if faults:
        raise BadInput(*faults)
    chosen = [find_column(cells, place, PLACES, "--place"), find_column(cells, height, HEIGHTS, "--height")]
    units = [read_heading(cells.heading[column]).unit or "1" for column in chosen]
    factor = [conversion_factor(parse_unit(unit), parse_unit("m")) or nan for unit in units]
    if isnan(sum(factor)):
        raise BadInput(f"{path}: '{cells.heading[chosen[isnan(factor[1])]]}' has no unit of length: x [mm]")
    points: dict[tuple[str, ...], list[tuple[float, ...]]] = {}
    for line, row in cells.lines:
        others = tuple(cell for column, cell in enumerate(row) if column not in chosen)
        numbers = tuple(read_cell(row[column], cells.decimal_comma).value for column in chosen)
        if isnan(sum(numbers)):
            raise BadInput(f"{path}: row {line} has no number for a place or a height; leave it out")
        points.setdefault(others, []).append(numbers)
    rows = []
    for others, profile in points.items():
        places, heights = (np.array(profile) * factor).T
        try:
            angle, top, radius = angle_height_and_radius(places, heights, grain)
        except BadInput as error:
            raise BadInput(f"{path}: heap {', '.join(others)}: {error}") from None
        rows.append([*others, plain(angle, 4), *(plain(x / factor[1], 4) for x in (top, radius))])
    names = [heading(name, unit) for name, unit in zip(MEASURES, ("deg", units[1], units[1]), strict=True)]
    return [*(h for k, h in enumerate(cells.heading) if k not in chosen), *names], rows


def write_heap_table(path: Path, source: Path, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Path:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([columns, *rows])
    return write_atomic(path, mark_toml(path, source, text.getvalue()))


def find_column(cells: Cells, choice: str | None, words: Sequence[str], option: str) -> int:
    """The column that is stated, or the one whose name is among some words. Raises BadInput."""
    names = [read_heading(text).name.casefold() for text in cells.heading]
    choices = (choice.casefold(),) if choice else words
    pairs = zip(names, cells.heading, strict=True)
    columns = [k for k, (name, text) in enumerate(pairs) if name in choices or text == choice]
    if len(columns) != 1:
        raise BadInput(f"{cells.file}: {option} 'HEADING' is needed, one of {', '.join(cells.heading)}")
    return columns[0]
