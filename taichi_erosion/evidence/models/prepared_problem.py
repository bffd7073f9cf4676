"""A study prepared for inference: comparison rows, bound model, three disjoint sets of seeds, row variances.

Seeds for fitting, for signatures and for scoring are disjoint: a residual and a signature that share the
noise of one run correlate by chance, and an effect that does nothing looks present.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, comparison_rows
from taichi_erosion.evidence.data.heap_correlation import (
    HeapCorrelation,
    correlated,
    heap_correlation,
    replicates_of,
)
from taichi_erosion.evidence.data.linear_algebra import Whitening, Working, projection, working
from taichi_erosion.evidence.data.measurement_noise import NoiseLevelPrior, noise_level_prior
from taichi_erosion.evidence.data.problem import (
    Bools,
    Candidate,
    Floats,
    Integers,
    Measurements,
    Observable,
    Problem,
    stronger_candidate,
)
from taichi_erosion.evidence.data.transforms import Axis, adopted_axis, from_scale, parameter_axis
from taichi_erosion.evidence.models.condition_errors import (
    ConditionErrors,
    at_best,
    condition_errors,
    error_columns,
)
from taichi_erosion.evidence.models.predictor import Predictor, seed_mean, seed_variance

PROBE_SEEDS = 4  # enough to see whether the model has noise at all, and how much
NOISE_SHARE = 0.1  # of the laboratory's variance that the simulator's own may reach
SCORING_FACTOR, SCORING_FACTOR_QUICK = 4, 2  # scoring seeds per fitting seed: scored once, fitted many times
MOST_FITTING = 16
LEVEL_WIDTHS = (0.05, 0.15, 0.5, 1.5, 4.5)  # prior sd of a free level: of ln factor, or over the typical size
LEVEL_REACH = 1.5  # least prior sd over the level that the calibrated model leaves
WIDER = 8.0  # prior sd beyond its range at which a calibrated number is tried: is the range to blame?
NO_VALUE = "the model gives no value at"  # first words of a warning on conditions that are left out
UNKNOWN_NOISE = 1e-12  # variance where neither side has noise: keeps divisions finite


@dataclass(frozen=True)
class Seeds:
    """Disjoint sets of seeds."""

    fitting: Integers
    signature: Integers
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
    doubt: NoiseLevelPrior
    warnings: tuple[str, ...]
    levels: tuple[str, ...] = ()  # observables of free level: the first columns of the shared errors
    condition_errors: ConditionErrors | None = None  # None: every condition is exact
    heaps: HeapCorrelation | None = None  # None: every row counts as measured on heaps of its own

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self.predictor.axes

    @property
    def quick(self) -> bool:
        return self.problem.budget.name == "quick"

    @cached_property
    def low(self) -> Floats:
        return np.array([axis.low for axis in self.axes])

    @cached_property
    def high(self) -> Floats:
        return np.array([axis.high for axis in self.axes])

    @property
    def prior_mean(self) -> Floats:
        """Prior mean of the calibrated numbers, within their bounds."""
        return np.clip(np.zeros(len(self.axes)), self.low, self.high)

    @cached_property
    def sd(self) -> Floats:
        return np.sqrt(self.variance)

    @cached_property
    def correlation(self) -> Floats | None:
        """Correlation (n, n) of the errors of rows, beside errors that they share; None: they have none."""
        if self.rows.covariance is None:
            return None
        return self.rows.covariance / np.outer(self.sd, self.sd) + np.eye(self.sd.size)

    @cached_property
    def white(self) -> Whitening:
        """Whitening of the rows, censored ones as ordinary ones."""
        if self.correlation is None:
            return Whitening(self.sd)
        values, vectors = np.linalg.eigh(self.correlation)
        return Whitening(self.sd, root=(vectors / np.sqrt(values)) @ vectors.T)

    def whitening(self, work: Working) -> Whitening:
        """Whitening of the rows about a residual; no censored row is correlated with others."""
        return replace(self.white, weight=work.weight)

    @cached_property
    def log_correlation(self) -> float:
        """Half of ln |R|: what correlations of rows add to the ln of the volume of their errors."""
        if self.correlation is None:
            return 0.0
        return 0.5 * float(np.linalg.slogdet(self.correlation)[1])

    @cached_property
    def white_shared(self) -> Floats:
        """Errors that rows share (n, q), whitened."""
        return self.white(self.rows.shared)

    @cached_property
    def white_reach(self) -> Floats:
        """Reach of censored values, in sd of each row."""
        return self.rows.reach / self.sd

    @cached_property
    def noisy(self) -> bool:
        return bool(np.any(self.seed_variance > 0.0))

    def working(self, mean: Floats) -> Working:
        """Whitened residual of a predicted mean (n,), censored rows as ordinary ones."""
        return working(self.white(self.rows.z - mean), self.white_reach)

    def with_rows(self, rows: ComparisonRows) -> "PreparedProblem":
        """The same with other variances of the laboratory's rows."""
        return replace(self, rows=rows, variance=self.variance + rows.variance - self.rows.variance)

    @property
    def has_model_errors(self) -> bool:
        """Whether values of the model have errors that depend on its setting."""
        return self.predictor.uncertainty is not None or self.condition_errors is not None

    def model_errors(self, x: Floats, acting: dict[str, float]) -> Floats:
        """Columns (n, q) of one sd each: the model's own errors, then those of the stated conditions."""
        own = self.predictor.model_errors(x, acting)
        if self.condition_errors is None:
            return own
        return np.hstack([own, error_columns(self.condition_errors, self.predictor, x, acting)])

    def with_model_errors(
        self, x: Floats, acting: dict[str, float], moved: bool = False
    ) -> "PreparedProblem":
        """The same with the model's own errors at one setting among the shared ones.

        With `moved` the conditions are at their most probable values there.
        """
        own = self.model_errors(x, acting)
        if not own.shape[1]:
            return self
        found = replace(self, rows=replace(self.rows, shared=np.hstack([self.rows.shared, own])))
        errors = self.condition_errors
        if not moved or errors is None or not errors.movable:
            return found
        sizes = found.shared_sizes(x, acting)
        if sizes is None:
            return found
        count = self.rows.shared.shape[1] + self.predictor.model_errors(x, acting).shape[1]
        predictor, columns = at_best(errors, self.predictor, sizes[count:], x, acting)
        shared = np.hstack([found.rows.shared[:, :count], columns])
        return replace(found, rows=replace(found.rows, shared=shared), predictor=predictor)

    def shared_sizes(self, x: Floats, acting: dict[str, float]) -> Floats | None:
        """Most probable sizes of the shared errors, in their sd; None where the model fails."""
        mean = self.predictor.mean(x, acting, self.seeds.fitting)
        if not np.all(np.isfinite(mean)):
            return None
        work = self.working(mean)
        columns = self.whitening(work)(self.rows.shared)
        part = projection(np.zeros((mean.size, 0)), columns)
        return part.solve(np.concatenate([work.residual, np.zeros(columns.shape[1])]))

    def with_free_levels(self, widths: Mapping[str, float]) -> "PreparedProblem":
        """The same with one more number for each observable: how far all its rows lie above the model.

        An offset, on a logarithmic scale a factor, with the prior sd of `widths` on the comparison scale;
        declared errors that rows share become part of it.
        """
        columns, names = [], []
        for observable, chosen in self.by_observable():
            own = chosen[:, np.newaxis] * self.rows.shared
            wide = widths.get(observable.name, 0.0) * level_shape(observable, self.rows.z)
            columns.append(np.where(chosen, np.hypot(wide, np.sqrt(np.sum(own**2, axis=1))), 0.0))
            names.append(observable.name)
        rows = replace(self.rows, shared=np.column_stack(columns))
        return replace(self, rows=rows, levels=tuple(names))

    def level_widths(self, mean: Floats, least: Mapping[str, float] | None = None) -> dict[str, float]:
        """Prior sd of every free level: the least of the scale that holds what a calibrated mean leaves.

        None is smaller than in `least`.
        """
        found = {}
        for observable, chosen in self.by_observable():
            unit = self.level_unit(observable, chosen)
            gap = np.nan_to_num(np.median(self.rows.z[chosen] - mean[chosen])) / unit
            held = max(LEVEL_REACH * abs(gap), (least or {}).get(observable.name, 0.0) / unit)
            widths = [w for w in LEVEL_WIDTHS if w >= held * (1.0 - 1e-9)] or [LEVEL_WIDTHS[-1]]
            found[observable.name] = widths[0] * unit
        return found

    def level_columns(self) -> Floats:
        """Change of the rows (n, observables) by a level of width 1 of each observable."""
        columns = []
        for observable, chosen in self.by_observable():
            unit = self.level_unit(observable, chosen)
            columns.append(np.where(chosen, unit * level_shape(observable, self.rows.z), 0.0))
        return np.column_stack(columns)

    def level_unit(self, observable: Observable, chosen: Bools) -> float:
        """What a level of width 1 is on the comparison scale: a typical value, of logarithms a factor e."""
        z = self.rows.z[chosen]
        typical = max(float(np.median(np.abs(z))), float(np.std(z)), 1e-300)
        return typical if observable.transform == "identity" else 1.0

    def with_wide_ranges(self) -> "PreparedProblem":
        """The same with the ranges of all calibrated numbers wider by WIDER prior sd, strengths apart."""
        axes = tuple(
            replace(axis, low=axis.low - WIDER, high=axis.high + WIDER) if axis.logarithmic else axis
            for axis in self.axes
        )
        return replace(self, predictor=replace(self.predictor, axes=axes))

    def by_observable(self) -> Iterator[tuple[Observable, Bools]]:
        """Every observable that has rows, with the mask of its rows."""
        for index, observable in enumerate(self.rows.observables):
            chosen = self.rows.which == index
            if chosen.any():
                yield observable, chosen

    def candidate(self, name: str, beyond: bool = False) -> Candidate:
        """A candidate; with `beyond` one whose strength may exceed the largest that the list allows."""
        found = next(candidate for candidate in self.problem.candidates if candidate.name == name)
        return stronger_candidate(found) if beyond else found

    def mask(self, name: str) -> Bools:
        """Rows in which a candidate can act."""
        chosen = self.candidate(name).mask
        if chosen is None:
            return np.ones(self.rows.size, dtype=np.bool_)
        return np.broadcast_to(np.asarray(chosen(self.rows.conditions), dtype=np.bool_), self.rows.size)


