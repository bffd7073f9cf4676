"""The table of how an angle of repose depends on the size of its heap."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from doe.common.cases import Row, read_rows
from taichi_erosion.core.files import write_atomic
from taichi_erosion.measures.silhouette import fit_window
from taichi_erosion.report.markdown import fill_tables, markdown_table, with_spread

DIAMETER = 1.5e-3  # m, of the scene's grains
HEADER = (
    "soil",
    "grains",
    "height [d]",
    "rows on the flank",
    "angle [deg]",
    "outline angle [deg]",
    "centroid [d]",
)


def flank_rows(height: float) -> float:
    """Rows of grains between the ends of a fitted flank, of a heap whose height is in diameters."""
    low, high = fit_window(height, 1.0)
    return max(high - low, 0.0)


def lines(rows: Sequence[Row]) -> Iterator[tuple[str, ...]]:
    """One line per soil and number of grains."""
    cases: dict[tuple[str, int], dict[str, Row]] = {}
    for row in rows:
        cases.setdefault((row.group, row.grains), {})[row.observable] = row
    for (soil, grains), found in sorted(cases.items()):
        height = found["pile_height"].value / DIAMETER
        angles = (found[name] for name in ("repose_angle", "angle_of_repose"))
        centroid = found["centroid_height"]
        yield (
            soil,
            str(grains),
            f"{height:.1f}",
            f"{flank_rows(height):.1f}",
            *(with_spread(angle.value, angle.sd, angle.n) for angle in angles),
            with_spread(centroid.value / DIAMETER, centroid.sd / DIAMETER, centroid.n),
        )


def publish(table: Path) -> None:
    """Fill the table of the README."""
    page = table.with_name("README.md")
    tables = {"heaps": markdown_table(HEADER, list(lines(read_rows(table))))}
    write_atomic(page, fill_tables(page.read_text(encoding="utf-8"), tables).encode())
