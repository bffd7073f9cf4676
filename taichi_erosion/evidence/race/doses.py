"""Mechanisms: one dose for every set of conditions.

    z = m(v, w) + F u + e,   w = tau L s,   s ~ N(0, 1),   L L^T = k(conditions) + 1/4

with w = ln(1 + dose) above 0 and the dose itself below. About doses w the rows are linear in s, so that the
doses are one more block of the race with columns (dm/dw) L, shared by all observables. Each kernel k, along
one condition or all, is a hypothesis of its own. Every row is simulated at its own dose: that costs as many
runs as any other setting.

Reference: Rasmussen & Williams (2006), Gaussian Processes, 3.4 (Gauss-Newton steps of a latent function).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import log

import numpy as np

from taichi_erosion.evidence.data.problem import Floats, Mechanism
from taichi_erosion.evidence.race.blocks import EACH_SET_UP, Block, dose_factors
from taichi_erosion.evidence.race.expansion import Acting
from taichi_erosion.evidence.race.fit import FAR, SLACK, Doses, Fit, Hypothesis, Race, log_joint
from taichi_erosion.evidence.race.linear_evidence import one_scale
from taichi_erosion.evidence.race.priors import CARRIED, KEEP
from taichi_erosion.evidence.race.search import prior

SHARES = (1.0, 0.4, 0.16, 0.06)  # of a step of doses, that are tried in turn
LEAST_DOSE = -0.95  # a place that is almost switched off
LARGEST_STEP, STILL = 0.7, 0.02  # of w
FIRST, THEN = 4, 14  # steps with the scales at their priors, so that no level takes what a dose does; all

Seen = tuple["Dosing", Fit, Floats]  # mechanisms, a fit from which they start, and their doses there


def dose_to_axis(dose: Floats) -> Floats:
    return np.where(dose > 0.0, np.log1p(np.maximum(dose, 0.0)), dose)


@dataclass(frozen=True)
class Dosing:
    """Mechanisms with one kernel of their doses, alone or beside listed effects."""

    race: Race
    mechanisms: tuple[Mechanism, ...]
    log_prior: float
    axis: str  # condition along which the doses vary
    factor: Floats  # (n, r), L of the kernel of each
    names: Acting = ()  # effects beside them

    @property
    def key(self) -> Hypothesis:
        return Hypothesis(self.names, tuple(each.name for each in self.mechanisms), self.axis)

    @cached_property
    def dose_range_on_axis(self) -> Floats:
        """Range (2, m n) of the doses on their axis."""
        ends = [[max(each.low, LEAST_DOSE), each.high] for each in self.mechanisms]
        return np.repeat(dose_to_axis(np.array(ends, dtype=np.float64).T), self.factor.shape[0], axis=1)

    @cached_property
    def factors(self) -> Floats:
        """Factor (m n, m r) of all doses."""
        return np.asarray(np.kron(np.eye(len(self.mechanisms)), self.factor), dtype=np.float64)

    def clip_coefficients_to_range(self, beta: Floats) -> Floats:
        """Coefficients whose doses are nearest to those of some within the range."""
        w = self.factors @ beta
        return beta + Doses(np.clip(w, *self.dose_range_on_axis) - w, w, self.factors).coefficients

    def clip_doses_and_predict(self, v: Floats, w: Floats) -> tuple[Floats, Floats]:
        """Doses on their axis within the range, and the mean (n,) there."""
        inside = np.round(np.clip(w, *self.dose_range_on_axis), 3)
        return inside, self.race.model.predict_mean(self.names, v, self.key.doses_of(inside))

    def dose_slope(self, v: Floats, w: Floats, mean: Floats) -> Floats:
        """Slope (m n,) of the mean along w."""
        slopes, each = [], np.arange(w.size) // mean.size
        for k in range(len(self.mechanisms)):
            h = np.where(each == k, np.where(w > np.mean(self.dose_range_on_axis, axis=0), -0.05, 0.05), 0.0)
            slopes.append(np.nan_to_num((self.clip_doses_and_predict(v, w + h)[1] - mean) / h[each == k]))
        return np.concatenate(slopes)

    def fit_about(self, at: Fit, beta: Floats, w: Floats, u: Floats | None, steps: int) -> Fit:
        """The race's rows about numbers, doses w and their coefficients."""
        dose = Doses(self.factors @ beta, self.dose_slope(at.v, w, at.mean), self.factors)
        size = one_scale("dose", cauchy=self.race.priors.dose)
        block = Block("dose", "", dose.change(self.factors, at.mean.size), size)
        about = {"hypothesis": self.key, "log_prior": self.log_prior, "is_optimum": True, "dose": dose}
        return self.race.fit_at_scales(replace(at, **about, blocks=(*self.race.blocks, block)), steps, u)

    def is_hopeless(self, fit: Fit) -> bool:
        """Whether a fit is so unlikely that no few steps more make it worth another run."""
        return log_joint(fit) < max(map(log_joint, self.race.fits.values())) + 2.0 * log(KEEP)

    def optimise(self, start: Fit, w: Floats) -> Fit:
        """Numbers and doses by Gauss-Newton steps from some, none of which raises the misfit."""
        beta, u = Doses(w, w, self.factors).coefficients, None
        w, mean = self.clip_doses_and_predict(start.v, self.factors @ beta)
        fit = replace(start, mean=mean)
        for step in range(THEN):
            fit = self.fit_about(fit, beta, w, u, 0 if step < FIRST else 4)
            u, change, turn, tau = fit.scales, *self.newton_step(fit, beta)
            small = np.max(np.abs(change), initial=0.0) < 0.05 and np.max(np.abs(self.factors @ turn)) < STILL
            if step >= FIRST and (small or self.is_hopeless(fit)):
                break
            before = self.race.misfit(fit, fit.mean, fit.v) + float(beta @ beta) / tau**2
            for share in SHARES:
                v, tried = fit.v + share * change, self.clip_coefficients_to_range(beta + share * turn)
                there, mean = self.clip_doses_and_predict(v, self.factors @ tried)
                after = self.race.misfit(fit, np.nan_to_num(mean, nan=1e6), v) + float(tried @ tried) / tau**2
                if after < before + 0.1 * SLACK:
                    break
            else:
                break
            move, jacobian = share * change, fit.jacobian
            if np.max(np.abs(move), initial=0.0) > 0.1:
                linear = fit.mean + (fit.dose.change(there - w, mean.size) if fit.dose is not None else 0.0)
                jacobian = jacobian + np.outer(mean - linear - jacobian @ move, move) / (move @ move)
            fit, beta, w = replace(fit, v=v, mean=mean, jacobian=jacobian), tried, there
        fit = replace(fit, errors=self.race.model.errors(self.names, fit.v, self.key.doses_of(w)))
        expansion = self.evidence_at_mean(self.fit_about(fit, beta, w, u, 8), beta)
        return self.race.best_of(expansion, self.race.fits.get(self.key, expansion))

    def optimise_from_own_slopes(self) -> Fit:
        fit = self.race.fits[self.key]
        return self.optimise(replace(fit, jacobian=self.number_slopes(fit.v, fit.w, fit.mean)), fit.w)

    def evidence_at_mean(self, fit: Fit, beta: Floats) -> Fit:
        """The fit with the evidence at the mean that the model gives, not where linear rows would go."""
        now, tau = fit.evidence.solution, float(np.exp(fit.scales[len(self.race.blocks)]))
        there = self.race.misfit(fit, fit.mean, fit.v) + float(beta @ beta) / tau**2
        short = max(0.0, there - float(now.rows.y @ now.whitened[0]) - SLACK)
        return replace(fit, evidence=replace(fit.evidence, log_evidence=fit.log_evidence - 0.5 * short))

    def newton_step(self, fit: Fit, beta: Floats) -> tuple[Floats, Floats, float]:
        """Steps of the numbers and of the coefficients to the best of the linear model, and tau of these."""
        now = fit.evidence.solution
        steps = now.rows.block == len(self.race.blocks)
        tau = float(np.exp(fit.scales[len(self.race.blocks)]))
        turn = tau * now.centre[steps] - beta
        turn *= min(1.0, LARGEST_STEP / max(float(np.max(np.abs(self.factors @ turn))), 1e-12))
        return np.clip(fit.linear_target - fit.v, -FAR, FAR), turn, tau

    def number_slopes(self, v: Floats, w: Floats, mean: Floats) -> Floats:
        """Slopes (n, p) of the mean along the numbers."""
        return self.race.model.jacobian(self.names, v, mean, self.key.doses_of(w))


