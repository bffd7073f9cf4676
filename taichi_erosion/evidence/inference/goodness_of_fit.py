"""Where the model fails: by observable, along every condition, in words.

For every axis the projected residual e is tested for smooth structure,

    T = e^T M K M e  ~  sum lambda_j chi^2_1

with K a squared-exponential kernel along that condition within the observable, and its null distribution from
the eigenvalues lambda_j; probabilities are adjusted by Holm's method over all axes and levels.

Reference: Imhof (1961), Biometrika 48, 419 (three-moment approximation of the null).

Rows, noise budgets and misfits as the findings show them: back in the observables' own units.
"""

from dataclasses import dataclass

import numpy as np
from scipy import stats

from taichi_erosion.evidence.data.findings import MisfitPlace, Noise, ObservableMisfit, ObservableNoise, Rows
from taichi_erosion.evidence.data.linear_algebra import projection, working
from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.data.transforms import from_scale
from taichi_erosion.evidence.inference.levels import LEAST_P, NOISE_LEVEL, fails
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion
from taichi_erosion.evidence.inference.model_discrepancy import free_residual
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.predictor import standard_axis

LENGTH = 0.7  # of the kernel, in sd of a condition
BINS = 4  # along an axis, of equal numbers of rows
LEVEL_AXIS = "level"


@dataclass(frozen=True)
class Residuals:
    """Whitened residual of an expansion, what calibration leaves of it, and the basis that it removed."""

    whole: Floats
    free: Floats
    basis: Floats


def residuals_of(prepared: PreparedProblem, expansion: Expansion) -> Residuals:
    """Residuals of one hypothesis."""
    work = working((prepared.rows.z - expansion.mean) / prepared.sd, prepared.rows.censored)
    free, basis = free_residual(prepared, expansion)
    return Residuals(work.residual, free, basis[: prepared.rows.size])


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


