"""A polynomial fitted to one response of a design by ordinary least squares, and its quality.

    y = b_0 + sum_j b_j t_j(x) + error

with x the coded levels [1], t_j the terms of the model, y the response in its own unit. Runs without a result
are left out. In natural units u, with c and h centre and half range of a factor, x_k = (u_k - c_k) / h_k
turns every coded term into a sum of natural ones; that equation holds inside the design only, and its
coefficients must not be compared in size.

    R^2       = 1 - SS_error / SS_total
    adjusted  = 1 - (SS_error / df_error) / (SS_total / df_total)
    predicted = 1 - PRESS / SS_total,   PRESS = sum (e / (1 - h))^2
    adequate precision = (max fitted - min fitted) / sqrt(p MS_error / n)
    CV [%]    = 100 sqrt(MS_error) / mean

with e the residuals, h the leverages, p the number of coefficients, n of runs. Adequate precision above 4 is
taken for a signal worth following. An adjusted R^2 that exceeds the predicted one by more than 0.2 tells that
the model follows single runs instead of the response.

References: Montgomery (2017), Design and Analysis of Experiments, 9th ed., ch. 10 and 11; Box & Wetz (1973)
for adequate precision; Anderson & Whitcomb (2016), RSM Simplified, 2nd ed., for the limit of 0.2.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from math import comb, nan, sqrt
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from statsmodels.regression.linear_model import OLS, RegressionResultsWrapper
from statsmodels.stats.outliers_influence import OLSInfluence

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments.design import Design, Factor

EXACT = 1e-20  # share of the total sum of squares below which a residual is rounding, not error [1]
CERTAIN = 1e-9  # 1 - leverage below which a run is met whatever its value [1]
R2_APART = 0.2  # most by which adjusted R^2 may exceed predicted R^2 [1]

Term = tuple[int, ...]  # exponent of every factor; (1, 0, 1) is A C, (0, 2, 0) is B^2
Polynomial = dict[Term, float]  # coefficient of every term; the constant is the term of zeros
Order = Literal["linear", "interactions", "quadratic"]


def interaction_terms(count: int, order: int) -> tuple[Term, ...]:
    """Products of `order` different factors: A, B ...; A B, A C, B C ..."""
    model = combinations(range(count), order)
    return tuple(tuple(int(k in factors) for k in range(count)) for factors in model)


def model_terms(count: int, order: Order) -> tuple[Term, ...]:
    """Terms of a complete model, without the constant."""
    linear = terms = interaction_terms(count, 1)
    if order in ("interactions", "quadratic"):
        terms += interaction_terms(count, 2)
    if order == "quadratic":
        terms += tuple(tuple(2 * power for power in term) for term in linear)
    return terms


def term_name(term: Term, names: Sequence[str]) -> str:
    """`A`, `A*B`, `A^2`, with the factors' names."""
    parts = [n if power == 1 else f"{n}^{power}" for n, power in zip(names, term, strict=True) if power]
    return "*".join(parts) or "1"


def term_label(name: str, labels: Mapping[str, str]) -> str:
    """A term's name with labels for the factors, "sliding friction × restitution^2"."""
    words = (factor.partition("^") for factor in name.split("*"))
    return " \N{MULTIPLICATION SIGN} ".join(labels.get(key, key) + hat + power for key, hat, power in words)


def lower_order_terms(term: Term) -> set[Term]:
    """Terms that hierarchy requires beside this one: each exponent lowered, down to single factors."""
    lower = [(*term[:k], power - 1, *term[k + 1 :]) for k, power in enumerate(term) if power]
    return set[Term]().union(*({each} | lower_order_terms(each) for each in lower if any(each)))


def model_matrix(coded: ArrayLike, terms: Sequence[Term]) -> Floats:
    """Constant and terms at coded points, [runs, 1 + terms]."""
    points = np.atleast_2d(np.asarray(coded, dtype=float))
    powers = np.array(terms, dtype=int).reshape(len(terms), points.shape[1])
    return np.column_stack([np.ones(len(points)), np.prod(points[:, None, :] ** powers, axis=2)])


@dataclass(frozen=True, eq=False)
class Fit:
    response: str
    factors: tuple[Factor, ...]
    terms: tuple[Term, ...]
    coded: Floats  # [runs, factors], runs with a result only
    values: Floats  # [runs]
    rows: NDArray[np.int64]  # [runs], place of each run in the design

    @cached_property
    def results(self) -> RegressionResultsWrapper:
        """What statsmodels found; columns: constant, terms."""
        return OLS(self.values, model_matrix(self.coded, self.terms)).fit()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(term_name(term, [f.path for f in self.factors]) for term in self.terms)

    @cached_property
    def coefficients(self) -> Floats:
        """Constant and terms, coded."""
        return np.asarray(self.results.params)

    @property
    def df_error(self) -> int:
        """Degrees of freedom of the residuals."""
        return int(self.results.df_resid)

    @property
    def ss_error(self) -> float:
        """Sum of squares of the residuals."""
        return float(self.results.ssr)

    @property
    def ss_total(self) -> float:
        """Sum of squares about the mean."""
        return float(self.results.centered_tss)

    @property
    def ms_error(self) -> float:
        """Mean square of the residuals, NaN where none is left."""
        return self.ss_error / self.df_error if self.df_error else nan

    @property
    def fitted(self) -> Floats:
        return np.asarray(self.results.fittedvalues)

    def predict(self, coded: ArrayLike) -> Floats:
        """Response at coded points, [points]."""
        return model_matrix(coded, self.terms) @ self.coefficients

    def leverage(self, coded: ArrayLike) -> Floats:
        """Variance of the predicted mean over the variance of a single run [1]."""
        matrix = model_matrix(coded, self.terms)
        return np.einsum("ij,jk,ik->i", matrix, self.unscaled_covariance, matrix)

    @cached_property
    def unscaled_covariance(self) -> Floats:
        """(X'X)^-1 of constant and terms."""
        return np.asarray(self.results.normalized_cov_params)

    def mean_interval(self, coded: ArrayLike) -> Floats:
        """Interval of 95 % for the true mean at coded points, [points, 2]."""
        return np.asarray(self.results.get_prediction(model_matrix(coded, self.terms)).conf_int())


