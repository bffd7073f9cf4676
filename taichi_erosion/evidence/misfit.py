"""Where the model fails: by observable, along every condition, in words.

For every axis the projected residual e is tested for smooth structure,

    T = e^T M K M e  ~  sum lambda_j chi^2_1

with K a squared-exponential kernel along that condition within the observable, and its null distribution from
the eigenvalues lambda_j; probabilities are adjusted by Holm's method over all axes and levels.

Reference: Imhof (1961), Biometrika 48, 419 (three-moment approximation of the null).
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from taichi_erosion.evidence.algebra import working
from taichi_erosion.evidence.evidence import Expansion
from taichi_erosion.evidence.examination import Examination
from taichi_erosion.evidence.findings import Where
from taichi_erosion.evidence.problem import Bools, Floats
from taichi_erosion.evidence.smooth import standard_axis
from taichi_erosion.evidence.unknown import free_residual

LENGTH = 0.7  # of the kernel, in sd of a condition
BINS = 4  # along an axis, of equal numbers of rows
TOLD = 0.05  # adjusted probability below which a place is told as a failure
LEVEL_AXIS = "level"
LEAST_P = 1e-16  # told as such; below, rounding decides


@dataclass(frozen=True)
class Residuals:
    """Whitened residual of an expansion, what calibration leaves of it, and the basis that it removed."""

    whole: Floats
    free: Floats
    basis: Floats


def residuals_of(exam: Examination, expansion: Expansion) -> Residuals:
    """Residuals of one hypothesis."""
    work = working((exam.rows.z - expansion.mean) / exam.sd, exam.rows.censored)
    free, basis = free_residual(exam, expansion)
    return Residuals(work.residual, free, basis[: exam.rows.size])


def chance_of_quadratic(value: float, eigenvalues: Floats) -> float:
    """P(sum lambda_j chi^2_1 > value) by matching three moments to a shifted chi^2."""
    first, second, third = (float(np.sum(eigenvalues**k)) for k in (1, 2, 3))
    if second <= 0.0 or third <= 0.0:
        return 1.0
    freedom = second**3 / third**2
    position = (value - first) * np.sqrt(freedom / second) + freedom
    return float(stats.chi2.sf(max(position, 0.0), freedom))


def misfit_p(left: Residuals) -> float:
    """Probability that a complete model would leave as much, calibration and shared errors accounted for.

    |M e|^2 over all stacked rows has n degrees of freedom when the truth is drawn from the prior.
    """
    return float(misfit_chances(left, np.ones(1))[0])


def misfit_chances(left: Residuals, factors: Floats) -> Floats:
    """The same where the scatter is `factors` times as large as stated."""
    value = float(left.free @ left.free)
    eigenvalues = np.linalg.eigvalsh(np.eye(left.whole.size) - left.basis @ left.basis.T)
    kept = np.maximum(eigenvalues, 0.0)
    return np.array([chance_of_quadratic(value / factor**2, kept) for factor in factors])


def structure_p(left: Residuals, factor: Floats) -> tuple[float, float]:
    """Statistic and chance of structure along one kernel factor."""
    free = factor - left.basis @ (left.basis.T @ factor)
    eigenvalues = np.linalg.eigvalsh(factor.T @ free)
    projected = factor.T @ left.free
    value = float(projected @ projected)
    return value, chance_of_quadratic(value, np.maximum(eigenvalues, 0.0))


def where_it_fails(exam: Examination, expansion: Expansion) -> tuple[Where, ...]:
    """Every place looked at, worst first, with its Holm-adjusted probability and a sentence."""
    left = residuals_of(exam, expansion)
    found: list[tuple[str, str, float, str]] = []
    for index, observable in enumerate(exam.rows.observables):
        rows = exam.rows.which == index
        if not rows.any():
            continue
        level = rows.astype(float)[:, np.newaxis] / exam.sd[:, np.newaxis]
        _, p = structure_p(left, level / np.linalg.norm(level))
        found.append((observable.name, LEVEL_AXIS, p, level_words(exam, left, rows)))
        for name, column in exam.rows.conditions.items():
            axis = standard_axis(column[rows])
            if axis is None or np.unique(axis).size < 3:
                continue
            square = ((axis[:, np.newaxis] - axis[np.newaxis, :]) / LENGTH) ** 2
            values, vectors = np.linalg.eigh(np.exp(-0.5 * square))
            factor = np.zeros((exam.rows.size, axis.size))
            factor[rows] = vectors * np.sqrt(np.maximum(values, 0.0))
            _, p = structure_p(left, factor)
            found.append((observable.name, name, p, axis_words(column[rows], left.free[rows])))
    adjusted = holm([item[2] for item in found])
    places = [
        Where(name, axis, p, sentence(name, axis, words, p))
        for (name, axis, _, words), p in zip(found, adjusted, strict=True)
    ]
    return tuple(sorted(places, key=lambda place: place.p))


def holm(p: list[float]) -> list[float]:
    """Holm's step-down adjustment."""
    order = np.argsort(p)
    adjusted, last = [0.0] * len(p), 0.0
    for rank, index in enumerate(order):
        last = max(last, min(1.0, (len(p) - rank) * p[index]))
        adjusted[index] = last
    return adjusted


def level_words(exam: Examination, left: Residuals, rows: Bools) -> str:
    """Direction in which a whole observable is off."""
    return "too low" if float(np.sum(left.free[rows] / exam.sd[rows])) > 0.0 else "too high"


def axis_words(column: Floats, free: Floats) -> str:
    """The end or middle of an axis where the residual is largest, and its direction."""
    order = np.argsort(column)
    parts = [part for part in np.array_split(order, min(BINS, max(2, np.unique(column).size))) if part.size]
    pulls = [float(free[part].sum() / np.sqrt(part.size)) for part in parts]
    worst = int(np.argmax(np.abs(pulls)))
    direction = "too low" if pulls[worst] > 0.0 else "too high"
    values = column[parts[worst]]
    if worst == 0:
        return f"{direction} up to {{axis}} = {values.max():.3g}"
    if worst == len(parts) - 1:
        return f"{direction} from {{axis}} = {values.min():.3g}"
    if values.min() == values.max():
        return f"{direction} at {{axis}} = {values.max():.3g}"
    return f"{direction} for {{axis}} between {values.min():.3g} and {values.max():.3g}"


def sentence(observable: str, axis: str, words: str, p: float) -> str:
    """Plain words about one place."""
    if p >= TOLD:
        place = "as a whole" if axis == LEVEL_AXIS else f"along {axis}"
        return f"{observable}: no misfit seen {place} ({chance_words(p)})"
    what = words.format(axis=axis) if axis != LEVEL_AXIS else f"{words} as a whole"
    return f"{observable}: the model is {what} ({chance_words(p)})"


def chance_words(p: float) -> str:
    """A probability in words; one too small to be computed is not called zero."""
    return f"p = {p:.2g}" if p >= LEAST_P else f"p < {LEAST_P:g}"
