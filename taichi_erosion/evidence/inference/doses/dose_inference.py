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

Doses that held-out rows ask for, one set of conditions at a time, after a law of a mechanism was adopted.

    s_j = argmin r_j(s)^T V_j^-1 r_j(s),    D_j = s_j D(c_j)

with r_j the whitened residuals of the rows of set j at strength s of the law D, calibrated by the fitted rows
alone, and V_j = R + S C S^T their covariance: scatter, and what the fitted rows leave uncertain in the
calibrated numbers. The standard error is the root mean square about s_j over all strengths, weighted by their
likelihood. A set where the law has no dose, or no row depends on it, tells nothing and is left out.
"""

from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp, working
from taichi_erosion.evidence.data.mechanism_findings import DoseEstimate
from taichi_erosion.evidence.data.problem import Candidate, Floats, Mechanism
from taichi_erosion.evidence.inference.doses.dose_path import DosePath, dose_path
from taichi_erosion.evidence.inference.doses.dose_search import (
    ConditionSets,
    DoseFit,
    DosePrior,
    censored_part,
    dose_searches,
    gaussian_log_evidence,
)
from taichi_erosion.evidence.inference.goodness_of_fit import quadratic_form_p
from taichi_erosion.evidence.inference.map_fit import Fit
from taichi_erosion.evidence.inference.model_discrepancy import condition_axes, low_rank, squared_distance
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

LENGTHS = (0.7, 2.0)  # of the kernel, in sd of a condition
AMPLITUDES = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)  # lambda, sd of the doses [1]
FIRST_AMPLITUDE = 1.0  # at which every kernel is tried first
LEVEL = 0.25  # variance of the level of the doses over that of their variation
ALL = ""  # name of the kernel over all conditions together
STEPS, FIRST_STEPS, BESIDE_STEPS = 30, 8, 3  # Gauss-Newton steps of the best fit, a first one, one beside it
STRENGTHS = 301  # at which the rows are predicted, over all that the law may have
LEAST_FALL = 1.0  # of the misfit over all strengths, below which a set tells nothing


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
    residual = prepared.white(prepared.rows.z - path.bare + path.jacobian @ path.x)
    fitted = columns @ ridge(columns, residual)
    work = working(residual - fitted, prepared.white_reach)
    columns = calibration_columns(prepared, path, work.weight)
    pseudo = work.residual + work.weight * fitted
    return gaussian_log_evidence(columns, pseudo, prepared.doubt.factor) + censored_part(work, prepared)


def calibration_columns(prepared: PreparedProblem, path: DosePath, weight: Floats) -> Floats:
    """Whitened columns of calibrated numbers and shared errors (n, p + q)."""
    white = replace(prepared.white, weight=weight)
    return white(np.hstack([path.jacobian, prepared.rows.shared]))


def ridge(columns: Floats, residual: Floats) -> Floats:
    """Most likely coefficients with unit priors."""
    matrix = columns.T @ columns + np.eye(columns.shape[1])
    return np.asarray(np.linalg.solve(matrix, columns.T @ residual), dtype=np.float64)


def first_fit(prepared: PreparedProblem, path: DosePath) -> DoseFit:
    """Best doses of the likeliest kernel and amplitude, from the bare model."""
    sets = condition_sets(prepared)
    priors = dose_priors(prepared, sets)
    first = dose_searches(prepared, path, sets, [(prior, FIRST_AMPLITUDE) for prior in priors])
    fits = first.fits(first.run(first.start(), FIRST_STEPS))
    asked = [(prior, amplitude) for prior in priors for amplitude in AMPLITUDES]
    searches = dose_searches(prepared, path, sets, asked)
    theta = searches.run(searches.beside([fit for fit in fits for _ in AMPLITUDES]), 1)
    chances = [prepared.doubt.averaged(fit.log_evidence) for fit in searches.fits(theta)]
    top = np.array([int(np.argmax(chances))])
    best = searches.only(top)
    return best.fits(best.run(theta[top], STEPS))[0]


def again(prepared: PreparedProblem, path: DosePath, fit: DoseFit) -> DoseFit:
    """The same kernel and amplitude fitted on another path, from the doses found."""
    search = dose_searches(prepared, path, condition_sets(prepared), [(fit.prior, fit.amplitude)])
    return search.fits(search.run(search.beside([fit]), STEPS))[0]


def dose_evidence(prepared: PreparedProblem, path: DosePath, fit: DoseFit) -> DoseEvidence:
    """Evidence of one mechanism from its best doses, all kernels and amplitudes alike likely beforehand."""
    sets = condition_sets(prepared)
    asked = [
        (prior, amplitude)
        for prior in dose_priors(prepared, sets)
        for amplitude in AMPLITUDES
        if (prior.axis, prior.length, amplitude) != fit.chosen
    ]
    searches = dose_searches(prepared, path, sets, asked)
    fits = [fit, *searches.fits(searches.run(searches.beside([fit] * searches.size), BESIDE_STEPS))]
    best = max(fits, key=lambda each: prepared.doubt.averaged(each.log_evidence))
    evidence = log_sum_exp(np.array([each.log_evidence for each in fits]), axis=0) - np.log(len(fits))
    return DoseEvidence(path, sets, best, evidence)


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
    doses, blocks = fit.columns[:, fit.others :], []
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
    white = prepared.whitening(fit.work)
    column = white(shape * slope)
    size = float(np.linalg.norm(column))
    if size == 0.0:
        return 0.0
    start, worst = path.change(shape)[0], 0.0
    for sign in (-1.0, 1.0):
        moved = path.change(shape * (1.0 + sign / size))[0] - start
        change = white(moved)
        worst = max(worst, float(np.linalg.norm(change - sign * column / size)))
    return worst


def held_out_doses(
    held: PreparedProblem, best: Fit, law: Candidate, covariance: Floats
) -> tuple[DoseEstimate, ...]:
    """Dose of every held-out set of conditions; `covariance` is that of the calibrated numbers."""
    assert law.dose is not None
    ends = Mechanism(law.name, -law.maximum, law.maximum)
    path = dose_path(held, ends, best.x)
    if path.curve is None or not np.all(np.isfinite(path.bare)):
        return ()
    sets, found = condition_sets(held), []
    doses = law.dose({name: column[sets.first] for name, column in held.rows.conditions.items()})
    for number, row in enumerate(sets.first):
        own = np.flatnonzero(sets.index == number)
        strength, sd = strength_of(held, path, own, covariance)
        unit = float(doses[number])
        if np.isfinite(sd) and unit != 0.0:
            at, acting = held.rows.conditions_at(int(row)), best.acting()[law.name]
            found.append(DoseEstimate(at, strength * unit, sd * abs(unit), acting * unit))
    return tuple(found)


def strength_of(
    held: PreparedProblem, path: DosePath, own: np.ndarray, covariance: Floats
) -> tuple[float, float]:
    """Strength that some rows ask for, and its standard error; NaN where they do not depend on it."""
    scale = 1.0 / held.sd[own]
    slopes = path.jacobian[own] * scale[:, np.newaxis]
    scatter = np.eye(own.size) if held.correlation is None else held.correlation[np.ix_(own, own)]
    root = np.linalg.inv(np.linalg.cholesky(scatter + slopes @ covariance @ slopes.T))

    def residual(strength: float) -> Floats:
        change = path.change(np.full(held.rows.size, strength))[0]
        return root @ ((held.rows.z - path.bare - change)[own] * scale)

    strengths = np.linspace(path.low, path.high, STRENGTHS)
    squares = np.array([float(np.sum(residual(strength) ** 2)) for strength in strengths])
    if np.ptp(squares) < LEAST_FALL:
        return float("nan"), float("nan")
    weight = np.exp(-0.5 * (squares - squares.min()))
    best = float(strengths[int(np.argmin(squares))])
    return best, float(np.sqrt(weight @ (strengths - best) ** 2 / weight.sum()))
