"""Coverage of the intervals of `predict` on closed-form cases, with and without a smooth discrepancy.

python -m doe.prediction.run --cases 200      draws a new salt, writes coverage.csv and the table of README.md
"""

import csv
import io
import secrets
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import typer
from scipy import stats
from threadpoolctl import threadpool_limits

from doe.prediction.cases import draw
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.prediction.new_conditions import NewConditions
from taichi_erosion.evidence.prediction.predict import predict

FOLDER = Path(__file__).parent
DISCREPANCIES = (0.0, 0.5, 1.0, 2.0)  # rms over the standard error of a row
MARK = "<!-- table -->\n"


@dataclass(frozen=True)
class Score:
    """Shares inside of one case."""

    discrepancy: float
    number: int
    mean: float  # of true means inside `low` to `high`
    measured: float  # of new measurements inside `measured_low` to `measured_high`
    fitted: float  # of fitted rows inside what the others predict
    width: float  # of the interval of the mean over that of one measurement


def score(salt: int, number: int, discrepancy: float) -> Score:
    """One case, solved as `predict` does."""
    seed = np.random.SeedSequence([salt, number, round(10 * discrepancy)]).generate_state(1)[0]
    case = draw(int(seed), discrepancy)
    found = predict(case.problem, NewConditions(case.observable, case.conditions))
    rows = found.rows
    inside = [row.low <= true <= row.high for row, true in zip(rows, case.truth, strict=True)]
    pairs = zip(rows, case.measured, strict=True)
    single = [row.measured_low <= value <= row.measured_high for row, value in pairs]
    width = [(row.high - row.low) / (row.measured_high - row.measured_low) for row in rows]
    mean, measured, spread = float(np.mean(inside)), float(np.mean(single)), float(np.mean(width))
    return Score(discrepancy, number, mean, measured, found.fitted.inside / found.fitted.n, spread)


def main(cases: int = 200) -> None:
    """Draw, solve and count."""
    salt = secrets.randbits(63)
    with threadpool_limits(1, user_api="blas"):
        scores = [score(salt, number, size) for size in DISCREPANCIES for number in range(cases)]
    page = io.StringIO()
    writer = csv.writer(page, lineterminator="\n")
    writer.writerow(["salt", *Score.__dataclass_fields__])
    writer.writerows([salt, *(f"{value:.4g}" for value in vars(each).values())] for each in scores)
    write_atomic(FOLDER / "coverage.csv", page.getvalue().encode())
    readme = FOLDER / "README.md"
    head = readme.read_text(encoding="utf-8").partition(MARK)[0]
    write_atomic(readme, (head + MARK + "\n".join(table(scores)) + "\n").encode())


def table(scores: list[Score]) -> list[str]:
    """Means over cases with their standard errors; cases, not rows, are independent."""
    lines = ["| discrepancy | cases | mean inside | new measurement inside | fitted row inside | width |"]
    lines += ["|---|---|---|---|---|---|"]
    for size in DISCREPANCIES:
        own = [each for each in scores if each.discrepancy == size]
        cells = [interval([getattr(each, key) for each in own]) for key in ("mean", "measured", "fitted")]
        width = np.mean([each.width for each in own])
        lines.append(f"| {size:g} | {len(own)} | {' | '.join(cells)} | {width:.2f} |")
    return lines


def interval(shares: list[float]) -> str:
    """Mean share with its 95 % interval, cases as the unit."""
    half = stats.t.ppf(0.975, len(shares) - 1) * np.std(shares, ddof=1) / np.sqrt(len(shares))
    return f"{np.mean(shares):.3f} +- {half:.3f}"


if __name__ == "__main__":
    typer.run(main)
