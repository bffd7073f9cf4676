"""Dose that each set of conditions asks for, with its marginal likelihood: one mechanism at a time.

    z_i = m_i(x) + c_i(psi_j(i)) + shared errors + noise,    psi = L f,    f ~ N(0, 1),    x ~ N(0, 1)

with m the bare model, linear in the calibrated numbers x about the setting of its path, c the change by the
mechanism, psi_j the dose of the set of conditions j, and L L^T = lambda^2 (K + 1/4) the covariance of a
Gaussian process over one condition, or all of them, with a level of its own. About its best doses the model
is linear, so that with whitened columns B = [J S C'L] and pseudo-data y

    ln Z = -1/2 ln |f^2 + B B^T| - 1/2 y^T (f^2 + B B^T)^-1 y

for every factor f of the noise: the exact marginal likelihood where c is linear in the dose. `curvature` says
how far it is from that.

Reference: Rasmussen & Williams (2006), Gaussian processes for machine learning, sections 2.7 and 5.4.
"""

from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import Working, log_sum_exp, working
from taichi_erosion.evidence.data.problem import Floats, Integers
from taichi_erosion.evidence.inference.doses.dose_path import DosePath
from taichi_erosion.evidence.inference.goodness_of_fit import quadratic_form_p
from taichi_erosion.evidence.inference.model_discrepancy import condition_axes, low_rank, squared_distance
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

LENGTHS = (0.7, 2.0)  # of the kernel, in sd of a condition
AMPLITUDES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # lambda, sd of the doses [1]
FIRST_AMPLITUDE = 1.0  # at which every kernel is tried first
LEVEL = 0.25  # variance of the level of the doses over that of their variation
ALL = ""  # name of the kernel over all conditions together
SLACK = 1e-3  # variance of doses at which a prior takes over those of another one
STEPS, FIRST_STEPS, BESIDE_STEPS = 30, 8, 3  # Gauss-Newton steps of the best fit, a first one, one beside it
HALVINGS = 6  # of one step
ENOUGH = 1e-3  # fall of the misfit below which no further step is made [1]


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
    covariance: Floats  # (j, j), of the doses, calibrated numbers and shared errors integrated out
    theta: Floats  # (p + q + r,), calibrated numbers, shared errors, coefficients of the doses
    work: Working  # residual of the rows at the best fit
    columns: Floats  # (n, p + q + r), whitened B
    pseudo: Floats  # (n,), whitened y
    log_evidence: Floats  # per noise factor
    misfit: float  # |residual|^2 plus priors


@dataclass(frozen=True)
class DoseEvidence:
    """What one mechanism explains, all priors of its doses together."""

    path: DosePath
    sets: ConditionSets
    best: DoseFit
    log_evidence: Floats  # per noise factor, averaged over kernels and amplitudes


def condition_sets(prepared: PreparedProblem) -> ConditionSets:
    """Sets of equal conditions among the rows."""
    columns = [np.nan_to_num(column) for column in prepared.rows.conditions.values()]
    table = np.column_stack(columns) if columns else np.zeros((prepared.rows.size, 1))
    _, first, index = np.unique(table, axis=0, return_index=True, return_inverse=True)
    return ConditionSets(index.reshape(-1), first)


def dose_priors(prepared: PreparedProblem, sets: ConditionSets) -> list[DosePrior]:
    """Priors along every condition that varies, and along all of them; a level alone where none varies."""
    axes = {name: values[sets.first] for name, values in condition_axes(prepared).items()}
    priors = []
    for length in LENGTHS:
        squares = {name: squared_distance(values, length) for name, values in axes.items()}
        if len(squares) > 1:
            squares[ALL] = np.sum(list(squares.values()), axis=0)
        for name, square in squares.items():
            priors.append(DosePrior(name, length, low_rank(np.exp(-0.5 * square) + LEVEL)))
    return priors or [DosePrior(ALL, LENGTHS[0], np.ones((sets.size, 1)))]


def bare_log_evidence(prepared: PreparedProblem, path: DosePath) -> Floats:
    """Ln Z without any dose, per noise factor, on the same linear model of the calibrated numbers."""
    columns = calibration_columns(prepared, path, np.ones(prepared.rows.size))
    residual = (prepared.rows.z - path.bare + path.jacobian @ path.x) / prepared.sd
    fitted = columns @ ridge(columns, residual)
    work = working(residual - fitted, prepared.rows.censored)
    columns = calibration_columns(prepared, path, work.weight)
    pseudo = work.residual + work.weight * fitted
    return gaussian_log_evidence(columns, pseudo, prepared.doubt.factor) + censored_part(work, prepared)


def calibration_columns(prepared: PreparedProblem, path: DosePath, weight: Floats) -> Floats:
    """Whitened columns of calibrated numbers and shared errors (n, p + q)."""
    scale = (weight / prepared.sd)[:, np.newaxis]
    return np.hstack([path.jacobian, prepared.rows.shared]) * scale


