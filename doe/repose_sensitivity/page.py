"""The page on what the funnel angle depends on: its tables and its figure."""

import re
from collections.abc import Sequence
from math import isfinite
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from doe.common.cases import STOPPED, Row, by_case, read_rows
from doe.common.pages import RESULTS, write_pages
from taichi_erosion.tables.number_words import markdown_table, value_and_sd_text

PICTURE = "pictures/repose_sensitivity.png"
REFERENCE = "reference"
SHOWN = (REFERENCE, "surface energy", "grain number", "outlet height", "pouring rate")  # in docs/
ADHESION = ("adhesion and time step", "law of adhesion", "surface energy", "adhesion and grain size")
MEASURED = (33.52, 0.68)  # deg, mean and sd of 10 repeats, Hao et al. (2022)
MILLIMETRES = 1e3  # per metre
OURS, THEIRS = "#1f4e79", "#c0392b"

BEND = re.compile(r"changes by (-?[\d.]+) deg")

Found = dict[str, Row]  # rows of one case by observable


def case_line(name: tuple[str, str], found: Found) -> tuple[str, ...]:
    """One line: what was changed, the two angles, the heap, the step."""
    row = next(iter(found.values()))
    if row.observable == STOPPED:
        return (*name, "stopped", "", "", "", "", row.note.partition("; likely cause")[0])
    angle = spread(found, "repose_angle")
    return (
        *name,
        angle,
        spread(found, "cone_angle") if found["repose_angle"].n else angle,
        spread(found, "pile_height", MILLIMETRES),
        spread(found, "centroid_height", MILLIMETRES),
        f"{1e6 * row.time_step:.3g}",
        remark(found["repose_angle"].note),
    )


def remark(note: str) -> str:
    """What an angle's note says, in few words."""
    if bends := BEND.findall(note):
        return f"flank bent by {', '.join(bends)} deg"
    _, hanging, reason = note.partition("no heap")
    return hanging + reason


def spread(found: Found, name: str, factor: float = 1.0) -> str:
    """Value with its spread over seeds."""
    row = found[name]
    return value_and_sd_text(factor * row.value, factor * row.sd, row.n)


def case_table(rows: Sequence[Row], groups: Sequence[str]) -> str:
    """Lines of some groups, the reference first."""
    header = (
        "group",
        "case",
        "angle [deg]",
        "cone angle [deg]",
        "height [mm]",
        "centroid [mm]",
        "step [us]",
        "remark",
    )
    cases = by_case(rows)
    names = [name for name in cases if name[0] == REFERENCE] + [name for name in cases if name[0] in groups]
    return markdown_table(header, [case_line(name, cases[name]) for name in names])


def angle_table(rows: Sequence[Row]) -> str:
    """Angle and centroid of the groups that the page in docs/ shows."""
    lines = [
        (
            ": ".join(name),
            spread(found, "repose_angle") if found["repose_angle"].n else "no heap",
            spread(found, "centroid_height", MILLIMETRES),
        )
        for name, found in by_case(rows).items()
        if name[0] in SHOWN and STOPPED not in found
    ]
    return markdown_table(("case", "angle [deg]", "centroid [mm]"), lines)


def tables(rows: Sequence[Row]) -> dict[str, str]:
    """All tables of the page by the name of their mark."""
    dry = [group for group in dict.fromkeys(row.group for row in rows) if group not in (*ADHESION, REFERENCE)]
    return {"angles": angle_table(rows), "adhesion": case_table(rows, ADHESION), "dry": case_table(rows, dry)}


def draw(rows: Sequence[Row], file: Path) -> None:
    """The angle of every case that left a heap, with the spread over seeds."""
    cases = {name: found for name, found in by_case(rows).items() if "repose_angle" in found}
    figure, frame = plt.subplots(figsize=(8.0, 0.6 + 0.27 * len(cases)), layout="constrained")
    for place, found in enumerate(cases.values()):
        row = found["repose_angle"]
        if not isfinite(row.value):
            frame.text(MEASURED[0], place, "no heap", ha="center", va="center", fontsize=7)
        frame.errorbar(row.value, place, xerr=row.sd if row.n > 1 else None, fmt="o", color=OURS, capsize=3)
    value, sd = MEASURED
    frame.axvspan(value - sd, value + sd, color=THEIRS, alpha=0.25, lw=0.0, label="Hao et al. (2022)")
    frame.set_yticks(range(len(cases)), [": ".join(name) for name in cases], fontsize=7)
    frame.set_ylim(len(cases) - 0.5, -0.5)
    frame.set(xlabel="angle of repose [deg]")
    frame.legend(frameon=False, fontsize=8)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def publish(table: Path, docs: Path) -> None:
    """Draw the figure and fill the tables of the page."""
    rows = read_rows(table)
    (docs / PICTURE).parent.mkdir(parents=True, exist_ok=True)
    draw(rows, docs / PICTURE)
    write_pages((docs / RESULTS, table.with_name("README.md")), tables(rows))
