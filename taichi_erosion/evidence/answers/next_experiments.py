"""What to measure next: the experiments that would decide between the remaining explanations.

For every measurement x that the laboratory could make, explanations a and b with probabilities q predict
mu_a(x) +- v_a(x), calibration and strengths being as uncertain as the present data leave them. The next one
maximises

    U(x) = sum_{a<b} q_a q_b (mu_a - mu_b)^2 / (s^2 + v_a + v_b) / cost(x)

(the rivals get to refit: v), everything is updated, and so on. The chance that the whole set decides comes
from simulated outcomes, not from U.

Reference: Buzzi-Ferraris & Forzatti (1983), Chem. Eng. Sci. 38, 225, after Box & Hill (1967), Technometrics
9, 57.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.stats import qmc

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows
from taichi_erosion.evidence.data.findings import Discovery, Experiment, PlausibleHypothesis
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Conditions, Floats, Laboratory, Problem, expected_strength
from taichi_erosion.evidence.data.transforms import from_scale, position_of, slope
from taichi_erosion.evidence.inference.levels import DECIDED
from taichi_erosion.evidence.inference.map_fit import Objective
from taichi_erosion.evidence.inference.posterior import label
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.models.predictor import Predictor
from taichi_erosion.scene.schema.units import Scale

EXPERIMENTS = 6
POINTS = 32  # settings considered per observable, the corners of the ranges among them
MOST_CORNERED = 3  # conditions whose corners are considered, the others at their middle
LEAST_WEIGHT = 0.02  # of an explanation that is not excluded
MOST_RIVALS = 8
OUTCOMES = 400  # simulated per explanation


@dataclass(frozen=True)
class DesignPool:
    """Measurements that could be made."""

    predictor: Predictor
    rows: ComparisonRows  # whose values are meaningless: only observable and conditions count
    variance: Floats  # of the mean of the repeats, on the comparison scale
    cost: Floats
    scales: Mapping[str, Scale] = field(default_factory=dict)  # of the conditions: from table to use


@dataclass(frozen=True)
class RivalPrediction:
    """One explanation on the pool: mean and what remains uncertain after the present data."""

    name: str
    weight: float
    mean: Floats  # (pool,)
    root: Floats  # (pool, k): covariance of predictions = root root^T


def next_experiments(problem: Problem, found: Discovery, laboratory: Laboratory) -> list[Experiment]:
    """Greedy choice of experiments, best first; empty where no rival is left."""
    prepared = prepare(problem, problem.visible(), found.seed)
    if prepared.rows.size == 0 or not prepared.rows.conditions:
        return []
    pool = design_pool(prepared, laboratory)
    rivals = [rival_prediction(prepared, pool, each) for each in rival_hypotheses(prepared, found)]
    rivals = [rival for rival in rivals if np.all(np.isfinite(rival.mean))]
    if len(rivals) < 2:
        return []
    total = sum(max(rival.weight, LEAST_WEIGHT) for rival in rivals)
    rivals = [replace(rival, weight=max(rival.weight, LEAST_WEIGHT) / total) for rival in rivals]
    chosen = greedy_design(pool, rivals)
    chances = [decision_chance(pool, rivals, chosen[: k + 1], found.seed) for k in range(len(chosen))]
    return [experiment(pool, rivals, at, chance) for at, chance in zip(chosen, chances, strict=True)]


def rival_hypotheses(prepared: PreparedProblem, found: Discovery) -> list[PlausibleHypothesis]:
    """Plausible explanations; effects that could be hiding have their expected strength.

    A fit that found nothing leaves a hidden effect at strength near zero, where it differs from nothing.
    """
    bare = next((each for each in found.survivors if not each.names), None)
    named = {*found.named, *found.group}
    kept = [each for each in found.survivors if not each.names or named & set(each.names)]
    if not kept:  # nothing was named, and yet the bare model is excluded: all that are left compete
        kept = list(found.survivors)
    have = {name for each in kept for name in each.names}
    for name, effect in found.effects.items():
        if bare is not None and effect.status == "not_testable" and name not in have:
            hidden = {**bare.strengths, name: expected_strength(prepared.candidate(name))}
            kept.append(PlausibleHypothesis((name,), LEAST_WEIGHT, bare.parameters, hidden))
    return kept[:MOST_RIVALS]


def design_pool(prepared: PreparedProblem, laboratory: Laboratory) -> DesignPool:
    """Settings within the laboratory's ranges, for every observable that was measured before."""
    settings = pool_settings(prepared, laboratory)
    size = next(iter(settings.values())).size if settings else POINTS
    present = [int(index) for index in np.unique(prepared.rows.which)]
    noise, cost = [], []
    for observable, own in prepared.by_observable():
        single, simulated = np.median(prepared.rows.variance[own]), np.median(prepared.seed_variance[own])
        noise.append(single / laboratory.repeats + simulated / prepared.seeds.fitting.size)
        cost.append(laboratory.costs.get(observable.name, 1.0))
    which = np.repeat(present, size).astype(np.int64)
    conditions = {name: np.tile(column, len(present)) for name, column in settings.items()}
    zero = np.zeros(which.size)
    rows = replace(
        prepared.rows,
        which=which,
        z=zero,
        variance=zero + 1.0,
        censored=np.zeros(which.size, dtype=np.bool_),
        shared=np.zeros((which.size, 0)),
        conditions=conditions,
        group=("",) * which.size,
        slope=zero,
    )
    predictor = prepared.predictor.over(prepared.predictor.observables, which, conditions)
    scales = prepared.problem.measurements.scales
    return DesignPool(predictor, rows, np.repeat(noise, size), np.repeat(cost, size), scales)


