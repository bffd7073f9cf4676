"""What to measure next: the experiments that would decide between the explanations that are left.

For every measurement x that the laboratory could make, explanations a and b with probabilities q predict
normal distributions of mean mu and covariance S, calibration and strengths being as uncertain as the present
data leave them (the rivals get to refit). The probability that a set of measurements ends in the wrong one is
at most

    E = sum_{a<b} sqrt(q_a q_b) exp(-B_ab),    B the Bhattacharyya distance

and the next one maximises

    U(x) = N(x) / cost(x) ln(E without x / E with x)
    N(x) = prod_c (1 - exp(-d(x, c)^2 / 2 l^2))

so that pairs that are separated already ask for nothing more. The product runs over the measurements c that
were chosen before for the same observable, at the distance d in shares of the ranges: what a law predicts at
neighbouring settings is wrong together, so that a second measurement there tells little. Settings that
were measured already are left out. The chance that the set decides comes from simulated outcomes, not from E.

Reference: Kailath (1967), IEEE Trans. Commun. Technol. 15, 52 (the bound and the distance).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.stats import qmc

from taichi_erosion.evidence.answers.finding_sentences import (
    UNPREDICTED,
    alone_sentence,
    scatter_sentence,
    separation_sentence,
    spoken,
)
from taichi_erosion.evidence.data.comparison_rows import ComparisonRows
from taichi_erosion.evidence.data.findings import (
    OUTSIDE,
    SILENT,
    Discovery,
    Experiment,
    PlausibleHypothesis,
    Proposals,
)
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.number_words import plain
from taichi_erosion.evidence.data.problem import (
    Bools,
    Conditions,
    Floats,
    Laboratory,
    Problem,
    expected_strength,
)
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.data.transforms import from_scale, position_of, slope
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.map_fit import Objective
from taichi_erosion.evidence.inference.posterior import label
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.models.predictor import Predictor
from taichi_erosion.scene.schema.units import Scale

EXPERIMENTS = 6
POINTS = 64  # settings considered per observable, the corners of the ranges among them
MOST_CORNERED = 3  # conditions whose corners are considered, the others at their middle
LEAST_WEIGHT = 0.02  # of an explanation that is not excluded
MOST_RIVALS = 8  # survivors of a discovery; hidden effects are compared with all of them
TOLD = 3  # predictions in the sentence of an experiment
OUTCOMES = 400  # simulated per explanation
SPREAD = 0.2  # l: distance in shares of the ranges within which two measurements tell the same
LEAST_GAIN = 1e-9  # of ln E, from which a measurement tells anything
SAME_SETTING = 0.02  # distance in shares of the ranges within which a setting is measured already
DIGITS = 2  # of a proposed setting
DECIDING = levels.DECIDING
RANGES = "wider ranges under [laboratory] ranges in the study open others."


@dataclass(frozen=True)
class DesignPool:
    """Measurements that could be made."""

    predictor: Predictor
    rows: ComparisonRows  # whose values are meaningless: only observable and conditions count
    variance: Floats  # of the mean of the repeats, on the comparison scale
    cost: Floats
    share: Floats  # (pool, conditions): place within the ranges [1]; 0 for a condition that does not vary
    units: TableUnits = field(default_factory=TableUnits)


@dataclass(frozen=True)
class RivalPrediction:
    """One explanation on the pool: mean and what remains uncertain after the present data."""

    name: str
    weight: float
    mean: Floats  # (pool,)
    root: Floats  # (pool, k): covariance of predictions = root root^T


def next_experiments(problem: Problem, found: Discovery, laboratory: Laboratory) -> Proposals:
    """Experiments that tell the leading explanation from its rivals, best first, and what they can decide."""
    prepared = prepare(problem, problem.visible(), found.seed)
    live = rival_hypotheses(prepared, found)
    weights = {label(each.names): each.probability for each in live}
    if prepared.rows.size == 0 or not prepared.rows.conditions:
        return Proposals(
            (), weights, "No condition varies, or no scatter is known: no experiment can be planned."
        )
    if len(live) < 2:
        return Proposals((), weights, alone_sentence(weights, found))
    pool = design_pool(prepared, laboratory)
    if pool is None:
        return Proposals(
            (), weights, f"Every setting within the ranges of the laboratory is measured already: {RANGES}"
        )
    rivals = weighted([rival_prediction(prepared, pool, each) for each in acting(prepared, pool, live)])
    if len(rivals) < 2:
        others = dict.fromkeys((label(each.names) for each in live[1:]), 0.0)
        return Proposals((), weights, separation_sentence(label(live[0].names), others, ()))
    return proposals(pool, rivals, found)


def proposals(pool: DesignPool, rivals: list[RivalPrediction], found: Discovery) -> Proposals:
    """Experiments that separate the leading explanation from its rivals, and a sentence on all rivals."""
    weights = {rival.name: rival.weight for rival in rivals}
    leader, *others = sorted(rivals, key=lambda each: -each.weight)
    chosen = greedy_design(pool, rivals)
    told_apart = [
        each for each in others if pair_chance(pool, (leader, each), chosen, found.seed) >= DECIDING
    ]
    separated = [
        each for each in told_apart if value_chance(pool, (leader, each), chosen, found.seed) >= DECIDING
    ]
    if separated:
        rivals = weighted([leader, *separated])
        chosen = greedy_design(pool, rivals)
    chances = {each.name: pair_chance(pool, (leader, each), chosen, found.seed) for each in others}
    scatter_alone = [each.name for each in told_apart if each not in separated]
    apart = {name: chance for name, chance in chances.items() if name not in scatter_alone}
    words = separation_sentence(leader.name, apart, [each.name for each in separated])
    words = f"{words} {scatter_sentence(leader.name, scatter_alone)}".strip()
    if found.probabilities.get(OUTSIDE, 0.0) > others[0].weight:
        words += f" {UNPREDICTED}"
    if not separated:
        return Proposals((), weights, words)
    won = [decision_chance(pool, rivals, chosen[: k + 1], found.seed) for k in range(len(chosen))]
    told = [experiment(pool, rivals, at, chance) for at, chance in zip(chosen, won, strict=True)]
    return Proposals(tuple(told), weights, words)


def pair_chance(
    pool: DesignPool, pair: tuple[RivalPrediction, RivalPrediction], chosen: list[int], seed: int
) -> float:
    """Chance that the chosen measurements decide between two explanations that are equally likely before."""
    return (
        decision_chance(pool, [replace(each, weight=0.5) for each in pair], chosen, seed) if chosen else 0.0
    )


def value_chance(
    pool: DesignPool, pair: tuple[RivalPrediction, RivalPrediction], chosen: list[int], seed: int
) -> float:
    """Chance that two rivals are told apart by the predicted values alone, at their average uncertainty."""
    root = np.hstack([each.root for each in pair]) / np.sqrt(2.0)
    first, second = (replace(each, root=root) for each in pair)
    return pair_chance(pool, (first, second), chosen, seed)


def rival_hypotheses(prepared: PreparedProblem, found: Discovery) -> list[PlausibleHypothesis]:
    """Live explanations, likeliest first; where nothing is named, hidden effects at their expected strength.

    A fit that found nothing leaves a hidden effect at strength near zero, where it differs from nothing.
    """
    live = [each for each in found.survivors if each.probability >= levels.PLAUSIBLE]
    bare = next((each for each in live if not each.names), None)
    have = {name for each in live for name in each.names}
    live = sorted(live, key=lambda each: -each.probability)[:MOST_RIVALS]
    silent = found.verdict in SILENT
    for name, effect in found.effects.items():
        if bare is not None and silent and effect.status == "not_testable" and name not in have:
            hidden = {**bare.strengths, name: expected_strength(prepared.candidate(name))}
            weight = max(effect.probability, LEAST_WEIGHT)
            live.append(PlausibleHypothesis((name,), weight, bare.parameters, hidden))
    return sorted(live, key=lambda each: -each.probability)


def acting(
    prepared: PreparedProblem, pool: DesignPool, live: Sequence[PlausibleHypothesis]
) -> list[PlausibleHypothesis]:
    """The explanations whose effects can all act at some measurement of the pool or of the table."""
    there = replace(prepared, rows=pool.rows)
    return [
        each
        for each in live
        if all(bool(there.mask(name).any() or prepared.mask(name).any()) for name in each.names)
    ]


def weighted(rivals: list[RivalPrediction]) -> list[RivalPrediction]:
    """Those with a value everywhere, with weights that sum to 1; alike where the leader has won already.

    The chance of deciding then is that between equal weights, not the probability that the leader had before.
    """
    rivals = [rival for rival in rivals if np.all(np.isfinite(rival.mean))]
    floored = np.maximum([rival.weight for rival in rivals], LEAST_WEIGHT)
    share = floored / np.sum(floored)
    if np.any(share >= levels.DECIDED):
        share = np.full(share.size, 1.0 / share.size)
    return [replace(rival, weight=float(q)) for rival, q in zip(rivals, share, strict=True)]


def design_pool(prepared: PreparedProblem, laboratory: Laboratory) -> DesignPool | None:
    """Settings within the laboratory's ranges, for every observable; None if all are measured."""
    parts = [(index, *settings_of(prepared, laboratory, index)) for index in np.unique(prepared.rows.which)]
    parts = [part for part in parts if part[2].shape[0]]
    if not parts:
        return None
    which = np.concatenate([np.full(share.shape[0], index) for index, _, share in parts]).astype(np.int64)
    conditions = {
        name: np.concatenate([settings[name] for _, settings, _ in parts])
        for name in prepared.rows.conditions
    }
    zero = np.zeros(which.size)
    rows = replace(
        prepared.rows,
        which=which,
        z=zero,
        variance=zero + 1.0,
        censored=np.zeros(which.size, dtype=np.bool_),
        reach=zero,
        shared=np.zeros((which.size, 0)),
        conditions=conditions,
        group=("",) * which.size,
        slope=zero,
        covariance=None,
    )
    noise = {index: mean_variance(prepared, int(index), laboratory.repeats) for index, _, _ in parts}
    cost = {i: laboratory.costs.get(prepared.rows.observables[int(i)].name, 1.0) for i, _, _ in parts}
    return DesignPool(
        prepared.predictor.over(prepared.predictor.observables, which, conditions),
        rows,
        np.array([noise[index] for index in which]),
        np.array([cost[index] for index in which]),
        np.concatenate([share for _, _, share in parts]),
        prepared.problem.measurements.table_units,
    )


