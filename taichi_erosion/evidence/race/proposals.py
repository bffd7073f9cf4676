"""What to measure next: the measurements that are expected to tell most about which explanation holds.

    I(x) = sum_k q_k E[ln p(k | y_x, y_c) - ln p(k | y_c) | k],   next: max I(x) / cost(x)

y_x is the outcome of a measurement x of one observable, y_c those of the measurements chosen before, k the
explanations with probabilities q_k, each a normal distribution of all outcomes together, conditioned on the
rows that are known. Slopes are taken over one sd of the posterior on either side, expectations over mirrored
draws. Settings are those that were measured and a central composite design over the ranges.

References: Lindley (1956), Ann. Math. Stat. 27, 986; Box & Hill (1967), Technometrics 9, 57 (information on
which model holds); Box & Wilson (1951), J. R. Stat. Soc. B 13, 1 (central composite design).
"""

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.linalg import hadamard
from scipy.stats import norm

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, joined
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Integers, Laboratory
from taichi_erosion.evidence.data.transforms import from_scale, slope
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.race.blocks import dose_columns, nuisance, unlisted
from taichi_erosion.evidence.race.doses import STEP_W, dosers
from taichi_erosion.evidence.race.expansion import RaceModel
from taichi_erosion.evidence.race.posterior import SEED, Posterior
from taichi_erosion.evidence.race.priors import KEEP, SURE
from taichi_erosion.evidence.race.record import ExperimentPart, Interval
from taichi_erosion.evidence.race.search import UNLISTED_KEY, Fit, Hypothesis, Race

MOST = 6  # explanations that are compared, and measurements: a few days in a laboratory
LEAST = 0.02  # information [nat] and chance of no worth: of two explanations 0.4 sd apart, d^2 / 8
DRAWS = 128  # mirrored pairs of outcomes under each explanation: chances within 0.02


@dataclass(frozen=True)
class Proposed:
    """The measurements in the order to be made, or why there are none."""

    state: Literal["decided", "undecidable", "proposed"]
    experiments: tuple[ExperimentPart, ...] = ()


@dataclass(frozen=True)
class Rival:
    """One explanation and what it expects of every measurement that could be made."""

    hypothesis: Hypothesis
    weight: float
    mean: Floats  # (m,)
    covariance: Floats  # (m, m), errors of the measurements included


def proposals(posterior: Posterior, laboratory: Laboratory) -> Proposed:
    """Measurements that would decide between the explanations that are left."""
    weights = explanations(posterior.probability)
    leading = next(iter(weights))
    if sum(p for h, p in posterior.probability.items() if right(leading, h)) >= SURE:
        return Proposed("decided")
    pool = pool_of(posterior.race, laboratory)
    rivals = [pool.rival(posterior.race.fits[h], weight) for h, weight in weights.items()]
    told = tuple(pool.experiment(rivals, at, chance) for at, chance in best_design(rivals, pool.cost))
    return Proposed("proposed" if told else "undecidable", told)


# -- explanations


def acting(hypothesis: Hypothesis) -> frozenset[str]:
    """What acts: effects, a mechanism, something that is not in the list; of an instrument's zero nothing."""
    return frozenset((*hypothesis.names, hypothesis.beyond.partition("|")[0])) - {"", "zero"}


def right(told: Hypothesis, true: Hypothesis) -> bool:
    """Whether what one explanation says is right where another holds: all that it names acts, or nothing."""
    return acting(told) <= acting(true) if acting(told) else not acting(true)


def name_of(hypothesis: Hypothesis) -> str:
    """`a+b`, `none`, `outside_library`; `a(condition)` of a dose that varies, `zero|a` of an instrument."""
    key, _, rest = hypothesis.beyond.partition("|")
    varying = f"{key}({rest.rpartition('|')[2]})"
    told = {"": "", UNLISTED_KEY: "outside_library", "zero": hypothesis.beyond}.get(key, varying)
    return "+".join(filter(None, (*hypothesis.names, told))) or "none"