def pool_settings(prepared: PreparedProblem, laboratory: Laboratory) -> Conditions:
    """Sobol' points and corners of the ranges: of the laboratory, or as measured."""
    ranges = {
        name: laboratory.ranges.get(name, (float(np.nanmin(column)), float(np.nanmax(column))))
        for name, column in prepared.rows.conditions.items()
        if np.any(np.isfinite(column))
    }
    varied = [name for name, (low, high) in ranges.items() if high > low]
    share = qmc.Sobol(max(len(varied), 1), scramble=False).random(POINTS)
    if varied:
        cornered = min(len(varied), MOST_CORNERED)
        corners = np.full((2**cornered, len(varied)), 0.5)
        corners[:, :cornered] = list(product((0.0, 1.0), repeat=cornered))
        share = np.unique(np.vstack([share, corners]), axis=0)  # Sobol's points begin in a corner
    settings = {}
    for name, (low, high) in ranges.items():
        part = share[:, varied.index(name)] if name in varied else np.zeros(share.shape[0])
        settings[name] = low * (high / low) ** part if low > 0.0 else low + part * (high - low)
    return settings


def rival_prediction(
    prepared: PreparedProblem, pool: DesignPool, rival: PlausibleHypothesis
) -> RivalPrediction:
    """Predictions of one explanation, with the uncertainty that the present data leave it."""
    adopted = {candidate.name for candidate in prepared.problem.adopted}
    own = {name: value for name, value in rival.strengths.items() if name in adopted}
    x = position_of(prepared.axes, rival.parameters, own)
    acting = {name: float(rival.strengths[name]) for name in rival.names}
    position = np.append(x, list(acting.values()))
    objective = Objective(prepared, rival.names, prepared.seeds.fitting)
    slopes = objective.jacobian(position, central=False)
    design = np.hstack([slopes, prepared.with_model_errors(x, acting).white_shared])
    covariance = np.linalg.inv(design.T @ design + np.eye(design.shape[1]))[: position.size, : position.size]
    there = replace(prepared, rows=pool.rows, predictor=pool.predictor, variance=np.ones(pool.rows.size))
    ahead = replace(objective, prepared=there)
    mean, root = ahead.mean(position), ahead.jacobian(position, central=False)
    if position.size:
        root = root @ np.linalg.cholesky(covariance + 1e-12 * np.eye(position.size))
    errors = pool.predictor.model_errors(x, acting)
    return RivalPrediction(label(rival.names), rival.probability, mean, np.hstack([root, errors]))