def mean_variance(prepared: PreparedProblem, index: int, repeats: int) -> float:
    """Variance of the mean of so many repeats of an observable, with tolerance and the model's scatter."""
    observable, own = prepared.rows.observables[index], prepared.rows.which == index
    numerical = prepared.rows.noise[observable.name].numerical ** 2
    simulated = float(np.median(prepared.seed_variance[own])) / prepared.seeds.fitting.size
    return repeat_variance(prepared, index) / repeats + numerical + simulated


def repeat_variance(prepared: PreparedProblem, index: int) -> float:
    """Variance of a single repeat of one observable on its comparison scale.

    A row of the table is a mean already: its variance is that of single repeats over their number.
    """
    observable, own = prepared.rows.observables[index], prepared.rows.which == index
    numerical = prepared.rows.noise[observable.name].numerical ** 2
    of_row = max(float(np.median(prepared.rows.variance[own])) - numerical, 0.0)
    table = prepared.problem.visible()
    counts = np.array(
        [n for n, name in zip(table.n, table.observable, strict=True) if name == observable.name]
    )
    behind = float(np.sum(np.where(counts >= 1.0, counts, 1.0))) / max(int(np.sum(own)), 1)
    return of_row * max(behind, 1.0)


def settings_of(prepared: PreparedProblem, laboratory: Laboratory, index: int) -> tuple[Conditions, Floats]:
    """Settings of one observable that were not measured yet, and their places within the ranges.

    Sobol' points and corners of the ranges, rounded as a laboratory sets them. A condition that no row of the
    observable states is not varied.
    """
    ranges = setting_ranges(prepared, laboratory, index)
    varied = [name for name, (low, high) in ranges.items() if high > low]
    points = qmc.Sobol(max(len(varied), 1), scramble=False).random(POINTS)
    if varied:
        cornered = min(len(varied), MOST_CORNERED)
        corners = np.full((2**cornered, len(varied)), 0.5)
        corners[:, :cornered] = list(product((0.0, 1.0), repeat=cornered))
        points = np.vstack([points, corners])
    settings: Conditions = {}
    for name in prepared.rows.conditions:
        low, high = ranges.get(name, (np.nan, np.nan))
        part = points[:, varied.index(name)] if name in varied else np.zeros(points.shape[0])
        value = low * (high / low) ** part if low > 0.0 else low + part * (high - low)
        scale = prepared.problem.measurements.table_units.conditions.get(name, Scale())
        settings[name] = np.clip(rounded(value, scale), low, high) if name in varied else value
    share = np.column_stack([place(settings[name], ranges, name) for name in prepared.rows.conditions])
    share, first = np.unique(np.round(share, 9), axis=0, return_index=True)
    new = ~already_measured(prepared, index, ranges, share)
    return {name: column[first[new]] for name, column in settings.items()}, share[new]


