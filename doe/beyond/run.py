"""Sealed cases beyond the list: draws, solves and opens them, fills the page.

python -m doe.beyond.run draw NAME SECRET --cases 500      truths into SECRET, digests into seals/NAME.csv
python -m doe.beyond.run solve NAME --seconds 2400         goes on where it was stopped
python -m doe.beyond.run score NAME SECRET                 results/NAME.csv and the page
python -m doe.beyond.run page                              only the page
"""

import os
from pathlib import Path
from time import monotonic
from typing import Annotated

import typer

from doe.beyond.page import publish
from doe.beyond.solve import solve_file
from doe.beyond.trial import FOLDER, seal, sealed, sealed_set, write_results
from doe.common.method import method_commit

SHARES = (0.4, 0.4, 0.2)  # outside the list, nothing missing, listed
Secret = Annotated[Path, typer.Argument(help="Folder of truths, outside the tree.")]
program = typer.Typer(add_completion=False)


@program.command()
def draw(name: str, secret: Secret, cases: int = 500) -> None:
    """Draw a set of cases; commit its digests before it is solved."""
    seal(sealed_set(name, secret), cases, SHARES)


@program.command()
def solve(name: str, seconds: float = float("inf")) -> None:
    """Answer problems in their order, which is that of independent draws, until the time is over."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    trial, method, start = sealed_set(name), method_commit(), monotonic()
    for number in sealed(trial):
        if monotonic() - start > seconds:
            break
        if not trial.answer(number).exists():
            solve_file(trial.problem(number), trial.answer(number), method)


@program.command()
def score(name: str, secret: Secret) -> None:
    """Compare the answers with the truths."""
    write_results(sealed_set(name, secret))
    page()


@program.command()
def page() -> None:
    """Fill the page from the tables of results."""
    publish(FOLDER)


if __name__ == "__main__":
    program()
