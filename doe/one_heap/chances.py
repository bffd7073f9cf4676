"""Chances that nulls with correlated observables look like a misfit or an effect, their heaps told or not.

python -m doe.one_heap.chances --draws 100 --seed 2      writes chances.csv and its table in README.md
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import typer
from threadpoolctl import threadpool_limits

from doe.common.method import method_commit
from doe.one_heap.run import draw, share
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.inference.familywise_test import familywise_test
from taichi_erosion.evidence.inference.goodness_of_fit import projection_traces, shifted_chi2_p
from taichi_erosion.evidence.inference.map_fit import fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.inference.screen import screen

FOLDER = Path(__file__).parent
START, END = "<!-- chances -->\n", "<!-- end of chances -->\n"
CORRELATIONS = (0.8, -0.8, 0.0)
NOISE_DRAWS = 2000
LEVELS = (0.05, 0.01)


@dataclass(frozen=True)
class Chance:
    """One null, asked once."""

    correlation: float
    number: int
    told: bool  # which rows are of one run
    misfit: float  # p of the whole misfit
    strongest: float  # family-wise p of the strongest of six effects


def chance(problem: Problem, correlation: float, number: int, told: bool) -> Chance:
    """Chances of one table, scatter as measured."""
    if not told:
        problem = replace(problem, measurements=replace(problem.measurements, heap=()))
    prepared, best, _ = fit_base(prepare(problem, problem.measurements, number))
    screened = screen(prepared, expand(prepared, best))
    weight = np.exp(prepared.doubt.log_weight)
    factors = np.random.default_rng(number).choice(prepared.doubt.factor, NOISE_DRAWS, p=weight)
    test, left = familywise_test(prepared, screened, factors, number), screened.left
    misfit = shifted_chi2_p(float(left.free @ left.free), projection_traces(left.row_basis))
    return Chance(correlation, number, told, float(misfit), test.p)


def main(draws: int = 100, seed: int = 2) -> None:
    """Draw, ask twice, count."""
    method, found = method_commit(), list[Chance]()
    with threadpool_limits(1, user_api="blas"):
        for correlation in CORRELATIONS:
            for number in range(draws):
                problem = draw(seed, number, correlation, False).problem
                found += [chance(problem, correlation, number, told) for told in (False, True)]
    page = io.StringIO()
    writer = csv.writer(page, lineterminator="\n")
    writer.writerow(["seed", "method", *(field.name for field in fields(Chance))])
    writer.writerows([seed, method, *vars(each).values()] for each in found)
    write_atomic(FOLDER / "chances.csv", page.getvalue().encode())
    readme = FOLDER / "README.md"
    head, _, rest = readme.read_text(encoding="utf-8").partition(START)
    text = head + START + "\n".join(table(found)) + "\n" + END + rest.partition(END)[2]
    write_atomic(readme, text.encode())


def table(found: Sequence[Chance]) -> list[str]:
    """Shares of nulls below each level, with 95 % bounds."""
    heads = [f"{what}, p < {level:g}" for what in ("misfit", "strongest effect") for level in LEVELS]
    lines = [
        f"| correlation | rows of one run | {' | '.join(heads)} |",
        "| --: | :-- |" + " --: |" * len(heads),
    ]
    for correlation in CORRELATIONS:
        for told in (False, True):
            own = [each for each in found if each.correlation == correlation and each.told is told]
            cells = [
                share([getattr(each, name) < level for each in own])
                for name in ("misfit", "strongest")
                for level in LEVELS
            ]
            words = "told" if told else "not told"
            lines.append(f"| {correlation:g} | {words} | {' | '.join(cells)} |")
    return lines


if __name__ == "__main__":
    typer.run(main)