def setting_ranges(
    prepared: PreparedProblem, laboratory: Laboratory, index: int
) -> dict[str, tuple[float, float]]:
    """Ranges of the conditions that an observable has: of the laboratory, else as measured."""
    own = prepared.rows.which == index
    return {
        name: laboratory.ranges.get(name, (float(np.nanmin(column)), float(np.nanmax(column))))
        for name, column in prepared.rows.conditions.items()
        if np.any(np.isfinite(column[own]))
    }


def rounded(value: Floats, scale: Scale) -> Floats:
    """Values with DIGITS significant digits in the unit of the laboratory's table."""
    return np.array([scale.used(float(f"{scale.written(float(each)):.{DIGITS}g}")) for each in value])


def place(column: Floats, ranges: Mapping[str, tuple[float, float]], name: str) -> Floats:
    """Place of values within the range of a condition [1]; 0 where it has none, or for a missing value."""
    low, high = ranges.get(name, (0.0, 0.0))
    if not high > low:
        return np.zeros(column.size)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.log(column / low) / np.log(high / low) if low > 0.0 else (column - low) / (high - low)
    return np.where(np.isfinite(share), share, 0.0)


def already_measured(
    prepared: PreparedProblem, index: int, ranges: Mapping[str, tuple[float, float]], share: Floats
) -> Bools:
    """Settings at which the observable was measured, rows of the vault included."""
    table, name = prepared.problem.measurements, prepared.rows.observables[index].name
    own = np.array([entry == name for entry in table.observable])
    known = np.column_stack([place(table.conditions[c][own], ranges, c) for c in prepared.rows.conditions])
    distance = np.abs(share[:, np.newaxis, :] - known[np.newaxis, :, :]).max(axis=2)
    return np.asarray(np.any(distance < SAME_SETTING, axis=1))


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
    """Indices of the chosen measurements in order, each the one that lowers the bound of errors most."""
    chosen: list[int] = []
    novelty = np.ones(pool.rows.size)
    now = log_error_bound(rivals, np.zeros((len(rivals), len(rivals), 1)))[0]
    while len(chosen) < EXPERIMENTS:
        bound = log_error_bound(rivals, distances(pool, rivals, chosen))
        gain = (now - bound) * novelty / pool.cost
        best = int(np.argmax(gain))
        if gain[best] <= LEAST_GAIN:
            break
        chosen.append(best)
        now = bound[best]
        novelty *= 1.0 - nearness(pool, best)
    return chosen