def explanations(probability: Mapping[Hypothesis, float]) -> dict[Hypothesis, float]:
    """The likeliest explanations, best first, kernels of a dose together; they stand for all others too."""
    found: dict[tuple, tuple[Hypothesis, float]] = {}
    for h, p in sorted(probability.items(), key=lambda item: -item[1]):
        key = h.names, h.beyond.partition("|")[0]
        found[key] = found.get(key, (h, 0.0))[0], found.get(key, (h, 0.0))[1] + p
    kept = dict(sorted(found.values(), key=lambda each: -each[1])[:MOST])
    leading = next(iter(kept))

    def agreeing(some: Mapping[Hypothesis, float], h: Hypothesis) -> float:
        return sum(p for other, p in some.items() if right(leading, other) == right(leading, h))

    told = {h: p for h, p in kept.items() if p > 0.1 * KEEP}
    return {h: p * agreeing(probability, h) / agreeing(told, h) for h, p in told.items()}


# -- what they expect


@dataclass(frozen=True)
class Pool:
    """m measurements that could be made, as rows that follow the n known ones."""

    race: Race
    typical: Integers  # (m,), known row with the median error of the same observable
    ahead: PreparedProblem  # the study with these measurements for rows
    model: RaceModel  # there
    variance: Floats  # (m,), of the mean of the repeats
    cost: Floats  # (m,)

    def rival(self, fit: Fit, weight: float) -> Rival:
        """An explanation, given the known rows; every measurement is a batch of its own."""
        n, v, names = fit.mean.size, fit.target, fit.hypothesis.names
        value, bent, offset = self.dosed(fit)
        middle, root = value(v), np.linalg.cholesky(fit.covariance)
        change = [0.5 * (value(v + step) - value(v - step)) for step in root.T]
        slopes = np.linalg.solve(root.T, np.reshape(change, (v.size, middle.size))).T
        blocks = self.blocks(fit, middle, bent)
        known = [replace(b, columns=own[:n]) for b, own in zip(fit.blocks, blocks, strict=True)]
        rows, _ = self.race.linear(replace(fit, blocks=tuple(known)))
        now = rows.with_bad(fit.evidence.bad).solved(fit.evidence.solved.u)
        shared = self.ahead.rows.shared
        errors = np.pad(shared, ((0, 0), (0, fit.errors.shape[1] - shared.shape[1])))
        columns = np.hstack([slopes, errors, *(own[n:] for own in blocks)]) * now.tau
        mean = middle - offset + columns[:, v.size :] @ now.centre[v.size :]
        scatter = np.append(np.exp(2.0 * now.u[rows.blocks :]), 1.0)[self.race.scatter[self.typical]]
        batch = sum(np.exp(2.0 * now.u[i]) for i, b in enumerate(fit.blocks) if b.kind == "batch")
        numbers = self.model.numbers(v[: self.model.count])
        own = self.ahead.predictor.model_errors(numbers, self.model.strengths(names, v))
        single = np.diag(self.variance * scatter + self.ahead.variance * batch)
        return Rival(fit.hypothesis, weight, mean, columns @ now.inverse @ columns.T + own @ own.T + single)

    def dosed(self, fit: Fit) -> tuple[Callable[[Floats], Floats], Floats, Floats]:
        """Mean as a function of v at the likeliest doses, their columns (n + m, r), their part in it (m,)."""
        n, m, doses = fit.mean.size, self.typical.size, fit.dose
        if doses is None:
            names = fit.hypothesis.names
            return lambda v: self.model.mean(names, v), np.zeros((n + m, 0)), np.zeros(m)
        name, k, axis = fit.hypothesis.beyond.split("|")
        there = copy(self.race)
        there.model = self.model
        doser = next(each for each in dosers(self.race) if each.name == name)
        kernels = dose_columns(joined([self.race.prepared.rows, self.ahead.rows]))
        factor = [each for along, each in kernels if along == axis][int(k) % 2]
        w = factor[n:] @ np.linalg.lstsq(factor[:n], doses.w, rcond=None)[0]
        h = np.where(w > 0.5 * doser.top, -STEP_W, STEP_W)
        bend = (doser.at(there, fit.target, w + h)[1] - doser.at(there, fit.target, w)[1]) / h
        return lambda v: doser.at(there, v, w)[1], np.append(doses.slope, bend)[:, None] * factor, bend * w

    def blocks(self, fit: Fit, middle: Floats, bent: Floats) -> list[Floats]:
        """Columns (n + m, q) of every block of a fit, as large in the known rows as there."""
        steep, p = np.zeros(middle.size), self.race.prepared
        for observable, own in self.ahead.by_observable():
            steep[own] = slope(observable, from_scale(observable, middle[own]))
        rows = joined([p.rows, replace(self.ahead.rows, z=middle, slope=steep)])
        usual = nuisance(rows, np.arange(rows.size) < p.rows.size, np.append(p.sd, self.ahead.sd))
        found = {(b.kind, b.observable): b.columns for b in (*usual, *unlisted(usual))} | {("dose", ""): bent}
        for zero in self.race.zeros:
            own = np.array(rows.names) == zero.observable
            found["zero", zero.observable] = np.where(own, rows.slope, 0.0)[:, None]
        pairs = [(found[b.kind, b.observable], np.linalg.norm(b.columns)) for b in fit.blocks]
        return [new * size / max(np.linalg.norm(new[: p.rows.size]), 1e-300) for new, size in pairs]

    def experiment(self, rivals: Sequence[Rival], at: int, chance: float) -> ExperimentPart:
        """One measurement with what every explanation expects of it."""
        rows, expected = self.ahead.rows, {}
        for rival in rivals:
            z = rival.mean[at] + np.sqrt(rival.covariance[at, at]) * norm.ppf([0.5, 0.05, 0.95])
            expected[name_of(rival.hypothesis)] = Interval(*map(float, from_scale(rows.observable_at(at), z)))
        stated = {name: value for name, value in rows.conditions_at(at).items() if np.isfinite(value)}
        return ExperimentPart(rows.names[at], stated, expected, chance, float(self.cost[at]))


