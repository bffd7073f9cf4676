"""The law that the doses of a mechanism follow, chosen by nested cross-validation over groups of rows.

A law is fitted to the rows themselves, through the path of the mechanism, with the calibrated numbers and
shared errors at their best: this is what the doses with their covariance say, without the prior that smooths
them. Forms are ranked by their log score on left-out groups, less 1/2 ln n for every number (Schwarz); the
share of misfit that is told comes from groups that neither the fit nor the choice of the form has seen.

Reference: Varma & Simon (2006), BMC Bioinformatics 7, 91 (nested cross-validation); Schwarz (1978), Ann.
Stat. 6, 461 (price of a number).
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy import stats

from taichi_erosion.evidence.data.findings import Estimate
from taichi_erosion.evidence.data.mechanism_findings import DoseLaw
from taichi_erosion.evidence.data.problem import Bools, Conditions, Floats
from taichi_erosion.evidence.inference.doses.dose_forms import GROUPS, Form, forms_of
from taichi_erosion.evidence.inference.doses.law_fit import (
    FittedForm,
    LawRows,
    Remake,
    fitted_form,
    law_part,
    settled_form,
)
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

SIMPLE = 1.0  # the same of a form that is neither a power nor a constant
POWERS = ("constant", "power", *GROUPS)  # forms that are taken where others are hardly better
SETTLED = 8  # forms that get calibrated numbers of their own, after a first fit to all rows
KEPT = 6  # forms that are cross-validated, after their fit to all rows at hand
QUANTILE = float(stats.norm.ppf(0.95))  # half width of a 90 % interval, in sd
LEAST_ROWS = 6
CURVE = 33  # values of a condition at which a law is drawn
STEP = 1e-3  # of a number, for the slope of a law along it
STEPS = (1.0, 0.6, 0.35, 1.7)  # conditions at which a law is stated, over their largest values [1]


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