def log_error_bound(rivals: list[RivalPrediction], distance: Floats) -> Floats:
    """Ln of sum_{a<b} sqrt(q_a q_b) exp(-B_ab) for distances (rivals, rivals, pool)."""
    first, second = np.triu_indices(len(rivals), 1)
    weight = np.log([max(rival.weight, 1e-300) for rival in rivals])
    terms = 0.5 * (weight[first] + weight[second])[:, np.newaxis] - distance[first, second]
    return log_sum_exp(terms, axis=0)


def distances(pool: DesignPool, rivals: list[RivalPrediction], chosen: list[int]) -> Floats:
    """Bhattacharyya distances (rivals, rivals, pool) by what was chosen and each measurement beside it.

    B = 1/8 d^T S^-1 d + 1/2 ln |S| - 1/4 ln |S_a| - 1/4 ln |S_b|,    S = (S_a + S_b) / 2
    """
    found = np.zeros((len(rivals), len(rivals), pool.rows.size))
    own = [bordered(pool, [rival.root], chosen) for rival in rivals]
    for a, b in zip(*np.triu_indices(len(rivals), 1), strict=True):
        middle = bordered(pool, [rivals[a].root, rivals[b].root], chosen)
        gap = rivals[a].mean - rivals[b].mean
        left = gap - middle.regression @ gap[chosen]
        square = float(gap[chosen] @ middle.inverse @ gap[chosen]) + left**2 / middle.conditional
        volume = middle.log_volume - 0.5 * (own[a].log_volume + own[b].log_volume)
        found[a, b] = 0.125 * square + 0.5 * volume
    return found


