"""Where the wind begins over spheres at rest, and how rough they are to it, by the law of their drag.

python -m doe.bed_wind.run zero       regular layers: flow resolved, and columns by law; writes zero.csv
python -m doe.bed_wind.run rough      beds of the simulator of three diameters; writes roughness.csv
python -m doe.bed_wind.run --page     only the tables of README.md
"""

import csv
from collections.abc import Callable, Iterator, Sequence
from io import StringIO
from pathlib import Path

from doe.bed_wind.column import LAYERS, VISCOSITY, Blow, height_of, zero_depth
from doe.bed_wind.exposure import exposure_table, load_table, read_spheres, upper_spheres
from doe.bed_wind.stokes import zero_depth as resolved_depth
from doe.common.command import words
from taichi_erosion.core.files import write_atomic
from taichi_erosion.report.markdown import fill_tables, markdown_table
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import with_section
from tests.verification.reference.hopping import Sand, hopping_threshold
from tests.verification.wind.saltation import AIR, DENSITY, SMALLEST, at_rest, roughness, winds_over_beds

FOLDER = Path(__file__).parent
PAGE, ZERO, ROUGH = (FOLDER / name for name in ("README.md", "zero.csv", "roughness.csv"))
MEASURED_BY = "flow resolved"
LAWS = ("two_limits", "two_limits_hindered", "di_felice")
CREEPING, WIND, DIAMETER = 3e-4, 0.3, 0.25e-3  # m2 s-1, m s-1, m
CELLS = (8, 12)  # on a diameter, of the resolved flow
SIZES, WINDS = (1.0, 2.0, 4.0), (0.27, 0.36, 0.54)  # over 0.25 mm; m s-1, near which such sand starts
FAR = 100.0  # diameters over a bed, from where its roughness is seen
SMOOTH, GRAIN = 0.11, 1.0 / 30.0  # z0 u* / nu of a smooth wall; z0 / d of a rough bed [1]

Cells = dict[str, str | float]


def zero_rows() -> list[Cells]:
    """Depth of the zero below the tops of regular layers, by every method."""
    rows: list[Cells] = []
    for name, layers in LAYERS.items():
        for cells in CELLS:
            method = f"{MEASURED_BY}, {cells} cells on a diameter"
            depth = resolved_depth(name, cells)
            rows.append({"layer": name, "method": method, "creeping": depth, "air": ""})
        for law in LAWS:
            depth = zero_depth(layers, Blow(WIND, DIAMETER, law, False, CREEPING))
            air = height_of(layers, Blow(WIND, DIAMETER, law), 1.0)
            rows.append({"layer": name, "method": law, "creeping": depth, "air": air})
    return rows


def resting(size: float, law: str) -> Scene:
    """A bed at rest under a wind that feels its grains by a law of drag."""
    return with_section(at_rest(size), "wind", drag=law)


def rough_rows() -> Iterator[Cells]:
    """Roughness lengths of beds of the simulator, and the winds in which one grain goes on over them."""
    for law in reversed(LAWS[:2]):
        sands = [Sand(size * SMALLEST, DENSITY, AIR) for size in SIZES]
        winds = winds_over_beds([resting(size, law) for size in SIZES], sands)
        for sand, friction, over in zip(sands, WINDS, winds, strict=True):
            z0 = roughness(over(friction), friction, FAR * sand.diameter)
            alone = hopping_threshold(sand, over)
            cells = {"diameter": 1e3 * sand.diameter, "law": law, "wind": friction, "z0": 1e3 * z0}
            yield cells | {"hopping": alone}


def write_rough() -> None:
    """Write the roughness of every bed as soon as it is known."""
    rows: list[Cells] = []
    for row in rough_rows():
        rows.append(row)
        write(ROUGH, rows)


def write(path: Path, rows: Sequence[Cells]) -> None:
    """Write rows as CSV."""
    text = StringIO(newline="")
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    for row in rows:
        table.writerow({k: f"{cell:.4g}" if isinstance(cell, float) else cell for k, cell in row.items()})
    write_atomic(path, text.getvalue().encode())


def lines(path: Path) -> list[dict[str, str]]:
    """Lines of a CSV file; none where it has not been made yet."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def zero_table() -> str:
    """Every method on both layers."""
    header = ("layer", "method or law of drag", "creeping shear", "0.25 mm in air at u* = 0.3 m/s")
    return markdown_table(header, [tuple(line.values()) for line in lines(ZERO)])


def rough_table() -> str:
    """Roughness of the simulator's beds beside that of textbooks."""
    header = (
        *("d [mm]", "u* [m/s]", "u* d / nu", "law of drag", "z0 [mm]", "d / z0", "smooth wall", "rough"),
        "one grain goes on at u* [m/s]",
    )
    rows = []
    for line in sorted(lines(ROUGH), key=lambda line: float(line["diameter"])):
        size, wind, z0 = (float(line[name]) for name in ("diameter", "wind", "z0"))
        smooth = 1e3 * SMOOTH * VISCOSITY / wind
        reynolds = wind * 1e-3 * size / VISCOSITY
        cells = (f"{size:g}", f"{wind:g}", f"{reynolds:.1f}", line["law"], f"{z0:.4f}", f"{size / z0:.0f}")
        rows.append((*cells, f"{size / smooth:.0f}", f"{1.0 / GRAIN:.0f}", line["hopping"]))
    return markdown_table(header, rows)


STEPS: dict[str, Callable[[], object]] = {"zero": lambda: write(ZERO, zero_rows()), "rough": write_rough}


def main(asked: Sequence[str]) -> None:
    """Compute what was asked for, then fill the page."""
    for name in asked:
        if name in STEPS:
            STEPS[name]()
    beds = upper_spheres(read_spheres())
    tables = {"zero": zero_table(), "rough": rough_table()}
    tables |= {"loads": load_table(beds), "exposure": exposure_table(beds)}
    PAGE.write_text(fill_tables(PAGE.read_text(encoding="utf-8"), tables), encoding="utf-8")


if __name__ == "__main__":
    main(words(__doc__))
