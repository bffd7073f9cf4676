"""A study made ready: scaled rows, a counted model, seeds of three kinds, the variance of everything.

Seeds for fitting, for signatures and for judging are disjoint: a residual and a signature that share the
noise of one run correlate by chance, and an effect that does nothing looks present.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, comparison_rows
from taichi_erosion.evidence.data.measurement_noise import NoiseLevelPrior, noise_level_prior
from taichi_erosion.evidence.data.problem import Bools, Candidate, Floats, Integers, Measurements, Problem
from taichi_erosion.evidence.data.transforms import Axis, adopted_axis, parameter_axis
from taichi_erosion.evidence.models.predictor import Predictor, seed_mean, seed_variance

PROBE_SEEDS = 4  # enough to see whether the model has noise at all, and how much
NOISE_SHARE = 0.1  # of the laboratory's variance that the simulator's own may reach
SCORING_FACTOR = 4  # seeds that judge, per seed that fits: judged once, fitted many times
MOST_FITTING = 16
UNKNOWN_NOISE = 1e-12  # variance where neither side has noise: keeps divisions finite


@dataclass(frozen=True)
class Seeds:
    """Disjoint sets of seeds."""

    fitting: Integers
    signature: Integers
    scoring: Integers


@dataclass(frozen=True)
class PreparedProblem:
    """What every later step works on."""

    problem: Problem
    rows: ComparisonRows
    predictor: Predictor
    seeds: Seeds
    seed_variance: Floats  # of one seed, row by row; zero for a model without noise
    variance: Floats  # of a judged residual: laboratory, numerical, simulated mean
    doubt: NoiseLevelPrior
    warnings: tuple[str, ...]

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self.predictor.axes

    @cached_property
    def low(self) -> Floats:
        return np.array([axis.low for axis in self.axes])

    @cached_property
    def high(self) -> Floats:
        return np.array([axis.high for axis in self.axes])

    @cached_property
    def sd(self) -> Floats:
        return np.sqrt(self.variance)

    @cached_property
    def noisy(self) -> bool:
        return bool(np.any(self.seed_variance > 0.0))

    def about(self, x: Floats, acting: dict[str, float]) -> "PreparedProblem":
        """The same with the model's own errors at one setting among the shared ones."""
        own = self.predictor.model_errors(x, acting)
        if not own.shape[1]:
            return self
        return replace(self, rows=replace(self.rows, shared=np.hstack([self.rows.shared, own])))

    def candidate(self, name: str) -> Candidate:
        return next(candidate for candidate in self.problem.candidates if candidate.name == name)

    def mask(self, name: str) -> Bools:
        """Rows in which a candidate can act."""
        chosen = self.candidate(name).mask
        if chosen is None:
            return np.ones(self.rows.size, dtype=np.bool_)
        return np.broadcast_to(np.asarray(chosen(self.rows.conditions), dtype=np.bool_), self.rows.size)


def axes_of(problem: Problem) -> tuple[Axis, ...]:
    """Calibrated numbers: the parameters, then the strengths of adopted effects."""
    return tuple(parameter_axis(p) for p in problem.parameters) + tuple(
        adopted_axis(c) for c in problem.adopted
    )


def bound_predictor(problem: Problem, rows: ComparisonRows) -> Predictor:
    """The model over some rows."""
    return Predictor(
        problem.model,
        rows.observables,
        rows.which,
        rows.conditions,
        axes_of(problem),
        problem.candidates,
        problem.uncertainty,
    )


def prepare(problem: Problem, table: Measurements, seed: int) -> PreparedProblem:
    """Everything that is needed before the first fit; measures the model's own noise at the start values."""
    rows = comparison_rows(problem, table)
    predictor = bound_predictor(problem, rows)
    start = np.array([min(max(0.0, axis.low), axis.high) for axis in predictor.axes])
    generator = np.random.default_rng(seed)
    probe = draw_seeds(generator, PROBE_SEEDS)
    values = predictor.predict(start, {}, probe)
    warnings = list(rows.warnings)
    variance = seed_variance(values, rows.which)
    noisy = bool(np.nanmax(np.ptp(np.nan_to_num(values), axis=0), initial=0.0) > 0.0)
    if not noisy:
        variance = np.zeros(rows.size)
    count = fitting_seeds(problem, rows, variance) if noisy else 1
    draw = iter([draw_seeds(generator, k) for k in seed_counts(problem, count, noisy)])
    seeds = Seeds(next(draw), next(draw), next(draw))
    failed = ~np.isfinite(seed_mean(values))
    if failed.all() and rows.size:
        warnings.append("the model fails at every condition with the start values")
    usable = ~failed
    if failed.any():
        warnings.append(
            f"the model fails at {int(failed.sum())} of {rows.size} conditions; they are left out"
        )
        rows, variance = rows.rows(usable), variance[usable]
        predictor = predictor.over(rows.observables, rows.which, rows.conditions)
    return judged(problem, rows, predictor, seeds, variance, tuple(warnings))


def judged(
    problem: Problem,
    rows: ComparisonRows,
    predictor: Predictor,
    seeds: Seeds,
    variance: Floats,
    warnings: tuple[str, ...],
) -> PreparedProblem:
    """Rows with known noise, and the variance of their judged residuals."""
    known = rows.known
    kept = rows.rows(known)
    kept_predictor = predictor.over(kept.observables, kept.which, kept.conditions)
    total = kept.variance + variance[known] / seeds.scoring.size + UNKNOWN_NOISE
    return PreparedProblem(
        problem,
        kept,
        kept_predictor,
        seeds,
        variance[known],
        total,
        noise_level_prior(rows.freedom),
        warnings,
    )


def draw_seeds(generator: np.random.Generator, count: int) -> Integers:
    """Fresh seeds that any generator accepts."""
    return generator.integers(1, 2**31 - 1, size=count).astype(np.int64)


def fitting_seeds(problem: Problem, rows: ComparisonRows, variance: Floats) -> int:
    """Seeds per fitted setting: until the simulator's variance is a small share, within the budget."""
    known = rows.known
    if not known.any():
        return PROBE_SEEDS
    wanted = (
        float(np.nanmedian(variance[known] / np.maximum(rows.variance[known], UNKNOWN_NOISE))) / NOISE_SHARE
    )
    affordable = problem.budget.runs / settings_needed(problem)
    return int(np.clip(np.ceil(wanted), 2, max(2, min(affordable, MOST_FITTING))))


def settings_needed(problem: Problem) -> float:
    """Settings of the model that an autopsy visits, judging seeds included."""
    p, k = len(problem.parameters) + len(problem.adopted), len(problem.candidates)
    if problem.budget.name == "quick":
        return 4.0 * (p + 1) + 3.0 * k + 3.0 * (3.0 * p + 8.0)
    return 10.0 * p + 12.0 * (p + 1) + 5.0 * k + 8.0 * (6.0 * p + 14.0)


def seed_counts(problem: Problem, fitting: int, noisy: bool) -> tuple[int, int, int]:
    """How many seeds fit, make signatures, judge."""
    if not noisy:
        return 1, 1, 1
    factor = 2 if problem.budget.name == "quick" else SCORING_FACTOR
    return fitting, fitting, fitting * factor
