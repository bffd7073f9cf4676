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
    Lenth: s_0 = 1.5 median |effect|,  PSE = 1.5 median of those |effect| < 2.5 s_0,
           ME = t(0.975, m / 3) PSE,  SME = t((1 + 0.95^(1/m)) / 2, m / 3) PSE

Lenth's limits need no error of their own and serve a saturated design.

References: Montgomery (2017), Design and Analysis of Experiments, 9th ed., 5.3, 6.8, 11.2 and ch. 6;
Lenth (1989), Technometrics 31, 469, eq. (1)-(4).
"""

from dataclasses import dataclass, replace
from math import inf, nan

import numpy as np
from scipy import stats

from taichi_erosion.experiments.design_table import SAME_POINT, Floats, replicate_groups
from taichi_erosion.experiments.fit import EXACT, Fit, block_sum
from taichi_erosion.experiments.terms import Term, model_matrix, parents, term_name


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
class PureError:
    """Scatter of runs that differ in nothing but the noise."""

    sum_of_squares: float
    df: int

    @property
    def mean_square(self) -> float:
        """Variance of a run."""
        return self.sum_of_squares / self.df if self.df else nan


@dataclass(frozen=True)
class Curvature:
    """Mean at the corners less mean in the centre, tested against an error that is free of it."""

    difference: float  # in the response's unit
    sum_of_squares: float
    f: float
    p: float
    df_error: int
    ms_error: float


def replicate_error(fit: Fit) -> PureError:
    """Pure error of the runs that stand at one point of one block."""
    groups = replicate_groups(fit.coded, fit.blocks)
    counts = np.bincount(groups)
    means = np.bincount(groups, weights=fit.values) / counts
    return PureError(float(np.sum((fit.values - means[groups]) ** 2)), int(len(groups) - len(counts)))


def anova(fit: Fit) -> list[Row]:
    """The table: block, model, terms, residual, lack of fit, pure error, total; terms against residuals."""
    pure, against = replicate_error(fit), (fit.ms_error, fit.df_error)
    total = float(np.sum((fit.values - fit.values.mean()) ** 2))
    blocks = block_sum(fit)
    block_df = len(np.unique(fit.blocks)) - 1
    rows = [tested("Block", blocks, block_df, nan, 0)] if block_df else []
    model = total - blocks - fit.ss_error
    rows.append(tested("Model", model, len(fit.terms), *against))
    sums = term_sums(fit)
    rows += [tested(name, float(ss), 1, *against) for name, ss in zip(fit.names, sums, strict=True)]
    rows.append(tested("Residual", fit.ss_error, fit.df_error, nan, 0))
    if pure.df:
        lack, lack_df = max(fit.ss_error - pure.sum_of_squares, 0.0), fit.df_error - pure.df
        lack = 0.0 if lack < EXACT * total else lack
        if lack_df:
            rows.append(tested("Lack of fit", lack, lack_df, pure.mean_square, pure.df))
        rows.append(tested("Pure error", pure.sum_of_squares, pure.df, nan, 0))
    return [*rows, tested("Total", total, len(fit.values) - 1, nan, 0)]


def tested(source: str, sum_of_squares: float, df: int, error: float, df_error: int) -> Row:
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


def curvature(fit: Fit) -> Curvature | None:
    """Curvature of a two-level design by its centre points; None without centre points or error.

        SS = n_f n_c (mean_f - mean_c)^2 / (n_f + n_c)

    for an orthogonal design. The error is the residual of the model with the curvature as one more term, so
    that curvature does not pass for noise.
    """
    centre = np.all(np.abs(fit.coded) < SAME_POINT, axis=1)
    if not centre.any() or centre.all():
        return None
    full = np.column_stack([model_matrix(fit.coded, fit.terms), ~centre, *block_dummies(fit)])
    coefficients, _, rank, _ = np.linalg.lstsq(full, fit.values, rcond=None)
    df_error = len(fit.values) - int(rank)
    if rank < full.shape[1] or not df_error:
        return None
    ss_error = float(np.sum((fit.values - full @ coefficients) ** 2))
    row = tested("Curvature", fit.ss_error - ss_error, 1, ss_error / df_error, df_error)
    difference = float(coefficients[1 + len(fit.terms)])
    return Curvature(difference, row.sum_of_squares, row.f, row.p, df_error, ss_error / df_error)


def block_dummies(fit: Fit) -> list[Floats]:
    """One indicator for every block but the first."""
    return [(fit.blocks == block).astype(float) for block in np.unique(fit.blocks)[1:]]


STAY = 0.1  # largest p value of a term that stays, as in Design-Expert's backward elimination [1]


@dataclass(frozen=True)
class Reduction:
    """The model that is left, and what left it: (term, p value at that time), in that order."""

    fit: Fit
    removed: tuple[tuple[str, float], ...]


def reduced(fit: Fit) -> Reduction:
    """Backward elimination down to terms with p <= STAY and their parents."""
    removed: list[tuple[str, float]] = []
    names = [factor.path for factor in fit.factors]
    while (worst := least_significant(fit)) is not None and worst[1] > STAY:
        removed.append((term_name(worst[0], names), worst[1]))
        fit = replace(fit, terms=tuple(term for term in fit.terms if term != worst[0]))
    return Reduction(fit, tuple(removed))


def least_significant(fit: Fit) -> tuple[Term, float] | None:
    """The removable term of the largest p value, and that value; None where no term may leave."""
    needed = set[Term]().union(*(parents(term) for term in fit.terms))
    p = p_values(fit)
    removable = [(term, float(value)) for term, value in zip(fit.terms, p, strict=True) if term not in needed]
    return max(removable, key=lambda pair: pair[1], default=None)


def p_values(fit: Fit) -> np.ndarray:
    """The p value of every term.

    A saturated model has no error: there its terms compete by size, and the smallest counts as p = 1.
    """
    sums = term_sums(fit)
    if not fit.df_error:
        return sums.min() / np.maximum(sums, np.finfo(float).tiny)
    return stats.f.sf(sums / fit.ms_error, 1, fit.df_error)


CONFIDENCE = 0.95  # [1]
LENTH_INFLATION, LENTH_TRIM = 1.5, 2.5  # Lenth (1989): 1.5 makes the median of |N(0, s)| an estimate of s [1]


@dataclass(frozen=True)
class Effect:
    """One effect, in the response's unit."""

    name: str
    value: float
    share: float  # of the sum of squares of all terms [1]
    t: float
    p: float


