"""A study prepared for the race: comparison rows, bound model, seeds, variances of the rows.

Seeds for fitting and for scoring are disjoint: settings are compared with few seeds that they share, and the
mean of many others says where they all lie.

Errors of stated conditions are propagated through the slope of the model (effective variance). A row says
that a condition was c; in truth it was c + s u, with u ~ N(0, 1) and s the `sd of` that condition:

    z = m(c + s u) + e ~ m(c) + F u + e,    F = s dm/dc

The columns of F are errors that rows share: the rows of one set-up under the same conditions share one u.
This is right for a condition that was set to c and then differs from it (Berkson). One that was measured,
with an error, is taken so too: a law along it comes out too flat (regression dilution).

Reference: Orear (1982), Am. J. Phys. 50, 912 (effective variance); Carroll, Ruppert, Stefanski & Crainiceanu
(2006), Measurement Error in Nonlinear Models, chapter 1 (Berkson and classical errors).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data import transforms
from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, comparison_rows, condition_groups
from taichi_erosion.evidence.data.heap_correlation import HeapCorrelation, add_correlation, heap_correlation
from taichi_erosion.evidence.data.problem import (
    MOST_SETTINGS,
    Bools,
    Conditions,
    Floats,
    Integers,
    Measurements,
    Numbers,
    Observable,
    Problem,
)
from taichi_erosion.evidence.models.predictor import Predictor, mean_over_finite_seeds, pooled_seed_variance

SLOPE_SEED = 1  # of the runs from which slopes along conditions are taken
PROBE_SEEDS = 4  # enough to see whether the model has noise at all, and how much
NOISE_SHARE = 0.1  # of the laboratory's variance that the simulator's own may reach
SCORING_FACTOR = 4  # scoring seeds per fitting seed: scored once, fitted many times
BARE, EACH = 25, 9  # settings of an answer without candidates, and for each candidate and number
MOST_FITTING = 16
NO_VALUE = "the model gives no value at"  # first words of a warning on conditions that are left out
UNKNOWN_NOISE = 1e-12  # variance where neither side has noise: keeps divisions finite


@dataclass(frozen=True)
class Seeds:
    fitting: Integers
    scoring: Integers


@dataclass(frozen=True)
class PreparedProblem:
    """Rows of known noise with the model bound to them."""

    problem: Problem
    rows: ComparisonRows
    predictor: Predictor
    seeds: Seeds
    seed_variance: Floats  # (n,), of one seed; zero for a model without noise
    variance: Floats  # (n,), of a scored residual: laboratory, numerical, simulated mean
    warnings: tuple[str, ...]
    heaps: HeapCorrelation | None = None  # None: every row counts as measured on heaps of its own

    @property
    def parameter_axes(self) -> tuple[transforms.Axis, ...]:
        return self.predictor.axes

    @cached_property
    def condition_errors(self) -> tuple[Conditions, Integers]:
        return condition_errors(self.rows)

    @cached_property
    def row_sd(self) -> Floats:
        return np.sqrt(self.variance)

    @cached_property
    def error_correlation_of_rows(self) -> Floats | None:
        """Correlation (n, n) of the errors of rows, beside errors that they share; None: they have none."""
        if self.rows.covariance is None:
            return None
        return self.rows.covariance / np.outer(self.row_sd, self.row_sd) + np.eye(self.row_sd.size)

    @cached_property
    def whiten(self) -> transforms.Whitening:
        """Whitening of the rows, censored ones as ordinary ones."""
        if self.error_correlation_of_rows is None:
            return transforms.Whitening(self.row_sd)
        values, vectors = np.linalg.eigh(self.error_correlation_of_rows)
        return transforms.Whitening(self.row_sd, root=(vectors / np.sqrt(values)) @ vectors.T)

    def working_residuals(self, mean: Floats) -> transforms.Working:
        """Whitened residual of a predicted mean (n,), censored rows as ordinary ones."""
        return transforms.working_residuals(self.whiten(self.rows.z - mean), self.rows.reach / self.row_sd)

    def model_errors(
        self, x: Floats, acting: Numbers, doses: Conditions | None = None, exact: int | None = None
    ) -> Floats:
        """Columns (n, q) of one sd each: the model's errors, those of stated conditions, of rounding."""
        parts, (errors, cell) = [self.predictor.error_factor(x, acting, doses, exact)], self.condition_errors
        for name, sd in errors.items():
            change = change_per_sd(self.predictor, name, sd, x, acting)
            column = cell[:, np.newaxis] == np.unique(cell[sd > 0.0])
            parts.append(np.where(column, change[:, np.newaxis], 0.0))
        return np.hstack([*parts, np.diag(self.rows.rounding)[:, self.rows.rounding > 0.0]])

    def observables_with_row_masks(self) -> Iterator[tuple[Observable, Bools]]:
        for index, observable in enumerate(self.rows.observables):
            chosen = self.rows.which == index
            if chosen.any():
                yield observable, chosen