def level_shape(observable: Observable, z: Floats) -> Floats:
    """Change of the comparison scale per unit of a free level: 1, but less where a floor dominates."""
    if observable.transform != "log_floor":
        return np.ones(z.size)
    return np.maximum(from_scale(observable, z), 0.0) * np.exp(-z)


def bound_predictor(problem: Problem, rows: ComparisonRows) -> Predictor:
    """The model over some rows; it is calibrated by the parameters, then the strengths of adopted effects."""
    axes = *map(parameter_axis, problem.parameters), *map(adopted_axis, problem.adopted)
    return Predictor(
        problem.model,
        rows.observables,
        rows.which,
        rows.conditions,
        axes,
        problem.candidates,
        problem.uncertainty,
    )


def prepare(problem: Problem, table: Measurements, seed: int) -> PreparedProblem:
    """Everything that is needed before the first fit; the model's own noise is measured at the prior mean.

    Conditions at which the model fails are left out, and so are rows of unknown noise. Raises BadInput.
    """
    rows = comparison_rows(problem, table)
    predictor = bound_predictor(problem, rows)
    start = np.array([min(max(0.0, axis.low), axis.high) for axis in predictor.axes])
    generator = np.random.default_rng(seed)
    values = predictor.predict(start, {}, draw_seeds(generator, PROBE_SEEDS))
    noisy = bool(np.nanmax(np.ptp(np.nan_to_num(values), axis=0), initial=0.0) > 0.0)
    variance = seed_variance(values, rows.which) if noisy else np.zeros(rows.size)
    seeds = Seeds(*(draw_seeds(generator, count) for count in seed_counts(problem, rows, variance, noisy)))
    failed = ~np.isfinite(seed_mean(values))
    replicates = replicates_of(rows, values) if noisy and rows.heaps else problem.replicates
    heaps = heap_correlation(rows, table, replicates)
    rows = correlated(rows, heaps)
    warnings = [*rows.warnings, *(heaps.sentences if heaps is not None else ())]
    if failed.all():
        raise BadInput(f"{NO_VALUE} any measured condition with the start values of its numbers")
    if failed.any():
        words = f"{NO_VALUE} {int(failed.sum())} of {rows.size} conditions; they are left out"
        warnings.append(words)
        rows, variance = rows.rows(~failed), variance[~failed]
    known = rows.known
    rows, variance = rows.rows(known), variance[known]
    predictor = predictor.over(rows.observables, rows.which, rows.conditions)
    total = rows.variance + variance / seeds.scoring.size + UNKNOWN_NOISE
    prior = noise_level_prior(rows.freedom)
    errors = condition_errors(rows)
    return PreparedProblem(
        problem,
        rows,
        predictor,
        seeds,
        variance,
        total,
        prior,
        tuple(warnings),
        condition_errors=errors,
        heaps=heaps,
    )


