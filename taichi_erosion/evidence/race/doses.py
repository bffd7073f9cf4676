"""Mechanisms, and listed effects whose strength varies: one dose for every set of conditions.

    z = m(v, w) + F u + e,   w = tau L s,   s ~ N(0, 1),   L L^T = k(conditions) + 1/4

with w = ln(1 + dose) above 0 and the dose itself below. About doses w the rows are linear in s, so that the
doses are one more block of the race with columns (dm/dw) L, shared by all observables. Each kernel k, along
one condition or all, is a hypothesis of its own. Every row is simulated at its own dose: that costs as many
runs as any other setting.

Reference: Rasmussen & Williams (2006), Gaussian Processes, 3.4 (Gauss-Newton steps of a latent function).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import log
from typing import Any

import numpy as np

from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.race.blocks import Block, dose_columns
from taichi_erosion.evidence.race.fit import FAR, SHARES, SLACK, Doses, Fit, Hypothesis, Race
from taichi_erosion.evidence.race.linear_evidence import scale
from taichi_erosion.evidence.race.priors import CARRIED, DOSE, STEP
from taichi_erosion.evidence.race.search import log_prior_mechanism

LEAST_DOSE = -0.95  # a place that is almost switched off
LARGEST_STEP, STILL = 0.7, 0.02  # of w
FIRST, THEN = 4, 14  # steps with the scales at their priors, so that no level takes what a dose does; all

Kernels = Sequence[tuple[str, Floats]]  # condition, L (n, r)


def to_axis(dose: float) -> float:
    """A dose on its axis."""
    return float(np.log1p(dose)) if dose > 0.0 else dose


def from_axis(w: Floats) -> Floats:
    """Doses of places on that axis."""
    return np.where(w > 0.0, np.expm1(np.maximum(w, 0.0)), w)


@dataclass(frozen=True)
class Dosing:
    """A mechanism, or an effect of varying strength, with one kernel of its doses."""

    race: Race
    name: str
    low: float
    high: float
    prior: float  # ln probability of all its kernels together
    kernels: Kernels
    k: int = 0

    @property
    def hypothesis(self) -> Hypothesis:
        """Its key in the race."""
        return Hypothesis((), f"{self.name}|{self.k}|{self.kernels[self.k][0]}")

    @property
    def factor(self) -> Floats:
        """Factor L (n, r)."""
        return self.kernels[self.k][1]

    @cached_property
    def ends(self) -> tuple[float, float]:
        """Range of its doses on their axis."""
        return to_axis(self.low), to_axis(self.high)

    def with_kernel(self, k: int) -> "Dosing":
        """The same with another kernel."""
        return replace(self, k=k)

    def at(self, v: Floats, w: Floats) -> tuple[Floats, Floats]:
        """Doses on their axis within the range, and the mean (n,) there."""
        held = np.round(np.clip(w, *self.ends), 3)
        return held, self.race.model.dosed(v, self.name, from_axis(held))

    def slope(self, v: Floats, w: Floats, mean: Floats) -> Floats:
        """Slope (n,) of the mean along w."""
        h = np.where(w > np.mean(self.ends), -0.05, 0.05)
        return np.nan_to_num((self.at(v, w + h)[1] - mean) / h)

    def expanded(self, at: Fit, beta: Any, w: Floats, u: Floats | None, steps: int) -> Fit:
        """The race's rows about numbers, doses w and their coefficients."""
        slope = self.slope(at.v, w, at.mean)
        block = Block("dose", "", slope[:, np.newaxis] * self.factor, (), scale("dose", cauchy=DOSE))
        return self.race.solved(
            replace(
                at,
                hypothesis=self.hypothesis,
                blocks=(*self.race.blocks, block),
                dose=Doses(self.factor @ beta, slope, self.factor, self.kernels[self.k][0]),
                log_prior=self.prior - log(len(self.kernels)),
            ),
            steps,
            u,
        )

    def fitted(self, start: Fit) -> Fit:
        """Numbers and doses by Gauss-Newton steps, none of which raises the misfit."""
        beta: Any = np.zeros(self.factor.shape[1])
        u = None
        if start.dose is not None:
            beta = np.linalg.lstsq(self.factor, start.dose.w, rcond=None)[0]
        w, mean = self.at(start.v, self.factor @ beta)
        fit = replace(start, mean=mean)
        for step in range(THEN):
            fit = self.expanded(fit, beta, w, u, 0 if step < FIRST else 4)
            u, change, turn, tau = fit.scales, *self.steps_of(fit, beta)
            small = np.max(np.abs(change), initial=0.0) < 0.05 and np.max(np.abs(self.factor @ turn)) < STILL
            if small and step >= FIRST:
                break
            before = self.race.misfit(fit, fit.mean, fit.v) + float(beta @ beta) / tau**2
            for share in SHARES:
                v, tried = fit.v + share * change, beta + share * turn
                there, mean = self.at(v, self.factor @ tried)
                after = self.race.misfit(fit, np.nan_to_num(mean, nan=1e6), v) + float(tried @ tried) / tau**2
                if after < before + 0.1 * SLACK:
                    break
            else:
                break
            gone, jacobian = share * change, fit.jacobian
            if np.max(np.abs(gone), initial=0.0) > 0.1:
                linear = fit.mean + fit.dose.slope * (there - w) if fit.dose is not None else fit.mean
                jacobian = jacobian + np.outer(mean - linear - jacobian @ gone, gone) / (gone @ gone)
            fit, beta, w = replace(fit, v=v, mean=mean, jacobian=jacobian), tried, there
        found = self.expanded(fit, beta, w, u, 8)
        old = self.race.fits.get(self.hypothesis, found)
        return self.race.kept(max(found, old, key=lambda each: each.log_evidence))

    def steps_of(self, fit: Fit, beta: Floats) -> tuple[Floats, Floats, float]:
        """Steps of the numbers and of the coefficients to the best of the linear model, and tau of these."""
        now = fit.evidence.solved
        own = now.rows.block == len(self.race.blocks)
        tau = float(np.exp(fit.scales[len(self.race.blocks)]))
        turn = tau * now.centre[own] - beta
        turn *= min(1.0, LARGEST_STEP / max(float(np.max(np.abs(self.factor @ turn))), 1e-12))
        return np.clip(fit.target - fit.v, -FAR, FAR), turn, tau

    def with_slopes(self, fit: Fit) -> Fit:
        """The fit with slopes along its numbers at its doses."""
        columns = [np.zeros((fit.mean.size, 0))]
        for h in np.diag(np.where(fit.v > 0.0, -0.1, 0.1)):
            if fit.dose is not None:
                column = (self.at(fit.v + h, fit.dose.w)[1] - fit.mean) / h.sum()
                columns.append(np.nan_to_num(column)[:, np.newaxis])
        return replace(fit, jacobian=np.hstack(columns))