def prepare_problem(problem: Problem, table: Measurements, seed: int) -> PreparedProblem:
    """Everything that is needed before the first fit; the model's own noise is measured at the prior mean.

    The model is calibrated by the parameters, then the strengths of adopted effects. Conditions at which it
    fails are left out, and so are rows of unknown noise and readings that their repeats contradict. Raises
    BadInput.
    """
    rows = comparison_rows(problem, table)
    axes = *map(transforms.parameter_axis, problem.parameters), *map(transforms.adopted_axis, problem.adopted)
    columns = rows.observables, rows.which, rows.conditions
    predictor = Predictor(problem.model, *columns, axes, problem.candidates, problem.uncertainty)
    start = np.array([min(max(0.0, axis.low), axis.high) for axis in predictor.axes])
    generator = np.random.default_rng(seed)
    values = predictor.predict_on_scale(start, {}, random_seeds(generator, PROBE_SEEDS))
    noisy = bool(np.nanmax(np.ptp(np.nan_to_num(values), axis=0), initial=0.0) > 0.0)
    variance = pooled_seed_variance(values, rows.which) if noisy else np.zeros(rows.size)
    seeds = Seeds(*(random_seeds(generator, count) for count in seed_counts(problem, rows, variance, noisy)))
    failed = ~np.isfinite(mean_over_finite_seeds(values))
    heaps = heap_correlation(rows, table, problem.replicates)
    rows = add_correlation(rows, heaps)
    if failed.all():
        raise BadInput(f"{NO_VALUE} any measured condition with the start values of its numbers")
    lost = f"{NO_VALUE} {int(failed.sum())} of {rows.size} conditions; they are left out"
    warnings = rows.warnings + (lost,) * bool(failed.any())
    usable = ~failed & rows.has_noise & ~rows.awaits_correction
    rows, variance = rows.select_rows(usable), variance[usable]
    predictor = predictor.at_rows(rows.which, rows.conditions)
    total = rows.variance + variance / seeds.scoring.size + UNKNOWN_NOISE
    return PreparedProblem(problem, rows, predictor, seeds, variance, total, warnings, heaps)


def random_seeds(generator: np.random.Generator, count: int) -> Integers:
    return generator.integers(1, 2**31 - 1, size=count).astype(np.int64)


def usual_count_of_settings(numbers: int, candidates: int) -> int:
    """Settings of the model that an answer usually takes (80 tables of doe/trials)."""
    return BARE + EACH * max(numbers, 1) * candidates


def seed_counts(problem: Problem, rows: ComparisonRows, variance: Floats, noisy: bool) -> tuple[int, int]:
    """How many seeds fit and score: until the simulator's variance is NOISE_SHARE of the laboratory's.

    The runs of a usual answer stay within the budget.
    """
    finite, count = rows.has_noise, 1
    if noisy and finite.any():
        numbers = len(problem.parameters) + len(problem.adopted)
        share = float(np.nanmedian(variance[finite] / np.maximum(rows.variance[finite], UNKNOWN_NOISE)))
        settings = MOST_SETTINGS if problem.runs is None else problem.runs / max(rows.size, 1)
        most = settings / usual_count_of_settings(numbers, len(problem.candidates))
        count = int(np.clip(np.ceil(share / NOISE_SHARE), 2, max(2, min(most, MOST_FITTING))))
    return count, count * SCORING_FACTOR if noisy else 1


def condition_errors(rows: ComparisonRows) -> tuple[Conditions, Integers]:
    """Sd (n,) of conditions that are not exact, and the number (n,) of each row's set-up and conditions.

    Rows of one number share an error.
    """
    errors = {name: np.nan_to_num(sd) for name, sd in rows.condition_sd.items() if np.any(sd > 0.0)}
    cells = zip(rows.group, rows.source, condition_groups(rows), strict=True)
    keys = ["|".join(map(str, each)) for each in cells]
    return errors, np.unique(keys, return_inverse=True)[1]


def change_per_sd(predictor: Predictor, name: str, sd: Floats, x: Floats, acting: Numbers) -> Floats:
    """Half the difference of the mean one sd above and below; 0 where the model fails.

    A condition that is nowhere negative is not taken below 0.
    """
    uncertain, change = np.flatnonzero(sd > 0.0), np.zeros(sd.size)
    conditions = {key: column[uncertain] for key, column in predictor.conditions.items()}
    which, values = predictor.which[uncertain], conditions[name]
    least = 0.0 if np.nanmin(values) >= 0.0 else -np.inf
    ends = [np.maximum(values - sd[uncertain], least), values + sd[uncertain]]
    seeds = random_seeds(np.random.default_rng(SLOPE_SEED), PROBE_SEEDS)
    parts = [predictor.at_rows(which, {**conditions, name: end}) for end in ends]
    low, high = (part.predict_on_scale(x, acting, seeds) for part in parts)
    gap = mean_over_finite_seeds(high) - mean_over_finite_seeds(low)
    change[uncertain] = np.nan_to_num(gap * sd[uncertain] / (ends[1] - ends[0]))
    return change
