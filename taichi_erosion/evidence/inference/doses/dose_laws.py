"""The law that the doses of a mechanism follow, chosen by nested cross-validation over groups of rows.

A law is fitted to the rows themselves, through the path of the mechanism, with the calibrated numbers and
shared errors at their best: this is what the doses with their covariance say, without the prior that smooths
them. Forms are ranked by their log score on left-out groups, less 1/2 ln n for every number (Schwarz); the
share of misfit that is told comes from groups that neither the fit nor the choice of the form has seen.

Reference: Varma & Simon (2006), BMC Bioinformatics 7, 91 (nested cross-validation); Schwarz (1978), Ann.
Stat. 6, 461 (price of a number).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from taichi_erosion.evidence.data.findings import Estimate
from taichi_erosion.evidence.data.mechanism_findings import DoseLaw
from taichi_erosion.evidence.data.problem import Bools, Conditions, Floats, Integers
from taichi_erosion.evidence.inference.cross_validation import fold_numbers
from taichi_erosion.evidence.inference.doses.dose_forms import GROUPS, Form, forms_of
from taichi_erosion.evidence.inference.doses.dose_inference import DoseEvidence
from taichi_erosion.evidence.inference.doses.dose_path import DosePath
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

SIMPLE = 1.0  # the same of a form that is neither a power nor a constant
POWERS = ("constant", "power", *GROUPS)  # forms that are taken where others are hardly better
FOLDS = 6  # of the groups, at most
KEPT = 6  # forms that are cross-validated, after their fit to all rows at hand
QUANTILE = float(stats.norm.ppf(0.95))  # half width of a 90 % interval, in sd
LEAST_ROWS = 6
CURVE = 33  # values of a condition at which a law is drawn
STEP = 1e-3  # of a number, for the slope of a law along it
MOST_STEPS = 20  # of one fit
STEPS = (1.0, 0.6, 0.35, 1.7)  # conditions at which a law is stated, over their largest values [1]


@dataclass(frozen=True)
class LawRows:
    """Rows at the best doses: working residuals, and the linear model of the calibrated numbers."""

    path: DosePath
    conditions: Conditions
    target: Floats  # (n,), whitened: what dose and calibrated numbers have to explain
    scale: Floats  # (n,), whitening factor
    columns: Floats  # (n, p + q), whitened, unit priors
    folds: Integers  # (n,)

    def residual(self, dose: Floats) -> Floats:
        """Whitened residual at doses of all rows, calibrated numbers at their prior mean."""
        return self.target - self.scale * self.path.change(dose)[0]


@dataclass(frozen=True)
class FittedForm:
    """A form fitted to some rows."""

    form: Form
    numbers: Floats
    misfit: float  # of these rows, priors of calibrated numbers included
    covariance: Floats  # of the numbers


def law_rows(prepared: PreparedProblem, evidence: DoseEvidence) -> LawRows:
    """Rows for laws of one mechanism; a censored row stands as an ordinary one with its working residual."""
    path, fit = evidence.path, evidence.best
    scale = fit.work.weight / prepared.sd
    columns = fit.columns[:, : fit.columns.shape[1] - fit.prior.factor.shape[1]]
    change = scale * path.change(fit.doses[evidence.sets.index])[0]
    target = fit.work.residual + columns @ fit.theta[: columns.shape[1]] + change
    folds = fold_numbers(prepared) % FOLDS
    return LawRows(path, prepared.rows.conditions, target, scale, columns, folds)


def projector(columns: Floats) -> Floats:
    """Square root of (1 + B B^T)^-1: whitens a residual with the calibrated numbers integrated out."""
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    return np.eye(columns.shape[0]) + left @ np.diag(1.0 / np.sqrt(1.0 + values**2) - 1.0) @ left.T


def fitted_form(rows: LawRows, form: Form, chosen: Bools, start: Floats | None = None) -> FittedForm:
    """Best numbers of a form on some rows, from one start or from all of its own."""
    whiten = projector(rows.columns[chosen])
    own = {name: column[chosen] for name, column in rows.conditions.items()}
    spread = np.zeros(rows.target.size)

    def misfit(numbers: Floats) -> Floats:
        spread[chosen] = np.nan_to_num(form.dose(own, numbers), posinf=1e6, neginf=-1e6)
        return whiten @ rows.residual(spread)[chosen]

    low, high = np.array(form.low), np.array(form.high)
    own_starts = [np.array([first, *rest]) for rest in form.starts for first in first_doses(rows.path)]
    begins = [np.clip(each, low + 1e-9, high - 1e-9) for each in (own_starts if start is None else [start])]
    found = [
        optimize.least_squares(misfit, begin, bounds=(low, high), x_scale=scales(form), max_nfev=MOST_STEPS)
        for begin in begins
    ]
    best = min(found, key=lambda each: each.cost)
    hessian = best.jac.T @ best.jac
    covariance = np.linalg.pinv(hessian, hermitian=True)
    return FittedForm(form, best.x, 2.0 * float(best.cost), covariance)


def first_doses(path: DosePath) -> tuple[float, ...]:
    """Doses at typical conditions from which a fit starts, to both sides where the range has both."""
    return tuple(dose for dose in (0.1 * path.high, 0.3 * path.low) if abs(dose) > 0.0)


def scales(form: Form) -> Floats:
    """Typical size of every number."""
    return np.array([1.0, *(max(abs(value), 1e-6) for value in form.starts[0])])


def held_out_score(
    rows: LawRows, fitted: FittedForm | None, inside: Bools, outside: Bools
) -> tuple[float, float]:
    """Log score of some rows predicted from others, and their squared whitened gaps; None: without doses."""
    dose = np.zeros(rows.target.size)
    if fitted is not None:
        dose = law_doses(rows, fitted)
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


def ranked_forms(rows: LawRows, fits: Sequence[FittedForm]) -> list[FittedForm]:
    """The best of fitted forms, by misfit and number of numbers."""
    fits = list(fits)
    fits.sort(key=lambda fit: 0.5 * fit.misfit + price(rows, fit.form))
    return fits[:KEPT]


def chosen_form(rows: LawRows, fits: Sequence[FittedForm], chosen: Bools) -> tuple[FittedForm, float]:
    """The form that predicts groups within some rows best, of forms fitted to them, and its score."""
    ranked = ranked_forms(rows, fits)
    folds = [
        fold
        for fold in np.unique(rows.folds[chosen])
        if 0 < np.sum(chosen & (rows.folds == fold)) < chosen.sum()
    ]
    if len(folds) < 2:
        return ranked[0], float("nan")
    totals = []
    for fit in ranked:
        total = -price(rows, fit.form)
        for fold in folds:
            outside = chosen & (rows.folds == fold)
            inside = chosen & ~outside
            refit = fitted_form(rows, fit.form, inside, fit.numbers)
            total += held_out_score(rows, refit, inside, outside)[0]
            total -= held_out_score(rows, None, inside, outside)[0]
        totals.append(total)
    top = int(np.argmax(totals))
    return ranked[top], float(totals[top]) + price(rows, ranked[top].form)


def law_doses(rows: LawRows, fitted: FittedForm) -> Floats:
    """Doses of a law in all rows."""
    return np.nan_to_num(fitted.form.dose(rows.conditions, fitted.numbers), posinf=1e6, neginf=-1e6)


def dose_law(rows: LawRows) -> tuple[FittedForm | None, DoseLaw | None]:
    """The law of the doses; None where there are too few rows."""
    everything = np.ones(rows.target.size, dtype=np.bool_)
    if everything.size < LEAST_ROWS:
        return None, None
    fits = [fitted_form(rows, form, everything) for form in forms_of(rows.conditions)]
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
        refits = [fitted_form(rows, fit.form, inside, fit.numbers) for fit in fits]
        chosen, _ = chosen_form(rows, refits, inside)
        before += held_out_score(rows, None, inside, outside)[1]
        after += held_out_score(rows, chosen, inside, outside)[1]
        same += chosen.form.name == best.name and chosen.form.conditions == best.conditions
        count += 1.0
    if count == 0.0 or before <= 0.0:
        return float("nan"), float("nan")
    return 1.0 - after / before, same / count