def dosings(race: Race, kernels: Kernels) -> list[Dosing]:
    """Every mechanism, and the effects that explain most alone, with another law of their strength."""
    found = [
        Dosing(race, m.name, max(m.low, LEAST_DOSE), m.high, log_prior_mechanism(race), kernels)
        for m in race.prepared.problem.mechanisms
    ]
    bare = race.fits[Hypothesis(())]
    singles = [fit for h, fit in race.fits.items() if len(h.names) == 1 and not h.beyond]
    better = [fit for fit in singles if fit.log_evidence > bare.log_evidence]
    for single in sorted(better, key=lambda fit: -fit.log_evidence)[:CARRIED]:
        (name,), prior = single.hypothesis.names, single.log_prior + 2.0 * log(STEP)
        found.append(Dosing(race, name, 0.0, race.model.largest(name), prior, kernels))
    return found


def add_doses(race: Race) -> None:
    """Every mechanism and varying strength with every kernel; the likeliest from slopes at their own numbers.

    They start at the prior mean of the numbers: calibrated ones have taken what a dose explains.
    """
    kernels = dose_columns(race.prepared.rows, np.ones(race.prepared.rows.size, dtype=np.bool_))
    if not kernels:
        return
    v = np.zeros(race.model.count)
    mean = race.model.mean((), v)
    start = replace(race.fits[Hypothesis(())], v=v, mean=mean, jacobian=race.model.jacobian((), v, mean))
    every = dosings(race, kernels)
    for each in every:
        for k in range(len(kernels)):
            each.with_kernel(k).fitted(start)
    share = race.posterior()

    def probability(each: Dosing) -> float:
        return sum(p for hypothesis, p in share.items() if hypothesis.kind == each.name)

    for each in sorted(every, key=probability, reverse=True)[:CARRIED]:
        own = sorted(map(each.with_kernel, range(len(kernels))), key=lambda one: -share[one.hypothesis])
        for one in own[:2]:
            fit = one.fitted(one.with_slopes(race.fits[one.hypothesis]))
            if one.low < 0.0 and fit.dose is not None:  # the other side of 0, which no step crosses to
                one.fitted(replace(start, dose=replace(fit.dose, w=-0.5 * fit.dose.w)))
