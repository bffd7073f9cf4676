"""The law that the doses of a mechanism follow, fitted to the rows themselves.

    y = G M(w(a)) (1, v) + B s + e,   w = ln(1 + dose(conditions, a)),   v, s, e ~ N(0, 1)

with y the whitened rows, a the numbers of a form, M (n, 1 + p) the mean of the model along the dose, linear
in the calibrated numbers v, G its whitening, and B all errors in common with the scales of the mechanism's
fit; its smooth prior of doses is left out. v is at its best for every a. Forms are ranked by

    sum over folds of ln N(rows left out | other rows, a fitted to these) - 1/2 ln n for every number,

with one step less for a form that is no power; one whose doses leave the range of the mechanism is none. The
best have means and slopes of their own. The share of
misfit that is told comes from groups that the fit has not seen, but the choice of the form has. Intervals
follow from (D^T D)^-1, D the slopes of the whitened residual along a, widened by the misfit that is left.

References: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413 (linear unknowns eliminated); Schwarz (1978),
Ann. Stat. 6, 461 (price of a number); Stone (1974), J. R. Stat. Soc. B 36, 111 (cross-validation).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import scipy

from taichi_erosion.evidence.data.problem import Bools, Conditions, Floats, Integers
from taichi_erosion.evidence.models.run_store import BudgetSpentError
from taichi_erosion.evidence.race.decision import Decision, fit_of_decision
from taichi_erosion.evidence.race.doses import STILL, Dosing, dose_to_axis, dosing_of_fit
from taichi_erosion.evidence.race.fit import Fit, Race, axis_to_dose
from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.race.priors import CARRIED, DRAWS, PRIORS, SEED
from taichi_erosion.mechanisms.dose_forms import POWERS, Form, allowed_forms

FOLDS = 6  # of the groups, at most
ROUNDS = 3  # expansions of a form about its own mean
NODES = 8  # doses of the table, over the whole range and again over that of the fit


@dataclass(frozen=True)
class LawRows:
    """Rows about some numbers and doses, linear in everything but the doses."""

    conditions: Conditions
    folds: Integers  # (n,)
    curve: "scipy.interpolate.PPoly"  # M of w
    offset: Floats  # (n, 1 + p), of M, so that it is exact about these numbers and doses
    y: Floats
    gain: Floats  # G (n, n)
    variance: Floats  # 1 + B B^T

    def linearise(self, w: Floats) -> Floats:
        """Residual at v = 0 and minus slopes along v (n, 1 + p), at doses of all rows."""
        slopes = self.gain @ (curve_at_doses(self.curve, w) + self.offset)
        slopes[:, 0] = self.y - slopes[:, 0]
        return slopes

    def held_out_fold_density(self, w: Floats, outside: Bools) -> Floats:
        """Ln density of rows outside given all others, and their misfit."""
        linear, densities = self.linearise(w), []
        variance = self.variance + linear[:, 1:] @ linear[:, 1:].T
        for k in (np.ones_like(outside), ~outside):
            root = scipy.linalg.cholesky(variance[np.ix_(k, k)], lower=True)
            misfit = float(np.sum(scipy.linalg.solve_triangular(root, linear[k, 0], lower=True) ** 2))
            densities.append([-0.5 * misfit - float(np.sum(np.log(np.diag(root)))), misfit])
        return np.subtract(*densities)


@dataclass(frozen=True)
class FittedForm:
    form: Form
    rows: LawRows
    selection: Bools
    numbers: Floats
    misfit: float
    covariance: Floats  # of the numbers

    @cached_property
    def whitener(self) -> Floats:
        """Inverse root of the variance of the rows."""
        variance = self.rows.variance[np.ix_(self.selection, self.selection)]
        return np.linalg.inv(scipy.linalg.cholesky(variance, lower=True))

    @property
    def complexity_penalty(self) -> float:
        """Ln score by which the form must be better than one without numbers."""
        rare = self.form.name not in POWERS
        return 0.5 * np.log(self.rows.y.size) * self.numbers.size - np.log(PRIORS.step) * rare

    @property
    def bounds(self) -> tuple[Floats, Floats]:
        return np.array([-np.inf, *self.form.low]), np.array([np.inf, *self.form.high])

    def doses(self, numbers: Floats | None = None) -> Floats:
        """Doses of all rows, on their axis, by default for the best numbers."""
        numbers = self.numbers if numbers is None else numbers
        return dose_to_axis(self.form.dose(self.rows.conditions, numbers))

    def best_numbers(self, numbers: Floats) -> tuple[Floats, Floats]:
        """Best v for some numbers, and the residual with its prior."""
        white = self.whitener @ self.rows.linearise(self.doses(numbers))[self.selection]
        r, slopes = white[:, 0], white[:, 1:]
        v = scipy.linalg.solve(slopes.T @ slopes + np.eye(slopes.shape[1]), slopes.T @ r)
        return v, np.concatenate([r - slopes @ v, v])

    def fit_numbers(self, starts: Sequence[Floats]) -> "FittedForm":
        """The form with least misfit, from the best of some starts."""
        ends, enough = self.bounds, 1e-5  # relative change of misfit and numbers, far below their errors
        search = partial(scipy.optimize.least_squares, bounds=ends, x_scale="jac", ftol=enough, xtol=enough)
        fits = [search(lambda a: self.best_numbers(a)[1], start.clip(*ends)) for start in starts]
        best = min(fits, key=lambda each: each.cost)
        covariance = np.linalg.pinv(best.jac.T @ best.jac, hermitian=True)
        return replace(self, numbers=best.x, misfit=2.0 * best.cost, covariance=covariance)

    def refit_to_rows(self, rows: LawRows, chosen: Bools) -> "FittedForm":
        return replace(self, rows=rows, selection=chosen).fit_numbers([self.numbers])

    def draw_numbers(self) -> Floats:
        """Draws (m, k) of the numbers within their range."""
        excess = max(1.0, self.misfit / (self.rows.y.size - self.numbers.size))
        random = np.random.default_rng(SEED)
        return random.multivariate_normal(self.numbers, excess * self.covariance, DRAWS).clip(*self.bounds)


Law = tuple[str, FittedForm, float]  # mechanism, form, share of the misfit left out that it explains


def dose_law_of_decision(posterior: Posterior, decision: Decision) -> Law | None:
    """The law of the doses of a mechanism that is told; None without one, or where the budget is spent."""
    if not decision.acting_mechanisms:
        return None
    try:
        return dose_law_of_fit(posterior.race, fit_of_decision(posterior, decision))
    except BudgetSpentError:
        return None


def dose_law_of_fit(race: Race, fit: Fit) -> Law | None:
    """Law of the mechanism of a fit; None without one, with two or with few rows. Raises BudgetSpentError."""
    if fit.dose is None or len(fit.row_doses_of) > 1 or fit.mean.size < FOLDS:
        return None
    dosing = dosing_of_fit(race, fit, fit.dose.factor)
    curve = tabulate_model_over_dose(dosing, fit.v, fit.w)
    slopes = curve_at_doses(curve, fit.w)[:, 1:]
    rows = law_rows_about_fit(race, fit, curve, fit.v, fit.w, fit.mean, slopes)
    first = [fit_form_to_all_rows(rows, form, fit.w) for form in allowed_forms(rows.conditions)]
    first.sort(key=lambda each: 0.5 * each.misfit + each.complexity_penalty)
    settled = [converge_form(race, dosing, fit, each) for each in first[:CARRIED]]
    low, high = dosing.dose_range_on_axis + np.array([[-STILL], [STILL]])
    settled = [each for each in settled if np.all((low < each.doses()) & (each.doses() < high))]
    if not settled:
        return None
    scores, misfits = np.array([cross_validation_density(each.rows, each) for each in settled]).T
    best = int(np.argmax(scores - [each.complexity_penalty for each in settled]))
    nothing = cross_validation_density(rows)[1]
    return "+".join(fit.hypothesis.extra), settled[best], float(1.0 - misfits[best] / nothing)


def tabulate_model_over_dose(dosing: Dosing, v: Floats, w: Floats) -> "scipy.interpolate.PPoly":
    """M along one dose for all rows, with slopes at the ends of the range, of doses and at 0."""
    low, top = dosing.dose_range_on_axis[:, 0]
    ends = np.unique(np.clip([low, w.min(), 0.0, w.max(), top], low, top).round(2))
    near = np.linspace(ends[1], ends[-2], NODES)
    nodes = np.unique(np.concatenate([ends, np.linspace(low, top, NODES), near]).round(2))
    table = np.array([dosing.clip_doses_and_predict(v, np.full(w.size, node))[1] for node in nodes])
    good = np.all(np.isfinite(table), axis=1)
    nodes, table = nodes[good], table[good]
    ends = ends[np.isin(ends, nodes)]
    bent = [dosing.number_slopes(v, np.full(w.size, end), table[nodes == end][0]) for end in ends]
    bent = scipy.interpolate.PchipInterpolator(ends, bent, axis=0)(nodes)
    both = np.concatenate([(table - bent @ v)[..., np.newaxis], bent], axis=2)
    return scipy.interpolate.PchipInterpolator(nodes, both, axis=0)


def curve_at_doses(curve: "scipy.interpolate.PPoly", w: Floats) -> Floats:
    """M (n, 1 + p) of rows with a dose of its own each, held within the table."""
    inside = np.clip(w, curve.x[0], curve.x[-1])
    piece = np.clip(np.searchsorted(curve.x, inside, side="right") - 1, 0, curve.x.size - 2)
    a, b, c, d = curve.c[:, piece, np.arange(w.size)]
    t = (inside - curve.x[piece])[:, np.newaxis]
    return ((a * t + b) * t + c) * t + d


def law_rows_about_fit(
    race: Race, fit: Fit, curve: "scipy.interpolate.PPoly", v: Floats, w: Floats, mean: Floats, slopes: Floats
) -> LawRows:
    """Rows with M exact at v and w, of mean (n,) and slopes (n, p), and the errors of the evidence of a fit.

    Rows of one group share a fold; of one set of conditions, where groups are few.
    """
    p, now = race.prepared, fit.evidence.solution
    labels = np.array(p.rows.group)
    if np.unique(labels).size < FOLDS // 2:
        labels = np.array([repr(each) for each in zip(*p.rows.conditions.values(), strict=True)])
    folds = np.unique(labels, return_inverse=True)[1] % FOLDS
    work, root = p.working_residuals(mean), np.sqrt(now.inverse_variance_of_rows)
    shared = now.rows.block != len(fit.blocks) - 1
    shared[: fit.v.size] = False
    columns = root[:, np.newaxis] * (now.rows.columns * now.tau)[:, shared]
    gain = (root * work.weight)[:, np.newaxis] * p.whiten(np.eye(root.size))
    offset = np.column_stack([mean - slopes @ v, slopes]) - curve_at_doses(curve, w)
    y, variance = root * work.residual + gain @ mean, np.eye(root.size) + columns @ columns.T
    return LawRows(p.rows.conditions, folds, curve, offset, y, gain, variance)


def fit_form_to_all_rows(rows: LawRows, form: Form, w: Floats) -> FittedForm:
    """A form fitted to all rows, from the numbers nearest to some doses."""
    dose, starts = axis_to_dose(w), []
    for rest in form.starts:
        shape = form.dose(rows.conditions, np.array([1.0, *rest]))
        starts.append(np.array([float(shape @ dose / (shape @ shape or 1.0)), *rest]))  # 0 where it vanishes
    everything, size = np.ones(w.size, dtype=np.bool_), starts[0].size
    return FittedForm(form, rows, everything, starts[0], np.inf, np.eye(size)).fit_numbers(starts)


def converge_form(race: Race, dosing: Dosing, fit: Fit, each: FittedForm) -> FittedForm:
    """The form with rows made anew about its own numbers and doses, until they stay."""
    v, w = fit.v, fit.w
    for _ in range(ROUNDS):
        before, (v, _) = (v, w), each.best_numbers(each.numbers)
        w, mean = dosing.clip_doses_and_predict(v, each.doses())
        move = max(np.max(np.abs(v - before[0]), initial=0.0), np.max(np.abs(w - before[1])))
        if move < STILL or not np.all(np.isfinite(mean)):
            break
        slopes = dosing.number_slopes(v, w, mean)
        rows = law_rows_about_fit(race, fit, each.rows.curve, v, w, mean, slopes)
        each = each.refit_to_rows(rows, each.selection)
    return each


def cross_validation_density(rows: LawRows, fit: FittedForm | None = None) -> Floats:
    """Ln density of every fold given the others with a form fitted to these, and its misfit, summed."""
    errors = np.zeros(2)
    for fold in np.unique(rows.folds):
        outside = rows.folds == fold
        w = np.zeros(outside.size) if fit is None else fit.refit_to_rows(rows, ~outside).doses()
        errors += rows.held_out_fold_density(w, outside)
    return errors
