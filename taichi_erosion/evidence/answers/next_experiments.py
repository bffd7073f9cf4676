"""What to measure next: the experiments that would tell the surviving explanations apart.

For every measurement x that the laboratory could make, explanations a and b with probabilities q predict
mu_a(x) +- v_a(x), calibration and strengths being as uncertain as the present data leave them. The next one
maximises

    U(x) = sum_{a<b} q_a q_b (mu_a - mu_b)^2 / (s^2 + v_a + v_b) / cost(x)

(the rivals get to refit: v), everything is updated, and so on. The chance that the whole set decides comes
from simulated outcomes, not from U.

Reference: Buzzi-Ferraris & Forzatti (1983), Chem. Eng. Sci. 38, 225, after Box & Hill (1967), Technometrics
9, 57.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import qmc

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.comparison_rows import ComparisonRows
from taichi_erosion.evidence.data.findings import Discovery, Experiment, PlausibleHypothesis
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Laboratory, Problem, Progress
from taichi_erosion.evidence.data.transforms import from_scale, position_of, slope
from taichi_erosion.evidence.inference.levels import DECIDED
from taichi_erosion.evidence.inference.map_fit import Objective
from taichi_erosion.evidence.inference.posterior import label
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.models.predictor import Predictor

EXPERIMENTS = 6
POINTS = 32  # settings considered per observable, the corners of the ranges among them
LEAST_WEIGHT = 0.02  # of an explanation that is still standing
MOST_RIVALS = 8
OUTCOMES = 400  # simulated per explanation


@dataclass(frozen=True)
class DesignPool:
    """Measurements that could be made."""

    predictor: Predictor
    which: Integers
    conditions: Conditions
    variance: Floats  # of the mean of the repeats, on the comparison scale
    cost: Floats


@dataclass(frozen=True)
class RivalPrediction:
    """One explanation on the pool: mean and what remains uncertain after the present data."""

    name: str
    weight: float
    mean: Floats  # (pool,)
    root: Floats  # (pool, k): covariance of predictions = root root^T


def propose(
    problem: Problem, laboratory: Laboratory, seed: int, progress: Progress = no_progress
) -> tuple[Discovery, list[Experiment]]:
    """The autopsy, and the experiments that would decide what it left open."""
    found = discover(problem, seed, problem.budget, progress)
    experiments = next_experiments(problem, found, laboratory)
    return replace(found, next_experiments=tuple(experiments)), experiments


def next_experiments(problem: Problem, found: Discovery, laboratory: Laboratory) -> list[Experiment]:
    """Greedy choice of experiments, best first; empty where no rival is left to tell apart."""
    prepared = prepare(problem, problem.visible(), found.seed)
    if prepared.rows.size == 0 or not prepared.rows.conditions:
        return []
    pool = design_pool(prepared, laboratory)
    rivals = [rival_prediction(prepared, pool, survivor) for survivor in rival_hypotheses(prepared, found)]
    rivals = [rival for rival in rivals if np.all(np.isfinite(rival.mean))]
    if len(rivals) < 2:
        return []
    total = sum(max(rival.weight, LEAST_WEIGHT) for rival in rivals)
    rivals = [replace(rival, weight=max(rival.weight, LEAST_WEIGHT) / total) for rival in rivals]
    chosen = greedy_design(pool, rivals)
    chances = [decision_chance(pool, rivals, chosen[: k + 1], found.seed) for k in range(len(chosen))]
    return [experiment(prepared, pool, rivals, at, odds) for at, odds in zip(chosen, chances, strict=True)]


def rival_hypotheses(prepared: PreparedProblem, found: Discovery) -> list[PlausibleHypothesis]:
    """Surviving explanations; effects that could be hiding stand at their expected strength.

    A fit that found nothing leaves a hidden effect at strength near zero, where it differs from nothing.
    """
    bare = next((survivor for survivor in found.survivors if not survivor.names), None)
    named = {*found.named, *found.group}
    kept = [survivor for survivor in found.survivors if not survivor.names or named & set(survivor.names)]
    if not kept:  # nothing was named, and yet the bare model has fallen: all that are left compete
        kept = list(found.survivors)
    have = {name for survivor in kept for name in survivor.names}
    for name, effect in found.effects.items():
        if bare is not None and effect.status == "not_testable" and name not in have:
            candidate = prepared.candidate(name)
            strength = min(candidate.prior_scale, candidate.maximum)
            hidden = {**bare.strengths, name: strength}
            kept.append(PlausibleHypothesis((name,), LEAST_WEIGHT, bare.parameters, hidden))
    return kept[:MOST_RIVALS]


def design_pool(prepared: PreparedProblem, laboratory: Laboratory) -> DesignPool:
    """Settings within the laboratory's ranges, for every observable that was measured before."""
    ranges = {
        name: laboratory.ranges.get(name, (float(np.nanmin(column)), float(np.nanmax(column))))
        for name, column in prepared.rows.conditions.items()
        if np.any(np.isfinite(column))
    }
    open_names = [name for name, (low, high) in ranges.items() if high > low]
    share = qmc.Sobol(max(len(open_names), 1), scramble=False).random(POINTS)
    corners = (
        np.array(np.meshgrid(*[[0.0, 1.0]] * min(len(open_names), 3))).reshape(min(len(open_names), 3), -1).T
    )
    if open_names:
        filled = np.full((corners.shape[0], len(open_names)), 0.5)
        filled[:, : corners.shape[1]] = corners
        share = np.unique(np.vstack([share, filled]), axis=0)  # Sobol's points begin in a corner
    settings = {}
    for name, (low, high) in ranges.items():
        part = share[:, open_names.index(name)] if name in open_names else np.zeros(share.shape[0])
        settings[name] = low * (high / low) ** part if low > 0.0 else low + part * (high - low)
    present = [int(index) for index in np.unique(prepared.rows.which)]
    which = np.repeat(present, share.shape[0]).astype(np.int64)
    conditions = {name: np.tile(column, len(present)) for name, column in settings.items()}
    noise = np.full(len(prepared.rows.observables), np.nan)
    for index in present:
        own = prepared.rows.which == index
        single, simulated = np.median(prepared.rows.variance[own]), np.median(prepared.seed_variance[own])
        noise[index] = single / laboratory.repeats + simulated / prepared.seeds.fitting.size
    predictor = prepared.predictor.over(prepared.predictor.observables, which, conditions)
    return DesignPool(
        predictor,
        which,
        conditions,
        noise[which],
        np.array([laboratory.costs.get(prepared.rows.observables[i].name, 1.0) for i in which]),
    )


