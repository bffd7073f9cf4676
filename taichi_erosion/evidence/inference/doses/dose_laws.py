"""The law that the doses of a mechanism follow, chosen by nested cross-validation over groups of rows.

A law is fitted to the rows themselves, through the path of the mechanism, with the calibrated numbers and
shared errors at their best: this is what the doses with their covariance say, without the prior that smooths
them. Forms are ranked by their log score on left-out groups, less 1/2 ln n for every number (Schwarz); the
share of misfit that is told comes from groups that neither the fit nor the choice of the form has seen.

Reference: Varma & Simon (2006), BMC Bioinformatics 7, 91 (nested cross-validation); Schwarz (1978), Ann.
Stat. 6, 461 (price of a number).

Fit of the form of a law to the rows themselves, calibrated numbers and shared errors at their best.

    r(a) = W (y - C(a)),    W W^T = (1 + B B^T)^-1

with y the whitened rows, C the change by the mechanism at the doses of the form with numbers a, and B the
whitened slopes along calibrated numbers and shared errors, whose priors are normal: |r|^2 is the misfit with
these at their best. The slopes are those at the best calibrated numbers of the form itself: each form has
rows of its own, made anew until the numbers stay.

Reference: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413 (linear numbers eliminated).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np
from scipy import stats

from taichi_erosion.evidence.data.findings import Estimate
from taichi_erosion.evidence.data.linear_algebra import Whitening
from taichi_erosion.evidence.data.mechanism_findings import DoseLaw
from taichi_erosion.evidence.data.problem import Bools, Conditions, Floats, Integers
from taichi_erosion.evidence.inference.cross_validation import fold_numbers
from taichi_erosion.evidence.inference.doses.dose_forms import GROUPS, Form, forms_of
from taichi_erosion.evidence.inference.doses.dose_inference import ridge
from taichi_erosion.evidence.inference.doses.dose_path import DosePath, next_numbers
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

FOLDS = 6  # of the groups, at most
MOST_STEPS = 60  # of one fit
SMALL_STEP = 1e-7  # of a number over its range, for the slope of a residual
FIRST_DAMPING, EASIER, HARDER, MOST_DAMPING = 1e-3, 0.1, 5.0, 1e9  # of a step, over the curvature [1]
ENOUGH = 1e-6  # fall of the misfit, over it, below which a fit ends [1]
LEAST_DAMPING = 1e-9  # at which equations of numbers with the same slopes have a solution still [1]
TINY = 1e-12  # curvature along a number that changes nothing
ROUNDS = 12  # in which a law is fitted anew where the calibrated numbers have moved
EXACT_ROUNDS = 3  # in which the rows are exact about the doses
STILL = 0.02  # move below which they stay, in prior sd
SIMPLE = 1.0  # the same of a form that is neither a power nor a constant
POWERS = ("constant", "power", *GROUPS)  # forms that are taken where others are hardly better
SETTLED = 8  # forms that get calibrated numbers of their own, after a first fit to all rows
KEPT = 6  # forms that are cross-validated, after their fit to all rows at hand
QUANTILE = float(stats.norm.ppf(0.95))  # half width of a 90 % interval, in sd
LEAST_ROWS = 6
CURVE = 33  # values of a condition at which a law is drawn
STEP = 1e-3  # of a number, for the slope of a law along it
STEPS = (1.0, 0.6, 0.35, 1.7)  # conditions at which a law is stated, over their largest values [1]


@dataclass(frozen=True)
class LawRows:
    """Rows at the best doses: working residuals, and the linear model of the calibrated numbers."""

    path: DosePath
    conditions: Conditions
    target: Floats  # (n,), whitened: what dose and calibrated numbers have to explain
    white: Whitening
    columns: Floats  # (n, p + q), whitened, unit priors
    folds: Integers  # (n,)

    def residual(self, dose: Floats) -> Floats:
        """Whitened residual at doses of all rows, calibrated numbers at their prior mean."""
        return self.target - self.white(self.path.change(dose)[0])


@dataclass(frozen=True)
class FittedForm:
    """A form fitted to some rows."""

    form: Form
    rows: LawRows
    numbers: Floats
    misfit: float  # of these rows, priors of calibrated numbers included
    covariance: Floats  # of the numbers

    @property
    def doses(self) -> Floats:
        """Doses in all rows, those that are left out too."""
        return bounded_dose(self.form, self.rows.conditions, self.numbers)


def rows_about(
    prepared: PreparedProblem, path: DosePath, dose: Floats, shared: Floats | None = None
) -> LawRows:
    """Rows for laws, linear about the calibrated numbers of a path and some doses.

    A censored row stands as an ordinary one with its working residual.
    """
    errors = prepared.rows.shared if shared is None else shared
    change, jacobian = path.change(dose)[0], path.slopes(dose)[0]
    work = prepared.working(path.bare + change)
    white = prepared.whitening(work)
    columns = white(np.hstack([jacobian, errors]))
    start = np.concatenate([path.x, np.zeros(errors.shape[1])])
    target = work.residual + columns @ start + white(change)
    return LawRows(path, prepared.rows.conditions, target, white, columns, fold_numbers(prepared) % FOLDS)


@dataclass(frozen=True)
class LawPart:
    """Some of the rows, whitened with calibrated numbers and shared errors integrated out."""

    rows: LawRows  # all of them
    chosen: Bools  # (n,)
    path: DosePath  # of the chosen ones
    own: Conditions
    target: Floats  # (m,)
    whiten: Floats  # (m, m), of changes of the mean

    def residual(self, form: Form, numbers: Floats) -> tuple[Floats, Floats]:
        """Whitened residual of a form (m,), and its slopes along the numbers (m, k)."""
        dose, slopes = form_slopes(form, self.own, numbers)
        change, slope = self.path.change(dose)
        return self.target - self.whiten @ change, -(self.whiten * slope) @ slopes


def law_part(rows: LawRows, chosen: Bools) -> LawPart:
    """Some rows; their whitening is the square root of (1 + B B^T)^-1."""
    left, values, _ = np.linalg.svd(rows.columns[chosen], full_matrices=False)
    whiten = np.eye(int(chosen.sum())) + (left * (1.0 / np.sqrt(1.0 + values**2) - 1.0)) @ left.T
    own = {name: column[chosen] for name, column in rows.conditions.items()}
    scale, root = rows.white.scale[chosen], rows.white.root
    whitened = whiten * scale if root is None else whiten @ (root[np.ix_(chosen, chosen)] * scale)
    return LawPart(rows, chosen, rows.path.over(chosen), own, whiten @ rows.target[chosen], whitened)


def form_slopes(form: Form, conditions: Conditions, numbers: Floats) -> tuple[Floats, Floats]:
    """Doses of a form, and their slopes along its numbers (m, k): every form is linear in the first."""
    unit = numbers.copy()
    unit[0] = 1.0
    shape = bounded_dose(form, conditions, unit)
    slopes = [shape]
    for k in range(1, form.size):
        moved, step = unit.copy(), SMALL_STEP * (form.high[k] - form.low[k])
        moved[k] += step
        slopes.append((bounded_dose(form, conditions, moved) - shape) * (numbers[0] / step))
    return numbers[0] * shape, np.column_stack(slopes)


def bounded_dose(form: Form, conditions: Conditions, numbers: Floats) -> Floats:
    """Doses of a form within bounds."""
    dose = form.dose(conditions, numbers)
    return dose if isfinite(np.add.reduce(dose)) else np.nan_to_num(dose, posinf=1e6, neginf=-1e6)


def fitted_form(part: LawPart, form: Form, start: Floats | None = None) -> FittedForm:
    """Best numbers of a form on some rows, from one start or from all of its own."""
    low, high = np.array(form.low), np.array(form.high)
    own_starts = [np.array([first, *rest]) for rest in form.starts for first in first_doses(part.path)]
    begins = [np.clip(each, low, high) for each in (own_starts if start is None else [start])]
    return min((descended(part, form, begin) for begin in begins), key=lambda fit: fit.misfit)


def descended(part: LawPart, form: Form, numbers: Floats) -> FittedForm:
    """Least misfit from one start, by damped Gauss-Newton steps within the ranges of the numbers.

    Reference: Marquardt (1963), J. SIAM 11, 431.
    """
    low, high, damping = np.array(form.low), np.array(form.high), FIRST_DAMPING
    residual, slopes = part.residual(form, numbers)
    misfit = float(residual @ residual)
    for _ in range(MOST_STEPS):
        gradient, matrix = slopes.T @ residual, slopes.T @ slopes
        held = ((numbers <= low) & (gradient > 0.0)) | ((numbers >= high) & (gradient < 0.0))
        gradient[held], matrix[held], matrix[:, held] = 0.0, 0.0, 0.0
        matrix[np.diag_indices(form.size)] += damping * np.diag(matrix) + TINY
        tried = np.clip(numbers - np.linalg.solve(matrix, gradient), low, high)
        left, moved = part.residual(form, tried)
        fall = misfit - float(left @ left)
        if fall > 0.0:
            numbers, residual, slopes, misfit = tried, left, moved, misfit - fall
            damping = max(damping * EASIER, LEAST_DAMPING)
        else:
            damping *= HARDER
        if abs(fall) < ENOUGH * (1.0 + misfit) or damping > MOST_DAMPING:
            break
    covariance = np.asarray(np.linalg.pinv(slopes.T @ slopes, hermitian=True), dtype=np.float64)
    return FittedForm(form, part.rows, numbers, misfit, covariance)


def first_doses(path: DosePath) -> tuple[float, ...]:
    """Doses at typical conditions from which a fit starts, to both sides where the range has both."""
    return tuple(dose for dose in (0.1 * path.high, 0.3 * path.low) if abs(dose) > 0.0)


Remake = Callable[[Floats, Floats, DosePath | None], LawRows | None]
"""(numbers, doses, path) -> rows about them on that path, moved there; without one, on an exact path."""


def settled_form(prepared: PreparedProblem, fit: FittedForm, remake: Remake) -> FittedForm:
    """The same form fitted to rows made anew until its calibrated numbers stay where they were made."""
    for _ in range(EXACT_ROUNDS):
        moved = moved_form(prepared, fit, remake)
        if moved is fit:
            break
        fit = refitted(moved, remake(moved.rows.path.x, moved.doses, None))
    return fit


def moved_form(prepared: PreparedProblem, fit: FittedForm, remake: Remake) -> FittedForm:
    """The same form on paths that are moved until its calibrated numbers stay; itself where they stay."""
    for _ in range(ROUNDS):
        rows = fit.rows
        x = next_numbers(prepared, rows.path, ridge(rows.columns, rows.residual(fit.doses)), STILL)
        made = None if x is None else remake(x, fit.doses, rows.path)
        if made is None:
            break
        fit = refitted(fit, made)
    return fit


def refitted(fit: FittedForm, rows: LawRows | None) -> FittedForm:
    """The same form fitted to other rows, from its numbers; itself without rows."""
    if rows is None:
        return fit
    return fitted_form(law_part(rows, np.ones(rows.target.size, dtype=np.bool_)), fit.form, fit.numbers)


def held_out_score(rows: LawRows, dose: Floats, inside: Bools, outside: Bools) -> tuple[float, float]:
    """Log score of some rows predicted from others at doses of all, and their squared whitened gaps."""
    residual = rows.residual(dose)
    own, other = rows.columns[inside], rows.columns[outside]
    inverse = np.linalg.inv(own.T @ own + np.eye(own.shape[1]))
    gap = residual[outside] - other @ (inverse @ (own.T @ residual[inside]))
    covariance = np.eye(gap.size) + other @ inverse @ other.T
    squares = float(gap @ np.linalg.solve(covariance, gap))
    return -0.5 * squares - 0.5 * float(np.linalg.slogdet(covariance)[1]), squares


def price(rows: LawRows, form: Form) -> float:
    """Ln score by which a form must be better than one without numbers."""
    return 0.5 * float(np.log(rows.target.size)) * form.size + (0.0 if form.name in POWERS else SIMPLE)


def ranked_forms(rows: LawRows, fits: Sequence[FittedForm], most: int) -> list[FittedForm]:
    """The best of fitted forms, by misfit and number of numbers."""
    return sorted(fits, key=lambda fit: 0.5 * fit.misfit + price(rows, fit.form))[:most]


def chosen_form(rows: LawRows, fits: Sequence[FittedForm], chosen: Bools) -> tuple[FittedForm, float]:
    """The form that predicts groups within some rows best, of forms fitted to them, and its score."""
    ranked = ranked_forms(rows, fits, KEPT)
    folds = [
        fold
        for fold in np.unique(rows.folds[chosen])
        if 0 < np.sum(chosen & (rows.folds == fold)) < chosen.sum()
    ]
    if len(folds) < 2:
        return ranked[0], float("nan")
    totals = np.array([-price(rows, fit.form) for fit in ranked])
    for fold in folds:
        outside = chosen & (rows.folds == fold)
        inside = chosen & ~outside
        nothing = held_out_score(rows, np.zeros(chosen.size), inside, outside)[0]
        for k, fit in enumerate(ranked):
            refit = fitted_form(law_part(fit.rows, inside), fit.form, fit.numbers)
            totals[k] += held_out_score(fit.rows, refit.doses, inside, outside)[0] - nothing
    top = int(np.argmax(totals))
    return ranked[top], float(totals[top]) + price(rows, ranked[top].form)


def fitted_forms(prepared: PreparedProblem, rows: LawRows, remake: Remake) -> list[FittedForm]:
    """All forms fitted to all rows, the best of them with calibrated numbers of their own."""
    part = law_part(rows, np.ones(rows.target.size, dtype=np.bool_))
    ranked = ranked_forms(rows, [fitted_form(part, form) for form in forms_of(rows.conditions)], SETTLED)
    return [settled_form(prepared, fit, remake) for fit in ranked]


def dose_law(
    prepared: PreparedProblem, rows: LawRows, remake: Remake
) -> tuple[FittedForm | None, DoseLaw | None]:
    """The law of the doses; None where there are too few rows."""
    everything = np.ones(rows.target.size, dtype=np.bool_)
    if everything.size < LEAST_ROWS:
        return None, None
    fits = fitted_forms(prepared, rows, remake)
    best, score = chosen_form(rows, fits, everything)
    share, stability = nested_share(rows, fits, best.form)
    excess = max(1.0, best.misfit / max(rows.target.size - best.form.size, 1))
    numbers = {
        name: estimate(float(best.numbers[k]), float(best.covariance[k, k]) * excess, best.form, k)
        for k, name in enumerate(best.form.names)
    }
    values = {name: f"{number.value:.3g}" for name, number in numbers.items()}
    exact = {name: f"PARAMS_{name}" for name in numbers}
    law = DoseLaw(
        form=best.form.name,
        expression=best.form.text.format(**values),
        conditions=best.form.conditions,
        numbers=numbers,
        exponents={condition: numbers[name] for condition, name in best.form.exponents.items()},
        score=score,
        held_out_share=share,
        stability=stability,
        python=best.form.python.format(**exact),
        points=tuple(law_points(rows, best)),
        curve=law_curve(rows, best, excess),
    )
    return best, law


def law_points(rows: LawRows, best: FittedForm) -> Iterator[tuple[dict[str, float], float]]:
    """Conditions at STEPS of their largest values, and the dose of the law there."""
    for step in STEPS:
        at = {name: float(f"{step * rows.conditions[name].max():.4g}") for name in best.form.conditions}
        columns = {name: np.array([value]) for name, value in at.items()}
        yield at, float(best.form.dose(columns, best.numbers)[0])


def law_table(best: FittedForm, conditions: Conditions) -> tuple[tuple[dict[str, float], float], ...]:
    """Every set of the conditions of a law in a table, and the dose of the law there."""
    names = best.form.conditions
    if not names:
        return (({}, float(best.numbers[0])),)
    sets = np.unique(np.column_stack([conditions[name] for name in names]), axis=0)
    sets = sets[np.all(np.isfinite(sets), axis=1)]
    dose = np.nan_to_num(best.form.dose({name: sets[:, k] for k, name in enumerate(names)}, best.numbers))
    at = [dict(zip(names, map(float, row), strict=True)) for row in sets]
    return tuple(zip(at, map(float, dose), strict=True))


def law_curve(rows: LawRows, best: FittedForm, excess: float) -> tuple[tuple[float, float, float], ...]:
    """A law of one condition between its least and largest value, with the standard error of its numbers."""
    if len(best.form.conditions) != 1:
        return ()
    (name,) = best.form.conditions
    column = rows.conditions[name]
    x = np.linspace(float(column.min()), float(column.max()), CURVE)

    def dose(numbers: Floats) -> Floats:
        return np.nan_to_num(best.form.dose({name: x}, numbers))

    steps = np.diag(STEP * np.maximum(np.abs(best.numbers), STEP))
    slopes = np.column_stack(
        [(dose(best.numbers + step) - dose(best.numbers - step)) / (2.0 * step.sum()) for step in steps]
    )
    variance = excess * np.einsum("ij,jk,ik->i", slopes, best.covariance, slopes)
    sd = np.sqrt(np.maximum(variance, 0.0))
    return tuple((float(a), float(b), float(c)) for a, b, c in zip(x, dose(best.numbers), sd, strict=True))


def estimate(value: float, variance: float, form: Form, index: int) -> Estimate:
    """A number with its 90 % interval, within its range."""
    half, low, high = QUANTILE * np.sqrt(max(variance, 0.0)), form.low[index], form.high[index]
    at_bound = min(value - low, high - value) < 1e-3 * (high - low)
    return Estimate(value, max(value - half, low), min(value + half, high), bool(at_bound))


def nested_share(rows: LawRows, fits: Sequence[FittedForm], best: Form) -> tuple[float, float]:
    """Share of left-out misfit explained by a form chosen without its rows; how often it is the same."""
    before = after = same = count = 0.0
    for fold in np.unique(rows.folds):
        outside = rows.folds == fold
        inside = ~outside
        if inside.sum() < LEAST_ROWS:
            continue
        refits = [fitted_form(law_part(fit.rows, inside), fit.form, fit.numbers) for fit in fits]
        chosen, _ = chosen_form(rows, refits, inside)
        before += held_out_score(rows, np.zeros(inside.size), inside, outside)[1]
        after += held_out_score(chosen.rows, chosen.doses, inside, outside)[1]
        same += chosen.form.name == best.name and chosen.form.conditions == best.conditions
        count += 1.0
    if count == 0.0 or before <= 0.0:
        return float("nan"), float("nan")
    return 1.0 - after / before, same / count
