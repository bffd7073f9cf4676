"""Mechanisms, and listed effects whose strength varies: one dose for every set of conditions.

    z = m(v, 0) + c(w),   w = ln(1 + dose) = tau L s,   s ~ N(0, 1),   L L^T = k(conditions) + 1/4

c, the change of each row along the dose, is computed at a few doses and interpolated; about the best doses the
rows are linear in s, so that the doses are one more block of the race with columns c'(w) L, shared by all
observables. Each kernel k, along one condition or all, is a hypothesis of its own.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log

import numpy as np

from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.race.blocks import Block, dose_columns
from taichi_erosion.evidence.race.expansion import RaceModel
from taichi_erosion.evidence.race.linear_evidence import scale
from taichi_erosion.evidence.race.priors import DOSE, KEEP, STEP
from taichi_erosion.evidence.race.search import SLACK, Doses, Fit, Hypothesis, Race, log_prior

LEAST_DOSE = -0.95  # a place that is almost switched off
STEP_W = 0.05  # of w, for a slope
LARGEST_STEP, STILL = 0.7, 0.02  # of w
FIRST = 4  # steps with the scales at their priors, so that no level takes what a dose explains
CARRIED = 4  # kernels with which a mechanism is fitted anew about its own numbers


def to_axis(dose: float) -> float:
    """A dose on its axis: ln(1 + dose) above 0, the dose itself below."""
    return float(np.log1p(dose)) if dose > 0.0 else dose


def from_axis(w: float) -> float:
    """The dose of a place on that axis."""
    return float(np.expm1(w)) if w > 0.0 else float(w)


def with_dose(race: Race, parent: Fit, each: "Doser", hypothesis: Hypothesis, factor: Floats, steps: int) -> Fit:
    """Numbers and doses of one mechanism with one kernel: Gauss-Newton steps, none of which raises the misfit."""
    model, v, beta = race.model, parent.v, np.zeros(factor.shape[1])
    if parent.dose is not None:
        beta = np.linalg.lstsq(factor, parent.dose.w, rcond=None)[0]
    jacobian, u, fit = parent.jacobian, None, parent
    w, mean = each.at(race, v, factor @ beta)
    for k in range(steps):
        h = np.where(w > 0.5 * each.top, -STEP_W, STEP_W)
        slope = np.nan_to_num((each.at(race, v, w + h)[1] - mean) / h)
        block = Block("dose", "", slope[:, np.newaxis] * factor, (), scale("dose", cauchy=DOSE))
        doses = Doses(factor @ beta, slope, factor, hypothesis.beyond.rpartition("|")[2])
        fit = replace(
            parent, hypothesis=hypothesis, v=v, mean=mean, jacobian=jacobian, dose=doses,
            blocks=(*race.blocks, block), log_prior=each.prior,
        )
        fit = race.solved(fit, 0 if k < FIRST else 4, u)
        now = fit.evidence.solved
        u, own = now.u, now.rows.block == len(race.blocks)
        tau = float(np.exp(u[len(race.blocks)]))
        step, turn = np.clip(fit.target - v, -1.5, 1.5), tau * now.centre[own] - beta
        turn *= min(1.0, LARGEST_STEP / max(float(np.max(np.abs(factor @ turn))), 1e-12))
        if np.max(np.abs(step), initial=0.0) < 0.05 and np.max(np.abs(factor @ turn)) < STILL and k >= FIRST:
            break
        before = race.misfit(fit, mean, v) + float(beta @ beta) / tau**2
        for share in (1.0, 0.4, 0.16, 0.06):
            tried = beta + share * turn
            there, value = each.at(race, v + share * step, factor @ tried)
            if np.all(np.isfinite(value)):
                after = race.misfit(fit, value, v + share * step) + float(tried @ tried) / tau**2
                if after < before + 0.1 * SLACK:
                    break
        else:
            break
        gone = share * step
        if np.max(np.abs(gone), initial=0.0) > 0.1:
            linear = mean + slope * (there - w)
            jacobian = jacobian + np.outer(value - linear - jacobian @ gone, gone) / (gone @ gone)
        v, beta, w, mean = v + gone, tried, there, value
    return race.solved(fit, 8, u)


@dataclass(frozen=True)
class Doser:
    """A mechanism or a listed effect, and the range of its dose."""

    name: str
    low: float
    high: float
    prior: float  # ln probability

    @property
    def top(self) -> float:
        return to_axis(self.high)

    def at(self, race: Race, v: Floats, w: Floats) -> tuple[Floats, Floats]:
        """Doses on their axis within the range, and the mean (n,) there."""
        held = np.round(np.clip(w, to_axis(self.low), self.top), 3)
        return held, race.model.dosed(v, self.name, np.where(held > 0.0, np.expm1(np.maximum(held, 0.0)), held))


def dosers(race: Race) -> list[Doser]:
    """Mechanisms share what no list holds; a strength that varies is one step less likely than one that does not."""
    mechanisms, model = race.prepared.problem.mechanisms, race.model
    found = [Doser(m.name, max(m.low, LEAST_DOSE), m.high, race.log_prior_mechanism) for m in mechanisms]
    for name in model.candidates:
        single = race.fits.get(Hypothesis((name,)))
        if single is None or single.log_evidence < race.fits[Hypothesis(())].log_evidence:
            continue  # what explains nothing with one strength is not tried with several
        prior = log_prior(Hypothesis((name,)), len(model.candidates)) + 2.0 * log(STEP)
        found.append(Doser(name, 0.0, model.largest(name), prior))
    return found


def add_doses(race: Race) -> None:
    """Every mechanism and every varying strength as hypotheses of the race.

    All of them with long kernels along each condition, then the likeliest with every kernel, with slopes at
    their own numbers and doses.
    """
    bare, kernels = at_start(race), dose_columns(race.prepared.rows)
    if not kernels:
        return
    for each in dosers(race):
        own = replace(each, prior=each.prior - log(max(len(kernels), 1)))
        for k in range(len(kernels)):
            race.kept(with_dose(race, bare, own, hypothesis_of(each, k, kernels), kernels[k][1], 8))
    share = race.posterior()
    for each in sorted(dosers(race), key=lambda each: -share_of(share, each.name))[:CARRIED]:
        settle(race, replace(each, prior=each.prior - log(len(kernels))), kernels)


def at_start(race: Race) -> Fit:
    """The bare model at the prior mean of its numbers: the calibrated ones have taken what a dose explains."""
    bare = race.fits[Hypothesis(())]
    v = np.zeros(race.model.count)
    mean = race.model.mean((), v)
    return replace(bare, v=v, mean=mean, jacobian=race.model.jacobian((), v, mean))


def share_of(share: dict[Hypothesis, float], name: str) -> float:
    """Probability of a mechanism with any kernel."""
    return sum(p for hypothesis, p in share.items() if hypothesis.beyond.partition("|")[0] == name)


def hypothesis_of(each: Doser, k: int, kernels: Sequence[tuple[str, Floats]]) -> Hypothesis:
    """A mechanism with one kernel."""
    return Hypothesis((), f"{each.name}|{k}|{kernels[k][0]}")


def settle(race: Race, each: Doser, kernels: Sequence[tuple[str, Floats]]) -> None:
    """A likely mechanism with its two best kernels, from slopes at its best fit."""
    share = race.posterior()
    for k in sorted(range(len(kernels)), key=lambda k: -share[hypothesis_of(each, k, kernels)])[:2]:
        fit = race.fits[hypothesis_of(each, k, kernels)]
        columns = []
        for j in range(fit.v.size):
            h = np.zeros(fit.v.size)
            h[j] = -0.1 if fit.v[j] > 0.0 else 0.1
            columns.append((each.at(race, fit.v + h, fit.dose.w)[1] - fit.mean) / h[j])
        jacobian = np.nan_to_num(np.column_stack(columns)) if columns else fit.jacobian
        race.kept(with_dose(race, replace(fit, jacobian=jacobian), each, fit.hypothesis, kernels[k][1], 14))
