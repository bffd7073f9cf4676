"""Intervals of strengths and calibrated numbers out of a scored hypothesis."""

import numpy as np
from scipy import stats

from taichi_erosion.evidence.data.findings import Estimate
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.data.transforms import axis_value, effect_of
from taichi_erosion.evidence.inference.levels import INTERVAL_TAIL
from taichi_erosion.evidence.inference.marginal_likelihood import ScoredHypothesis
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

HALF_WIDTH = float(stats.norm.ppf(1.0 - INTERVAL_TAIL))  # of a normal 90 % interval, in sd
BOUND = 1e-3  # of a prior sd: closer to an end of its range a number is called bound


def joint_weight(prepared: PreparedProblem, scored: ScoredHypothesis, with_prior: bool) -> Floats:
    """Weights (noise factors, columns of strengths), summing to 1."""
    paths = scored.expansion.paths
    if len(paths) == 2:
        prior = (paths[0].log_prior[:, np.newaxis] + paths[1].log_prior[np.newaxis, :]).ravel()
        width = (cell_width(paths[0].grid)[:, np.newaxis] * cell_width(paths[1].grid)[np.newaxis, :]).ravel()
    elif paths:
        prior, width = paths[0].log_prior, cell_width(paths[0].grid)
    else:
        prior, width = np.zeros(1), np.ones(1)
    shift = prior if with_prior else np.log(np.maximum(width, 1e-300))
    weight = (
        np.array([s.log_likelihood + shift for s in scored.likelihoods])
        + prepared.doubt.log_weight[:, np.newaxis]
    )
    return np.exp(weight - log_sum_exp(weight))


def cell_width(grid: Floats) -> Floats:
    """Trapezoid widths of a grid."""
    if grid.size < 2:
        return np.ones(grid.size)
    width = np.gradient(grid)
    width[[0, -1]] *= 0.5
    return width


def strength_fits(prepared: PreparedProblem, scored: ScoredHypothesis) -> dict[str, Estimate]:
    """Strength of every acting effect with its 90 % interval, no prior but the allowed range."""
    if not scored.likelihoods:
        return {}
    weight = joint_weight(prepared, scored, with_prior=False).sum(axis=0)
    paths = scored.expansion.paths
    found = {}
    for index, (name, path) in enumerate(zip(scored.expansion.fit.names, paths, strict=True)):
        if len(paths) == 2:
            table = weight.reshape(paths[0].grid.size, paths[1].grid.size)
            share = table.sum(axis=1 - index)
        else:
            share = weight
        low, high = (quantile(path.grid, share, q) for q in (INTERVAL_TAIL, 1.0 - INTERVAL_TAIL))
        best = float(scored.expansion.fit.psi[index])
        maximum = prepared.candidate(name).maximum
        found[name] = Estimate(best, min(low, best), max(high, best), best >= maximum * (1.0 - BOUND))
    return found


def quantile(grid: Floats, share: Floats, level: float) -> float:
    """Quantile of cell probabilities on a grid, linear within cells."""
    if grid.size < 2:
        return float(grid[0]) if grid.size else 0.0
    density = share / cell_width(grid)
    pieces = 0.5 * (density[1:] + density[:-1]) * np.diff(grid)
    cumulative = np.concatenate([[0.0], np.cumsum(pieces)])
    return float(np.interp(level * cumulative[-1], cumulative, grid))


def parameter_fits(prepared: PreparedProblem, scored: ScoredHypothesis) -> dict[str, Estimate]:
    """Calibrated numbers with 90 % intervals, strengths and noise factors integrated out.

    Numbers of a candidate that does not act are left out: nothing was learnt about them.
    """
    count = len(prepared.axes)
    if count == 0 or not scored.likelihoods:
        return {}
    weight = joint_weight(prepared, scored, with_prior=True)
    x = scored.expansion.fit.x
    centres = np.array([s.position for s in scored.likelihoods])
    variances = np.array([np.diag(s.covariance) for s in scored.likelihoods])
    mean = np.einsum("fc,fpc->p", weight, centres)
    second = np.einsum("fc,fpc->p", weight, centres**2) + np.einsum("fc,fp->p", weight, variances)
    sd = np.sqrt(np.maximum(second - mean**2, 0.0))
    idle = {candidate.name for candidate in prepared.problem.candidates} - set(scored.expansion.fit.names)
    fits = {}
    for j, axis in enumerate(prepared.axes):
        if effect_of(axis.name) in idle:
            continue
        middle = float(np.clip(mean[j], axis.low, axis.high))
        low = float(np.clip(mean[j] - HALF_WIDTH * sd[j], axis.low, axis.high))
        high = float(np.clip(mean[j] + HALF_WIDTH * sd[j], axis.low, axis.high))
        bound = bool(x[j] - axis.low < BOUND or axis.high - x[j] < BOUND)
        ends = sorted((axis_value(axis, low), axis_value(axis, high)))
        fits[axis.name] = Estimate(axis_value(axis, middle), ends[0], ends[1], bound)
    return fits


def upper_strength(grid: Floats, log_likelihood: Floats) -> float:
    """Strength above which an effect is excluded with 95 %."""
    weight = np.exp(log_likelihood - log_likelihood.max()) * cell_width(grid)
    return quantile(grid, weight, 1.0 - INTERVAL_TAIL)
