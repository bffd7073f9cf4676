"""Sealed cases on the reduced model: draws, solves and opens them, writes results.csv, fills the page.

python doe/t0/run.py --cases 3000 --seed 1 --processes 2     goes on where it was stopped
python doe/t0/run.py --page                                  only the table, from results.csv
"""

import csv
import io
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated

import typer

from taichi_erosion.evidence.blind_solve import solve_file
from taichi_erosion.evidence.blind_trial import COLUMNS, Trial, opened, seal, sealed
from taichi_erosion.recording.whole_file import write_whole
from taichi_erosion.report.blind_trial import publish

FOLDER = Path(__file__).parent
WORK = FOLDER.parent / "t0-results"  # problems and answers
TOLD = 100  # cases from one line of progress to the next


def main(
    cases: int = 3000,
    seed: Annotated[int, typer.Option(help="Family of cases; each is used once.")] = 1,
    processes: int = 1,
    page: Annotated[bool, typer.Option("--page", help="Only fill the page from results.csv.")] = False,
) -> None:
    """Whatever was asked for, then the page."""
    if not page:
        write_table(list(tried(Trial(seed, cases, WORK / f"{seed}-{cases}"), processes)))
    publish(FOLDER / "results.csv", FOLDER / "README.md")


def tried(trial: Trial, processes: int) -> Iterator[dict[str, str]]:
    """Rows of all cases, in order; solving processes are given problem files only."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    seal(trial)
    numbers = range(trial.count)
    problems, answers = [trial.problem(k) for k in numbers], [trial.answer(k) for k in numbers]
    digests = sealed(trial)
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for done, _ in enumerate(pool.map(solve_file, problems, answers), 1):
            if done % TOLD == 0 or done == trial.count:
                typer.echo(f"{done} of {trial.count} solved")
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(opened, repeat(trial), numbers, [digests[k] for k in numbers])


def write_table(rows: list[dict[str, str]]) -> None:
    """The table of results."""
    page = io.StringIO()
    writer = csv.DictWriter(page, list[str](COLUMNS), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_whole(FOLDER / "results.csv", page.getvalue().encode())


if __name__ == "__main__":
    typer.run(main)
