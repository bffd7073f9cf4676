"""Doses that held-out rows ask for, one set of conditions at a time, after a law of a mechanism was adopted.

    s_j = argmin r_j(s)^T V_j^-1 r_j(s),    D_j = s_j D(c_j)

with r_j the whitened residuals of the rows of set j at strength s of the law D, calibrated by the fitted rows
alone, and V_j = R + S C S^T their covariance: scatter, and what the fitted rows leave uncertain in the
calibrated numbers. The standard error is the root mean square about s_j over all strengths, weighted by their
likelihood. A set where the law has no dose, or no row depends on it, tells nothing and is left out.
"""

import numpy as np

from taichi_erosion.evidence.data.mechanism_findings import DoseEstimate
from taichi_erosion.evidence.data.problem import Candidate, Floats, Mechanism
from taichi_erosion.evidence.inference.doses.dose_inference import condition_sets
from taichi_erosion.evidence.inference.doses.dose_path import DosePath, dose_path
from taichi_erosion.evidence.inference.map_fit import Fit
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

STRENGTHS = 301  # at which the rows are predicted, over all that the law may have
LEAST_FALL = 1.0  # of the misfit over all strengths, below which a set tells nothing


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
