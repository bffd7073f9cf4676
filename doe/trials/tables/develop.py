"""Open cases from a plain seed, answered at once: for whoever changes the method.

python -m doe.trials.tables.develop --seed S --cases N --processes 2 [--case K] [--keep FOLDER]
"""

import os
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory

import typer

from doe.common.cases import method_commit
from doe.trials.metrics import HEADER, Case
from doe.trials.table import Row
from doe.trials.tables.draw import draw
from doe.trials.tables.outcome import line, table_metrics
from doe.trials.tables.solve import table_answer
from taichi_erosion.report.markdown import markdown_table


def answered(seed: int, number: int, folder: Path) -> Row:
    """One open case, drawn, written and answered in a folder of its own."""
    case, place = draw(seed, number), folder / f"case_{number:05d}"
    rmtree(place, ignore_errors=True)
    case.write(place)
    return {"case": number, **case.row(table_answer(place))}


def main(
    seed: int = 1, cases: int = 60, processes: int = 2, case: int = -1, keep: Path | None = None
) -> None:
    """Draw cases (or one CASE), answer them, print one line for each and the score; KEEP their studies."""
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # read by the processes when they start
    numbers, found = range(cases) if case < 0 else [case], list[Case]()
    pool = ProcessPoolExecutor(processes, mp_context=get_context("spawn"))
    with TemporaryDirectory() as other, pool:
        for row in pool.map(answered, repeat(seed), numbers, repeat(keep or Path(other))):
            found.append(Case(row))
            typer.echo(line(found[-1]))
    table = markdown_table(HEADER, [each.cells() for each in table_metrics(found) if each.count])
    typer.echo(f"\n{len(found)} cases of seed {seed} by {method_commit()}\n\n{table}")


if __name__ == "__main__":
    typer.run(main)
