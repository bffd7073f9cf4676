"""The page of the proposals: shares of cases that are decided rightly, with bounds."""

import csv
import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from scipy import stats

from doe.proposals.cases import COUNTS
from doe.sealed.score import IDENTIFIABLE, STRONG, share
from taichi_erosion.core.files import write_atomic
from taichi_erosion.report.markdown import fill_tables, markdown_table

FOLDER = Path(__file__).parent
Row = dict[str, str]
DESIGNS = {  # of `criterion.csv`
    "before": "none",
    "random": "six at random",
    "squares": "six by squared separations (before)",
    "bound": "six by the bound of errors (now)",
}


def results_of(name: str) -> Path:
    """Table of one set."""
    return FOLDER / "results" / f"{name}.csv"


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """A table of results in place of an earlier one."""
    page = io.StringIO()
    writer = csv.DictWriter(page, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(path, page.getvalue().encode())


def read_rows(path: Path) -> list[Row]:
    """A table of results."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def publish(slots: int) -> None:
    """Fill the tables of the page, one for every set and method."""
    page, tables = FOLDER / "README.md", {}
    text = page.read_text(encoding="utf-8")
    for path in sorted((FOLDER / "results").glob("*.csv")):
        rows = read_rows(path)
        for method in dict.fromkeys(row["method"] for row in rows):
            own = [row for row in rows if row["method"] == method]
            tables[f"{path.stem} {method}"] = shares_table(own, slots)
    tables["criterion"] = criterion_table(read_rows(FOLDER / "criterion.csv"))
    write_atomic(page, fill_tables(text, tables).encode())


def criterion_table(rows: Sequence[Row]) -> str:
    """How well designs show the truth: medians, and cases above the lines of being identified and named."""
    lines = []
    for arm, words in DESIGNS.items():
        told = [words]
        for measure in ("ratio", "separation"):
            values = np.array([float(row[f"{arm} {measure}"]) for row in rows])
            told += [
                f"{np.median(values):.2g}",
                *(str(int(np.sum(values >= x))) for x in (IDENTIFIABLE, STRONG)),
            ]
        lines.append(tuple(told))
    limits = (f">= {IDENTIFIABLE:g}", f">= {STRONG:g}")
    header = ("measurements", "ratio, median", *limits, "separation, median", *limits)
    return markdown_table(header, lines)


def right(row: Row, arm: str) -> bool:
    """Whether an answer is decided and right: it names all that acts alone, or silence means absence."""
    acting = {word.split(" ")[0] for word in row["truth"].split("+")} - {""}
    if not acting:
        return row[f"{arm} verdict"] == "none_detected"
    return row[f"{arm} verdict"] == "present" and set(row[f"{arm} named"].split("+")) == acting


def false(row: Row, arm: str) -> bool:
    """Whether an answer names an effect that does not act, or flags what is listed as not in the list."""
    acting = {word.split(" ")[0] for word in row["truth"].split("+")} - {""}
    named = set(row[f"{arm} named"].split("+")) - {""}
    return bool(named - acting) or row[f"{arm} verdict"] == "outside_library"


def shares_table(rows: Sequence[Row], slots: int) -> str:
    """Shares before, with proposals and with random measurements, and the paired difference of the two."""
    asked = [row for row in rows if row["proposed verdict"] and row["random verdict"]]
    lines = []
    told = [row for row in asked if row["truth"]]
    sets = {
        f"an effect acts, {kind}": [r for r in told if r["kind"] == kind] for kind in COUNTS if kind != "null"
    }
    sets["an effect acts, proposals made"] = [row for row in told if row["proposals"] != "0"]
    sets = {"an effect acts, all": told, **sets, "nothing is missing": [r for r in asked if not r["truth"]]}
    for words, some in sets.items():
        for measure, hit in (("decided rightly", right), ("told wrongly", false)):
            if some:
                lines.append((words, measure, *shares_of(some, hit), str(len(some))))
    header = (
        "cases",
        "answer",
        "before",
        f"{slots} proposed",
        f"{slots} random",
        "proposed - random",
        "number",
    )
    return markdown_table(header, lines)


def shares_of(rows: Sequence[Row], hit: Callable[[Row, str], bool]) -> list[str]:
    """Shares with bounds, and the difference of the two kinds of measurements."""
    found = []
    for arm in ("before", "proposed", "random"):
        metric = share("", [hit(row, arm) for row in rows], (">=", 0.0))
        found.append(f"{metric.value:.3f} ({metric.low:.3f} to {metric.high:.3f})")
    only = [
        sum(hit(r, a) and not hit(r, b) for r in rows)
        for a, b in (("proposed", "random"), ("random", "proposed"))
    ]
    value, low, high = paired_difference(only[0], only[1], len(rows))
    return [*found, f"{value:+.3f} ({low:+.3f} to {high:+.3f})"]


def paired_difference(first: int, second: int, count: int) -> tuple[float, float, float]:
    """Difference of two shares on the same cases with 95 % bounds.

    `first` cases have only the one, `second` only the other. Given how many differ, the one is right in a
    binomial share of them, whose bounds are those of Clopper and Pearson.

    Reference: Agresti (2013), Categorical Data Analysis, section 11.1 (McNemar's test, conditional).
    """
    differ = first + second
    if differ == 0:
        return 0.0, 0.0, 0.0
    low = float(stats.beta.ppf(0.025, first, second + 1)) if first else 0.0
    high = float(stats.beta.ppf(0.975, first + 1, second)) if second else 1.0
    scale = differ / count
    return (first - second) / count, float((2.0 * low - 1.0) * scale), float((2.0 * high - 1.0) * scale)
