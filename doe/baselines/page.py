"""The page of the baselines: what every method says, by kind of case and by ratio."""

import csv
import json
from collections.abc import Callable, Sequence
from pathlib import Path

from doe.sealed.score import IDENTIFIABLE, STRONG, share
from taichi_erosion.core.files import write_atomic
from taichi_erosion.report.markdown import fill_tables, markdown_table

FOLDER = Path(__file__).parent
METHOD = "discover"
METHODS = (METHOD, "correlation", "BIC", "discrepancy")
RATIOS = ((0.0, 3.0), (3.0, IDENTIFIABLE), (IDENTIFIABLE, STRONG), (STRONG, float("inf")))
Row = dict[str, str]
Hit = Callable[[Row], bool]


def publish() -> None:
    """Fill the table of the page from the table of results."""
    with (FOLDER / "results.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    page = FOLDER / "README.md"
    text = fill_tables(page.read_text(encoding="utf-8"), {"answers": answers_table(rows)})
    write_atomic(page, text.encode())


def names(row: Row, column: str) -> set[str]:
    """Effects of a column."""
    return set(row[column].split("+")) - {""}


def right(row: Row) -> bool:
    """Whether all that acts is named, and nothing else."""
    return bool(row["effects"]) and names(row, "named") == names(row, "effects")


def wrong(row: Row) -> bool:
    """Whether an effect is named that does not act."""
    acting = names(row, "effects") if row["kind"] != "outside" else set[str]()
    return bool(names(row, "named") - acting)


def flagged(row: Row) -> bool:
    """Whether something is said to be missing."""
    return row["flagged"] == "1"


def unnamed(row: Row) -> bool:
    """Whether something is said to be missing, without a name."""
    return flagged(row) and not row["named"]


def lines_of(rows: Sequence[Row]) -> list[tuple[str, str, Hit, list[Row]]]:
    """Sets of cases and what is counted in them."""
    honest = [row for row in rows if float(row["understated"]) == 1.0]
    nulls = [row for row in honest if row["kind"] == "null"]
    lines: list[tuple[str, str, Hit, list[Row]]] = [
        ("nothing is missing", "something named", wrong, nulls),
        ("nothing is missing", "said to be missing", flagged, nulls),
    ]
    for kind, low, high in [*(("single", *r) for r in RATIOS), *(("pair", *r) for r in RATIOS[-1:])]:
        some = [r for r in honest if r["kind"] == kind and low <= float(r["ratio"]) < high]
        words = f"{kind}, ratio {low:g} to {high:g}" if high < float("inf") else f"{kind}, ratio >= {low:g}"
        lines += [(words, what, hit, some) for what, hit in (("right name", right), ("wrong name", wrong))]
    outside = [r for r in honest if r["kind"] == "outside" and float(r["ratio"]) >= STRONG]
    lines.append((f"not in the list, ratio >= {STRONG:g}", "wrong name", wrong, outside))
    lines.append((f"not in the list, ratio >= {STRONG:g}", "missing, no name", unnamed, outside))
    poor = [r for r in honest if r["kind"] == "impossible"]
    return [*lines, ("impossible designs", "a lone name", lambda row: bool(row["named"]), poor)]


def answers_table(rows: Sequence[Row]) -> str:
    """Every method in a column of its own."""
    table = []
    for words, what, hit, some in lines_of(rows):
        by_method = [[row for row in some if row["method"] == method] for method in METHODS]
        if by_method[0]:
            cells = [share_words([hit(row) for row in own]) for own in by_method]
            table.append((words, what, *cells, str(len(by_method[0]))))
    covered = [covered_words([row for row in rows if row["method"] == method]) for method in METHODS]
    table.append(("all, sd as stated", "90 % interval of a calibrated number", *covered, ""))
    return markdown_table(("cases", "answer", *METHODS, "number"), table)


def share_words(hits: Sequence[bool]) -> str:
    """A share with its bounds."""
    metric = share("", hits, (">=", 0.0))
    return f"{metric.value:.3f} ({metric.low:.3f} to {metric.high:.3f})"


def covered_words(rows: Sequence[Row]) -> str:
    """Share of calibrated numbers whose interval holds the truth; empty for a method without intervals."""
    hits = []
    for row in (row for row in rows if float(row["understated"]) == 1.0):
        truth = json.loads(row["parameters"])
        hits += [
            low <= truth[k] <= high for k, (_, low, high) in json.loads(row["told"]).items() if k in truth
        ]
    return share_words(hits) if hits else ""
