"""Gauss-Newton searches for the best doses of one path, for many priors and amplitudes side by side.

All searches of a batch have one array operation a step; factors of fewer columns are filled up with zeros,
whose coefficients stay at 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import Working, working
from taichi_erosion.evidence.data.problem import Bools, Floats, Integers
from taichi_erosion.evidence.inference.doses.dose_path import DosePath
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

SLACK = 1e-3  # variance of doses at which a prior takes over those of another one
HALVINGS = 6  # of one step
ENOUGH = 1e-3  # fall of the misfit below which no further step is made [1]
MOST_ENTRIES = 2_000_000  # of the columns of a batch: 16 MB


@dataclass(frozen=True)
class ConditionSets:
    """Sets of equal conditions; rows of all observables of one set share one dose."""

    index: Integers  # (n,), set of each row
    first: Integers  # (j,), a row of each set

    @property
    def size(self) -> int:
        return int(self.first.size)


@dataclass(frozen=True)
class DosePrior:
    """Factor L of the prior covariance of the doses at amplitude 1, over one condition or all."""

    axis: str
    length: float
    factor: Floats  # (j, r)


@dataclass(frozen=True)
class DoseFit:
    """Best doses at one prior and amplitude, and the linear model about them."""

    prior: DosePrior
    amplitude: float
    doses: Floats  # (j,)
    theta: Floats  # (p + q + r,), calibrated numbers, shared errors, coefficients of the doses
    work: Working  # residual of the rows at the best fit
    columns: Floats  # (n, p + q + r), whitened B
    pseudo: Floats  # (n,), whitened y
    log_evidence: Floats  # per noise factor
    misfit: float  # |residual|^2 plus priors

    @property
    def others(self) -> int:
        """Number of calibrated numbers and shared errors, whose columns come before those of the doses."""
        return self.theta.size - self.prior.factor.shape[1]

    @property
    def chosen(self) -> tuple[str, float, float]:
        """Condition and length of the kernel, and the amplitude."""
        return self.prior.axis, self.prior.length, self.amplitude

    @cached_property
    def covariance(self) -> Floats:
        """Covariance of the doses (j, j), calibrated numbers and shared errors integrated out."""
        inverse = np.linalg.inv(self.columns.T @ self.columns + np.eye(self.theta.size))
        factor = self.amplitude * self.prior.factor
        return factor @ inverse[self.others :, self.others :] @ factor.T


@dataclass(frozen=True)
class DoseStates:
    """Rows at the doses and calibrated numbers of k searches."""

    residual: Floats  # (k, n), working residual
    weight: Floats  # (k, n)
    deviance: Floats  # (k,)
    jacobian: Floats  # (k, n, p), of the mean along the calibrated numbers
    slope: Floats  # (k, n), of the mean along the dose
    misfit: Floats  # (k,), deviance plus priors

    def only(self, chosen: Integers | Bools) -> "DoseStates":
        """Some of the searches."""
        return DoseStates(*(getattr(self, each.name)[chosen] for each in fields(self)))

    def with_others(self, chosen: Integers, others: "DoseStates") -> "DoseStates":
        """The same with other states of some searches."""
        if chosen.size == self.misfit.size:
            return others
        columns = []
        for each in fields(self):
            column = getattr(self, each.name).copy()
            column[chosen] = getattr(others, each.name)
            columns.append(column)
        return DoseStates(*columns)


@dataclass(frozen=True)
class DoseSearches:
    """Gauss-Newton searches for the best doses of one path, each with a prior and an amplitude."""

    prepared: PreparedProblem
    path: DosePath
    sets: ConditionSets
    priors: tuple[DosePrior, ...]
    amplitudes: Floats  # (k,)
    factors: Floats  # (k, j, r), amplitude times the factor of the prior

    @property
    def size(self) -> int:
        return int(self.amplitudes.size)

    def only(self, chosen: Integers) -> "DoseSearches":
        """Some of the searches."""
        if chosen.size == self.size:
            return self
        return replace(
            self,
            priors=tuple(self.priors[k] for k in chosen),
            amplitudes=self.amplitudes[chosen],
            factors=self.factors[chosen],
        )

    @cached_property
    def origin(self) -> Floats:
        """Calibrated numbers of the path, and no shared errors."""
        return np.concatenate([self.path.x, np.zeros(self.prepared.rows.shared.shape[1])])

    def start(self) -> Floats:
        """The bare model with the calibrated numbers of the path, for every search (k, p + q + r)."""
        theta = np.concatenate([self.origin, np.zeros(self.factors.shape[2])])
        return np.repeat(theta[np.newaxis], self.size, axis=0)

    def beside(self, fits: Sequence[DoseFit]) -> Floats:
        """[x, s, f] with the doses of another fit for each search, as well as its prior has them."""
        heads = np.array([self.head(fit) for fit in fits])
        doses = np.array([fit.doses for fit in fits])
        turned = np.swapaxes(self.factors, 1, 2)
        matrix = turned @ self.factors + SLACK * np.eye(self.factors.shape[2])
        near = np.linalg.solve(matrix, turned @ doses[:, :, np.newaxis])[:, :, 0]
        return np.asarray(np.hstack([heads, near]), dtype=np.float64)

    def head(self, fit: DoseFit) -> Floats:
        """Calibrated numbers and shared errors of another fit; no such errors where they are others."""
        start = self.origin.copy()
        if fit.others == start.size:
            return fit.theta[: start.size]
        start[: self.path.x.size] = fit.theta[: self.path.x.size]
        return start

    def states(self, theta: Floats) -> DoseStates:
        """The rows at [x, s, f] of every search."""
        rows, numbers, count = self.prepared.rows, self.path.x.size, self.origin.size
        dose = (self.factors @ theta[:, count:, np.newaxis])[:, self.sets.index, 0]
        change, slope = self.path.change(dose)
        jacobian, bend = self.path.slopes(dose)
        away = theta[:, :count] - self.origin
        moved = (jacobian @ away[:, :numbers, np.newaxis])[:, :, 0] + away[:, numbers:] @ rows.shared.T
        slope = slope + (bend @ away[:, :numbers, np.newaxis])[:, :, 0]
        gap = rows.z - (self.path.bare + moved + change)
        work = working(self.prepared.white(gap.T), self.prepared.white_reach)
        misfit = work.deviances + np.sum(theta**2, axis=1)
        return DoseStates(work.residual.T, work.weight.T, work.deviances, jacobian, slope, misfit)

    def columns(self, states: DoseStates) -> Floats:
        """Whitened columns B of the linear models (k, n, p + q + r)."""
        white = replace(self.prepared.white, weight=states.weight)
        doses = self.factors[:, self.sets.index] * states.slope[:, :, np.newaxis]
        shared = np.broadcast_to(self.prepared.rows.shared, (self.size, *self.prepared.rows.shared.shape))
        return white(np.concatenate([states.jacobian, shared, doses], axis=2))

    def run(self, theta: Floats, steps: int) -> Floats:
        """Best [x, s, f] from a start each."""
        theta = theta.copy()
        for part in self.parts():
            theta[part] = self.only(part).descended(theta[part], steps)
        return theta

    def descended(self, theta: Floats, steps: int) -> Floats:
        """The same of one batch."""
        theta, states, going = theta.copy(), self.states(theta), np.arange(self.size)
        for _ in range(steps):
            before = states.misfit
            theta[going], states = self.only(going).step(theta[going], states)
            still = before - states.misfit >= ENOUGH
            going, states = going[still], states.only(still)
            if not going.size:
                break
        return theta

    def parts(self) -> list[Integers]:
        """Searches in batches of bounded size."""
        entries = self.prepared.rows.size * (self.origin.size + self.factors.shape[2])
        most = max(MOST_ENTRIES // max(entries, 1), 1)
        return [np.arange(first, min(first + most, self.size)) for first in range(0, self.size, most)]

    def step(self, theta: Floats, states: DoseStates) -> tuple[Floats, DoseStates]:
        """One step of every search, halved until the misfit falls, and the states there."""
        columns = self.columns(states)
        turned = np.swapaxes(columns, 1, 2)
        gradient = (turned @ states.residual[:, :, np.newaxis])[:, :, 0] - theta
        matrix = turned @ columns + np.eye(theta.shape[1])
        step = np.linalg.solve(matrix, gradient[:, :, np.newaxis])[:, :, 0]
        theta, left = theta.copy(), np.arange(self.size)
        for _ in range(HALVINGS):
            tried = theta[left] + step[left]
            there = self.only(left).states(tried)
            better = there.misfit < states.misfit[left]
            theta[left[better]] = tried[better]
            states = states.with_others(left[better], there.only(better))
            left = left[~better]
            if not left.size:
                break
            step[left] *= 0.5
        return theta, states

    def fits(self, theta: Floats) -> list[DoseFit]:
        """The linear model about [x, s, f] of every search, and its evidence."""
        found = list[DoseFit]()
        for part in self.parts():
            found += self.only(part).batch_fits(theta[part])
        return found

    def batch_fits(self, theta: Floats) -> list[DoseFit]:
        """The same of one batch."""
        states = self.states(theta)
        columns = self.columns(states)
        pseudo = states.residual + (columns @ theta[:, :, np.newaxis])[:, :, 0]
        evidence = gaussian_log_evidence(columns, pseudo, self.prepared.doubt.factor)
        doses, found = (self.factors @ theta[:, self.origin.size :, np.newaxis])[:, :, 0], list[DoseFit]()
        for k, prior in enumerate(self.priors):
            size = self.origin.size + prior.factor.shape[1]
            work = Working(states.residual[k], states.weight[k], states.deviance[k])
            log_evidence = evidence[k] + censored_part(work, self.prepared)
            linear = (columns[k, :, :size], pseudo[k], log_evidence, float(states.misfit[k]))
            fit = DoseFit(prior, float(self.amplitudes[k]), doses[k], theta[k, :size], work, *linear)
            found.append(fit)
        return found


def dose_searches(
    prepared: PreparedProblem, path: DosePath, sets: ConditionSets, asked: Sequence[tuple[DosePrior, float]]
) -> DoseSearches:
    """Searches with some priors and amplitudes."""
    rank = max(prior.factor.shape[1] for prior, _ in asked)
    factors = np.zeros((len(asked), sets.size, rank))
    for k, (prior, amplitude) in enumerate(asked):
        factors[k, :, : prior.factor.shape[1]] = amplitude * prior.factor
    amplitudes = np.array([amplitude for _, amplitude in asked])
    return DoseSearches(prepared, path, sets, tuple(prior for prior, _ in asked), amplitudes, factors)


def gaussian_log_evidence(columns: Floats, pseudo: Floats, factors: Floats) -> Floats:
    """Ln N(y; 0, f^2 + B B^T) without ln 2 pi for columns (..., n, m), for every noise factor f (..., f)."""
    turned = np.swapaxes(columns, -1, -2)
    values, vectors = np.linalg.eigh(turned @ columns)
    parts = (np.swapaxes(vectors, -1, -2) @ (turned @ pseudo[..., np.newaxis]))[..., 0] ** 2
    noise = factors[:, np.newaxis] ** 2
    total = noise + np.maximum(values, 0.0)[..., np.newaxis, :]
    squares = np.sum(pseudo**2, axis=-1)[..., np.newaxis]
    squares = (squares - np.sum(parts[..., np.newaxis, :] / total, axis=-1)) / noise[:, 0]
    free = pseudo.shape[-1] * np.log(noise[:, 0])
    return np.asarray(-0.5 * (np.sum(np.log(total / noise), axis=-1) + free + squares))


def censored_part(work: Working, prepared: PreparedProblem) -> float:
    """Ln likelihood of censored rows beyond that of the ordinary rows that stand for them."""
    if not prepared.rows.censored.any():
        return 0.0
    return -0.5 * (work.deviance - float(work.residual @ work.residual))
