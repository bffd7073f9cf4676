"""Posterior probabilities of the explanations, and credible intervals of strengths and calibrated numbers.

The explanations are exclusive: nothing missing, one effect, two effects, something that is not in the list.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb
from typing import Literal

import numpy as np
from scipy import stats

from taichi_erosion.evidence.data.findings import NONE, OUTSIDE, Estimate, LevelShift
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.number_words import plain
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.data.transforms import axis_value, effect_of
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.intervals.mixtures import tabulated
from taichi_erosion.evidence.inference.marginal_likelihood import (
    BOUND,
    ScoredHypothesis,
    cell_width,
    level_sets,
    log_level_sets,
)
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

TAIL = levels.INTERVAL_TAIL
HALF_WIDTH = float(stats.norm.ppf(1.0 - TAIL))  # of a normal 90 % interval, in sd


@dataclass(frozen=True)
class Hypothesis:
    """One explanation and its evidence at every noise factor."""

    names: tuple[str, ...]
    outside: bool  # a smooth discrepancy acts too
    log_prior: float
    log_evidence: Floats
    rejected: bool = False  # its probability counts for something that is not in the list


@dataclass(frozen=True)
class Posterior:
    """Probabilities, summing to 1 over exclusive explanations."""

    probability: Mapping[str, float]  # "none", "outside_library", effect, "a+b"
    inclusion: Mapping[str, float]  # effect -> probability that it acts at all
    log_bayes: Mapping[str, float]  # effect -> ln evidence over the base
    noise_weight: Floats  # of every noise factor
    log_total: float = 0.0  # ln evidence of all explanations that the measurements do not reject
    log_all: float = 0.0  # ln evidence of all explanations

    @property
    def named(self) -> float:
        """Probability that listed effects act."""
        return 1.0 - self.probability[NONE] - self.probability[OUTSIDE]


def label(names: tuple[str, ...]) -> str:
    """Key of a set of effects in the table of probabilities."""
    return "+".join(names) if names else NONE


def log_prior_of(names: tuple[str, ...], outside: bool, count: int) -> float:
    """Ln prior of an explanation among `count` candidates."""
    if not names:
        return float(np.log(levels.PRIOR_OUTSIDE if outside else levels.PRIOR_NONE))
    several = [share for size, share in enumerate(levels.PRIOR_SETS, 2) if size <= count]
    if len(names) > 1:
        return float(np.log(levels.PRIOR_SETS[len(names) - 2] / comb(count, len(names))))
    singles = 1.0 - levels.PRIOR_NONE - levels.PRIOR_OUTSIDE - sum(several)
    share = levels.PRIOR_REMAINDER if outside else 1.0 - levels.PRIOR_REMAINDER
    return float(np.log(singles / count * share))


def posterior_of(prepared: PreparedProblem, hypotheses: list[Hypothesis]) -> Posterior:
    """Probabilities over all hypotheses, noise factors averaged."""
    doubt = prepared.doubt.log_weight
    joint = np.array([h.log_prior + doubt + h.log_evidence for h in hypotheses])
    total = log_sum_exp(joint)
    weight = np.exp(joint - total)
    inclusion = {candidate.name: 0.0 for candidate in prepared.problem.candidates}
    probability: dict[str, float] = {NONE: 0.0, OUTSIDE: 0.0} | inclusion
    for hypothesis, share in zip(hypotheses, weight.sum(axis=1), strict=True):
        key = OUTSIDE if hypothesis.rejected else label(hypothesis.names)
        probability[key] = probability.get(key, 0.0) + float(share)
        for name in () if hypothesis.rejected else hypothesis.names:
            inclusion[name] += float(share)
    alone: dict[tuple[str, ...], Floats] = {}
    for each in (h for h in hypotheses if not h.outside):
        value = log_sum_exp(doubt + each.log_evidence)
        alone[each.names] = np.maximum(value, alone.get(each.names, value))
    factors = {names[0]: float(value - alone[()]) for names, value in alone.items() if len(names) == 1}
    kept = np.array([not h.rejected for h in hypotheses])
    accepted = float(log_sum_exp(joint[kept])) if kept.any() else -np.inf
    return Posterior(probability, inclusion, factors, weight.sum(axis=0), accepted, float(total))


def mixed(first: Posterior, each: Sequence[Posterior], weight: Floats) -> Posterior:
    """Probabilities averaged over accounts of the same measurements, with weights that sum to 1.

    What belongs to one account alone, factors and noise, is that of the first.
    """

    def mean(tables: Sequence[Mapping[str, float]]) -> dict[str, float]:
        keys = dict.fromkeys(key for table in tables for key in table)
        return {
            key: float(sum(w * table.get(key, 0.0) for w, table in zip(weight, tables, strict=True)))
            for key in keys
        }

    probability = mean([posterior.probability for posterior in each])
    return replace(first, probability=probability, inclusion=mean([one.inclusion for one in each]))


def joint_weight(prepared: PreparedProblem, scored: ScoredHypothesis, with_prior: bool) -> Floats:
    """Weights (noise factors, columns of strengths), summing to 1."""
    expansion = scored.expansion
    shift = expansion.log_prior if with_prior else np.log(np.maximum(expansion.cell_widths, 1e-300))
    weight = np.array([each.log_likelihood + shift for each in scored.likelihoods])
    weight += prepared.doubt.log_weight[:, np.newaxis]
    return np.exp(weight - log_sum_exp(weight))


def strength_estimates(prepared: PreparedProblem, scored: ScoredHypothesis) -> dict[str, Estimate]:
    """Strength of every acting effect with its 90 % interval, no prior but the allowed range."""
    if not scored.likelihoods:
        return {}
    paths, best = scored.expansion.paths, scored.expansion.fit
    weight = joint_weight(prepared, scored, with_prior=False).sum(axis=0)
    table = weight.reshape([path.grid.size for path in paths])
    found = {}
    for index, (name, value) in enumerate(best.acting().items()):
        share = table.sum(axis=tuple(k for k in range(len(paths)) if k != index))
        low, high = (quantile(paths[index].grid, share, q) for q in (TAIL, 1.0 - TAIL))
        bound = value >= prepared.candidate(name, best.beyond).maximum * (1.0 - BOUND)
        found[name] = Estimate(value, min(low, value), max(high, value), bound)
    return found


def level_shifts(prepared: PreparedProblem, scored: ScoredHypothesis) -> tuple[LevelShift, ...]:
    """Levels that are off under one hypothesis, each with its interval, the less likely ones at 0."""
    if not prepared.levels or not scored.likelihoods:
        return ()
    found = scored.likelihoods[int(np.argmax(prepared.doubt.log_weight + scored.log_evidence))]
    column = int(np.argmax(found.log_likelihood))
    mean, covariance = found.levels[:, column], found.level_covariance
    covariance = covariance if covariance.ndim == 2 else covariance[column]
    weight = log_level_sets(mean[:, np.newaxis], covariance)[:, 0]
    weight = np.exp(weight - log_sum_exp(weight))
    sets, _ = level_sets(mean.size)
    chosen = sets[int(np.argmax(weight))]
    rest = [k for k in range(mean.size) if k not in chosen]
    gain = covariance[:, rest] @ np.linalg.inv(covariance[np.ix_(rest, rest)])
    mean, covariance = mean - gain @ mean[rest], covariance - gain @ covariance[rest]
    shifts = []
    for k in range(mean.size):
        probability = float(sum(w for w, each in zip(weight, sets, strict=True) if k in each))
        reach = HALF_WIDTH * float(np.sqrt(max(covariance[k, k], 0.0)))
        if k in chosen and probability > levels.TOLD_LEVEL and abs(mean[k]) > reach:
            shifts.append(level_shift(prepared, k, mean[k] + reach * np.array([0.0, -1.0, 1.0]), probability))
    return tuple(shifts)


def level_shift(prepared: PreparedProblem, index: int, levels_off: Floats, probability: float) -> LevelShift:
    """One level in words, from its value and the ends of its interval, in prior sd."""
    name = prepared.levels[index]
    observable = prepared.rows.observable(name)
    own = prepared.rows.rows_of(observable)
    value, low, high = levels_off * float(np.max(prepared.rows.shared[own, index]))
    kind: Literal["factor", "offset"] = "offset" if observable.transform == "identity" else "factor"
    if kind == "offset":
        words = offset_words(value, low, high, prepared.problem.measurements.table_units, name)
    else:
        value, low, high = (float(np.exp(each)) for each in (value, low, high))
        words = f"measured is {value:.3g} ({low:.3g} to {high:.3g}) times the model"
    causes = "instrument, method, or contact law"
    causes = f"unit, {causes}" if kind == "factor" and not 0.5 < value < 2.0 else causes
    sure = "" if probability > levels.SURE_LEVEL else f" (probability {probability:.2g})"
    sentence = f"{name}: {words} at all conditions alike{sure}: {causes}."
    return LevelShift(name, kind, value, low, high, probability, sentence)


def offset_words(value: float, low: float, high: float, units: TableUnits, observable: str) -> str:
    """An offset with its interval, in the unit of the table."""
    way = "higher" if value > 0.0 else "lower"
    ends = (low, high) if value > 0.0 else (-high, -low)
    low_text, high_text = (plain(units.value(observable, end) or 0.0, 2) for end in ends)
    size = units.value_text(observable, abs(value), 2)
    return f"measured is {size} ({low_text} to {high_text}) {way} than the model"


def quantile(grid: Floats, share: Floats, level: float) -> float:
    """Quantile of cell probabilities on a grid."""
    if grid.size < 2:
        return float(grid[0]) if grid.size else 0.0
    table = tabulated(grid, share)
    return float(np.interp(level * table.below[-1], table.below, table.points))


def upper_strength(grid: Floats, log_likelihood: Floats) -> float:
    """Strength above which an effect is excluded with 95 %."""
    weight = np.exp(log_likelihood - log_likelihood.max()) * cell_width(grid)
    return quantile(grid, weight, 1.0 - TAIL)


def parameter_estimates(prepared: PreparedProblem, scored: ScoredHypothesis) -> dict[str, Estimate]:
    """Calibrated numbers with 90 % intervals, strengths and noise factors integrated out.

    Numbers of a candidate that does not act are left out: the measurements do not depend on them.
    """
    if not prepared.axes or not scored.likelihoods:
        return {}
    weight = joint_weight(prepared, scored, with_prior=True)
    x = scored.expansion.fit.x
    centres = np.array([each.position for each in scored.likelihoods])
    variances = np.array([np.diag(each.covariance) for each in scored.likelihoods])
    mean = np.einsum("fc,fpc->p", weight, centres)
    second = np.einsum("fc,fpc->p", weight, centres**2) + np.einsum("fc,fp->p", weight, variances)
    sd = np.sqrt(np.maximum(second - mean**2, 0.0))
    absent = set(prepared.problem.candidate_names) - set(scored.expansion.fit.names)
    found = {}
    for j, axis in enumerate(prepared.axes):
        if effect_of(axis.name) not in absent:
            points = np.clip(mean[j] + HALF_WIDTH * sd[j] * np.array([-1.0, 0.0, 1.0]), axis.low, axis.high)
            low, middle, high = (axis_value(axis, float(point)) for point in points)
            bound = bool(x[j] - axis.low < BOUND or axis.high - x[j] < BOUND)
            found[axis.name] = Estimate(middle, min(low, high), max(low, high), bound)
    return found
