"""The page that compares the column collapse with laboratory C: its tables and its figure."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan, sqrt
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from doe.common.cases import Row, read_rows
from doe.common.pages import write_pages
from doe.common.tables import lines_of
from taichi_erosion.tables.number_words import markdown_table, value_and_sd_text

PICTURE = "pictures/lab_c.png"
DIAMETERS = {"1.5 mm": 1.5e-3, "3 mm": 3e-3}  # m, by the label of a case
MAIN, REPAIRED = "as stated", "both causes removed"
MILLIMETRES = 1e3  # per metre
OURS, THEIRS, OTHER = "#1f4e79", "#c0392b", "#7f8c8d"


@dataclass(frozen=True)
class LaboratoryValue:
    """Mean of n repeats, with the spread of single repeats."""

    value: float
    sd: float
    n: int


Laboratory = dict[tuple[str, float], LaboratoryValue]  # by observable and diameter [m]


def read_laboratory(file: Path) -> Laboratory:
    """The laboratory's own values."""
    return {
        (line["observable"], float(line["diameter"])): LaboratoryValue(
            float(line["value"]), float(line["sd"]), int(line["n"])
        )
        for line in lines_of(file)
    }


def difference_in_errors(row: Row, laboratory: LaboratoryValue) -> float:
    """Difference of the means over its standard error [1].

        z = (x - y) / sqrt(s_x^2 / n_x + s_y^2 / n_y)

    A single run carries the laboratory's own spread. With six repeats each, |z| > 2.2 happens once in twenty
    tables of one observable (t distribution with ten degrees of freedom).
    """
    own = row.standard_error if row.n > 1 else laboratory.sd
    return (row.value - laboratory.value) / sqrt(own**2 + laboratory.sd**2 / laboratory.n)


def shown(unit: str) -> tuple[float, str]:
    """Factor and name of the unit in which an observable is shown."""
    return (MILLIMETRES, "mm") if unit == "m" else (1.0, unit)


def comparison_table(rows: Sequence[Row], laboratory: Laboratory, group: str) -> str:
    """Every observable of one group of cases beside the laboratory's."""
    header = ("observable", "d", "ours", "laboratory", "difference", "over d", "in standard errors")
    lines = []
    for row in (row for row in rows if row.group == group):
        theirs = laboratory[row.observable, DIAMETERS[row.label]]
        factor, unit = shown(row.unit)
        gap = row.value - theirs.value
        lines.append(
            (
                f"{row.observable} [{unit}]",
                row.label,
                value_and_sd_text(factor * row.value, factor * row.sd, row.n),
                value_and_sd_text(factor * theirs.value, factor * theirs.sd, theirs.n),
                f"{factor * gap:+.3g}",
                f"{gap / DIAMETERS[row.label]:+.3f}" if row.unit == "m" else "",
                f"{difference_in_errors(row, theirs):+.1f}",
            )
        )
    return markdown_table(header, lines)


def causes_table(rows: Sequence[Row], laboratory: Laboratory) -> str:
    """Difference from the laboratory in standard errors, case by case, at 1.5 mm."""
    label = "1.5 mm"
    groups = dict.fromkeys(row.group for row in rows if row.label == label)
    names = list(dict.fromkeys(row.observable for row in rows))
    lines = []
    for group in groups:
        found = {row.observable: row for row in rows if (row.group, row.label) == (group, label)}
        gaps = [difference_in_errors(found[name], laboratory[name, DIAMETERS[label]]) for name in names]
        lines.append((group, str(next(iter(found.values())).n), *(f"{gap:+.1f}" for gap in gaps)))
    return markdown_table(("case at 1.5 mm", "n", *names), lines)


def tables(rows: Sequence[Row], laboratory: Laboratory) -> dict[str, str]:
    """All tables of the page by the name of their mark."""
    return {
        "as stated": comparison_table(rows, laboratory, MAIN),
        "causes": causes_table(rows, laboratory),
        "both removed": comparison_table(rows, laboratory, REPAIRED),
    }


def draw(rows: Sequence[Row], laboratory: Laboratory, file: Path) -> None:
    """Difference from the laboratory in standard errors, observable by observable."""
    figure, frames = plt.subplots(1, 2, figsize=(9.0, 3.6), sharey=True, layout="constrained")
    names = list(dict.fromkeys(row.observable for row in rows))
    for frame, (label, diameter) in zip(frames, DIAMETERS.items(), strict=True):
        for group, colour in ((MAIN, THEIRS), (REPAIRED, OURS)):
            found = {row.observable: row for row in rows if (row.group, row.label) == (group, label)}
            gaps = [
                difference_in_errors(found[n], laboratory[n, diameter]) if n in found else nan for n in names
            ]
            frame.plot(gaps, range(len(names)), "o", color=colour, label=group)
        frame.axvspan(-2.0, 2.0, color=OTHER, alpha=0.25, lw=0.0)
        frame.set(title=f"d = {label}", xlabel="ours - laboratory [standard errors]")
    frames[0].set_yticks(range(len(names)), names)
    frames[1].legend(frameon=False, fontsize=8)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def publish(table: Path, laboratory_file: Path, docs: Path) -> None:
    """Draw the figure and fill the tables of the page."""
    rows, laboratory = read_rows(table), read_laboratory(laboratory_file)
    (docs / PICTURE).parent.mkdir(parents=True, exist_ok=True)
    draw(rows, laboratory, docs / PICTURE)
    write_pages([table.with_name("README.md")], tables(rows, laboratory))