@dataclass(frozen=True)
class BorderedCovariance:
    """Covariance of the chosen measurements and one more, for every one of the pool."""

    inverse: Floats  # (chosen, chosen), of the covariance of the chosen ones
    regression: Floats  # (pool, chosen), of each measurement on the chosen ones
    conditional: Floats  # (pool,), variance of each given the chosen ones
    log_volume: Floats  # (pool,), ln of the determinant


def bordered(pool: DesignPool, roots: Sequence[Floats], chosen: list[int]) -> BorderedCovariance:
    """Mean of the covariances of some explanations, with the scatter of the measurements."""
    share = 1.0 / len(roots)
    inner = share * sum((root[chosen] @ root[chosen].T for root in roots), np.zeros((len(chosen),) * 2))
    inner = inner + np.diag(pool.variance[chosen])
    cross = share * sum((root @ root[chosen].T for root in roots), np.zeros((pool.rows.size, len(chosen))))
    whole = pool.variance + share * sum(np.einsum("ij,ij->i", root, root) for root in roots)
    inverse = np.asarray(np.linalg.inv(inner), dtype=np.float64)
    regression = cross @ inverse
    conditional = np.maximum(whole - np.einsum("ij,ij->i", regression, cross), pool.variance)
    return BorderedCovariance(
        inverse, regression, conditional, np.log(conditional) + float(np.linalg.slogdet(inner)[1])
    )


def nearness(pool: DesignPool, at: int) -> Floats:
    """Share of a measurement's information that one at `at` has given: exp(-d^2 / 2 l^2) [1]."""
    distance = np.sum((pool.share - pool.share[at]) ** 2, axis=1)
    return np.where(pool.rows.which == pool.rows.which[at], np.exp(-0.5 * distance / SPREAD**2), 0.0)


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
        won += rival.weight * float(np.mean(share >= levels.DECIDED))
    return won


def experiment(pool: DesignPool, rivals: list[RivalPrediction], at: int, chance: float) -> Experiment:
    """One proposal in the laboratory's words."""
    observable = pool.rows.observable_at(at)
    predictions = {}
    for rival in by_weight_and_gap(pool, rivals, at):
        middle = float(from_scale(observable, rival.mean[[at]])[0])
        steep = float(slope(observable, np.array([middle]))[0])
        sd = float(np.sqrt(rival.root[at] @ rival.root[at] + pool.variance[at]))
        predictions[rival.name] = (middle, sd / steep if steep > 0.0 else float("nan"))
    conditions = {n: value for n, value in pool.rows.conditions_at(at).items() if np.isfinite(value)}
    setting = pool.units.setting_text(conditions)
    expected = list(predictions.items())[:TOLD]
    told = ", ".join(
        f"{prediction_words(pool.units, observable.name, *values)} if {spoken(name)}"
        for name, values in expected
    )
    words = f"Measure {observable.name} at {setting}: {told}; chance of deciding so far {chance:.0%}."
    return Experiment(observable.name, conditions, predictions, chance, float(pool.cost[at]), words)


def by_weight_and_gap(pool: DesignPool, rivals: Sequence[RivalPrediction], at: int) -> list[RivalPrediction]:
    """Explanations, likeliest first; equal ones by how well a measurement tells them from the leader."""
    leader = max(rivals, key=lambda each: each.weight)

    def gap(rival: RivalPrediction) -> float:
        variance = pool.variance[at] + 0.5 * sum(float(r.root[at] @ r.root[at]) for r in (leader, rival))
        return float(abs(rival.mean[at] - leader.mean[at]) / np.sqrt(variance))

    return sorted(rivals, key=lambda each: (each is not leader, -each.weight, -gap(each)))


def prediction_words(units: TableUnits, observable: str, mean: float, sd: float) -> str:
    """`25.3 +- 0.8 cm/s`."""
    middle = plain(units.value(observable, mean) or 0.0)
    return f"{middle} +- {units.value_text(observable, sd, 2)}"
