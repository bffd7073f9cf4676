"""Mechanisms: one dose for every set of conditions.

    z = m(v, w) + F u + e,   w = tau L s,   s ~ N(0, 1),   L L^T = k(conditions) + 1/4

with w = ln(1 + dose) above 0 and the dose itself below. About doses w the rows are linear in s, so that the
doses are one more block of the race with columns (dm/dw) L, shared by all observables. Each kernel k, along
one condition or all, is a hypothesis of its own. Every row is simulated at its own dose: that costs as many
runs as any other setting.

Reference: Rasmussen & Williams (2006), Gaussian Processes, 3.4 (Gauss-Newton steps of a latent function).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import log

import numpy as np

from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.race.blocks import Block, dose_columns
from taichi_erosion.evidence.race.fit import FAR, SHARES, SLACK, Doses, Fit, Hypothesis, Race
from taichi_erosion.evidence.race.linear_evidence import scale
from taichi_erosion.evidence.race.priors import CARRIED, DOSE
from taichi_erosion.evidence.race.search import log_prior_mechanism

LEAST_DOSE = -0.95  # a place that is almost switched off
LARGEST_STEP, STILL = 0.7, 0.02  # of w
FIRST, THEN = 4, 14  # steps with the scales at their priors, so that no level takes what a dose does; all


def to_axis(dose: Floats) -> Floats:
    """Doses on their axis."""
    return np.where(dose > 0.0, np.log1p(np.maximum(dose, 0.0)), dose)


def from_axis(w: Floats) -> Floats:
    """Doses of places on that axis."""
    return np.where(w > 0.0, np.expm1(np.maximum(w, 0.0)), w)


@dataclass(frozen=True)
class Dosing:
    """A mechanism with one kernel of its doses."""

    race: Race
    name: str
    ends: Floats  # (2,), range of its doses on their axis
    log_prior: float
    axis: str  # condition along which the doses vary
    factor: Floats  # (n, r), L of the kernel

    @property
    def hypothesis(self) -> Hypothesis:
        """Its key in the race."""
        return Hypothesis((), f"{self.name}|{self.axis}")

    def holds(self, w: Floats) -> bool:
        """Whether all doses, on their axis, lie in the range of the mechanism."""
        return bool(np.all((self.ends[0] - STILL < w) & (w < self.ends[1] + STILL)))

    def within(self, beta: Floats) -> Floats:
        """Coefficients whose doses are nearest to those of some within the range."""
        w = self.factor @ beta
        return beta + Doses(np.clip(w, *self.ends) - w, w, self.factor).coefficients

    def at(self, v: Floats, w: Floats) -> tuple[Floats, Floats]:
        """Doses on their axis within the range, and the mean (n,) there."""
        held = np.round(np.clip(w, *self.ends), 3)
        return held, self.race.model.dosed(v, self.name, from_axis(held))

    def slope(self, v: Floats, w: Floats, mean: Floats) -> Floats:
        """Slope (n,) of the mean along w."""
        h = np.where(w > np.mean(self.ends), -0.05, 0.05)
        return np.nan_to_num((self.at(v, w + h)[1] - mean) / h)

    def expanded(self, at: Fit, beta: Floats, w: Floats, u: Floats | None, steps: int) -> Fit:
        """The race's rows about numbers, doses w and their coefficients."""
        slope = self.slope(at.v, w, at.mean)
        block = Block("dose", "", slope[:, np.newaxis] * self.factor, scale("dose", cauchy=DOSE))
        return self.race.solved(
            replace(
                at,
                hypothesis=self.hypothesis,
                blocks=(*self.race.blocks, block),
                dose=Doses(self.factor @ beta, slope, self.factor),
                log_prior=self.log_prior,
            ),
            steps,
            u,
        )

    def fitted(self, start: Fit, w: Floats) -> Fit:
        """Numbers and doses by Gauss-Newton steps from some, none of which raises the misfit."""
        beta, u = Doses(w, w, self.factor).coefficients, None
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
                v, tried = fit.v + share * change, self.within(beta + share * turn)
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
        fit = replace(fit, errors=self.race.model.errors((), fit.v, {self.name: from_axis(w)}))
        found = self.arrived(self.expanded(fit, beta, w, u, 8), beta)
        return self.race.better(found, self.race.fits.get(self.hypothesis, found))

    def arrived(self, fit: Fit, beta: Floats) -> Fit:
        """The fit with the evidence at the mean that the model gives, not where linear rows would go."""
        now, tau = fit.evidence.solved, float(np.exp(fit.scales[len(self.race.blocks)]))
        there = self.race.misfit(fit, fit.mean, fit.v) + float(beta @ beta) / tau**2
        short = max(0.0, there - float(now.rows.y @ now.precision[0]) - SLACK)
        evidence = replace(fit.evidence, log_evidence=fit.log_evidence - 0.5 * short)
        return replace(fit, evidence=evidence)

    def steps_of(self, fit: Fit, beta: Floats) -> tuple[Floats, Floats, float]:
        """Steps of the numbers and of the coefficients to the best of the linear model, and tau of these."""
        now = fit.evidence.solved
        own = now.rows.block == len(self.race.blocks)
        tau = float(np.exp(fit.scales[len(self.race.blocks)]))
        turn = tau * now.centre[own] - beta
        turn *= min(1.0, LARGEST_STEP / max(float(np.max(np.abs(self.factor @ turn))), 1e-12))
        return np.clip(fit.target - fit.v, -FAR, FAR), turn, tau

    def slopes(self, v: Floats, w: Floats, mean: Floats) -> Floats:
        """Slopes (n, p) of the mean along the numbers, by differences towards the prior."""
        steps = np.diag(np.where(v > 0.0, -0.1, 0.1))
        columns = [((self.at(v + h, w)[1] - mean) / h.sum())[:, np.newaxis] for h in steps]
        return np.nan_to_num(np.hstack([np.zeros((w.size, 0)), *columns]))


def dosings(race: Race, kernels: Mapping[str, Floats]) -> list[Dosing]:
    """Every mechanism with every kernel L of a condition."""
    return [
        Dosing(
            race,
            each.name,
            to_axis(np.array([max(each.low, LEAST_DOSE), each.high])),
            log_prior_mechanism(race) - log(len(kernels)),
            axis,
            factor,
        )
        for each in race.prepared.problem.mechanisms
        for axis, factor in kernels.items()
    ]


def add_doses(race: Race) -> None:
    """Every mechanism with every kernel; the likeliest from slopes at their own numbers.

    They start at the prior mean of the numbers: calibrated ones have taken what a dose explains.
    """
    kernels = dose_columns(race.prepared.rows, np.ones(race.prepared.rows.size, dtype=np.bool_))
    v = np.zeros(race.model.count)
    mean = race.model.mean((), v)
    start = replace(race.bare, v=v, mean=mean, jacobian=race.model.jacobian((), v, mean))
    every = dosings(race, kernels)
    for each in every:
        each.fitted(start, start.w)
    share = race.posterior()
    total = {one.name: sum(p for h, p in share.items() if h.kind == one.name) for one in every}
    for name in sorted(total, key=lambda name: -total[name])[:CARRIED]:
        own = [one for one in every if one.name == name]
        for one in sorted(own, key=lambda one: -share[one.hypothesis])[:2]:
            seen = race.fits[one.hypothesis]
            slopes = one.slopes(seen.v, seen.w, seen.mean)
            fit = one.fitted(replace(seen, jacobian=slopes), seen.w)
            if one.ends[0] < 0.0:  # the other side of 0, which no step crosses to
                one.fitted(start, -0.5 * fit.w)