@dataclass(frozen=True)
class EffectLimits:
    """Sizes beyond which an effect is significant, in the response's unit; NaN where none can be given."""

    single: float  # t limit
    bonferroni: float
    lenth_margin: float  # ME
    lenth_simultaneous: float  # SME


def effects(fit: Fit) -> list[Effect]:
    """Effects of a linear or interaction model, in the order of its terms."""
    sums = term_sums(fit)
    spread = effect_errors(fit)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = 2.0 * fit.coefficients[1:] / spread
    p = 2.0 * stats.t.sf(np.abs(t), fit.df_error)
    return [
        Effect(name, 2.0 * float(b), float(ss / sums.sum()) if sums.sum() else nan, float(t_k), float(p_k))
        for name, b, ss, t_k, p_k in zip(fit.names, fit.coefficients[1:], sums, t, p, strict=True)
    ]


def effect_errors(fit: Fit) -> Floats:
    """Standard error of every effect, in the response's unit."""
    return 2.0 * np.sqrt(fit.ms_error * np.diag(fit.unscaled_covariance)[1:])


def effect_limits(fit: Fit) -> EffectLimits:
    """Limits for the effects of a fit; the t limits hold for the least certain of them."""
    count, df = len(fit.terms), fit.df_error
    spread = float(effect_errors(fit).max()) if df else nan
    tail = 0.5 * (1.0 - CONFIDENCE)
    margin, simultaneous = lenth_limits(2.0 * fit.coefficients[1:])
    return EffectLimits(
        single=float(stats.t.isf(tail, df)) * spread if df else nan,
        bonferroni=float(stats.t.isf(tail / count, df)) * spread if df else nan,
        lenth_margin=margin,
        lenth_simultaneous=simultaneous,
    )


def lenth_limits(values: Floats) -> tuple[float, float]:
    """Lenth's margin of error, for one effect and for all at once; for effects of one standard error."""
    sizes = np.abs(values)
    first = LENTH_INFLATION * float(np.median(sizes))
    small = sizes[sizes < LENTH_TRIM * first]
    if not len(small):
        return nan, nan
    pseudo_error, df = LENTH_INFLATION * float(np.median(small)), len(sizes) / 3.0
    together = 0.5 * (1.0 + CONFIDENCE ** (1.0 / len(sizes)))
    single = float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, df))
    return single * pseudo_error, float(stats.t.ppf(together, df)) * pseudo_error