def draw_seeds(generator: np.random.Generator, count: int) -> Integers:
    """Fresh seeds that any generator accepts."""
    return generator.integers(1, 2**31 - 1, size=count).astype(np.int64)


def seed_counts(
    problem: Problem, rows: ComparisonRows, variance: Floats, noisy: bool
) -> tuple[int, int, int]:
    """How many seeds fit, make signatures, score.

    Seeds per fitted setting: until the simulator's variance is NOISE_SHARE of the laboratory's, within the
    budget for all settings that an analysis visits, scoring seeds included.
    """
    if not noisy:
        return 1, 1, 1
    quick = problem.budget.name == "quick"
    p, k = len(problem.parameters) + len(problem.adopted), len(problem.candidates)
    settings = 10.0 * p + 12.0 * (p + 1) + 5.0 * k + 8.0 * (6.0 * p + 14.0)
    if quick:
        settings = 4.0 * (p + 1) + 3.0 * k + 3.0 * (3.0 * p + 8.0)
    known, count = rows.known, PROBE_SEEDS
    if known.any():
        share = float(np.nanmedian(variance[known] / np.maximum(rows.variance[known], UNKNOWN_NOISE)))
        most = max(2, min(problem.budget.settings(rows.size) / settings, MOST_FITTING))
        count = int(np.clip(np.ceil(share / NOISE_SHARE), 2, most))
    return count, count, count * (SCORING_FACTOR_QUICK if quick else SCORING_FACTOR)