def all_dosings(race: Race, kernels: Mapping[str, Floats]) -> list[Dosing]:
    """Every mechanism with every kernel L of a condition."""
    places = race.prepared.problem.mechanisms
    share = prior(race, Hypothesis((), (places[0].name,)), race.priors) / (len(places) * len(kernels))
    return [Dosing(race, (each,), log(share), *kernel) for each in places for kernel in kernels.items()]


def dosing_of_fit(race: Race, fit: Fit, factor: Floats) -> Dosing:
    places = {each.name: each for each in race.prepared.problem.mechanisms}
    acting, h = tuple(places[name] for name in fit.hypothesis.extra), fit.hypothesis
    return Dosing(race, acting, fit.log_prior, h.along, factor, h.names)


def fit_all_mechanisms(race: Race) -> None:
    """Every mechanism with every kernel; the likeliest from slopes at their own numbers.

    They start at the prior mean of the numbers: calibrated ones have taken what a dose explains.
    """
    kernels = dose_factors(race.prepared.rows, np.ones(race.prepared.rows.size, dtype=np.bool_))
    v = np.zeros(race.model.count)
    mean = race.model.predict_mean((), v)
    start = replace(race.bare, v=v, mean=mean, jacobian=race.model.jacobian((), v, mean))
    every = all_dosings(race, kernels)
    for each in every:
        each.optimise(start, start.w)
    for one in sorted(every, key=lambda one: -log_joint(race.fits[one.key]))[: 2 * CARRIED]:
        one.optimise_from_own_slopes()
    restart_likeliest_mechanisms(race, start, every)
    add_second_cause(race, every)