def rival_prediction(
    prepared: PreparedProblem, pool: DesignPool, survivor: PlausibleHypothesis
) -> RivalPrediction:
    """Predictions of one explanation, with the uncertainty that the present data leave it."""
    adopted = {candidate.name for candidate in prepared.problem.adopted}
    x = position_of(
        prepared.axes, survivor.parameters, {k: v for k, v in survivor.strengths.items() if k in adopted}
    )
    psi = np.array([survivor.strengths[name] for name in survivor.names])
    position = np.concatenate([x, psi])
    acting = dict(zip(survivor.names, map(float, psi), strict=True))
    objective = Objective(prepared, survivor.names, prepared.seeds.fitting)
    white = objective.jacobian(position, central=False)
    shared = prepared.about(x, acting).rows.shared / prepared.sd[:, np.newaxis]
    design = np.hstack([white, shared])
    covariance = np.linalg.inv(design.T @ design + np.eye(design.shape[1]))[: position.size, : position.size]
    there = replace(
        prepared, rows=pool_rows(prepared, pool), predictor=pool.predictor, variance=np.ones(pool.which.size)
    )
    ahead = Objective(there, survivor.names, prepared.seeds.fitting)
    mean = ahead.mean(position)
    slopes = ahead.jacobian(position, central=False)
    root = (
        slopes @ np.linalg.cholesky(covariance + 1e-12 * np.eye(position.size)) if position.size else slopes
    )
    own = pool.predictor.model_errors(x, acting)
    return RivalPrediction(label(survivor.names), survivor.probability, mean, np.hstack([root, own]))


