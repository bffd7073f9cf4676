"""Two observables of one experiment with correlated scatter, in closed form: answers with and without it.

    python -m doe.one_heap.run --nulls 120 --singles 40 --correlation 0.8
    python -m doe.one_heap.run --nulls 120 --singles 0 --correlation -0.8 --correlation 0

Each writes its answers into results.csv, beside those of other correlations, and the table of README.md.
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from time import process_time
from typing import Annotated, Any

import numpy as np
import typer
from scipy import stats
from threadpoolctl import threadpool_limits

from doe.common.method import method_commit
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.findings import Discovery
from taichi_erosion.evidence.data.problem import (
    Candidate,
    Conditions,
    Floats,
    Integers,
    Measurements,
    Numbers,
    Observable,
    Parameter,
    Problem,
)
from taichi_erosion.evidence.models import reduced

FOLDER = Path(__file__).parent
MARK = "<!-- table -->\n"
OBSERVABLES = ("threshold_u_star", "flux")
CANDIDATES = (
    "dry_cohesion",
    "liquid_bridge",
    "saffman_lift",
    "sheltering",
    "electrostatics",
    "mid_air_collisions",
)
CELLS, REPEATS = 16, 3
SCATTER = (0.03, 0.1)  # sd of ln of threshold and of flux, of single runs
PRIOR_SD = 0.2  # of ln of a calibrated number
STRENGTH = (0.5, 3.0)  # log-uniform


@dataclass(frozen=True)
class Draw:
    """One table and what was put into it."""

    problem: Problem  # with the experiments told
    parameters: Numbers
    effects: Numbers


@dataclass(frozen=True)
class Outcome:
    """What was said of one table."""

    seed: int
    method: str  # commit
    correlation: float
    effect: str
    number: int
    told: bool  # which rows are of one experiment
    verdict: str
    named: str
    p: float
    inside: int  # 90 % intervals of calibrated numbers that hold the truth
    numbers: int
    strength_inside: str  # of the effect, where it is named: yes or no
    width: float  # geometric mean of the intervals of calibrated numbers, in ln
    seconds: float


def model(
    observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
) -> Floats:
    """The closed-form model without scatter."""
    value = reduced.expected(observable, conditions, parameters, effects)
    return np.repeat(value[np.newaxis], seeds.size, axis=0)


def draw(seed: int, number: int, correlation: float, with_effect: bool) -> Draw:
    """Experiments at conditions drawn anew, three at each."""
    random = np.random.default_rng([seed, number, round(100 * (1 + correlation)), with_effect])
    at = {
        "diameter": np.exp(random.uniform(np.log(1.5e-4), np.log(5e-4), CELLS)),
        "moisture": random.choice([0.0, 0.002, 0.005, 0.01], CELLS),
        "spread": random.uniform(1.2, 2.5, CELLS),
        "u_star": random.uniform(0.7, 1.0, CELLS),
    }
    at = {name: np.repeat(column, REPEATS) for name, column in at.items()}
    starts = {"threshold_coefficient": 0.1, "flux_coefficient": 1.5}
    parameters = {k: v * float(np.exp(PRIOR_SD * random.standard_normal())) for k, v in starts.items()}
    low, high = np.log(STRENGTH)
    name, strength = str(random.choice(CANDIDATES)), float(np.exp(random.uniform(low, high)))
    effects = {name: strength} if with_effect else {}
    root = np.linalg.cholesky([[1.0, correlation], [correlation, 1.0]])
    errors = random.standard_normal((CELLS * REPEATS, 2)) @ root.T
    values = [
        reduced.expected(observable, at, parameters, effects) * np.exp(sd * error)
        for observable, sd, error in zip(OBSERVABLES, SCATTER, errors.T, strict=True)
    ]
    numbers = tuple(Parameter(k, v, 0.2 * v, 5.0 * v, PRIOR_SD) for k, v in starts.items())
    problem = Problem(
        table_of(at, values),
        {name: Observable(name, "log") for name in OBSERVABLES},
        numbers,
        tuple(map(Candidate, CANDIDATES)),
        model,
    )
    return Draw(problem, parameters, effects)


def table_of(at: Conditions, values: Sequence[Floats]) -> Measurements:
    """The experiments as a table of runs: no sd, every row a single one."""
    size = CELLS * REPEATS
    cell = np.repeat(np.arange(CELLS), REPEATS)
    return Measurements(
        observable=tuple(name for name in OBSERVABLES for _ in range(size)),
        value=np.concatenate(values),
        sd=np.full(2 * size, np.nan),
        n=np.ones(2 * size),
        group=tuple(f"set-up {k}" for k in cell) * 2,
        unit=("m/s",) * size + ("kg/(m s)",) * size,
        conditions={name: np.tile(column, 2) for name, column in at.items()},
        censored=np.zeros(2 * size, dtype=np.bool_),
        limit=np.full(2 * size, np.nan),
        source=("made",) * (2 * size),
        heap=tuple(f"run {k}" for k in range(size)) * 2,
    )


@dataclass(frozen=True)
class Case:
    """Which table is drawn."""

    seed: int
    method: str  # commit
    correlation: float
    number: int
    acts: bool  # an effect acts


def outcome(asked: Case, case: Draw, told: bool) -> Outcome:
    """What `discover` says."""
    problem = case.problem
    if not told:
        problem = replace(problem, measurements=replace(problem.measurements, heap=()))
    start = process_time()
    found = discover(problem, asked.number, problem.budget, no_progress)
    fits = [(found.parameters[name], value) for name, value in case.parameters.items()]
    return Outcome(
        asked.seed,
        asked.method,
        asked.correlation,
        "+".join(case.effects),
        asked.number,
        told,
        found.verdict,
        "+".join(found.named),
        found.p,
        sum(fit.low <= value <= fit.high for fit, value in fits),
        len(fits),
        strength_inside(found, case),
        float(np.exp(np.mean([np.log(np.log(fit.high / fit.low)) for fit, _ in fits]))),
        process_time() - start,
    )


def strength_inside(found: Discovery, case: Draw) -> str:
    """Whether the interval of the strength that was put in holds it; empty where it is not named."""
    for name, value in case.effects.items():
        if name in found.named:
            effect = found.effects[name]
            return "yes" if effect.strength_low <= value <= effect.strength_high else "no"
    return ""


def main(
    correlation: Annotated[list[float], typer.Option()], nulls: int = 120, singles: int = 40, seed: int = 1
) -> None:
    """Draw, answer twice, count; what is there so far is written after every table."""
    method = method_commit()
    results = [each for each in known() if each.correlation not in correlation]
    plan = [
        Case(seed, method, r, k, acts)
        for acts, n in ((False, nulls), (True, singles))
        for k in range(n)
        for r in correlation
    ]
    with threadpool_limits(1, user_api="blas"):
        for asked in plan:
            case = draw(asked.seed, asked.number, asked.correlation, asked.acts)
            results += [outcome(asked, case, told) for told in (False, True)]
            write(results)


def known() -> list[Outcome]:
    """Answers that stand in the table already."""
    with (FOLDER / "results.csv").open(encoding="utf-8", newline="") as file:
        return [
            Outcome(**{f.name: read_cell(f.type, row[f.name]) for f in fields(Outcome)})
            for row in csv.DictReader(file)
        ]


def read_cell(kind: Any, text: str) -> Any:
    """A cell as its column has it."""
    return text == "True" if kind is bool else kind(text)


def write(results: Sequence[Outcome]) -> None:
    """Results and the table of the page."""
    page = io.StringIO()
    writer = csv.writer(page, lineterminator="\n")
    writer.writerow([field.name for field in fields(Outcome)])
    for each in results:
        writer.writerow([f"{v:.4g}" if isinstance(v, float) else v for v in vars(each).values()])
    write_atomic(FOLDER / "results.csv", page.getvalue().encode())
    readme = FOLDER / "README.md"
    head = readme.read_text(encoding="utf-8").partition(MARK)[0]
    write_atomic(readme, (head + MARK + "\n".join(table(results)) + "\n").encode())


def table(results: Sequence[Outcome]) -> list[str]:
    """Shares with 95 % bounds of Clopper and Pearson."""
    lines = [
        '| correlation | rows of one run | nulls: named | nulls: "not in the list" | singles: named rightly '
        "| named wrongly | intervals of numbers | of named strengths | width of intervals |",
        "| --: | :-- | --: | --: | --: | --: | --: | --: | --: |",
    ]
    for correlation in sorted({each.correlation for each in results}, reverse=True):
        for told in (False, True):
            own = [e for e in results if e.correlation == correlation and e.told is told]
            nulls, singles = [e for e in own if not e.effect], [e for e in own if e.effect]
            if not own:
                continue
            strengths = [e.strength_inside == "yes" for e in singles if e.strength_inside]
            wrong = [bool(set(filter(None, e.named.split("+"))) - {e.effect}) for e in singles]
            cells = [
                share([bool(e.named) for e in nulls]),
                share([e.verdict == "outside_library" for e in nulls]),
                share([e.named == e.effect for e in singles]),
                share(wrong),
                share([True] * sum(e.inside for e in own) + [False] * sum(e.numbers - e.inside for e in own)),
                share(strengths),
                f"{np.exp(np.mean([np.log(e.width) for e in own])):.3f}",
            ]
            words = "told" if told else "not told"
            lines.append(f"| {correlation:g} | {words} | {' | '.join(cells)} |")
    return lines


def share(hits: Sequence[bool]) -> str:
    """Share with its bounds."""
    if not hits:
        return ""
    found = stats.binomtest(sum(hits), len(hits)).proportion_ci(0.95)
    return f"{np.mean(hits):.3f} ({found.low:.3f} to {found.high:.3f})"


if __name__ == "__main__":
    typer.run(main)
