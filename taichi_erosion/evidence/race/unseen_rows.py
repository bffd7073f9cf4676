"""Rows that a race has not seen: new conditions, which have no value, and the held-out rows of a study."""

from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, comparison_rows, joined
from taichi_erosion.evidence.data.heap_correlation import correlated
from taichi_erosion.evidence.data.new_conditions import NewConditions
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.data.transforms import from_scale, slope
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.condition_errors import condition_errors
from taichi_erosion.evidence.race.expansion import RaceModel
from taichi_erosion.evidence.race.fit import Race


@dataclass(frozen=True)
class Elsewhere:
    """Rows that a race has not seen, with the model bound to the fitted rows and these."""

    race: Race
    rows: ComparisonRows
    simulated: Floats  # (m,), variance of the simulated mean
    model: RaceModel


def new_rows(prepared: PreparedProblem, wanted: NewConditions) -> ComparisonRows:
    """New conditions as rows without a value, each with the scatter of one repeat.

    They are of no source and no batch. Raises KeyError for an observable without a fitted row.
    """
    rows, table = prepared.rows, prepared.problem.visible()
    which, m = rows.index_of(wanted.observable), len(wanted.observable)
    names, counts = np.array(table.observable), np.where(table.n >= 1.0, table.n, 1.0)
    repeats = [
        counts[names == observable.name].sum() / max(int(np.sum(rows.which == k)), 1)
        for k, observable in enumerate(rows.observables)
    ]
    noise = [rows.noise[observable.name] for observable in rows.observables]
    variance = np.array([r * each.lab**2 + each.numerical**2 for r, each in zip(repeats, noise, strict=True)])
    first = rows.rows(np.array([np.argmax(rows.which == k) for k in which], dtype=np.int64))
    return replace(
        first,
        z=np.full(m, np.nan),
        slope=np.full(m, np.nan),
        variance=variance[which],
        censored=np.zeros(m, dtype=np.bool_),
        reach=np.zeros(m),
        conditions={name: wanted.conditions[name] for name in rows.conditions},
        condition_sd={name: np.full(m, np.nan) for name in rows.condition_sd},
        group=("",) * m,
        source=("",) * m,
        heaps=(),
        covariance=None,
    )


def held_out_rows(prepared: PreparedProblem) -> ComparisonRows | None:
    """Held-out rows of fitted observables, of unknown scatter with that of fitted ones; None without any."""
    problem, fitted = prepared.problem, prepared.rows
    if not problem.vault.rows.size:
        return None
    rows = comparison_rows(problem, problem.hidden())
    rows = rows.rows(np.isin(rows.names, fitted.names))
    which = fitted.index_of(rows.names)
    rows = replace(rows, observables=fitted.observables, which=which, noise=fitted.noise)
    variance = np.where(rows.known, rows.variance, by_observable(fitted, fitted.variance)[which])
    return correlated(replace(rows, variance=variance), prepared.heaps) if rows.size else None


def by_observable(rows: ComparisonRows, values: Floats) -> Floats:
    """Median of some values of rows for each observable; 0 where it has no row."""
    own = [values[rows.which == k] for k in range(len(rows.observables))]
    return np.array([np.median(each) if each.size else 0.0 for each in own])


def elsewhere(race: Race, rows: ComparisonRows) -> Elsewhere:
    """Other rows of the observables of a race, with the model there."""
    p = race.prepared
    both, seeds = both_rows(p.rows, rows, np.zeros(rows.size)), by_observable(p.rows, p.seed_variance)
    predictor = p.predictor.over(both.observables, both.which, both.conditions)
    joint = replace(p, rows=both, predictor=predictor, condition_errors=condition_errors(both))
    return Elsewhere(race, rows, seeds[rows.which] / p.seeds.scoring.size, RaceModel(joint))


def both_rows(fitted: ComparisonRows, other: ComparisonRows, mean: Floats) -> ComparisonRows:
    """Fitted rows, then the others at their predicted mean, with one shared error for each instrument."""
    steep, size = np.zeros(other.size), np.zeros(other.size)
    for k, observable in enumerate(other.observables):
        own = other.which == k
        value = from_scale(observable, mean[own])
        steep[own] = slope(observable, value)
        size[own] = np.hypot(observable.sd_shared, observable.sd_shared_relative * value) * steep[own]
    sizes = (np.sqrt(np.sum(fitted.shared**2, axis=1)), size)
    told = replace(other, z=mean, slope=np.nan_to_num(steep))
    parts = [
        replace(
            rows, shared=np.nan_to_num((rows.which[:, None] == np.arange(len(rows.observables))) * s[:, None])
        )
        for rows, s in zip((fitted, told), sizes, strict=True)
    ]
    return replace(joined(parts), covariance=None)
