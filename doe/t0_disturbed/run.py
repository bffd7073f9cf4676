"""Sealed cases with the errors of real laboratories: draws, solves and opens them, fills the page.

python -m doe.t0_disturbed.run seal NAME --cases 300 --secret FOLDER     truths into FOLDER, digests here
python -m doe.t0_disturbed.run solve NAME --processes 2                  goes on where it was stopped
python -m doe.t0_disturbed.run open NAME --secret FOLDER                 writes results/NAME.csv and the page
python -m doe.t0_disturbed.run page                                      only the page
"""

import os
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import typer

from doe.common.method import method_commit
from doe.sealed.solve import solve_file
from doe.t0_disturbed.page import publish
from doe.t0_disturbed.trial import FOLDER, seal, sealed, sealed_set, write_results

TOLD = 50  # cases from one line of progress to the next
Secret = Annotated[Path, typer.Option(help="Folder of truths, outside the tree.")]
program = typer.Typer(add_completion=False)


@program.command("seal")
def draw(name: str, secret: Secret, cases: int = 300, nulls: float = 0.45) -> None:
    """Draw a set of cases; commit its digests before it is solved."""
    seal(sealed_set(name, secret), cases, nulls)


@program.command()
def solve(name: str, processes: int = 1, method: str = "", with_vault: bool = False) -> None:
    """Answer every problem that this commit has not answered yet."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    trial, method = sealed_set(name), method or method_commit()
    numbers = list(sealed(trial))
    trial.answer(0, method).parent.mkdir(parents=True, exist_ok=True)
    problems = [trial.problem(k) for k in numbers]
    answers = [trial.answer(k, method) for k in numbers]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        steps = pool.map(solve_file, problems, answers, repeat(with_vault), chunksize=5)
        for done, _ in enumerate(steps, 1):
            if done % TOLD == 0 or done == len(numbers):
                typer.echo(f"{done} of {len(numbers)} solved")


@program.command("open")
def unseal(name: str, secret: Secret, method: str = "") -> None:
    """Compare the answers of a commit with the truths."""
    write_results(sealed_set(name, secret), method or method_commit())
    page()


@program.command()
def page() -> None:
    """Fill the page from the tables of results."""
    publish(FOLDER)


if __name__ == "__main__":
    program()
