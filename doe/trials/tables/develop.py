"""Open cases from a plain seed, answered at once: for whoever changes the method.

python -m doe.trials.tables.develop --seed S --cases N --processes 2 [--case K] [--keep FOLDER]
"""

import os
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path

import typer

from doe.common.cases import method_commit
from doe.trials.metrics import HEADER, Case
from doe.trials.table import Row
from doe.trials.tables.draw import draw
from doe.trials.tables.outcome import line, table_metrics
from taichi_erosion.tables.number_words import markdown_table


def answered(seed: int, number: int, keep: Path | None) -> Row:
    """One open case, drawn, written and answered in a folder of its own."""
    case = draw(seed, number)
    return {"case": number, **case.row(case.answer(number, keep))}


def main(seed: int = 1, cases: int = 60, processes: int = 2, case: int = -1, keep: Path | None = None):
    """Draw cases (or one CASE), answer them, print one line for each and the score; KEEP their studies."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    numbers, found = range(cases) if case < 0 else [case], list[Case]()
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        for row in pool.map(answered, repeat(seed), numbers, repeat(keep)):
            found.append(Case(row))
            typer.echo(line(found[-1]))
    table = markdown_table(HEADER, [each.cells() for each in table_metrics(found) if each.count])
    typer.echo(f"\n{len(found)} cases of seed {seed} by {method_commit()}\n\n{table}")


if __name__ == "__main__":
    typer.run(main)
