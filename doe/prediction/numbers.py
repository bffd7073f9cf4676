"""Coverage of the intervals of calibrated numbers on the cases of predictions.

python -m doe.prediction.numbers --cases 60    draws a new salt, writes numbers.csv and the table of README.md
"""

import csv
import io
import secrets
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import typer
from threadpoolctl import threadpool_limits

from doe.prediction.cases import draw
from doe.prediction.run import DISCREPANCIES, interval
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.compare import SEED, calibrated_base, no_progress
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.intervals.estimates import estimates_alone
from taichi_erosion.evidence.inference.posterior import parameter_estimates

FOLDER = Path(__file__).parent
START, END = "<!-- numbers -->\n", "<!-- end of numbers -->"


@dataclass(frozen=True)
class NumberScore:
    """Shares of the identified numbers of one case that are inside their intervals."""

    discrepancy: float
    number: int
    plain: float  # of the calibrated model alone
    averaged: float  # with levels and discrepancies
    width: float  # averaged over plain, median


def score(salt: int, number: int, discrepancy: float) -> NumberScore:
    """One case, calibrated as `compare` does; numbers that it calls not identified are left out."""
    seed = np.random.SeedSequence([salt, number, round(10 * discrepancy)]).generate_state(1)[0]
    case = draw(int(seed), discrepancy)
    prepared, base, _ = calibrated_base(case.problem, SEED, no_progress)
    plain, averaged = parameter_estimates(prepared, base), estimates_alone(prepared, base)[1]
    told = [path for path, each in averaged.items() if each.prior_share < levels.UNIDENTIFIED]
    inside = [
        float(np.mean([table[path].low <= case.numbers[path] <= table[path].high for path in told]))
        for table in (plain, averaged)
    ]
    widths = [tuple(table[path].high - table[path].low for path in told) for table in (plain, averaged)]
    ratio = np.median([after / before for before, after in zip(*widths, strict=True) if before > 0.0])
    return NumberScore(discrepancy, number, *inside, float(ratio))


def main(cases: int = 60) -> None:
    """Draw, calibrate and count."""
    salt = secrets.randbits(63)
    with threadpool_limits(1, user_api="blas"):
        scores = [score(salt, number, size) for size in DISCREPANCIES for number in range(cases)]
    page = io.StringIO()
    writer = csv.writer(page, lineterminator="\n")
    writer.writerow(["salt", *NumberScore.__dataclass_fields__])
    writer.writerows([salt, *(f"{value:.4g}" for value in vars(each).values())] for each in scores)
    write_atomic(FOLDER / "numbers.csv", page.getvalue().encode())
    readme = FOLDER / "README.md"
    head, _, rest = readme.read_text(encoding="utf-8").partition(START)
    tail = rest.partition(END)[2]
    write_atomic(readme, (head + START + "\n".join(table(scores)) + "\n" + END + tail).encode())


def table(scores: list[NumberScore]) -> list[str]:
    """Means over cases with their 95 % intervals."""
    lines = ["| discrepancy | cases | inside, calibrated model alone | inside, averaged | width ratio |"]
    lines += ["|---|---|---|---|---|"]
    for size in DISCREPANCIES:
        own = [each for each in scores if each.discrepancy == size]
        cells = " | ".join(interval([getattr(each, key) for each in own]) for key in ("plain", "averaged"))
        lines.append(f"| {size:g} | {len(own)} | {cells} | {np.median([each.width for each in own]):.2f} |")
    return lines


if __name__ == "__main__":
    typer.run(main)
