"""How good a fitted model is, and which runs it does not believe.

    R^2       = 1 - SS_error / SS_total
    adjusted  = 1 - (SS_error / df_error) / (SS_total / df_total)
    predicted = 1 - PRESS / SS_total,   PRESS = sum (e / (1 - h))^2
    adequate precision = (max fitted - min fitted) / sqrt(p MS_error / n)
    CV [%]    = 100 sqrt(MS_error) / mean

with e the residuals, h the leverages, p the number of coefficients, n of runs; SS_total is counted within
blocks. Adequate precision above 4 is taken for a signal worth following.

References: Montgomery (2017), 10.6 and 11.2; Box & Wetz (1973) for adequate precision.
"""

from dataclasses import dataclass
from math import nan, sqrt

import numpy as np
from scipy import stats
from statsmodels.stats.outliers_influence import OLSInfluence

from taichi_erosion.experiments.anova import block_sum
from taichi_erosion.experiments.design_table import Floats
from taichi_erosion.experiments.fit import Fit

CERTAIN = 1e-9  # 1 - leverage below which a run is met whatever its value [1]


@dataclass(frozen=True)
class Quality:
    """Figures of merit; NaN where no degree of freedom is left for an error."""

    sd: float  # in the response's unit
    mean: float
    cv: float  # %
    r2: float
    r2_adjusted: float
    r2_predicted: float
    press: float
    adequate_precision: float


@dataclass(frozen=True, eq=False)
class Diagnostics:
    """Residuals run by run, and tests of what the analysis of variance takes for granted."""

    leverage: Floats
    studentized: Floats  # residual over its standard error
    deleted: Floats  # the same, its own run left out of the error
    cook: Floats  # Cook's distance [1]
    outliers: tuple[int, ...]  # rows of the design beyond the Bonferroni limit at 5 %
    limit: float  # that limit, on `deleted`
    normal_p: float  # Shapiro-Wilk
    constant_spread_p: float  # Spearman's correlation of |residual| with the fitted value


def quality(fit: Fit) -> Quality:
    """Figures of merit of a fit."""
    total = float(np.sum((fit.values - fit.values.mean()) ** 2)) - block_sum(fit)
    df_total = len(fit.values) - len(np.unique(fit.blocks))
    sd, mean = sqrt(fit.ms_error) if fit.df_error else nan, float(fit.values.mean())
    press = press_sum(fit)
    coefficients = 1 + len(fit.terms)
    signal = float(np.ptp(fit.fitted))
    noise = sd * sqrt(coefficients / len(fit.values))
    return Quality(
        sd=sd,
        mean=mean,
        cv=100.0 * ratio(sd, mean),
        r2=1.0 - ratio(fit.ss_error, total),
        r2_adjusted=1.0 - ratio(fit.ms_error, ratio(total, df_total)),
        r2_predicted=1.0 - ratio(press, total),
        press=press,
        adequate_precision=ratio(signal, noise),
    )


def ratio(numerator: float, denominator: float) -> float:
    """A quotient, NaN over 0."""
    return numerator / denominator if denominator else nan


def press_sum(fit: Fit) -> float:
    """Sum of squares of the errors with which every run is predicted from all others."""
    leverage = np.asarray(OLSInfluence(fit.results).hat_matrix_diag)
    if np.any(1.0 - leverage < CERTAIN):
        return nan  # a run that alone fixes a coefficient cannot be predicted from the others
    return float(np.sum((fit.residuals / (1.0 - leverage)) ** 2))


def diagnostics(fit: Fit) -> Diagnostics:
    """Residuals of a fit with at least two degrees of freedom for the error."""
    influence = OLSInfluence(fit.results)
    leverage = np.asarray(influence.hat_matrix_diag)
    studentized = np.full(len(leverage), nan)
    deleted, cook = studentized.copy(), studentized.copy()
    free = 1.0 - leverage > CERTAIN
    if fit.df_error > 1 and fit.ss_error > 0.0:
        studentized[free] = fit.residuals[free] / np.sqrt(fit.ms_error * (1.0 - leverage[free]))
        left = fit.df_error - studentized[free] ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            deleted[free] = studentized[free] * np.sqrt((fit.df_error - 1) / np.maximum(left, 0.0))
        share = leverage[free] / (1.0 - leverage[free])
        cook[free] = studentized[free] ** 2 * share / fit.results.params.size
    limit = float(stats.t.isf(0.025 / len(leverage), fit.df_error - 1)) if fit.df_error > 1 else nan
    beyond = np.flatnonzero(np.abs(np.nan_to_num(deleted)) > limit)
    return Diagnostics(
        leverage=leverage,
        studentized=studentized,
        deleted=deleted,
        cook=cook,
        outliers=tuple(int(fit.rows[row]) for row in beyond),
        limit=limit,
        normal_p=normality(studentized[free]),
        constant_spread_p=spread_trend(fit.fitted[free], studentized[free]),
    )


def normality(studentized: Floats) -> float:
    """The p value of Shapiro and Wilk's test, NaN for fewer than four residuals."""
    known = studentized[np.isfinite(studentized)]
    return float(stats.shapiro(known).pvalue) if len(known) > 3 and np.ptp(known) > 0.0 else nan


def spread_trend(fitted: Floats, studentized: Floats) -> float:
    """The p value of the rank correlation between fitted value and size of the residual."""
    known = np.isfinite(studentized)
    if known.sum() < 4 or np.ptp(fitted[known]) == 0.0 or np.ptp(np.abs(studentized[known])) == 0.0:
        return nan
    return float(np.asarray(stats.spearmanr(fitted[known], np.abs(studentized[known])))[1])