def pool_rows(prepared: PreparedProblem, pool: DesignPool) -> ComparisonRows:
    """Rows that stand for the pool where only their number and conditions matter."""
    size = pool.which.size
    nothing = np.zeros(size)
    return replace(
        prepared.rows,
        which=pool.which,
        z=nothing,
        variance=nothing + 1.0,
        censored=np.zeros(size, dtype=np.bool_),
        shared=np.zeros((size, 0)),
        conditions=pool.conditions,
        group=("",) * size,
        slope=nothing,
    )


def greedy_design(pool: DesignPool, rivals: list[RivalPrediction]) -> list[int]:
    """Indices of the chosen measurements in order; what each teaches every rival is taken into account."""
    roots = [rival.root for rival in rivals]
    chosen: list[int] = []
    for _ in range(EXPERIMENTS):
        spread = [np.einsum("ij,ij->i", root, root) for root in roots]
        gain = np.zeros(pool.which.size)
        for i in range(len(rivals)):
            for j in range(i):
                weight = rivals[i].weight * rivals[j].weight
                gap = (rivals[i].mean - rivals[j].mean) ** 2
                gain += weight * gap / (pool.variance + spread[i] + spread[j])
        gain[chosen] = 0.0
        best = int(np.argmax(gain / pool.cost))
        if gain[best] <= 0.0:
            break
        chosen.append(best)
        roots = [rank_one_update(root, best, float(pool.variance[best])) for root in roots]
    return chosen


def rank_one_update(root: Floats, at: int, variance: Floats | float) -> Floats:
    """Remaining uncertainty after one more measurement (rank-one update of the covariance's root)."""
    row = root[at]
    size = float(row @ row)
    if size <= 0.0:
        return root
    shrink = 1.0 - np.sqrt(variance / (variance + size))
    return root - np.outer(root @ row, row) * shrink / size


def decision_chance(pool: DesignPool, rivals: list[RivalPrediction], chosen: list[int], seed: int) -> float:
    """Probability that the chosen measurements leave the true explanation with DECIDED or more."""
    generator = np.random.default_rng(seed)
    factors, means = [], []
    for rival in rivals:
        root = rival.root[chosen]
        factors.append(np.linalg.cholesky(root @ root.T + np.diag(pool.variance[chosen])))
        means.append(rival.mean[chosen])
    log_weight = np.log([rival.weight for rival in rivals])
    won = 0.0
    for index, rival in enumerate(rivals):
        noise = generator.standard_normal((len(chosen), OUTCOMES))
        outcome = means[index][:, np.newaxis] + factors[index] @ noise
        fits = np.empty((len(rivals), OUTCOMES))
        for other in range(len(rivals)):
            scaled = np.linalg.solve(factors[other], outcome - means[other][:, np.newaxis])
            level = float(np.sum(np.log(np.diag(factors[other]))))
            fits[other] = log_weight[other] - level - 0.5 * np.sum(scaled**2, axis=0)
        share = np.exp(fits[index] - log_sum_exp(fits, axis=0))
        won += rival.weight * float(np.mean(share >= DECIDED))
    return won


def experiment(
    prepared: PreparedProblem, pool: DesignPool, rivals: list[RivalPrediction], at: int, odds: float
) -> Experiment:
    """One proposal in the laboratory's words."""
    observable = prepared.rows.observables[int(pool.which[at])]
    predictions = {}
    for rival in sorted(rivals, key=lambda item: -item.weight):
        middle = float(from_scale(observable, rival.mean[[at]])[0])
        steep = float(slope(observable, np.array([middle]))[0])
        sd = float(np.sqrt(rival.root[at] @ rival.root[at] + pool.variance[at]))
        predictions[rival.name] = (middle, sd / steep if steep > 0.0 else float("nan"))
    conditions = {name: float(column[at]) for name, column in pool.conditions.items()}
    setting = ", ".join(f"{name} = {value:.3g}" for name, value in conditions.items())
    told = ", ".join(f"{m:.3g} +- {s:.2g} if {name}" for name, (m, s) in list(predictions.items())[:3])
    words = f"Measure {observable.name} at {setting}: {told}; chance of deciding so far {odds:.0%}."
    return Experiment(observable.name, conditions, predictions, odds, float(pool.cost[at]), words)
