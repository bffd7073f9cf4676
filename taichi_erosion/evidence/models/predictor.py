"""Cached predictions on the comparison scale with their cost, and scales of conditions."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from taichi_erosion.evidence.data import problem
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Numbers, Observable, pick_rows
from taichi_erosion.evidence.data.transforms import Axis, split_numbers, to_scale

Key = tuple[bytes, tuple[tuple[str, float], ...], bytes]
NEGLIGIBLE = 1e-6  # share of the largest variance below which a common error is dropped
PRIOR_FREEDOM = 6.0  # nu_0, degrees of freedom of the pooled variance of seeds
LOG_SPAN = 3.0  # a positive condition that spans more than this factor is taken by its logarithm


@dataclass
class ModelCost:
    runs: int = 0  # a run is one set-up, evaluated with one seed


@dataclass(frozen=True)
class Predictor:
    """A model bound to rows and axes; `predict` is the only place where the model is called."""

    model: problem.Model
    observables: tuple[Observable, ...]
    which: Integers
    conditions: Conditions
    axes: tuple[Axis, ...]
    candidates: tuple[problem.Candidate, ...]
    uncertainty: problem.Uncertainty | None = None
    cost: ModelCost = field(default_factory=ModelCost)
    cache: dict[Key, Floats] = field(default_factory=dict)

    def at_rows(self, which: Integers, conditions: Conditions) -> "Predictor":
        """The same model and cost counter with other rows of the observables."""
        return replace(self, which=which, conditions=conditions, cache={})

    @cached_property
    def row_requests(self) -> tuple[tuple[Observable, Integers, Conditions], ...]:
        """Every observable that has rows, these rows, and their conditions."""
        pairs = ((each, np.flatnonzero(self.which == k)) for k, each in enumerate(self.observables))
        return tuple((each, rows, pick_rows(self.conditions, rows)) for each, rows in pairs if rows.size)

    def predict_on_scale(self, x: Floats, acting: Numbers, seeds: Integers) -> Floats:
        """Values (r, n) on the comparison scale at calibrated numbers x, with some effects acting."""
        key = (np.asarray(x, float).tobytes(), tuple(sorted(acting.items())), seeds.tobytes())
        if key not in self.cache:
            self.cache[key] = self.predict_without_cache(x, acting, seeds)
        return self.cache[key]

    def mean(self, x: Floats, acting: Numbers, seeds: Integers) -> Floats:
        """Mean over seeds; NaN only where every seed failed."""
        return mean_over_finite_seeds(self.predict_on_scale(x, acting, seeds))

    def parameters_and_strengths(self, x: Floats, acting: Numbers) -> tuple[Numbers, Numbers]:
        """Parameters and strengths of all effects at calibrated numbers x, with some effects acting."""
        parameters, adopted = split_numbers(self.axes, x)
        return parameters, {c.name: float(acting.get(c.name, 0.0)) for c in self.candidates} | adopted

    def predict_without_cache(
        self, x: Floats, acting: Numbers, seeds: Integers, doses: Mapping[str, Floats] | None = None
    ) -> Floats:
        """The same anew; `doses` of a mechanism are one for every row."""
        parameters, effects = self.parameters_and_strengths(x, acting)
        result = np.empty((seeds.size, self.which.size))
        for observable, rows, chosen in self.row_requests:
            strengths = effects | pick_rows(doses or {}, rows)
            answer = self.model(observable.name, dict(chosen), dict(parameters), strengths, seeds)
            result[:, rows] = to_scale(observable, np.asarray(answer, dtype=float))
        self.cost.runs += int(seeds.size * self.which.size)
        return np.where(np.isfinite(result), result, np.nan)

    def error_factor(
        self, x: Floats, acting: Numbers, doses: Conditions | None = None, exact: int | None = None
    ) -> Floats:
        """Factor F (n, r) of the covariance F F^T of the model's own errors at one setting.

        `doses`: of a mechanism, in every row; `exact`: as in `matrix_root`, by default all rows.
        """
        if self.uncertainty is None:
            return np.zeros((self.which.size, 0))
        parameters, effects = self.parameters_and_strengths(x, acting)
        queries = [(each, dict(at), pick_rows(doses or {}, rows)) for each, rows, at in self.row_requests]
        order = np.argsort(np.concatenate([rows for _, rows, _ in self.row_requests]))
        whole = np.nan_to_num(self.uncertainty(queries, parameters, effects))[np.ix_(order, order)]
        return matrix_root(whole, order.size if exact is None else exact, NEGLIGIBLE)


def matrix_root(kernel: Floats, exact: int, least: float) -> Floats:
    """Columns F with F F^T = K, of which `exact` rows come first, without their parts below `least`.

    With V d V^T = K_11 the first columns are K_1 V d^-1/2, and the others are 0 in exact rows: what is said
    of these, or of any other, does not depend on what else is asked.
    """
    values, vectors = np.linalg.eigh(kernel[:exact, :exact])
    large = values > least * max(float(values[-1]), 0.0)
    size, vectors = np.sqrt(values[large]), vectors[:, large]
    others = kernel[exact:, :exact] @ (vectors / size)
    values, vectors_of_rest = np.linalg.eigh(kernel[exact:, exact:] - others @ others.T)
    none = np.zeros((exact, values.size))
    return np.block([[vectors * size, none], [others, vectors_of_rest * np.sqrt(np.maximum(values, 0.0))]])


def mean_over_finite_seeds(values: Floats) -> Floats:
    good = np.isfinite(values)
    count = good.sum(axis=0)
    return np.where(count > 0, np.where(good, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def pooled_seed_variance(values: Floats, which: Integers) -> Floats:
    """Variance of one seed, row by row, shrunk towards the pooled one of its observable.

    s~_i^2 = (nu_0 s_t^2 + nu_i s_i^2) / (nu_0 + nu_i),    nu_0 = 6
    """
    good = np.isfinite(values)
    freedom = np.maximum(good.sum(axis=0) - 1, 0)
    squares = np.sum(np.where(good, values - mean_over_finite_seeds(values), 0.0) ** 2, axis=0)
    pooled = np.zeros(values.shape[1])
    for index in np.unique(which):
        rows = which == index
        pooled[rows] = squares[rows].sum() / max(int(freedom[rows].sum()), 1)
    return (PRIOR_FREEDOM * pooled + squares) / (PRIOR_FREEDOM + freedom)


@dataclass(frozen=True)
class AxisScale:
    """Standardisation of a condition, by the rows that it was made from."""

    middle: float  # where a missing entry sits
    centre: float
    width: float
    logarithmic: bool

    def __call__(self, column: Floats) -> Floats:
        """Standardised values of the rows, or of others."""
        return (self.standardise_column(column) - self.centre) / self.width

    def standardise_column(self, column: Floats) -> Floats:
        """Values on the scale of the axis, missing ones at the mean."""
        filled = np.where(np.isfinite(column), column, self.middle)
        return np.log(np.maximum(filled, 1e-300)) if self.logarithmic else filled


def axis_scale_of(column: Floats) -> AxisScale | None:
    """Standardisation of a condition; None if it does not vary."""
    finite = column[np.isfinite(column)]
    if finite.size < 2 or np.ptp(finite) <= 1e-12 * np.abs(finite).max():
        return None
    logarithmic = bool(finite.min() > 0.0 and finite.max() > LOG_SPAN * finite.min())
    scale = AxisScale(float(finite.mean()), 0.0, 1.0, logarithmic)
    filled = scale.standardise_column(column)
    return replace(scale, centre=float(filled.mean()), width=float(filled.std()))
