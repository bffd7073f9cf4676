"""The law that the doses of a mechanism follow, fitted to the rows themselves.

    y = G c(w(a)) + B s + e,   w = ln(1 + dose(conditions, a)),   s, e ~ N(0, 1),   V = 1 + B B^T

with y the whitened rows, a the numbers of a form, c the change of every row along the dose, G its whitening,
and B the calibrated numbers and all errors in common, with the scales of the mechanism's fit; its smooth prior
of doses is left out. |r|^2 = r^T V^-1 r, r = y - G c, is least for a. Forms are ranked by

    sum over folds of ln N(rows left out | other rows, a fitted to these) - 1/2 ln n for every number,

less SIMPLE for a form that is no power. The best of them have numbers, means and slopes of their own. The
share of misfit that is told comes from groups that neither the fit nor the choice of the form has seen.
Intervals follow from (S^T V^-1 S)^-1, S the slopes of G c along a, widened by the misfit that is left.

References: Golub & Pereyra (1973), SIAM J. Numer. Anal. 10, 413 (linear unknowns eliminated); Schwarz (1978),
Ann. Stat. 6, 461 (price of a number); Varma & Simon (2006), BMC Bioinformatics 7, 91 (nested validation).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import interpolate, linalg, optimize

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows
from taichi_erosion.evidence.data.problem import Bools, Conditions, Floats, Integers
from taichi_erosion.evidence.race.dose_forms import POWERS, Form, forms_of
from taichi_erosion.evidence.race.doses import Doser, dosers, from_axis, to_axis
from taichi_erosion.evidence.race.record import Interval, LawPart
from taichi_erosion.evidence.race.search import FAR, Fit, Race

SIMPLE = 1.0  # ln score by which a form that is no power must be better: powers are the laws of most forces
LEAST_ROWS = 6  # twice as many as a form has numbers
FOLDS = 6  # of the groups, at most
SETTLED, ROUNDS = 5, 3  # forms with numbers of their own, and expansions of each: 75 settings for four numbers
COARSE, FINE = 7, 9  # doses at which the rows are tabulated: over the whole range, and over that of the fit
STILL = 0.02  # of w, and of a number in prior sd
DRAWS, SEED = 1000, 0  # of the numbers, for intervals of doses


@dataclass(frozen=True)
class LawRows:
    """Rows about some numbers and doses, linear in everything but the doses."""

    conditions: Conditions
    folds: Integers  # (n,)
    curve: interpolate.PPoly  # c, of w
    y: Floats
    gain: Floats  # G (n, n)
    columns: Floats  # B (n, q), calibrated numbers first
    variance: Floats  # V

    def residual(self, w: Floats) -> Floats:
        """r at doses of all rows."""
        return self.y - self.gain @ along(self.curve, w)

    def log_density(self, r: Floats, chosen: Bools) -> tuple[float, float]:
        """Ln density of some rows at doses of all, and their misfit."""
        root = self.root(chosen)
        misfit = float(np.sum(linalg.solve_triangular(root, r[chosen], lower=True) ** 2))
        return -0.5 * misfit - float(np.sum(np.log(np.diag(root)))), misfit

    def root(self, chosen: Bools) -> Floats:
        """Cholesky factor of the covariance of some rows."""
        return linalg.cholesky(self.variance[np.ix_(chosen, chosen)], lower=True)

    def left_out(self, w: Floats, inside: Bools, outside: Bools) -> Floats:
        """Ln density of rows outside given those inside, and their misfit."""
        r = self.residual(w)
        return np.subtract(self.log_density(r, inside | outside), self.log_density(r, inside))


@dataclass(frozen=True)
class FittedForm:
    """A form fitted to some rows."""

    form: Form
    rows: LawRows
    numbers: Floats
    misfit: float
    covariance: Floats  # of the numbers

    @property
    def w(self) -> Floats:
        """Doses of all rows, on their axis."""
        return on_axis(self.form.dose(self.rows.conditions, self.numbers))

    @property
    def price(self) -> float:
        """Ln score by which the form must be better than one without numbers."""
        return 0.5 * np.log(self.rows.y.size) * self.numbers.size + SIMPLE * (self.form.name not in POWERS)


def law_of(race: Race, fit: Fit) -> LawPart | None:
    """The law of the mechanism of a fit; None with too few rows. Raises BudgetSpentError."""
    if fit.dose is None or fit.mean.size < LEAST_ROWS:
        return None
    doser = next(each for each in dosers(race) if each.name == fit.hypothesis.beyond.partition("|")[0])
    rows = rows_about(race, fit, tabulated(race, doser, fit))
    everything = np.ones(rows.y.size, dtype=np.bool_)
    first = [fitted(rows, form, starts_of(form, rows, fit), everything) for form in forms_of(rows.conditions)]
    first.sort(key=lambda each: 0.5 * each.misfit + each.price)
    settled = [settled_form(race, doser, fit, each) for each in first[:SETTLED]]
    best = settled[chosen_form(settled, everything)]
    return told(doser.name, best, held_out_share(rows, settled))


def tabulated(race: Race, doser: Doser, fit: Fit) -> interpolate.PPoly:
    """Mean of the rows along one dose for all, at the numbers of a fit."""
    low, top, w = to_axis(doser.low), doser.top, np.clip(fit.dose.w, to_axis(doser.low), doser.top)
    nodes = np.concatenate([[0.0], np.linspace(low, top, COARSE), np.linspace(w.min(), w.max(), FINE)])
    nodes = np.unique(np.round(nodes, 2).clip(low, top))
    table = np.array([doser.at(race, fit.v, np.full(w.size, node))[1] for node in nodes])
    good = np.all(np.isfinite(table), axis=1)
    return interpolate.PchipInterpolator(nodes[good], table[good], axis=0)


def along(curve: interpolate.PPoly, w: Floats) -> Floats:
    """Value of every row at a dose of its own, held within the table."""
    held = np.clip(w, curve.x[0], curve.x[-1])
    piece = np.clip(np.searchsorted(curve.x, held, side="right") - 1, 0, curve.x.size - 2)
    a, b, c, d = curve.c[:, piece, np.arange(w.size)]
    t = held - curve.x[piece]
    return ((a * t + b) * t + c) * t + d


def on_axis(dose: Floats) -> Floats:
    """Doses on their axis."""
    return np.where(dose > 0.0, np.log1p(np.maximum(dose, 0.0)), dose)


def fold_numbers(rows: ComparisonRows) -> Integers:
    """Fold of each row: rows of one group, or of one set of conditions where groups are few, stay together."""
    labels = np.array(rows.group)
    if np.unique(labels).size < FOLDS // 2:
        labels = np.array([repr(each) for each in zip(*rows.conditions.values(), strict=True)])
    return np.unique(labels, return_inverse=True)[1] % FOLDS


def rows_about(race: Race, fit: Fit, curve: interpolate.PPoly) -> LawRows:
    """Rows exact at the numbers and doses of a fit, with the scales and bad rows of its evidence."""
    p, now, d = race.prepared, fit.evidence.solved, fit.v.size
    work, root = p.working(fit.mean), np.sqrt(now.row_share)
    shared = now.rows.block != len(fit.blocks) - 1
    shared[:d] = False
    slopes = p.white(fit.jacobian) * work.weight[:, np.newaxis]
    columns = root[:, np.newaxis] * np.hstack([slopes, (now.rows.columns * now.tau)[:, shared]])
    gain = (root * work.weight)[:, np.newaxis] * p.white(np.eye(root.size))
    y = root * (work.residual + slopes @ fit.v) + gain @ along(curve, fit.dose.w)
    variance = np.eye(y.size) + columns @ columns.T
    return LawRows(p.rows.conditions, fold_numbers(p.rows), curve, y, gain, columns, variance)


def starts_of(form: Form, rows: LawRows, fit: Fit) -> list[Floats]:
    """Numbers from which a form is fitted, nearest to the doses of a fit."""
    dose = np.array([from_axis(w) for w in fit.dose.w])
    shapes = [form.shape(rows.conditions, np.array(rest)) for rest in form.starts]
    first = [float(shape @ dose / max(shape @ shape, 1e-12)) for shape in shapes]
    return [np.array([a, *rest]) for a, rest in zip(first, form.starts, strict=True)]


def fitted(rows: LawRows, form: Form, starts: Sequence[Floats], chosen: Bools) -> FittedForm:
    """Least misfit of a form on some rows, from the best of some starts."""
    root, ends = rows.root(chosen), (np.array([-np.inf, *form.low]), np.array([np.inf, *form.high]))

    def residual(numbers: Floats) -> Floats:
        r = rows.residual(on_axis(form.dose(rows.conditions, numbers)))
        return linalg.solve_triangular(root, r[chosen], lower=True)

    fits = [
        optimize.least_squares(residual, np.clip(start, *ends), bounds=ends, x_scale="jac", max_nfev=40)
        for start in starts
    ]
    best = min(fits, key=lambda each: each.cost)
    return FittedForm(form, rows, best.x, 2.0 * best.cost, np.linalg.pinv(best.jac.T @ best.jac, hermitian=True))


def settled_form(race: Race, doser: Doser, fit: Fit, each: FittedForm) -> FittedForm:
    """The form with rows made anew about its own numbers and doses, until they stay."""
    everything = np.ones(each.rows.y.size, dtype=np.bool_)
    for _ in range(ROUNDS):
        rows, w = each.rows, each.w
        pull = linalg.cho_solve((rows.root(everything), True), rows.residual(w))
        v = fit.v + np.clip((rows.columns.T @ pull)[: fit.v.size] - fit.v, -FAR, FAR)
        move = max(np.max(np.abs(v - fit.v), initial=0.0), np.max(np.abs(w - fit.dose.w)))
        moved = expanded(race, doser, fit, v, w)
        if move < STILL or not np.all(np.isfinite(moved.mean)):
            break
        fit = moved
        each = fitted(rows_about(race, fit, rows.curve), each.form, [each.numbers], everything)
    return each


def expanded(race: Race, doser: Doser, fit: Fit, v: Floats, w: Floats) -> Fit:
    """The fit at other numbers and doses."""
    held, mean = doser.at(race, v, w)
    jacobian = fit.jacobian.copy()
    for j in range(v.size):
        h = np.zeros(v.size)
        h[j] = -0.1 if v[j] > 0.0 else 0.1
        jacobian[:, j] = np.nan_to_num((doser.at(race, v + h, held)[1] - mean) / h[j])
    return replace(fit, v=v, mean=mean, jacobian=jacobian, dose=replace(fit.dose, w=held))


def chosen_form(fits: Sequence[FittedForm], chosen: Bools) -> int:
    """Which form predicts groups within some rows best from the others."""
    totals, folds = np.array([-each.price for each in fits]), fits[0].rows.folds
    for fold in np.unique(folds[chosen]):
        outside = chosen & (folds == fold)
        inside = chosen & ~outside
        totals += [left_out_by(each, inside, outside)[0] for each in fits]
    return int(np.argmax(totals))


def left_out_by(each: FittedForm, inside: Bools, outside: Bools) -> Floats:
    """Ln density of rows outside by a form fitted to those inside, and their misfit."""
    return each.rows.left_out(fitted(each.rows, each.form, [each.numbers], inside).w, inside, outside)


def held_out_share(rows: LawRows, fits: Sequence[FittedForm]) -> float:
    """Share of the misfit of left-out groups that a form explains which was chosen without them."""
    before = after = 0.0
    for fold in np.unique(rows.folds):
        outside = rows.folds == fold
        before += rows.left_out(np.zeros(outside.size), ~outside, outside)[1]
        after += left_out_by(fits[chosen_form(fits, ~outside)], ~outside, outside)[1]
    return float(1.0 - after / before)


def told(mechanism: str, best: FittedForm, share: float) -> LawPart:
    """The law with its intervals: of numbers by their covariance, of doses by draws of them."""
    form, conditions = best.form, best.rows.conditions
    covariance = best.covariance * max(1.0, best.misfit / (best.rows.y.size - best.numbers.size))
    low, high = np.array([-np.inf, *form.low]), np.array([np.inf, *form.high])
    draws = np.random.default_rng(SEED).multivariate_normal(best.numbers, covariance, DRAWS).clip(low, high)
    half = 1.645 * np.sqrt(np.diag(covariance))
    ends = np.clip([best.numbers - half, best.numbers + half], low, high).T
    names = ("a", *form.names)
    numbers = {n: Interval(float(x), *map(float, e)) for n, x, e in zip(names, best.numbers, ends, strict=True)}
    values = {name: f"{each.value:.3g}" for name, each in numbers.items()}
    at = [dict(zip(form.conditions, row, strict=True)) for row in sets_of(conditions, form.conditions)]
    columns = {name: np.array([each[name] for each in at]) for name in form.conditions} or {"": np.zeros(1)}
    spread = np.quantile([form.dose(columns, each) for each in draws], (0.05, 0.95), axis=0)
    doses = zip(form.dose(columns, best.numbers), *spread, strict=True)
    return LawPart(
        mechanism,
        form.conditions,
        form.name,
        form.text.format(**values),
        form.python.format(**values),
        numbers,
        {condition: numbers[name] for condition, name in form.exponents.items()},
        tuple((each, Interval(*map(float, dose))) for each, dose in zip(at, doses, strict=True)),
        share,
    )


def sets_of(conditions: Conditions, names: Sequence[str]) -> list[tuple[float, ...]]:
    """Different values of some conditions together."""
    return sorted(set(zip(*(map(float, conditions[name]) for name in names), strict=True))) if names else [()]
