"""A polynomial fitted to one response of a design by ordinary least squares, its quality and its residuals.

    y = b_0 + sum_j b_j t_j(x) + block + error

with x the coded levels [1], t_j the terms of the model, y the response in its own unit. Blocks are constants
that add up to 0, so that b_0 belongs to the average block. Runs without a result are left out. In natural
units u, with c and h centre and half range of a factor, x_k = (u_k - c_k) / h_k turns every coded term into
a sum of natural ones; that equation holds inside the design only, and its coefficients must not be compared
in size.

    R^2       = 1 - SS_error / SS_total
    adjusted  = 1 - (SS_error / df_error) / (SS_total / df_total)
    predicted = 1 - PRESS / SS_total,   PRESS = sum (e / (1 - h))^2
    adequate precision = (max fitted - min fitted) / sqrt(p MS_error / n)
    CV [%]    = 100 sqrt(MS_error) / mean

with e the residuals, h the leverages, p the number of coefficients, n of runs; SS_total is counted within
blocks. Adequate precision above 4 is taken for a signal worth following.

References: Montgomery (2017), Design and Analysis of Experiments, 9th ed., ch. 10 and 11; Box & Wetz (1973)
for adequate precision.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import comb, nan, sqrt

import numpy as np
from numpy.typing import ArrayLike
from scipy import stats
from statsmodels.regression.linear_model import OLS, RegressionResultsWrapper
from statsmodels.stats.outliers_influence import OLSInfluence

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.design_table import Design, Factor, Floats, Integers
from taichi_erosion.experiments.terms import Order, Term, model_matrix, model_terms, term_name

EXACT = 1e-20  # share of the total sum of squares below which a residual is rounding, not error [1]


@dataclass(frozen=True)
class Coefficient:
    """One coefficient in coded units; NaN where no degree of freedom is left for an error."""

    name: str
    value: float
    standard_error: float
    low: float  # 95 % confidence interval
    high: float
    t: float
    p: float
    vif: float  # variance inflation factor [1]


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model."""

    response: str
    factors: tuple[Factor, ...]
    terms: tuple[Term, ...]
    coded: Floats  # [runs, factors], runs with a result only
    values: Floats  # [runs]
    blocks: Integers  # [runs]
    rows: Integers  # [runs], place of each run in the design

    @cached_property
    def results(self) -> RegressionResultsWrapper:
        """What statsmodels found; columns: constant, terms, blocks."""
        matrix = np.column_stack([model_matrix(self.coded, self.terms), block_columns(self.blocks)])
        return OLS(self.values, matrix).fit()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the terms."""
        return tuple(term_name(term, [f.path for f in self.factors]) for term in self.terms)

    @cached_property
    def coefficients(self) -> Floats:
        """Constant and terms, coded."""
        return np.asarray(self.results.params)[: 1 + len(self.terms)]

    @property
    def df_error(self) -> int:
        """Degrees of freedom of the residuals."""
        return int(self.results.df_resid)

    @property
    def ss_error(self) -> float:
        """Sum of squares of the residuals."""
        return float(np.sum(self.residuals**2))

    @property
    def ms_error(self) -> float:
        """Mean square of the residuals, NaN where none is left."""
        return self.ss_error / self.df_error if self.df_error else float("nan")

    @property
    def fitted(self) -> Floats:
        """Fitted values, blocks included."""
        return np.asarray(self.results.fittedvalues)

    @property
    def residuals(self) -> Floats:
        """Response less fitted value."""
        return self.values - self.fitted

    def predict(self, coded: ArrayLike) -> Floats:
        """Response at coded points in the average block, [points]."""
        return model_matrix(np.asarray(coded, dtype=float), self.terms) @ self.coefficients

    def leverage(self, coded: ArrayLike) -> Floats:
        """Variance of the predicted mean over the variance of a single run [1]."""
        matrix = model_matrix(np.asarray(coded, dtype=float), self.terms)
        spread = self.unscaled_covariance
        return np.einsum("ij,jk,ik->i", matrix, spread, matrix)

    @cached_property
    def unscaled_covariance(self) -> Floats:
        """(X'X)^-1 of constant and terms."""
        count = 1 + len(self.terms)
        return np.asarray(self.results.normalized_cov_params)[:count, :count]

    def interval(self, coded: ArrayLike) -> Floats:
        """Interval of 95 % for the true mean at coded points, [points, 2]."""
        variance = self.ms_error * self.leverage(coded)
        reach = stats.t.ppf(0.975, self.df_error) * np.sqrt(variance)
        centre = self.predict(coded)
        return np.column_stack([centre - reach, centre + reach])


def fit_model(design: Design, response: str, terms: Sequence[Term] | Order) -> Fit:
    """Fit a model to one response; raises BadInput where the runs do not determine it."""
    if response not in design.responses:
        known = ", ".join(design.responses) or "none"
        raise BadInput(f"{design.name}: no response '{response}'; there are: {known}")
    wanted = model_terms(len(design.factors), terms) if isinstance(terms, str) else tuple(terms)
    rows = np.flatnonzero(np.isfinite(design.responses[response]))
    fit = Fit(
        response=response,
        factors=design.factors,
        terms=wanted,
        coded=design.coded[rows],
        values=design.responses[response][rows],
        blocks=design.blocks[rows],
        rows=rows,
    )
    refuse_unfittable(fit, design)
    return fit


def refuse_unfittable(fit: Fit, design: Design) -> None:
    """Raise BadInput where coefficients are confounded."""
    matrix = np.column_stack([model_matrix(fit.coded, fit.terms), block_columns(fit.blocks)])
    rank = np.linalg.matrix_rank(matrix) if len(matrix) else 0
    if rank < matrix.shape[1]:
        raise BadInput(
            f"{design.name}, {fit.response}: {len(fit.values)} runs with a result tell {rank} coefficients "
            f"apart, the model has {matrix.shape[1]}"
        )


def block_columns(blocks: Integers) -> Floats:
    """Contrasts of the blocks that add up to 0, [runs, blocks - 1]."""
    known = np.unique(blocks)
    contrasts = [(blocks == block).astype(float) - (blocks == known[-1]) for block in known[:-1]]
    return np.array(contrasts).T.reshape(len(blocks), len(contrasts))


def coefficient_table(fit: Fit) -> list[Coefficient]:
    """Constant and terms, each with its uncertainty."""
    spread = np.sqrt(fit.ms_error * np.diag(fit.unscaled_covariance))
    with np.errstate(divide="ignore", invalid="ignore"):
        t = fit.coefficients / spread
    p = 2.0 * stats.t.sf(np.abs(t), fit.df_error)
    reach = stats.t.ppf(0.975, fit.df_error) * spread
    return [
        Coefficient(name, *(float(number) for number in numbers))
        for name, *numbers in zip(
            ("Intercept", *fit.names),
            fit.coefficients,
            spread,
            fit.coefficients - reach,
            fit.coefficients + reach,
            t,
            p,
            inflation_factors(fit),
            strict=True,
        )
    ]


def inflation_factors(fit: Fit) -> Floats:
    """Variance of each coefficient over that in an orthogonal design of the same spread [1].

    VIF_j = (X'X)^-1_jj sum_i (t_ij - mean t_j)^2,   1 for the constant
    """
    values = model_matrix(fit.coded, fit.terms)[:, 1:]
    scatter = np.sum((values - values.mean(axis=0)) ** 2, axis=0)
    return np.concatenate([[1.0], np.diag(fit.unscaled_covariance)[1:] * scatter])


Polynomial = dict[Term, float]  # coefficient of every term; the constant is the term of zeros


def coded_polynomial(fit: Fit) -> Polynomial:
    """Coefficients in coded units."""
    constant = (0,) * len(fit.factors)
    return dict(zip((constant, *fit.terms), map(float, fit.coefficients), strict=True))


def natural_polynomial(fit: Fit) -> Polynomial:
    """Coefficients in the factors' own units."""
    total: Polynomial = {}
    for term, coefficient in coded_polynomial(fit).items():
        for lower, share in expanded(fit, term).items():
            total[lower] = total.get(lower, 0.0) + coefficient * share
    return total


def expanded(fit: Fit, term: Term) -> Polynomial:
    """One coded term as a natural polynomial, by the binomial theorem factor by factor."""
    shares = [
        [comb(power, k) * (-factor.centre) ** (power - k) / factor.half**power for k in range(power + 1)]
        for factor, power in zip(fit.factors, term, strict=True)
    ]
    found: Polynomial = {}
    for lower in product(*(range(power + 1) for power in term)):
        share = 1.0
        for column, k in zip(shares, lower, strict=True):
            share *= column[k]
        found[lower] = share
    return found


def equation(fit: Fit, polynomial: Mapping[Term, float], digits: int = 5) -> str:
    """The polynomial as one line of text."""
    names = [factor.path for factor in fit.factors]
    words = [f"{fit.response} ="]
    for term, coefficient in polynomial.items():
        sign = "-" if coefficient < 0.0 else "+"
        size = f"{abs(coefficient):.{digits}g}"
        words.append(f"{sign} {size} {term_name(term, names)}" if any(term) else f"{coefficient:.{digits}g}")
    return " ".join(words)


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


def block_sum(fit: Fit) -> float:
    """Sum of squares between the means of the blocks."""
    groups = [fit.values[fit.blocks == block] for block in np.unique(fit.blocks)]
    return float(sum(len(group) * (group.mean() - fit.values.mean()) ** 2 for group in groups))


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