def gaussian_log_evidence(columns: Floats, pseudo: Floats, factors: Floats) -> Floats:
    """Ln N(y; 0, f^2 + B B^T) without ln 2 pi, for every noise factor f."""
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    parts = (left.T @ pseudo) ** 2
    rest = max(float(pseudo @ pseudo) - float(parts.sum()), 0.0)
    noise = factors[:, np.newaxis] ** 2
    total = noise + values**2
    free = pseudo.size - values.size
    logs = np.sum(np.log(total), axis=1) + free * np.log(noise[:, 0])
    return np.asarray(-0.5 * (logs + np.sum(parts / total, axis=1) + rest / noise[:, 0]))


def censored_part(work: Working, prepared: PreparedProblem) -> float:
    """Ln likelihood of censored rows beyond that of the ordinary rows that stand for them."""
    if not prepared.rows.censored.any():
        return 0.0
    return -0.5 * (work.deviance - float(work.residual @ work.residual))


def ridge(columns: Floats, residual: Floats) -> Floats:
    """Most likely coefficients with unit priors."""
    matrix = columns.T @ columns + np.eye(columns.shape[1])
    return np.asarray(np.linalg.solve(matrix, columns.T @ residual), dtype=np.float64)


@dataclass(frozen=True)
class DoseState:
    """Rows at some doses and calibrated numbers."""

    work: Working
    jacobian: Floats  # (n, p), of the mean along the calibrated numbers
    slope: Floats  # (n,), of the mean along the dose
    misfit: float  # deviance plus priors


@dataclass(frozen=True)
class DoseSearch:
    """Gauss-Newton search for the best doses of one path and prior."""

    prepared: PreparedProblem
    path: DosePath
    sets: ConditionSets
    prior: DosePrior
    amplitude: float

    def state(self, theta: Floats) -> DoseState:
        """The rows at [x, s, f]."""
        shared = self.prepared.rows.shared
        count = self.path.x.size + shared.shape[1]
        dose = (self.amplitude * self.prior.factor @ theta[count:])[self.sets.index]
        change, slope = self.path.change(dose)
        jacobian, bend = self.path.slopes(dose)
        away = theta[:count] - self.origin
        moved = np.hstack([jacobian, shared]) @ away
        slope = slope + bend @ away[: self.path.x.size]
        work = self.prepared.working(self.path.bare + moved + change)
        return DoseState(work, jacobian, slope, work.deviance + float(theta @ theta))

    @property
    def origin(self) -> Floats:
        """Calibrated numbers of the path, and no shared errors."""
        return np.concatenate([self.path.x, np.zeros(self.prepared.rows.shared.shape[1])])

    def columns(self, state: DoseState) -> Floats:
        """Whitened columns B of the linear model (n, p + q + r)."""
        scale = (state.work.weight / self.prepared.sd)[:, np.newaxis]
        doses = self.amplitude * self.prior.factor[self.sets.index] * state.slope[:, np.newaxis]
        return np.hstack([state.jacobian, self.prepared.rows.shared, doses]) * scale

    def start(self) -> Floats:
        """The bare model with the calibrated numbers of the path."""
        shared = self.prepared.rows.shared.shape[1] + self.prior.factor.shape[1]
        return np.concatenate([self.path.x, np.zeros(shared)])

    def beside(self, fit: DoseFit) -> Floats:
        """[x, s, f] with the doses of another fit, as well as this prior has them."""
        start, count = self.origin, fit.theta.size - fit.prior.factor.shape[1]
        if count == start.size:
            start = fit.theta[:count]
        else:  # the errors that rows share are others
            start[: self.path.x.size] = fit.theta[: self.path.x.size]
        doses = self.amplitude * self.prior.factor
        near = np.linalg.solve(doses.T @ doses + SLACK * np.eye(doses.shape[1]), doses.T @ fit.doses)
        return np.asarray(np.concatenate([start, near]), dtype=np.float64)

    def run(self, theta: Floats, steps: int) -> Floats:
        """Best [x, s, f] from a start."""
        state = self.state(theta)
        for _ in range(steps):
            columns = self.columns(state)
            gradient = columns.T @ state.work.residual - theta
            step = np.linalg.solve(columns.T @ columns + np.eye(theta.size), gradient)
            before = state.misfit
            for _ in range(HALVINGS):
                tried = self.state(theta + step)
                if tried.misfit < state.misfit:
                    theta, state = theta + step, tried
                    break
                step = 0.5 * step
            if before - state.misfit < ENOUGH:
                break
        return theta

    def fit(self, theta: Floats) -> DoseFit:
        """The linear model about [x, s, f], and its evidence."""
        state = self.state(theta)
        work, columns = state.work, self.columns(state)
        pseudo = work.residual + columns @ theta
        evidence = gaussian_log_evidence(columns, pseudo, self.prepared.doubt.factor)
        count = columns.shape[1] - self.prior.factor.shape[1]
        covariance = np.linalg.inv(columns.T @ columns + np.eye(theta.size))[count:, count:]
        factor = self.amplitude * self.prior.factor
        return DoseFit(
            self.prior,
            self.amplitude,
            factor @ theta[count:],
            factor @ covariance @ factor.T,
            theta,
            work,
            columns,
            pseudo,
            evidence + censored_part(work, self.prepared),
            state.misfit,
        )