def misfit_places(prepared: PreparedProblem, expansion: Expansion) -> tuple[MisfitPlace, ...]:
    """Every place looked at, worst first, with its Holm-adjusted probability and a sentence."""
    left = residuals_of(prepared, expansion)
    found: list[tuple[str, str, float, str]] = []
    for index, observable in enumerate(prepared.rows.observables):
        rows = prepared.rows.which == index
        if not rows.any():
            continue
        level = rows.astype(float)[:, np.newaxis] / prepared.sd[:, np.newaxis]
        _, p = structure_p(left, level / np.linalg.norm(level))
        found.append((observable.name, LEVEL_AXIS, p, level_words(prepared, left, rows)))
        for name, column in prepared.rows.conditions.items():
            axis = standard_axis(column[rows])
            if axis is None or np.unique(axis).size < 3:
                continue
            square = ((axis[:, np.newaxis] - axis[np.newaxis, :]) / LENGTH) ** 2
            values, vectors = np.linalg.eigh(np.exp(-0.5 * square))
            factor = np.zeros((prepared.rows.size, axis.size))
            factor[rows] = vectors * np.sqrt(np.maximum(values, 0.0))
            _, p = structure_p(left, factor)
            found.append((observable.name, name, p, axis_words(column[rows], left.free[rows])))
    adjusted = holm([item[2] for item in found])
    places = [
        MisfitPlace(name, axis, p, sentence(name, axis, words, p))
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


def level_words(prepared: PreparedProblem, left: Residuals, rows: Bools) -> str:
    """Direction in which a whole observable is off."""
    return "too low" if float(np.sum(left.free[rows] / prepared.sd[rows])) > 0.0 else "too high"


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
    if not fails(p):
        place = "as a whole" if axis == LEVEL_AXIS else f"along {axis}"
        return f"{observable}: no misfit seen {place} ({probability_text(p)})"
    what = words.format(axis=axis) if axis != LEVEL_AXIS else f"{words} as a whole"
    return f"{observable}: the model is {what} ({probability_text(p)})"


def probability_text(p: float) -> str:
    """A probability in words; one too small to be computed is not called zero."""
    return f"p = {p:.2g}" if p >= LEAST_P else f"p < {LEAST_P:g}"


ASK_REPEATS = (
    "Neither an sd nor repeated measurements are given, so no effect can be named. Repeat at least 4 "
    "conditions 3 times or more, or state the sd of a single measurement."
)


def rows_table(prepared: PreparedProblem, expansion: Expansion) -> Rows:
    """Measured beside predicted."""
    rows = prepared.rows
    measured, predicted = np.empty(rows.size), np.empty(rows.size)
    for index, observable in enumerate(rows.observables):
        chosen = rows.which == index
        measured[chosen] = from_scale(observable, rows.z[chosen])
        predicted[chosen] = from_scale(observable, expansion.mean[chosen])
    steep = np.where(rows.slope > 0.0, rows.slope, np.nan)
    shared = np.sum(rows.shared**2, axis=1)
    own = np.sum(expansion.shared**2, axis=1) - shared  # of the model itself
    return Rows(
        observable=tuple(rows.observables[i].name for i in rows.which),
        group=rows.group,
        conditions=rows.conditions,
        measured=measured,
        measured_sd=np.sqrt(rows.variance + shared) / steep,
        predicted=predicted,
        predicted_sd=np.sqrt(np.maximum(prepared.variance - rows.variance + own, 0.0)) / steep,
        residual=working((rows.z - expansion.mean) / prepared.sd, rows.censored).residual,
    )


def chi_square(prepared: PreparedProblem, expansion: Expansion) -> float:
    """Misfit of the measurements alone, shared errors at their best: r^T V^-1 r."""
    work = working((prepared.rows.z - expansion.mean) / prepared.sd, prepared.rows.censored)
    shared = expansion.shared / prepared.sd[:, np.newaxis] * work.weight[:, np.newaxis]
    part = projection(np.zeros((work.residual.size, 0)), shared)
    stacked = np.concatenate([work.residual, np.zeros(shared.shape[1])])
    free = part.free(stacked)
    return float(free @ free)


def freedom(prepared: PreparedProblem, expansion: Expansion) -> float:
    """Degrees of freedom that calibration leaves: n minus the leverage of what it removes."""
    left = residuals_of(prepared, expansion)
    return float(prepared.rows.size - np.sum(left.basis**2))


def observable_misfits(
    prepared: PreparedProblem, expansion: Expansion, table: Rows
) -> dict[str, ObservableMisfit]:
    """Agreement observable by observable; p tests its own rows with calibration accounted for."""
    left, found = residuals_of(prepared, expansion), {}
    for index, observable in enumerate(prepared.rows.observables):
        chosen = prepared.rows.which == index
        if not chosen.any():
            continue
        gap = (table.measured - table.predicted)[chosen]
        part = left.basis[chosen]
        eigenvalues = np.maximum(np.linalg.eigvalsh(np.eye(int(chosen.sum())) - part @ part.T), 0.0)
        free = left.free[chosen]
        p = chance_of_quadratic(float(free @ free), eigenvalues)
        whole = left.whole[chosen]
        found[observable.name] = ObservableMisfit(
            int(chosen.sum()), float(whole @ whole), float(np.sqrt(np.mean(gap**2))), float(gap.mean()), p
        )
    return found


def noise_table(prepared: PreparedProblem, correlation: Floats | None, known: bool = True) -> Noise:
    """Noise budget with the simulator's share, and what must be said about it; `known` unless guessed."""
    budgets, sentences = {}, []
    simulated = np.sqrt(np.maximum(prepared.variance - prepared.rows.variance, 0.0))
    for index, observable in enumerate(prepared.rows.observables):
        given = prepared.rows.noise[observable.name]
        chosen = prepared.rows.which == index
        paired = correlation[chosen] if correlation is not None else np.full(int(chosen.sum()), np.nan)
        seeds = float(np.nanmedian(paired)) if np.any(np.isfinite(paired)) else float("nan")
        own = float(np.median(simulated[chosen])) if chosen.any() else float("nan")
        budgets[observable.name] = ObservableNoise(
            given.lab, own, given.shared, given.numerical, given.repeats, given.stated_factor, given.p, seeds
        )
        sentences += noise_words(observable.name, given)
    return Noise(budgets, known, tuple(sentences) if known else (ASK_REPEATS,))


def noise_words(name: str, given: ObservableNoise) -> list[str]:
    """What one observable's noise check says."""
    if given.stated_factor == given.stated_factor and given.p < NOISE_LEVEL:
        relation = "larger" if given.stated_factor > 1.0 else "smaller"
        return [
            f"{name}: repeated measurements scatter {given.stated_factor:.2g} times as much as stated, "
            f"{relation} than chance allows (p = {given.p:.2g}); the stated sd was corrected."
        ]
    if given.lab != given.lab:
        return [f"{name}: its noise is unknown; it is shown but decides nothing."]
    return []