def pool_of(race: Race, laboratory: Laboratory) -> Pool:
    """Every measurement that a laboratory could make."""
    p, table = race.prepared, race.prepared.problem.visible()
    named, parts = np.array(table.observable), []
    for k in np.unique(p.rows.which):
        own = np.flatnonzero(p.rows.which == k)
        sets = settings(p.rows, own, laboratory.ranges)
        behind = np.fmax(table.n[named == p.rows.observables[k].name], 1.0).sum() / own.size  # a row
        median = own[np.argsort(p.sd[own])[own.size // 2]]
        parts.append((sets, np.full(len(sets), median), np.full(len(sets), behind / laboratory.repeats)))
    sets, at, share = map(np.concatenate, zip(*parts, strict=True))
    none = np.zeros(at.size)
    rows = replace(
        p.rows.rows(at),
        conditions=dict(zip(p.rows.conditions, sets.T, strict=True)),
        condition_sd={name: np.full(at.size, np.nan) for name in p.rows.condition_sd},
        group=("",) * at.size,
        censored=none > 0.0,
        reach=none,
        shared=p.rows.shared[at],
        covariance=None,
    )
    predictor = p.predictor.over(rows.observables, rows.which, rows.conditions)
    seeds, variance = p.seed_variance[at], p.variance[at]
    ahead = replace(p, rows=rows, predictor=predictor, seed_variance=seeds, variance=variance)
    ahead = replace(ahead, condition_errors=None)
    cost = np.array([laboratory.costs.get(name, 1.0) for name in rows.names])
    return Pool(race, at, ahead, RaceModel(ahead), variance * share, cost)


def settings(rows: ComparisonRows, own: Integers, ranges: Mapping[str, tuple[float, float]]) -> Floats:
    """Sets of conditions (m, c) of one observable; what none of its rows states is NaN."""
    table = np.column_stack(list(rows.conditions.values()))
    stated = np.isfinite(table[own]).any(axis=0)
    measured = [(np.nanmin(column), np.nanmax(column)) for column in table.T]
    low, high = np.array([ranges.get(n, each) for n, each in zip(rows.conditions, measured, strict=True)]).T
    middle = np.where(low > 0.0, np.sqrt(np.abs(low * high)), 0.5 * (low + high))
    middle = np.clip([float(f"{each:.2g}") for each in middle], low, high)
    corners = hadamard(max(16, 2 ** low.size.bit_length()))[:, 1 : low.size + 1]
    share = np.vstack([corners, np.eye(low.size), -np.eye(low.size), np.zeros((1, low.size))])
    design = np.where(share > 0.0, high, np.where(share < 0.0, low, middle))
    inside = np.unique(table[np.all(~stated | ((table >= low) & (table <= high)), axis=1)], axis=0)
    inside = inside[:: 1 + len(inside) // len(corners)]
    return np.unique(np.where(stated, np.vstack([design, inside]), np.nan), axis=0)


# -- the design


def best_design(rivals: Sequence[Rival], cost: Floats) -> list[tuple[int, float]]:
    """Measurements and the chance that all up to each decide, while it rises; none if surely they do not."""
    valued = np.flatnonzero(np.all([np.isfinite(np.diag(r.covariance) + r.mean) for r in rivals], axis=0))
    mean = np.array([rival.mean[valued] for rival in rivals])
    covariance = np.array([rival.covariance[np.ix_(valued, valued)] for rival in rivals])
    half = np.random.default_rng(SEED).standard_normal((DRAWS, valued.size))
    kicks = np.vstack([half, -half]) @ np.linalg.cholesky(covariance).transpose(0, 2, 1)
    outcomes = (mean[:, np.newaxis] + kicks).reshape(-1, valued.size)
    gap = outcomes - mean[:, np.newaxis]  # (rivals, outcomes, m), from what each expects after those chosen
    weight, names = np.array([rival.weight for rival in rivals]), [rival.hypothesis for rival in rivals]
    rightness = np.array([[right(told, true) for true in names] for told in names], dtype=np.float64)
    true, every = np.repeat(np.arange(weight.size), 2 * DRAWS), np.arange(gap.shape[1])
    score, now = np.log(weight)[:, np.newaxis] + 0.0 * gap[..., 0], float(weight @ np.log(weight))
    told: list[tuple[int, float]] = []
    kept, best, open_ = 0, 0.0, np.ones(valued.size)
    while len(told) < min(MOST, valued.size):
        size = np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300)[:, np.newaxis]
        after = score[..., np.newaxis] - 0.5 * (np.log(size) + gap**2 / size)
        after -= log_sum_exp(after, axis=0)
        gain = open_ * (weight[true] @ after[true, every] / (2 * DRAWS) - now)
        at = int(np.argmax(np.where(gain > LEAST, gain / cost[valued], -np.inf)))
        if gain[at] <= LEAST:
            break
        score, now, open_[at] = after[..., at], now + gain[at], 0.0
        sure = (rightness @ np.exp(score))[np.argmax(score, axis=0), every] >= SURE  # of the leading one
        told.append((int(valued[at]), float(weight[true] @ sure) / (2 * DRAWS)))
        if told[-1][1] > best + LEAST:
            kept, best = len(told), told[-1][1]
        along = (covariance[:, :, at] / covariance[:, at, at, np.newaxis])[:, np.newaxis]
        gap = gap - gap[..., at, np.newaxis] * along
        covariance = covariance - along.transpose(0, 2, 1) * covariance[:, np.newaxis, at]
    return told[:kept] if best > 1.0 - SURE else []
