"""Fewer terms: those that say nothing leave the model, one at a time, as hierarchy allows.

A term stays as long as one of its products or powers is in the model: A B keeps A and B, A^2 keeps A, because
otherwise the model would change with the origin of the coded units.

Reference: Montgomery (2017), Design and Analysis of Experiments, 9th ed., 5.3 and 11.2.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from taichi_erosion.experiments.anova import ErrorSource, PureError, replicate_error, term_sums
from taichi_erosion.experiments.fit import Fit
from taichi_erosion.experiments.terms import Term, parents, term_name

STAY = 0.1  # largest p value of a term that stays, as in Design-Expert's backward elimination [1]


@dataclass(frozen=True)
class Reduction:
    """The model that is left, and what left it: (term, p value at that time), in that order."""

    fit: Fit
    removed: tuple[tuple[str, float], ...]


def reduced(fit: Fit, stay: float = STAY, error: ErrorSource = "residual") -> Reduction:
    """Backward elimination down to terms with p <= `stay` and their parents."""
    removed: list[tuple[str, float]] = []
    names = [factor.path for factor in fit.factors]
    while (worst := least_significant(fit, error)) is not None and worst[1] > stay:
        removed.append((term_name(worst[0], names), worst[1]))
        fit = replace(fit, terms=tuple(term for term in fit.terms if term != worst[0]))
    return Reduction(fit, tuple(removed))


def least_significant(fit: Fit, error: ErrorSource) -> tuple[Term, float] | None:
    """The removable term of the largest p value, and that value; None where no term may leave."""
    needed = set[Term]().union(*(parents(term) for term in fit.terms))
    p = p_values(fit, replicate_error(fit), error)
    removable = [(term, float(value)) for term, value in zip(fit.terms, p, strict=True) if term not in needed]
    return max(removable, key=lambda pair: pair[1], default=None)


def p_values(fit: Fit, pure: PureError, error: ErrorSource) -> np.ndarray:
    """The p value of every term.

    A saturated model has no error: there its terms compete by size, and the smallest counts as p = 1.
    """
    sums = term_sums(fit)
    mean_square, df = (pure.mean_square, pure.df) if error == "pure error" else (fit.ms_error, fit.df_error)
    if not df:
        return sums.min() / np.maximum(sums, np.finfo(float).tiny)
    return stats.f.sf(sums / mean_square, 1, df)
