"""What the method is worth beside usual ones, on sealed cases of doe/t0 that it has answered.

python -m doe.baselines.run --family F     answers of the baselines to the cases of a table of doe/t0
python -m doe.baselines.run --page         only the page, from results.csv
"""

import csv
import io
import json
from pathlib import Path
from typing import Annotated, Any

import typer

from doe.baselines.methods import Told, told_by_all
from doe.baselines.page import FOLDER, METHOD, publish
from doe.sealed.cases import draw_case
from doe.sealed.score import Marked
from doe.sealed.trial import marked, rounded, seal_of
from taichi_erosion.core.files import write_atomic

T0 = FOLDER.parent / "t0"


def main(
    family: Annotated[str, typer.Option(help="Family of the cases, hexadecimal.")] = "",
    table: Annotated[str, typer.Option(help="Table of doe/t0 that holds their truths.")] = "fresh.csv",
    page: Annotated[bool, typer.Option("--page", help="Only fill the page.")] = False,
) -> None:
    """Answers of all baselines, then the page."""
    if not page:
        write_table([row for each in read(T0 / table) for row in rows_of(int(family, 16), *each)])
    publish()


def read(table: Path) -> list[tuple[int, str, Marked]]:
    """Number, digest and record of every case."""
    csv.field_size_limit(1_000_000)
    with table.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return [(int(row["number"]), row["sha256"], each) for row, each in zip(rows, marked(rows), strict=True)]


def rows_of(family: int, number: int, digest: str, solved: Marked) -> list[dict[str, str]]:
    """One row for each method; raises ValueError where the case is not the one of the table."""
    case = draw_case(family, number)
    if seal_of(family, case) != digest:
        raise ValueError(f"case {number} of family {family:x} is not the one that was sealed")
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
