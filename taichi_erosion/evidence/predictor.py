"""The model behind one counter: predictions on the comparison scale, remembered, failures counted."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from taichi_erosion.evidence.problem import (
    Candidate,
    Conditions,
    Floats,
    Integers,
    Model,
    Observable,
    Uncertainty,
)
from taichi_erosion.evidence.scales import Axis, split_setting, strengths, to_scale

Key = tuple[bytes, tuple[tuple[str, float], ...], bytes]
Spectrum = tuple[Floats, Floats]  # eigenvalues and eigenvectors of a kernel
NEGLIGIBLE = 1e-6  # share of the largest variance below which a common error is dropped


@dataclass
class Ledger:
    """What the model has cost so far."""

    runs: int = 0  # seeds times settings, each over all conditions
    failures: int = 0  # values that could not be computed


@dataclass(frozen=True)
class Predictor:
    """Model, rows and axes bound together; `predict` is the only place where the model is called."""

    model: Model
    observables: tuple[Observable, ...]
    which: Integers
    conditions: Conditions
    axes: tuple[Axis, ...]
    candidates: tuple[Candidate, ...]
    uncertainty: Uncertainty | None = None
    ledger: Ledger = field(default_factory=Ledger)
    seen: dict[Key, Floats] = field(default_factory=dict)
    spectra: dict[bytes, Spectrum] = field(default_factory=dict)  # of smooth functions over some rows

    def over(
        self, observables: tuple[Observable, ...], which: Integers, conditions: Conditions
    ) -> "Predictor":
        """The same model, at the same cost counter, over other rows."""
        return replace(self, observables=observables, which=which, conditions=conditions, seen={}, spectra={})

    @cached_property
    def asked(self) -> tuple[tuple[Observable, Integers, Conditions], ...]:
        """Every observable that has rows, these rows, and their conditions, which nobody may write to."""
        parts = []
        for observable, rows in zip(self.observables, self.rows, strict=True):
            if rows.size:
                chosen = {name: column[rows] for name, column in self.conditions.items()}
                for column in chosen.values():
                    column.setflags(write=False)
                parts.append((observable, rows, chosen))
        return tuple(parts)

    @cached_property
    def rows(self) -> tuple[Integers, ...]:
        """Rows of every observable."""
        return tuple(np.flatnonzero(self.which == index) for index in range(len(self.observables)))

    def predict(self, x: Floats, acting: dict[str, float], seeds: Integers) -> Floats:
        """Values (r, n) on the comparison scale at calibrated numbers x, with some effects acting."""
        key = (np.asarray(x, float).tobytes(), tuple(sorted(acting.items())), seeds.tobytes())
        if key not in self.seen:
            self.seen[key] = self.compute(x, acting, seeds)
        return self.seen[key]

    def mean(self, x: Floats, acting: dict[str, float], seeds: Integers) -> Floats:
        """Mean over seeds; NaN only where every seed failed."""
        return seed_mean(self.predict(x, acting, seeds))

    def compute(self, x: Floats, acting: dict[str, float], seeds: Integers) -> Floats:
        parameters, adopted = split_setting(self.axes, x)
        effects = {**strengths(self.candidates, acting), **adopted}
        result = np.empty((seeds.size, self.which.size))
        for observable, rows, chosen in self.asked:
            answer = self.model(observable.name, dict(chosen), dict(parameters), dict(effects), seeds)
            result[:, rows] = to_scale(observable, np.asarray(answer, dtype=float))
        self.ledger.runs += int(seeds.size)
        failed = ~np.isfinite(result)
        if failed.any():
            self.ledger.failures += int(failed.sum())
            result[failed] = np.nan
        return result

    def own_errors(self, x: Floats, acting: dict[str, float]) -> Floats:
        """Errors (n, r) of the model itself at one setting, one sd each: their covariance is F F^T.

        No column for a model that is what it says.
        """
        if self.uncertainty is None:
            return np.zeros((self.which.size, 0))
        parameters, adopted = split_setting(self.axes, x)
        effects = {**strengths(self.candidates, acting), **adopted}
        parts = []
        for observable, rows, chosen in self.asked:
            own = self.uncertainty(observable, dict(chosen), dict(parameters), dict(effects))
            values, vectors = np.linalg.eigh(np.nan_to_num(own))
            kept = values > NEGLIGIBLE * max(float(values[-1]), 0.0)
            part = np.zeros((self.which.size, int(kept.sum())))
            part[rows] = vectors[:, kept] * np.sqrt(values[kept])
            parts.append(part)
        return np.hstack(parts)


def seed_mean(values: Floats) -> Floats:
    """Mean over the seeds that succeeded."""
    if values.shape[0] == 1:
        return values[0]
    good = np.isfinite(values)
    count = good.sum(axis=0)
    total = np.where(good, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def seed_variance(values: Floats, which: Integers) -> Floats:
    """Variance of one seed, row by row, drawn towards the pooled one of its observable.

    s~_i^2 = (nu_0 s_t^2 + nu_i s_i^2) / (nu_0 + nu_i),    nu_0 = 6
    """
    prior_freedom = 6.0
    good = np.isfinite(values)
    freedom = np.maximum(good.sum(axis=0) - 1, 0)
    centred = np.where(good, values - seed_mean(values), 0.0)
    squares = np.sum(centred**2, axis=0)
    pooled = np.zeros(values.shape[1])
    for index in np.unique(which):
        rows = which == index
        pooled[rows] = squares[rows].sum() / max(int(freedom[rows].sum()), 1)
    return (prior_freedom * pooled + squares) / (prior_freedom + freedom)
