"""Analysis of variance: which terms matter, lack of fit, curvature, reduction, effects and limits.

Type III sums of squares, F = (SS / df) / (SS_error / df_error). The error splits into

    pure error     SS = sum over points of sum (y - mean at the point)^2
    lack of fit    SS = SS_error - SS of pure error

Backward elimination removes insignificant terms one at a time. A term stays as long as one of its products or
powers is in the model: A B keeps A and B, A^2 keeps A, because otherwise the model would change with the
origin of the coded units. Effects of a two-level design, and sizes beyond which they are significant:

    effect = mean at high - mean at low = 2 b
    t limit            t(0.975, df)
    Bonferroni limit   t(1 - 0.025 / m, df)  for m effects

Reference: Montgomery (2017), Design and Analysis of Experiments, 9th ed., 5.3, 6.8, 11.2 and ch. 6.
"""

from dataclasses import dataclass, replace
from math import inf, nan

import numpy as np
from scipy import stats
from statsmodels.regression.linear_model import OLS

from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments.design import SAME_POINT
from taichi_erosion.experiments.fit import EXACT, Fit, Term, lower_order_terms, model_matrix

STAY = 0.1  # largest p value of a term that stays, as in Design-Expert's backward elimination [1]
CONFIDENCE = 0.95  # [1]
Error = tuple[float, int]  # mean square and degrees of freedom, where not those of the fit


@dataclass(frozen=True)
class Row:
    """One line of the table; F and p are NaN where the line is not tested."""

    source: str
    sum_of_squares: float
    df: int
    mean_square: float
    f: float = nan
    p: float = nan


@dataclass(frozen=True)
class Curvature:
    """Mean at the corners less mean in the centre, tested against an error that is free of it."""

    difference: float  # in the response's unit
    sum_of_squares: float
    f: float
    p: float
    df_error: int
    ms_error: float


def pure_error_row(fit: Fit) -> Row:
    """Pure error: scatter of the runs that stand at one point."""
    keys = np.round(fit.coded / SAME_POINT) + 0.0  # -0.0 is the same point; a misprint may exceed integers
    groups = np.unique(keys, axis=0, return_inverse=True)[1].ravel()
    counts = np.bincount(groups)
    means = np.bincount(groups, weights=fit.values) / counts
    scatter = float(np.sum((fit.values - means[groups]) ** 2))
    return anova_row("Pure error", scatter, len(groups) - len(counts))


def anova(fit: Fit) -> list[Row]:
    """The table: model, terms, residual, lack of fit, pure error, total; terms against residuals."""
    pure = pure_error_row(fit)
    total = fit.ss_total
    against = (fit.ms_error, fit.df_error)
    rows = [anova_row("Model", total - fit.ss_error, len(fit.terms), *against)]
    rows += [anova_row(n, float(ss), 1, *against) for n, ss in zip(fit.names, term_sums(fit), strict=True)]
    rows.append(anova_row("Residual", fit.ss_error, fit.df_error))
    if pure.df:
        lack, lack_df = fit.ss_error - pure.sum_of_squares, fit.df_error - pure.df
        if lack_df:
            lack = 0.0 if lack < EXACT * total else lack
            scatters = pure.sum_of_squares > EXACT * total  # equal repeats leave lack of fit untested
            rows.append(anova_row("Lack of fit", lack, lack_df, pure.mean_square, scatters * pure.df))
        rows.append(pure)
    return [*rows, anova_row("Total", total, len(fit.values) - 1)]


def anova_row(source: str, sum_of_squares: float, df: int, error: float = nan, df_error: int = 0) -> Row:
    """A line with its F test against a mean square; with df_error = 0 there is none."""
    if not df:
        return Row(source, sum_of_squares, df, nan)
    mean_square = sum_of_squares / df
    if not df_error:
        return Row(source, sum_of_squares, df, mean_square)
    f = mean_square / error if error > 0.0 else (inf if mean_square > 0.0 else nan)
    return Row(source, sum_of_squares, df, mean_square, f, float(stats.f.sf(f, df, df_error)))


def term_sums(fit: Fit) -> Floats:
    """Type III sum of squares of every term: how much the residual grows without it, b^2 / (X'X)^-1_jj."""
    return fit.coefficients[1:] ** 2 / np.diag(fit.unscaled_covariance)[1:]


def curvature_test(fit: Fit) -> Curvature | None:
    """Curvature of corners and centre under a model without squares; None for others, or without error.

        SS = n_f n_c (mean_f - mean_c)^2 / (n_f + n_c)

    for an orthogonal design. The error is the residual of the model with the curvature as one more term, so
    that curvature does not pass for noise.
    """
    centre = np.all(np.abs(fit.coded) < SAME_POINT, axis=1)
    corners = np.all(np.abs(np.abs(fit.coded) - 1.0) < SAME_POINT, axis=1)
    squares = any(power > 1 for term in fit.terms for power in term)
    if squares or not (centre.any() and corners.any() and np.logical_or(centre, corners).all()):
        return None
    matrix = np.column_stack([model_matrix(fit.coded, fit.terms), ~centre])
    if np.linalg.matrix_rank(matrix) < matrix.shape[1] or len(matrix) == matrix.shape[1]:
        return None
    bent = OLS(fit.values, matrix).fit()
    row = anova_row("Curvature", fit.ss_error - bent.ssr, 1, bent.mse_resid, int(bent.df_resid))
    difference, error = float(bent.params[-1]), float(bent.mse_resid)
    return Curvature(difference, row.sum_of_squares, row.f, row.p, int(bent.df_resid), error)


def eliminate_terms(fit: Fit) -> Fit:
    """Backward elimination down to terms with p <= STAY and their parents."""
    while True:
        parent_terms = set[Term]().union(*(lower_order_terms(term) for term in fit.terms))
        p = stats.f.sf(term_sums(fit) / fit.ms_error, 1, fit.df_error)
        removable = (pair for pair in zip(p.tolist(), fit.terms, strict=True) if pair[1] not in parent_terms)
        worst, leaving = max(removable, key=lambda pair: pair[0], default=(0.0, ()))
        if not worst > STAY:
            return fit
        fit = replace(fit, terms=tuple(term for term in fit.terms if term != leaving))


@dataclass(frozen=True)
class Effect:
    """One effect, in the response's unit."""

    name: str
    value: float
    share: float  # of the sum of squares of all terms [1]
    t: float
    p: float


def effects(fit: Fit, error: Error | None = None) -> tuple[list[Effect], dict[str, float]]:
    """Effects of a linear or interaction model, in the order of its terms, and their limits by name.

    The t limit (`single`) and that of Bonferroni are sizes beyond which the least certain of them is
    significant, in the response's unit; NaN where none can be given.
    """
    mean_square, df = error or (fit.ms_error, fit.df_error)
    sums, values = term_sums(fit), 2.0 * fit.coefficients[1:]
    errors = 2.0 * np.sqrt(mean_square * np.diag(fit.unscaled_covariance)[1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        t, shares = values / errors, sums / sums.sum()
    columns = np.column_stack([values, shares, t, 2.0 * stats.t.sf(np.abs(t), df)]).tolist()
    rows = [Effect(name, *line) for name, line in zip(fit.names, columns, strict=True)]
    tail = 0.5 * (1.0 - CONFIDENCE)
    single, bonferroni = stats.t.isf([tail, tail / len(fit.terms)], df) * float(errors.max())
    return rows, {"single": float(single), "bonferroni": float(bonferroni)}
