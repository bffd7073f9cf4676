"""What the method is worth beside usual ones, on sealed cases of doe/t0 that it has answered.

python -m doe.baselines.run --family F     answers of the baselines to cases of a table of doe/t0
python -m doe.baselines.run --page         only the page, from results.csv

Asked are the first cases of every kind and ratio in `STRATA`.
"""

import csv
import io
import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from doe.baselines.methods import Told, told_by_all
from doe.baselines.page import FOLDER, METHOD, publish
from doe.sealed.cases import draw_case
from doe.sealed.score import IDENTIFIABLE, STRONG, Marked
from doe.sealed.trial import marked, rounded
from taichi_erosion.core.files import write_atomic

T0 = FOLDER.parent / "t0"


STRATA = (  # kind, ratio from and below, cases
    ("null", 0.0, np.inf, 50),
    ("single", 3.0, IDENTIFIABLE, 15),
    ("single", IDENTIFIABLE, STRONG, 20),
    ("single", STRONG, np.inf, 30),
    ("pair", STRONG, np.inf, 15),
    ("outside", STRONG, np.inf, 20),
)
Solved = tuple[int, Marked]  # number and record of a case


def main(
    family: Annotated[str, typer.Option(help="Family of the cases, hexadecimal.")] = "",
    table: Annotated[str, typer.Option(help="Table of doe/t0 that holds their truths.")] = "results.csv",
    page: Annotated[bool, typer.Option("--page", help="Only fill the page.")] = False,
) -> None:
    """Answers of all baselines, then the page."""
    if not page:
        write_table([row for each in chosen(read(T0 / table)) for row in rows_of(int(family, 16), *each)])
    publish()


def chosen(cases: list[Solved]) -> list[Solved]:
    """The first cases of every stratum, sd as stated."""
    found = []
    for kind, low, high, count in STRATA:
        own = [case for case in cases if case[1].truth.kind == kind and low <= case[1].hard.ratio < high]
        found += [case for case in own if case[1].truth.understated == 1.0][:count]
    return found


def read(table: Path) -> list[Solved]:
    """Number and record of every case."""
    csv.field_size_limit(1_000_000)
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [(int(row["number"]), each) for row, each in zip(rows, marked(rows), strict=True)]


def rows_of(family: int, number: int, solved: Marked) -> list[dict[str, str]]:
    """One row for each method; raises ValueError where the case is not the one of the table."""
    case = draw_case(family, number)
    if rounded(asdict(case.truth)) != rounded(asdict(solved.truth)):
        raise ValueError(f"case {number} of family {family:x} is not the one of the table")
    answers = {METHOD: told_by_method(solved), **told_by_all(case.problem, number)}
    shared: dict[str, Any] = {
        "number": number,
        "kind": case.truth.kind,
        "ratio": f"{solved.hard.ratio:.3g}",
        "separation": f"{solved.hard.separation:.3g}",
        "understated": case.truth.understated,
        "effects": "+".join(case.truth.effects),
        "outside": case.truth.outside,
        "parameters": json.dumps(rounded(case.truth.parameters)),
    }
    return [
        shared
        | {
            "method": name,
            "flagged": int(told.flagged),
            "named": told.named,
            "told": json.dumps(rounded(told.parameters)),
        }
        for name, told in answers.items()
    ]


def told_by_method(solved: Marked) -> Told:
    """The answer of `discover` as the baselines give theirs; a group is none of its members alone."""
    answer = solved.answer
    flagged = answer.verdict in ("present", "group", "outside_library", "unstable")
    named = "+".join(answer.named) if answer.verdict == "present" else ""
    return Told(flagged, named, {path: (v, low, high) for path, (v, low, high) in answer.parameters.items()})


def write_table(rows: list[dict[str, Any]]) -> None:
    """The table of results."""
    page = io.StringIO()
    writer = csv.DictWriter(page, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomic(FOLDER / "results.csv", page.getvalue().encode())


if __name__ == "__main__":
    typer.run(main)