def fit_model(design: Design, response: str, terms: Sequence[Term] | Order) -> Fit:
    """Fit a model to one response; raises BadInput where the runs do not determine it."""
    model = model_terms(len(design.factors), terms) if isinstance(terms, str) else tuple(terms)
    values = design.responses[response]
    rows = np.flatnonzero(np.isfinite(values))
    fit = Fit(response, design.factors, model, design.coded[rows], values[rows], rows)
    rank = np.linalg.matrix_rank(model_matrix(fit.coded, model)) if len(rows) else 0
    if rank < 1 + len(model):
        words = f"{len(rows)} runs with a result tell {rank} coefficients apart"
        raise BadInput(f"{design.name}, {response}: {words}, the model has {1 + len(model)}")
    return fit


def coefficient_table(fit: Fit) -> pd.DataFrame:
    """Constant and terms in coded units, with errors, 95 % intervals, t and p; NaN without an error."""
    result = fit.results
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = np.asarray(result.conf_int()).T
        columns = {"name": ("Intercept", *fit.names), "value": result.params, "standard_error": result.bse}
        columns |= {"low": low, "high": high, "t": result.tvalues, "p": result.pvalues}
    table = pd.DataFrame(columns)
    return table if fit.df_error else table.assign(standard_error=nan, low=nan, high=nan, t=nan, p=nan)


def coded_polynomial(fit: Fit) -> Polynomial:
    constant = (0,) * len(fit.factors)
    return dict(zip((constant, *fit.terms), map(float, fit.coefficients), strict=True))


def natural_polynomial(fit: Fit) -> Polynomial:
    """Coefficients in the factors' own units, by the binomial theorem factor by factor."""
    total: Polynomial = {}
    for term, coefficient in coded_polynomial(fit).items():
        for lower in product(*(range(power + 1) for power in term)):
            share = coefficient
            for factor, power, k in zip(fit.factors, term, lower, strict=True):
                share *= comb(power, k) * (-factor.centre) ** (power - k) / factor.half_range**power
            total[lower] = total.get(lower, 0.0) + share
    return total


def equation_text(fit: Fit, polynomial: Mapping[Term, float]) -> str:
    names = [factor.path for factor in fit.factors]
    words = [f"{fit.response} ="]
    for term, coefficient in polynomial.items():
        sign = "-" if coefficient < 0.0 else "+"
        size = f"{abs(coefficient):.5g}"
        words.append(f"{sign} {size} {term_name(term, names)}" if any(term) else f"{coefficient:.5g}")
    return " ".join(words)


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


def figures_of_merit(fit: Fit) -> Quality:
    total, df_total = fit.ss_total, len(fit.values) - 1
    sd = sqrt(fit.ms_error)
    mean = float(fit.values.mean())
    influence = OLSInfluence(fit.results)
    # a run that alone fixes a coefficient cannot be predicted from the others
    alone = np.any(1.0 - np.asarray(influence.hat_matrix_diag) < CERTAIN)
    press = nan if alone else float(np.sum(np.asarray(influence.resid_press) ** 2))
    noise = sd * sqrt((1 + len(fit.terms)) / len(fit.values))
    return Quality(
        sd=sd,
        mean=mean,
        cv=100.0 * ratio_or_nan(sd, mean),
        r2=1.0 - ratio_or_nan(fit.ss_error, total),
        r2_adjusted=1.0 - ratio_or_nan(fit.ms_error, ratio_or_nan(total, df_total)),
        r2_predicted=1.0 - ratio_or_nan(press, total),
        press=press,
        adequate_precision=ratio_or_nan(float(np.ptp(fit.fitted)), noise),
    )


def ratio_or_nan(numerator: float, denominator: float) -> float:
    return numerator / denominator if denominator else nan


def overfit_warning(fit: Fit) -> str:
    """One line where the model predicts runs that it has not used far worse than its own; else empty."""
    merit = figures_of_merit(fit)
    if not merit.r2_adjusted - merit.r2_predicted > R2_APART:
        return ""
    gap = f"predicted R2 {merit.r2_predicted:.2f} is far below adjusted R2 {merit.r2_adjusted:.2f}"
    reason = "the surface follows the scatter of single runs, its optimum may not hold"
    return f"{fit.response}: {gap}: {reason}"
