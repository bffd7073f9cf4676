"""What to measure next: the measurements that are expected to tell most about which explanation holds.

    I(x) = sum_k q_k E[ln p(k | y_x, y_c) | k] - sum_k q_k E[ln p(k | y_c) | k],   next: max I(x) / cost(x)

y_x are outcomes of a measurement x of one observable, y_c those of the measurements that were chosen before,
k the explanations with probabilities q_k, each a normal distribution of all outcomes together, given the rows
that are known. Slopes are taken over one sd of the posterior on either side; the expectation is over mirrored
draws. Settings are those that were measured and a central composite design over the ranges.

References: Lindley (1956), Ann. Math. Stat. 27, 986; Box & Hill (1967), Technometrics 9, 57 (information about
which model holds); Box & Wilson (1951), J. R. Stat. Soc. B 13, 1 (central composite design).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.linalg import hadamard
from scipy.stats import norm

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows, joined
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Bools, Floats, Integers, Laboratory
from taichi_erosion.evidence.data.transforms import from_scale, slope
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.race.blocks import Block, dose_columns, nuisance, unlisted
from taichi_erosion.evidence.race.doses import STEP_W, dosers
from taichi_erosion.evidence.race.expansion import RaceModel
from taichi_erosion.evidence.race.posterior import SEED, Posterior
from taichi_erosion.evidence.race.priors import KEEP, SURE
from taichi_erosion.evidence.race.record import ExperimentPart, Interval
from taichi_erosion.evidence.race.search import UNLISTED_KEY, Fit, Hypothesis, Race

MOST = 6  # explanations that are compared, and measurements: what one day in a laboratory gives
LEAST = 0.02  # information [nat] and chance below which nothing moves: two explanations 0.4 sd apart
DRAWS = 128  # of outcomes if one explanation holds, and as many mirrored: a chance is known within 0.02

State = Literal["decided", "undecidable", "proposed"]


@dataclass(frozen=True)
class Proposed:
    """The measurements, or why there are none."""

    state: State
    experiments: tuple[ExperimentPart, ...] = ()


@dataclass(frozen=True)
class Rival:
    """One explanation with what it expects of every measurement that could be made."""

    name: str
    answer: frozenset[str]  # what acts if it holds
    weight: float
    mean: Floats  # (m,)
    covariance: Floats  # (m, m), errors of the measurements included


def proposals(posterior: Posterior, laboratory: Laboratory) -> Proposed:
    """Measurements that would decide between the explanations that are left, in the order to be made."""
    leading, *others = explanations(posterior)
    if sum(p for h, p in posterior.probability.items() if holds(leading[0], answer_of(h))) >= SURE:
        return Proposed("decided")
    pool = Pool(posterior.race, laboratory)
    scale = (1.0 - leading[2]) / max(sum(weight for *_, weight in others), 1e-300)  # they stand for all others
    weighted = [leading, *((answer, h, scale * weight) for answer, h, weight in others)]
    rivals = [pool.rival(answer, posterior.race.fits[h], weight) for answer, h, weight in weighted]
    chosen = best_design(rivals, pool.cost)
    told = tuple(pool.experiment(rivals, at, chance) for at, chance in chosen)
    return Proposed("proposed" if told else "undecidable", told)


# -- explanations


def answer_of(hypothesis: Hypothesis) -> frozenset[str]:
    """What acts: effects, a mechanism, something that is not in the list; of an instrument's zero nothing."""
    beyond = hypothesis.beyond.partition("|")[0]
    return frozenset((*hypothesis.names, *({beyond} - {"", "zero"})))


def holds(one: frozenset[str], other: frozenset[str]) -> bool:
    """Whether an answer is right where another one holds: all that it names acts, or nothing does."""
    return one <= other if one else not other


def name_of(hypothesis: Hypothesis) -> str:
    """`a+b`, `none`, `outside_library`; `a(condition)` of a dose that varies, `zero|a` of an instrument."""
    key, _, axis = hypothesis.beyond.partition("|")
    beyond = {"": "", UNLISTED_KEY: "outside_library", "zero": hypothesis.beyond}
    told = beyond.get(key, f"{key}({axis.rpartition('|')[2]})")
    return "+".join(filter(None, (*hypothesis.names, told))) or "none"


