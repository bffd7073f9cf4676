"""The page of the published series: what was said of each, and the errors at the source that was left out.

python -m doe.t4.page
"""

import csv
from collections.abc import Sequence
from pathlib import Path

from doe.common.command import words
from taichi_erosion.core.files import write_atomic
from taichi_erosion.report.markdown import fill_tables, markdown_table

HERE = Path(__file__).parent
VERDICTS = {
    "present": "named",
    "group": "group",
    "none_detected": "nothing",
    "outside_library": "not in the list",
    "not_testable": "not testable",
    "unstable": "unstable",
}
ANSWERS = (
    "series",
    "left out",
    "rows fitted, left out",
    "answer",
    "p of the misfit",
    "with it",
    "nothing, unlisted",
)
ERRORS = (
    "series",
    "left out",
    "adopted",
    "strength",
    "misfit a row",
    "with it",
    "random other",
    "p with it",
    "error, %",
    "with it, %",
    "closed forms, %",
)
Row = dict[str, str]


def said(row: Row) -> str:
    """Verdict, and the names or the group."""
    told = VERDICTS[row["verdict"]]
    names = " ".join(part.replace("+", ", ") for part in (row["named"],) if part)
    group = f"one of {row['group'].replace('+', ', ')}" if row["group"] else ""
    return ": ".join((told, "; ".join(part for part in (names, group) if part))).removesuffix(": ")


def answer_cells(row: Row) -> tuple[str, ...]:
    """What `discover` says of the rows that are left."""
    rows = f"{row['rows_fitted']}, {row['rows_held_out']}"
    shares = f"{row['none']}, {row['outside_library']}"
    return (row["series"], row["held_out"], rows, said(row), row["p_misfit"], row["p_misfit_after"], shares)


def error_cells(row: Row) -> tuple[str, ...]:
    """What adopting does to the rows that were left out."""
    adopted = row["effect"] if row["adopted_as"] == "named" else f"{row['effect']} ({row['adopted_as']})"
    misfit = (row["chi2_before"], row["chi2_after"], row["chi2_wrong"], row["p_held_out_after"])
    errors = (row["error_before"], row["error_after"], row["closed_forms"])
    return (row["series"], row["held_out"], adopted, row["strength"], *misfit, *errors)


def publish(folder: Path = HERE) -> None:
    """Fill both tables of the page from the table of results."""
    with (folder / "results.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    page = folder / "README.md"
    tables = {
        "answers": markdown_table(ANSWERS, [answer_cells(row) for row in rows]),
        "errors": markdown_table(ERRORS, [error_cells(row) for row in with_errors(rows)]),
    }
    write_atomic(page, fill_tables(page.read_text(encoding="utf-8"), tables).encode())


def with_errors(rows: Sequence[Row]) -> list[Row]:
    """Rows in which something was adopted."""
    return [row for row in rows if row["effect"]]


if __name__ == "__main__":
    words(__doc__)
    publish()