def restart_likeliest_mechanisms(race: Race, usual: Fit, every: Sequence[Dosing]) -> None:
    """Mechanisms along the condition of the likeliest explanation from more starts, as no step crosses 0.

    They are its numbers and doses, and the `usual` numbers with the middle of the range on either side of 0.
    """
    best = max([fit for h, fit in race.fits.items() if {*h.extra} - {EACH_SET_UP}], key=log_joint)
    count, zero = race.model.count, usual.w
    start = replace(usual, v=best.v[:count], jacobian=best.jacobian[:, :count])
    for one in [each for each in every if each.axis == (best.hypothesis.along or "all")]:
        one.optimise(start, best.w[: zero.size])
        for end in filter(None, one.dose_range_on_axis[:, 0]):
            one.optimise(usual, zero + 0.5 * end)
        if not one.is_hopeless(race.fits[one.key]):
            one.optimise_from_own_slopes()


def pairs_with_mechanism(race: Race, one: Dosing, fit: Fit, others: Sequence[Dosing]) -> Iterator[Seen]:
    """A likely mechanism with each listed effect, and with other mechanisms along the same condition."""
    for name in race.model.candidates:
        if (start := race.add_effect(fit, name, fit.log_prior)) is not None:
            yield replace(one, names=(name,)), start, fit.w
    for other in others:
        if other.axis == one.axis:
            pair, w = (*one.mechanisms, *other.mechanisms), np.append(fit.w, 0.0 * fit.w)
            yield replace(one, mechanisms=pair, log_prior=one.log_prior + log(2.0)), fit, w


def add_second_cause(race: Race, every: Sequence[Dosing]) -> None:
    """A second cause beside likely mechanisms and effects, seen from afar; what may be likely is followed."""
    share = race.posterior_probabilities()
    ranking, runs = sorted(every, key=lambda one: -share[one.key]), list[Seen]()
    others, count = ranking, len(race.prepared.problem.mechanisms)
    for _ in range(min(2, count)):
        one, others = others[0], [other for other in others if other.mechanisms != others[0].mechanisms]
        runs += pairs_with_mechanism(race, one, race.fits[one.key], others)
    for fit in sorted(race.effect_sets(1), key=log_joint, reverse=True)[:2]:
        some = ranking[: len(ranking) // 2]
        runs += [(replace(one, names=fit.hypothesis.names), fit, 0.0 * fit.mean) for one in some]
    more = log(race.priors.step / max(len(race.model.candidates) + count - 1, 1))
    fits = []
    for one, start, w in runs:
        dosing = replace(one, log_prior=one.log_prior + more)
        beta = Doses(w, w, dosing.factors).coefficients
        fits.append((dosing, dosing.fit_about(start, beta, w, None, FIRST), w))
    least = max(map(log_joint, race.fits.values())) + log(KEEP)
    for one, expansion, w in sorted(fits, key=lambda each: -log_joint(each[1]))[:CARRIED]:
        if log_joint(expansion) > least:
            one.optimise(expansion, w)
