"""What to measure next: the measurements that are expected to tell most about which explanation holds.

    I(x) = sum_k q_k E[ln p(k | y_x, y_c) - ln p(k | y_c) | k],   next: max I(x) / cost(x)

y_x is the outcome of a measurement x of one observable, y_c those of the measurements chosen before, k the
explanations with probabilities q_k, each a normal distribution of all outcomes together, conditioned on the
rows that are known (`outlook`). Expectations are over mirrored draws. Settings are those that were measured
and a central composite design over the ranges; days that have passed cannot be measured again.

References: Lindley (1956), Ann. Math. Stat. 27, 986; Box & Hill (1967), Technometrics 9, 57 (information on
which model holds); Box & Wilson (1951), J. R. Stat. Soc. B 13, 1 (central composite design).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import hadamard
from scipy.special import logsumexp, ndtri

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows
from taichi_erosion.evidence.data.problem import Floats, Integers, Laboratory
from taichi_erosion.evidence.data.table_units import DAY
from taichi_erosion.evidence.models.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.table_columns import NewConditions
from taichi_erosion.evidence.race.fit import UNLISTED, Fit, Hypothesis
from taichi_erosion.evidence.race.outlook import JointRows, interval_in_unit, joint_rows, new_rows, outlook
from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.race.priors import KEEP, SEED, SURE
from taichi_erosion.evidence.record import ExperimentPart

MOST = 6  # explanations that are compared, and measurements: a few days in a laboratory
LEAST = 0.02  # information [nat] and chance of no worth: of two explanations 0.4 sd apart, d^2 / 8
PAIRS = 128  # mirrored pairs of outcomes under each explanation: chances within 0.02


@dataclass(frozen=True)
class Rival:
    """One explanation and what it expects of every measurement that could be made."""

    hypothesis: Hypothesis
    weight: float
    mean: Floats  # (m,)
    covariance: Floats  # (m, m), errors of the measurements included


def proposals(posterior: Posterior, laboratory: Laboratory) -> tuple[ExperimentPart, ...]:
    """Measurements that would decide between the explanations that are left, in the order to be made.

    None where the leading one is SURE, or where no measurements decide.
    """
    weights = likeliest_explanations(posterior.probability)
    leading = next(iter(weights))
    if sum(p for h, p in posterior.probability.items() if agrees_with(leading, h)) >= SURE:
        return ()
    race, rows = posterior.race, possible_rows(posterior.race.prepared, laboratory.ranges)
    place = joint_rows(race, rows)
    cost = np.array([laboratory.costs.get(name, 1.0) for name in rows.names])
    rivals = [rival_at_rows(place, race.fits[h], weight, laboratory.repeats) for h, weight in weights.items()]
    fitted = race.prepared.rows
    least = [np.min(fitted.z[fitted.which == k]) for k in range(len(fitted.observables))]
    amount = np.array([each.transform == "log_floor" for each in fitted.observables])
    design = best_design(clip_to_least_values(rivals, np.where(amount, least, -np.inf)[rows.which]), cost)
    return tuple(experiment_record(rows, rivals, at, chance, float(cost[at])) for at, chance in design)


def agrees_with(hypothesis: Hypothesis, true: Hypothesis) -> bool:
    """Whether what one explanation says is right where another holds: all that it names acts, or nothing."""
    return hypothesis.acting <= true.acting if hypothesis.acting else not true.acting


def name_of_hypothesis(hypothesis: Hypothesis) -> str:
    """`a+b`, `none`, `each_set_up`, `outside_library`; `a(condition)` of a dose that varies."""
    names, extra_names = [*hypothesis.names], "+".join(hypothesis.extra)
    if extra_names:
        names.append(extra_names if extra_names in UNLISTED else f"{extra_names}({hypothesis.along})")
    return "+".join(names) or "none"


def likeliest_explanations(probability: Mapping[Hypothesis, float]) -> dict[Hypothesis, float]:
    """The likeliest explanations, best first, kernels of a dose together; they stand for all others too."""
    answers: dict[tuple, tuple[Hypothesis, float]] = {}
    for h, p in sorted(probability.items(), key=lambda item: -item[1]):
        likeliest, whole = answers.get((h.names, h.extra), (h, 0.0))
        answers[h.names, h.extra] = likeliest, whole + p
    shares = dict(sorted(answers.values(), key=lambda each: -each[1])[:MOST])
    leading = next(iter(shares))

    def agreement(some: Mapping[Hypothesis, float], h: Hypothesis) -> float:
        return sum(p for other, p in some.items() if agrees_with(leading, other) == agrees_with(leading, h))

    probabilities = {h: p for h, p in shares.items() if p > 0.1 * KEEP}
    return {h: p * agreement(probability, h) / agreement(probabilities, h) for h, p in probabilities.items()}


def rival_at_rows(place: JointRows, fit: Fit, weight: float, repeats: int) -> Rival:
    other = outlook(place, fit)
    scatter = place.scatter_ratio(other.solution) ** 2
    covariance = other.conditional_covariance() + np.diag(scatter * place.rows.variance / repeats)
    return Rival(fit.hypothesis, weight, other.mean(), covariance)


def clip_to_least_values(rivals: Sequence[Rival], least: Floats) -> list[Rival]:
    """Rivals that expect the `least` value (m,) where they expect less: below it none is seen."""
    smallest, clipped = np.diag(np.min([np.diag(each.covariance) for each in rivals], axis=0)), list[Rival]()
    for each in rivals:
        unseen = each.mean < least
        covariance = np.where(unseen[:, np.newaxis] | unseen, smallest, each.covariance)
        clipped.append(replace(each, mean=np.maximum(each.mean, least), covariance=covariance))
    return clipped


def experiment_record(
    rows: ComparisonRows, rivals: Sequence[Rival], at: int, chance: float, cost: float
) -> ExperimentPart:
    """One measurement with what every explanation expects of it."""
    expected, observable = {}, rows.observables[rows.which[at]]
    for each in rivals:
        z = each.mean[at] + np.sqrt(each.covariance[at, at]) * ndtri([0.5, 0.05, 0.95])
        expected[name_of_hypothesis(each.hypothesis)] = interval_in_unit(observable, z)
    conditions = {n: x for n, x in rows.conditions_at(at).items() if np.isfinite(x) and n != DAY}
    return ExperimentPart(rows.names[at], conditions, expected, chance, cost)


def possible_rows(prepared: PreparedProblem, ranges: Mapping[str, tuple[float, float]]) -> ComparisonRows:
    """Settings of all observables but those that are held out: what is measured there is held out too."""
    rows, names, sets = prepared.rows, [], []
    held_out = np.column_stack(list(prepared.problem.measurements_in_vault().conditions.values()))
    for k in np.unique(rows.which):
        some = settings(rows, np.flatnonzero(rows.which == k), ranges)
        alike = np.isclose(some[:, np.newaxis], held_out, rtol=1e-6, atol=0.0, equal_nan=True)
        sets.append(some[~np.any(np.all(alike, axis=2), axis=1)])
        names += [rows.observables[k].name] * len(sets[-1])
    conditions = dict(zip(rows.conditions, np.vstack(sets).T, strict=True))
    groups = tuple(f"|{row}" for row in range(len(names)))  # each a set-up of its own
    return new_rows(prepared, NewConditions(tuple(names), conditions, groups))


def settings(rows: ComparisonRows, indices: Integers, ranges: Mapping[str, tuple[float, float]]) -> Floats:
    """Sets of conditions (m, c) of one observable; what none of its rows states is NaN."""
    table = np.column_stack(list(rows.conditions.values()))
    is_stated = np.isfinite(table[indices]).any(axis=0)
    measured = [(np.nanmin(column), np.nanmax(column)) for column in table.T]
    measured = [(b if n == DAY else a, b) for n, (a, b) in zip(rows.conditions, measured, strict=True)]
    low, high = np.array([ranges.get(n, each) for n, each in zip(rows.conditions, measured, strict=True)]).T
    middle = np.where(low > 0.0, np.sqrt(np.abs(low * high)), 0.5 * (low + high))
    middle = np.clip([float(f"{each:.2g}") for each in middle], low, high)
    corners = hadamard(max(16, 2 ** low.size.bit_length()))
    independent = sorted(range(1, len(corners)), key=int.bit_count)  # columns, then their products
    corners = corners[:, independent[: low.size]]
    share = np.vstack([corners, np.eye(low.size), -np.eye(low.size), np.zeros((1, low.size))])
    design = np.where(share > 0.0, high, np.where(share < 0.0, low, middle))
    inside = np.unique(table[np.all(~is_stated | ((table >= low) & (table <= high)), axis=1)], axis=0)
    inside = inside[:: 1 + len(inside) // len(corners)]
    return np.unique(np.where(is_stated, np.vstack([design, inside]), np.nan), axis=0)


def best_design(rivals: Sequence[Rival], cost: Floats) -> list[tuple[int, float]]:
    """Measurements and the chance that all up to each decide, while it rises; none if surely they do not."""
    valued = np.flatnonzero(np.all([np.isfinite(np.diag(r.covariance) + r.mean) for r in rivals], axis=0))
    mean = np.array([rival.mean[valued] for rival in rivals])
    covariance = np.array([rival.covariance[np.ix_(valued, valued)] for rival in rivals])
    half = np.random.default_rng(SEED).standard_normal((PAIRS, valued.size))
    kicks = np.vstack([half, -half]) @ np.linalg.cholesky(covariance).transpose(0, 2, 1)
    outcomes = (mean[:, np.newaxis] + kicks).reshape(-1, valued.size)
    gap = outcomes - mean[:, np.newaxis]  # (rivals, outcomes, m), from what each expects after those chosen
    weight, names = np.array([rival.weight for rival in rivals]), [rival.hypothesis for rival in rivals]
    rightness = np.array([[agrees_with(each, true) for true in names] for each in names], dtype=np.float64)
    true, every = np.repeat(np.arange(weight.size), 2 * PAIRS), np.arange(gap.shape[1])
    score, now = np.log(weight)[:, np.newaxis] + 0.0 * gap[..., 0], float(weight @ np.log(weight))
    choice: list[tuple[int, float]] = []
    count, best, open_ = 0, 0.0, np.ones(valued.size)
    while len(choice) < min(MOST, valued.size):
        size = np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300)[:, np.newaxis]
        after = score[..., np.newaxis] - 0.5 * (np.log(size) + gap**2 / size)
        after = after - np.asarray(logsumexp(after, axis=0))
        gain = open_ * (weight[true] @ after[true, every] / (2 * PAIRS) - now)
        at = int(np.argmax(np.where(gain > LEAST, gain / cost[valued], -np.inf)))
        if gain[at] <= LEAST:
            break
        score, now, open_[at] = after[..., at], now + gain[at], 0.0
        is_sure = (rightness @ np.exp(score))[np.argmax(score, axis=0), every] >= SURE  # of the leading one
        choice.append((int(valued[at]), float(weight[true] @ is_sure) / (2 * PAIRS)))
        if choice[-1][1] > best + LEAST:
            count, best = len(choice), choice[-1][1]
        along = (covariance[:, :, at] / covariance[:, at, at, np.newaxis])[:, np.newaxis]
        gap = gap - gap[..., at, np.newaxis] * along
        covariance = covariance - along.transpose(0, 2, 1) * covariance[:, np.newaxis, at]
    return choice[:count] if best > 1.0 - SURE else []
