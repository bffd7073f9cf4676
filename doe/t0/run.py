"""Sealed cases on the reduced model: draws, solves and opens them, writes results.csv, fills the page.

python -m doe.t0.run --cases 3000 --seed 1 --processes 2     goes on where it was stopped
python -m doe.t0.run --cases 3000 --seed 1 --further 3000    and the pairs among 3000 more
python -m doe.t0.run --cases 3000 --seed 1 --score           opens what is answered
python -m doe.t0.run --cases 300 --seed 1 --table fresh      into fresh.csv, beside results.csv
python -m doe.t0.run --page                                  only the page, from both tables
"""

import csv
import io
import os
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import typer

from doe.sealed.solve import solve_file
from doe.sealed.trial import COLUMNS, Trial, opened, seal, sealed
from doe.t0.page import publish
from taichi_erosion.core.files import write_atomic

FOLDER = Path(__file__).parent
WORK = FOLDER.parent / "t0-results"  # problems and answers
TOLD = 100  # cases from one line of progress to the next


def main(
    cases: int = 3000,
    seed: Annotated[int, typer.Option(help="Family of cases; each is used once.")] = 1,
    further: Annotated[int, typer.Option(help="Cases beyond, of which the pairs are asked.")] = 0,
    processes: int = 1,
    score: Annotated[bool, typer.Option("--score", help="Open what is answered, solve no more.")] = False,
    table: Annotated[str, typer.Option(help="Table of results, without its ending.")] = "results",
    page: Annotated[bool, typer.Option("--page", help="Only fill the page from the tables.")] = False,
) -> None:
    """Whatever was asked for, then the page."""
    trial = Trial(seed, cases, WORK / f"{seed}-{cases}-{further}", further)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    if not page:
        seal(trial)
        if not score:
            solve(trial, processes)
        write_table(scored(trial, processes), FOLDER / f"{table}.csv")
    publish(FOLDER)


def solve(trial: Trial, processes: int) -> None:
    """Answer every problem that has no answer yet; solving processes are given problem files only."""
    paths = [(trial.problem(number), trial.answer(number)) for number in trial.numbers]
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for done, _ in enumerate(pool.map(solve_file, *zip(*paths, strict=True)), 1):
            if done % TOLD == 0 or done == len(paths):
                typer.echo(f"{done} of {len(paths)} solved")


def scored(trial: Trial, processes: int) -> list[dict[str, str]]:
    """Rows of all answered cases, in order."""
    answered = {k: digest for k, digest in sealed(trial).items() if trial.answer(k).exists()}
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        return list(pool.map(opened, repeat(trial), answered.keys(), answered.values()))


def write_table(rows: list[dict[str, str]], table: Path) -> None:
    """The table of results."""
    page = io.StringIO()
    writer = csv.DictWriter(page, list[str](COLUMNS), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomic(table, page.getvalue().encode())


if __name__ == "__main__":
    typer.run(main)