def first_fit(prepared: PreparedProblem, path: DosePath) -> DoseFit:
    """Best doses of the likeliest kernel and amplitude, from the bare model."""
    sets, tried = condition_sets(prepared), list[tuple[DoseSearch, DoseFit]]()
    for prior in dose_priors(prepared, sets):
        first = DoseSearch(prepared, path, sets, prior, FIRST_AMPLITUDE)
        fit = first.fit(first.run(first.start(), FIRST_STEPS))
        for amplitude in AMPLITUDES:
            search = replace(first, amplitude=amplitude)
            tried.append((search, search.fit(search.run(search.beside(fit), 1))))
    search, fit = max(tried, key=lambda item: averaged(prepared, item[1].log_evidence))
    return search.fit(search.run(fit.theta, STEPS))


def again(prepared: PreparedProblem, path: DosePath, fit: DoseFit) -> DoseFit:
    """The same kernel and amplitude fitted on another path, from the doses found."""
    search = DoseSearch(prepared, path, condition_sets(prepared), fit.prior, fit.amplitude)
    return search.fit(search.run(search.beside(fit), STEPS))


def dose_evidence(prepared: PreparedProblem, path: DosePath, fit: DoseFit) -> DoseEvidence:
    """Evidence of one mechanism from its best doses, all kernels and amplitudes alike likely beforehand."""
    sets, fits = condition_sets(prepared), [fit]
    for prior in dose_priors(prepared, sets):
        for amplitude in AMPLITUDES:
            search = DoseSearch(prepared, path, sets, prior, amplitude)
            if (prior.axis, prior.length, amplitude) != (fit.prior.axis, fit.prior.length, fit.amplitude):
                fits.append(search.fit(search.run(search.beside(fit), BESIDE_STEPS)))
    best = max(fits, key=lambda each: averaged(prepared, each.log_evidence))
    evidence = log_sum_exp(np.array([each.log_evidence for each in fits]), axis=0) - np.log(len(fits))
    return DoseEvidence(path, sets, best, evidence)


def averaged(prepared: PreparedProblem, log_evidence: Floats) -> float:
    """Ln evidence averaged over the factor of the noise."""
    return float(log_sum_exp(prepared.doubt.log_weight + log_evidence))


def free_part(fit: DoseFit) -> tuple[Floats, Floats]:
    """Projected residual of the rows (n,), and the basis that is projected out (n, p + q + r)."""
    below = np.eye(fit.columns.shape[1])
    basis, _ = np.linalg.qr(np.vstack([fit.columns, below]))
    stacked = np.concatenate([fit.pseudo, np.zeros(below.shape[0])])
    rows = basis[: fit.pseudo.size]
    return (stacked - basis @ (basis.T @ stacked))[: fit.pseudo.size], rows


def left_p(fit: DoseFit) -> float:
    """Chance that as much misfit is left by a complete model."""
    free, rows = free_part(fit)
    return float(quadratic_form_p(float(free @ free), np.eye(free.size) - rows @ rows.T))


def one_dose_p(prepared: PreparedProblem, evidence: DoseEvidence) -> float:
    """Chance that doses which serve all observables leave as much as if each had one of its own.

    NaN where the mechanism moves one observable only.
    """
    fit = evidence.best
    count = fit.columns.shape[1] - fit.prior.factor.shape[1]
    doses, blocks = fit.columns[:, count:], []
    for _, chosen in prepared.by_observable():
        if np.any(doses[chosen]):
            blocks.append(np.where(chosen[:, np.newaxis], doses, 0.0))
    if len(blocks) < 2:
        return float("nan")
    free, rows = free_part(fit)
    factor = np.hstack(blocks)
    projected = factor.T @ free
    kept = factor - rows @ (rows.T @ factor)
    return float(quadratic_form_p(float(projected @ projected), factor.T @ kept))


def curvature(prepared: PreparedProblem, evidence: DoseEvidence) -> float:
    """Rise of the misfit one posterior sd along the doses, over that of the linear model, less one [1].

    The larger of both directions, the calibrated numbers and shared errors held.
    """
    fit, path = evidence.best, evidence.path
    shape = fit.doses[evidence.sets.index]
    _, slope = path.change(shape)
    column = shape * slope * fit.work.weight / prepared.sd
    size = float(np.linalg.norm(column))
    if size == 0.0:
        return 0.0
    start, worst = path.change(shape)[0], 0.0
    for sign in (-1.0, 1.0):
        moved = path.change(shape * (1.0 + sign / size))[0] - start
        change = moved * fit.work.weight / prepared.sd
        worst = max(worst, float(np.linalg.norm(change - sign * column / size)))
    return worst
