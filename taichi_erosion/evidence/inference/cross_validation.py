"""Cross-validation by groups: each group of rows predicted from a fit to the others.

The fit to the others is linearised about the whole fit; the log score of the rows left out is compared with
that of the bare model. It does not decide, but it must not contradict.

Reference: Vehtari, Gelman & Gabry (2017), Stat. Comput. 27, 1413 (paired differences and their error).
"""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.problem import Floats, Integers
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

LEAST_GROUPS = 4  # fewer set-ups say nothing about prediction; sets of equal conditions take their place


@dataclass(frozen=True)
class ScoreGain:
    """Gain of the log score over the bare model, summed over groups, and its standard error."""

    gain: float = float("nan")
    error: float = float("nan")


def fold_numbers(prepared: PreparedProblem) -> Integers:
    """Number of each row's fold: its group, or its set of conditions where there are few groups."""
    labels = list(prepared.rows.group)
    if len(set(labels)) < LEAST_GROUPS:
        columns = list(prepared.rows.conditions.values())
        labels = [repr(tuple(float(column[i]) for column in columns)) for i in range(prepared.rows.size)]
    order = {label: number for number, label in enumerate(sorted(set(labels)))}
    return np.array([order[label] for label in labels], dtype=np.int64)


def fold_scores(prepared: PreparedProblem, expansion: Expansion, folds: Integers) -> Floats:
    """Log score of every fold, predicted from the others."""
    work = prepared.working(expansion.mean)
    white = prepared.whitening(work)
    design = white(np.hstack([expansion.slopes, expansion.shared]))
    loose, count = expansion.local.shape[1], len(prepared.axes)
    prior = np.ones(design.shape[1])
    own = [prepared.candidate(name, expansion.fit.beyond) for name in expansion.fit.names]
    prior[:loose] = [candidate.prior_scale**-2.0 for candidate in own]
    origin = np.zeros(design.shape[1])
    origin[: loose + count] = np.concatenate([expansion.fit.psi, expansion.fit.x])
    matrix, gradient = design.T @ design + np.diag(prior), design.T @ work.residual - prior * origin
    scores = []
    for fold in range(int(folds.max()) + 1):
        rows = folds == fold
        chosen = design[rows]
        inverse = np.linalg.inv(matrix - chosen.T @ chosen)
        change = inverse @ (gradient - chosen.T @ work.residual[rows])
        change[:loose] = np.maximum(change[:loose], -origin[:loose])
        gap = work.residual[rows] - chosen @ change
        covariance = np.eye(gap.size) + chosen @ inverse @ chosen.T
        squares = float(gap @ np.linalg.solve(covariance, gap))
        scores.append(-0.5 * squares - 0.5 * np.linalg.slogdet(covariance)[1])
    return np.array(scores)


def log_score_gain(prepared: PreparedProblem, base: Expansion, expansion: Expansion) -> ScoreGain:
    """Paired comparison with the bare model; NaN where there is one fold only."""
    folds = fold_numbers(prepared)
    if folds.size == 0 or folds.max() == 0:
        return ScoreGain()
    difference = fold_scores(prepared, expansion, folds) - fold_scores(prepared, base, folds)
    error = float(np.sqrt(difference.size * np.var(difference, ddof=1)))
    return ScoreGain(float(difference.sum()), error)