def explanations(posterior: Posterior) -> list[tuple[frozenset[str], Hypothesis, float]]:
    """The likeliest answers with their best hypotheses and probabilities; kernels of a dose count together."""
    whole: dict[tuple, list[Hypothesis]] = {}
    for h in sorted(posterior.probability, key=lambda h: -posterior.probability[h]):
        if posterior.probability[h] > 0.1 * KEEP or not whole:
            whole.setdefault((h.names, h.beyond.partition("|")[0]), []).append(h)
    told = [(answer_of(same[0]), same[0], sum(map(posterior.probability.get, same))) for same in whole.values()]
    return sorted(told, key=lambda each: -each[2])[:MOST]


# -- what they expect


@dataclass(frozen=True)
class Pool:
    """Measurements that could be made, and what explanations expect of them."""

    race: Race
    laboratory: Laboratory

    @cached_property
    def picked(self) -> tuple[Integers, Mapping[str, Floats]]:
        """For every measurement a typical row of its observable (m,), and the conditions."""
        p = self.race.prepared
        typical, columns = [], []
        for index in np.unique(p.rows.which):
            own = np.flatnonzero(p.rows.which == index)
            sets = settings(p.rows, p.rows.which == index, self.laboratory.ranges)
            typical.append(np.full(len(sets), own[np.argsort(p.sd[own])[own.size // 2]]))
            columns.append(sets)
        return np.concatenate(typical), dict(zip(p.rows.conditions, np.vstack(columns).T, strict=True))

    @cached_property
    def ahead(self) -> PreparedProblem:
        """The study with these measurements for rows."""
        (typical, conditions), p = self.picked, self.race.prepared
        new, none = p.rows.rows(typical), np.zeros(typical.size)
        exact = {name: np.full(typical.size, np.nan) for name in p.rows.condition_sd}
        new = replace(
            new,
            conditions=conditions,
            condition_sd=exact,
            group=tuple(f"|{i}" for i in range(typical.size)),
            censored=none > 0.0,
            reach=none,
            shared=p.rows.shared[typical],
            covariance=None,
        )
        predictor = p.predictor.over(new.observables, new.which, new.conditions)
        seeds, variance = p.seed_variance[typical], p.variance[typical]
        return replace(
            p, rows=new, predictor=predictor, seed_variance=seeds, variance=variance, condition_errors=None
        )

    @cached_property
    def model(self) -> RaceModel:
        return RaceModel(self.ahead)

    @cached_property
    def cost(self) -> Floats:
        return np.array([self.laboratory.costs.get(name, 1.0) for name in self.ahead.rows.names])

    @cached_property
    def variance(self) -> Floats:
        """Of the mean of the repeats (m,), each with the error of one repeat behind a row of the table."""
        p, table = self.race.prepared, self.race.prepared.problem.visible()
        repeats = {name: np.fmax(table.n[np.array(table.observable) == name], 1.0) for name in table.observable}
        behind = np.array([np.sum(repeats[o.name]) / max(np.sum(p.rows.rows_of(o)), 1) for o in p.rows.observables])
        return self.ahead.variance * behind[self.ahead.rows.which] / self.laboratory.repeats

    def rival(self, answer: frozenset[str], fit: Fit, weight: float) -> Rival:
        """One explanation, given the rows that are known."""
        race, count = self.race, fit.v.size
        doses, value = self.doses(fit)
        middle, h = value(fit.target), np.linalg.cholesky(fit.covariance) if count else np.zeros((0, 0))
        spread = np.reshape([0.5 * (value(fit.target + step) - value(fit.target - step)) for step in h.T], (count, -1))
        slopes = np.linalg.solve(h.T, spread).T if count else np.zeros((middle.size, 0))
        blocks = self.blocks(fit, middle, doses)
        known, size = [replace(b, columns=b.columns[: fit.mean.size]) for b in blocks], fit.mean.size
        rows, _ = race.linear(replace(fit, blocks=tuple(known)))
        now = rows.with_bad(fit.evidence.bad).solved(fit.evidence.solved.u)
        errors = np.zeros((middle.size, fit.errors.shape[1]))
        errors[:, : self.ahead.rows.shared.shape[1]] = self.ahead.rows.shared
        columns = np.hstack([slopes, errors, *(b.columns[size:] for b in blocks)]) * now.tau
        own = self.ahead.predictor.model_errors(*self.setting(fit))
        scatter = np.append(np.exp(2.0 * now.u[rows.blocks :]), 1.0)[self.scatter]
        covariance = columns @ now.inverse @ columns.T + own @ own.T + np.diag(self.variance * scatter)
        mean = middle + columns[:, count:] @ now.centre[count:] - (0.0 if doses is None else doses[2])
        return Rival(name_of(fit.hypothesis), answer, weight, mean, covariance)

    @property
    def scatter(self) -> Integers:
        """Scale of the scatter of every measurement."""
        return self.race.scatter[self.picked[0]]

    def setting(self, fit: Fit) -> tuple[Floats, dict[str, float]]:
        """Calibrated numbers and strengths at the best setting."""
        numbers = self.model.numbers(fit.target[: self.model.count])
        return numbers, self.model.strengths(fit.hypothesis.names, fit.target)

    def doses(self, fit: Fit) -> tuple[tuple[Floats, Floats, Floats] | None, Callable[[Floats], Floats]]:
        """Factor of the doses of all rows, change along them, its part in the mean; the mean as a function of v."""
        if fit.dose is None:
            return None, lambda v: self.model.mean(fit.hypothesis.names, v)
        name, k, axis = fit.hypothesis.beyond.split("|")
        rows = joined([self.race.prepared.rows, self.ahead.rows])
        factor = [each for along, each in dose_columns(rows) if along == axis][int(k) % 2]
        w = factor @ np.linalg.lstsq(factor[: fit.mean.size], fit.dose.w, rcond=None)[0]
        doser, there = next(each for each in dosers(self.race) if each.name == name), replace(self.race, model=self.model)
        w = w[fit.mean.size :]

        def value(v: Floats, more: float = 0.0) -> Floats:
            return doser.at(there, v, w + more)[1]

        h = np.where(w > 0.5 * doser.top, -STEP_W, STEP_W)
        change = (value(fit.target, h) - value(fit.target)) / h
        return (factor, np.append(fit.dose.slope, change), change * w), value

    def blocks(self, fit: Fit, middle: Floats, doses: tuple[Floats, Floats, Floats] | None) -> list[Block]:
        """The blocks of a fit over the known rows and the new ones."""
        p, unit = self.race.prepared, np.append(self.race.prepared.sd, self.ahead.sd)
        steep = np.zeros(middle.size)
        for observable, own in self.ahead.by_observable():
            steep[own] = slope(observable, from_scale(observable, middle[own]))
        rows = joined([p.rows, replace(self.ahead.rows, z=middle, slope=steep)])
        usual = nuisance(rows, np.arange(rows.size) < p.rows.size, unit)
        found = {(b.kind, b.observable): b.columns for b in (*usual, *unlisted(usual))}
        for zero in self.race.zeros:
            own = np.array(rows.names) == zero.observable
            found["zero", zero.observable] = np.where(own, rows.slope, 0.0)[:, np.newaxis]
        if doses is not None:
            found["dose", ""] = doses[1][:, np.newaxis] * doses[0]
        return [replace(b, columns=like(found[b.kind, b.observable], b.columns)) for b in fit.blocks]

    def experiment(self, rivals: Sequence[Rival], at: int, chance: float) -> ExperimentPart:
        """One measurement with what every explanation expects of it."""
        rows = self.ahead.rows
        conditions = {name: value for name, value in rows.conditions_at(at).items() if np.isfinite(value)}
        expected = {}
        for rival in rivals:
            z = rival.mean[at] + np.sqrt(rival.covariance[at, at]) * norm.ppf([0.5, 0.05, 0.95])
            expected[rival.name] = Interval(*map(float, from_scale(rows.observable_at(at), z)))
        return ExperimentPart(rows.names[at], conditions, expected, chance, float(self.cost[at]))


def like(columns: Floats, known: Floats) -> Floats:
    """Columns of all rows in the size that those of the known rows have."""
    return columns * (np.linalg.norm(known) / max(float(np.linalg.norm(columns[: len(known)])), 1e-300))


def settings(rows: ComparisonRows, own: Bools, ranges: Mapping[str, tuple[float, float]]) -> Floats:
    """Sets of conditions (m, c) of one observable, at most 16 of them measured; what no row states stays unstated."""
    table = np.column_stack(list(rows.conditions.values()))
    stated = np.isfinite(table[own]).any(axis=0)
    ends = np.array([ranges.get(n, (np.nanmin(c[own]), np.nanmax(c[own]))) for n, c in rows.conditions.items()])
    low, high = ends.T
    middle = np.where(low > 0.0, np.sqrt(np.abs(low * high)), 0.5 * (low + high))
    middle = np.clip([float(f"{value:.2g}") for value in middle], low, high)
    count = low.size
    level = hadamard(2 ** max(4, count.bit_length()))[:, 1 : count + 1]
    share = np.vstack([level, np.eye(count), -np.eye(count), np.zeros((1, count))])
    design = np.where(share > 0.0, high, np.where(share < 0.0, low, middle))
    inside = np.all(~stated | ((table >= low) & (table <= high)), axis=1)
    measured = np.unique(table[inside], axis=0)
    measured = measured[np.unique(np.linspace(0, len(measured) - 1, min(16, len(measured))).astype(int))]
    return np.unique(np.where(stated, np.vstack([design, measured]), np.nan), axis=0)


# -- the design


def best_design(rivals: Sequence[Rival], cost: Floats) -> list[tuple[int, float]]:
    """Measurements with the chance that all up to each decide, as far as that rises."""
    weight, count = np.array([rival.weight for rival in rivals]), len(rivals)
    right = np.array([[holds(a.answer, b.answer) for b in rivals] for a in rivals], dtype=np.float64)
    possible = np.all([np.isfinite(rival.mean) & np.isfinite(np.diag(rival.covariance)) for rival in rivals], axis=0)
    usable = np.flatnonzero(possible)
    mean = np.array([rival.mean[usable] for rival in rivals])
    covariance = np.array([rival.covariance[np.ix_(usable, usable)] for rival in rivals])
    half = np.random.default_rng(SEED).standard_normal((DRAWS, usable.size))
    kicks = np.vstack([half, -half])
    roots = np.linalg.cholesky(covariance)
    outcome = (mean[:, np.newaxis] + kicks @ roots.transpose(0, 2, 1)).reshape(-1, usable.size)
    true = np.repeat(np.arange(count), len(kicks))
    share = weight[true] / len(kicks)  # of every draw
    gap = outcome - mean[:, np.newaxis]  # (rivals, draws, m), from what each expects given those chosen
    score = np.repeat(np.log(weight)[:, np.newaxis], true.size, axis=1)
    known, chosen = float(weight @ np.log(weight)), []
    while len(chosen) < min(MOST, usable.size):
        size = np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-300)[:, np.newaxis]
        after = score[..., np.newaxis] - 0.5 * (np.log(size) + gap**2 / size)
        gain = share @ (after[true, np.arange(true.size)] - log_sum_exp(after, axis=0)) - known
        gain[[at for at, _ in chosen]] = -np.inf
        at = int(np.argmax(np.where(gain > LEAST, gain / cost[usable], -np.inf)))
        if gain[at] <= LEAST:
            break
        known, score = known + gain[at], after[..., at]
        decided = np.max(right @ np.exp(score - log_sum_exp(score, axis=0)), axis=0) >= SURE
        chosen.append((at, float(share @ decided)))
        along = covariance[:, :, at] / covariance[:, at, at, np.newaxis]
        gap = gap - gap[..., at, np.newaxis] * along[:, np.newaxis]
        covariance = covariance - along[:, :, np.newaxis] * covariance[:, np.newaxis, at]
    told, best = 0, 0.0
    for number, (_, chance) in enumerate(chosen, 1):
        told, best = (number, chance) if chance > best + LEAST else (told, best)
    return [(int(usable[at]), chance) for at, chance in chosen[:told]]
