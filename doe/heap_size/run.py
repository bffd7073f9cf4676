"""Angle of similar heaps of different size: simulates columns that collapse, writes results.csv.

python -m doe.heap_size.run             all cases
python -m doe.heap_size.run SOIL...     the heaps of some soils
python -m doe.heap_size.run --page      only the table of the README, from results.csv
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

from doe.common.cases import Case, Row, perform, read_rows, settings
from doe.common.command import words
from doe.common.pages import write_pages
from taichi_erosion.measures.silhouette import heights_of_fit_window
from taichi_erosion.tables.number_words import markdown_table, value_and_sd_text

SCENE = "scenes/column_collapse.toml"
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
TABLE = Path(__file__).with_name("results.csv")

COUNT, TUBE, GAP, LENGTH = 1800, 9.0, 0.6, 30.0  # of the scene: grains; lengths in diameters
SHORTEST, SETTLE, COLLAPSE = 50.0, 350.0, 430.0  # s m-1, durations of the scene over the diameter
SEEDS = {225: 6, 600: 6, 1800: 4, 5000: 2, 12_000: 1}  # by number of grains

SOILS = {
    "round": (),  # as the scene has them: rolling friction 0.12
    "rough": ("contact.grain-grain.friction_rolling=0.5", "contact.grain-grain.friction_sliding=0.8"),
    "sticky": ("effects.dry_adhesion.strength=1.0", "effects.dry_adhesion.beta=0.03"),  # a weight per contact
}


def column(count: int) -> tuple[str, ...]:
    """Settings of a similar column: lengths grow as N^(1/3), times with the root of the lengths."""
    size = (count / COUNT) ** (1.0 / 3.0)
    root = size**0.5
    return (
        f"grains.count={count}",
        f"geometry.tube.radius_d={TUBE * size:.4g}",
        f"geometry.tube.length_d={LENGTH * size:.4g}",
        f"fill.radius_d={TUBE * size - GAP:.4g}",
        f"stages.0.duration_min_d={SHORTEST * root:.4g}",
        f"stages.0.duration_max_d={SETTLE * root:.4g}",
        f"stages.1.duration_max_d={COLLAPSE * root:.4g}",
        "measure.repose_angle.plate=plate",
    )


CASES = [
    Case(soil, f"{count} grains", settings(*column(count), *orders), seeds)
    for count, seeds in SEEDS.items()
    for soil, orders in SOILS.items()
]  # small heaps first: a study may be cut short


def flank_rows(height: float) -> float:
    """Rows of grains between the ends of a fitted flank, of a heap whose height is in diameters."""
    low, high = heights_of_fit_window(height, 1.0)
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
            *(value_and_sd_text(angle.value, angle.sd, angle.n) for angle in angles),
            value_and_sd_text(centroid.value / DIAMETER, centroid.sd / DIAMETER, centroid.n),
        )


def publish(table: Path) -> None:
    """Fill the table of the README."""
    heaps = markdown_table(HEADER, list(lines(read_rows(table))))
    write_pages([table.with_name("README.md")], {"heaps": heaps})


def main(asked: list[str]) -> None:
    """Simulate what was asked for, then publish the table."""
    if asked != ["--page"]:
        perform(SCENE, [case for case in CASES if not asked or case.group in asked], TABLE)
    publish(TABLE)


if __name__ == "__main__":
    main(words(__doc__))