def greedy_design(pool: DesignPool, rivals: list[RivalPrediction]) -> list[int]:
    """Indices of the chosen measurements in order; each one reduces the uncertainty of every rival."""
    chosen: list[int] = []
    for _ in range(EXPERIMENTS):
        gain, spread = (
            np.zeros(pool.rows.size),
            [np.einsum("ij,ij->i", each.root, each.root) for each in rivals],
        )
        for i, one in enumerate(rivals):
            for j, other in enumerate(rivals[:i]):
                gap = (one.mean - other.mean) ** 2
                gain += one.weight * other.weight * gap / (pool.variance + spread[i] + spread[j])
        gain[chosen] = 0.0
        best = int(np.argmax(gain / pool.cost))
        if gain[best] <= 0.0:
            break
        chosen.append(best)
        variance = float(pool.variance[best])
        rivals = [replace(rival, root=rank_one_update(rival.root, best, variance)) for rival in rivals]
    return chosen


def rank_one_update(root: Floats, at: int, variance: float) -> Floats:
    """Root of the prediction covariance after one more measurement of row `at` with this variance."""
    row = root[at]
    size = float(row @ row)
    if size <= 0.0:
        return root
    shrink = 1.0 - np.sqrt(variance / (variance + size))
    return root - np.outer(root @ row, row) * shrink / size


def decision_chance(pool: DesignPool, rivals: list[RivalPrediction], chosen: list[int], seed: int) -> float:
    """Probability that the chosen measurements leave the true explanation with DECIDED or more."""
    generator = np.random.default_rng(seed)
    noise = np.diag(pool.variance[chosen])
    factors = [np.linalg.cholesky(rival.root[chosen] @ rival.root[chosen].T + noise) for rival in rivals]
    means = [rival.mean[chosen][:, np.newaxis] for rival in rivals]
    log_weight = np.log([rival.weight for rival in rivals])
    won = 0.0
    for index, rival in enumerate(rivals):
        outcome = means[index] + factors[index] @ generator.standard_normal((len(chosen), OUTCOMES))
        fits = np.empty((len(rivals), OUTCOMES))
        for other in range(len(rivals)):
            scaled = np.linalg.solve(factors[other], outcome - means[other])
            level = float(np.sum(np.log(np.diag(factors[other]))))
            fits[other] = log_weight[other] - level - 0.5 * np.sum(scaled**2, axis=0)
        share = np.exp(fits[index] - log_sum_exp(fits, axis=0))
        won += rival.weight * float(np.mean(share >= DECIDED))
    return won


def stated(name: str, value: float, scales: Mapping[str, Scale]) -> str:
    """A condition in the unit of the laboratory's table."""
    scale = scales.get(name, Scale())
    return f"{name} = {scale.written(value):.3g} {scale.unit}".rstrip()


def experiment(pool: DesignPool, rivals: list[RivalPrediction], at: int, chance: float) -> Experiment:
    """One proposal in the laboratory's words."""
    observable = pool.rows.observables[int(pool.rows.which[at])]
    predictions = {}
    for rival in sorted(rivals, key=lambda item: -item.weight):
        middle = float(from_scale(observable, rival.mean[[at]])[0])
        steep = float(slope(observable, np.array([middle]))[0])
        sd = float(np.sqrt(rival.root[at] @ rival.root[at] + pool.variance[at]))
        predictions[rival.name] = (middle, sd / steep if steep > 0.0 else float("nan"))
    conditions = {name: float(column[at]) for name, column in pool.rows.conditions.items()}
    setting = ", ".join(stated(name, value, pool.scales) for name, value in conditions.items())
    told = ", ".join(f"{m:.3g} +- {s:.2g} if {name}" for name, (m, s) in list(predictions.items())[:3])
    words = f"Measure {observable.name} at {setting}: {told}; chance of deciding so far {chance:.0%}."
    return Experiment(observable.name, conditions, predictions, chance, float(pool.cost[at]), words)
