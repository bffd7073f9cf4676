"""The rival "none of these": a smooth discrepancy that no calibration and no named effect can imitate.

    delta ~ GP(0, lambda^2 M K M)

with K built from one condition at a time, or all of them, within each observable, and M the projection that
removes what the hypothesis explains itself. Its evidence over that of the hypothesis without it,

    gain = -1/2 sum ln(1 + lambda^2 d_j) + 1/2 sum c_j^2 / f^2 lambda^2 d_j / (1 + lambda^2 d_j)

comes from the eigenvalues d_j of M K M and the coefficients c_j of the projected residual; it needs no
simulation. With such a rival probabilities cannot polarise onto a wrong name.

Reference: Plumlee & Joseph (2018), Stat. Sinica 28, 601 (orthogonal discrepancy).
"""

from dataclasses import replace

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, projected_residual
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.predictor import standard_axis

LENGTHS = (0.5, 1.0, 2.0)  # of the kernel, in sd of a condition
AMPLITUDES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # sd of the discrepancy over that of the noise
SMALL = 1e-5  # eigenvalues below this share of the largest are dropped


def condition_axes(prepared: PreparedProblem) -> dict[str, Floats]:
    """Conditions that vary, standardised; by their logarithm where they span a wide positive range."""
    axes = {name: standard_axis(column) for name, column in prepared.rows.conditions.items()}
    return {name: values for name, values in axes.items() if values is not None}


def kernels(prepared: PreparedProblem) -> list[Floats]:
    """Factors B (n, r) of K = B B^T: one per length and condition, and one over all conditions together.

    They are whitened by the typical noise of each observable.
    """
    axes = condition_axes(prepared)
    same = prepared.rows.which[:, np.newaxis] == prepared.rows.which[np.newaxis, :]
    typical = np.ones(prepared.rows.size)
    for _, rows in prepared.by_observable():
        typical[rows] = np.median(prepared.sd[rows])
    height = typical / prepared.sd
    found = []
    for length in LENGTHS:
        distances = {name: squared_distance(values, length) for name, values in axes.items()}
        if len(distances) > 1:
            distances["all"] = np.sum(list(distances.values()), axis=0)
        for square in distances.values():
            found.append(low_rank(np.where(same, np.exp(-0.5 * square), 0.0) * np.outer(height, height)))
    return found


def squared_distance(values: Floats, length: float) -> Floats:
    """Squared distance along one axis over the squared length."""
    return ((values[:, np.newaxis] - values[np.newaxis, :]) / length) ** 2


def low_rank(matrix: Floats) -> Floats:
    """Factor B with K = B B^T to within SMALL."""
    values, vectors = np.linalg.eigh(matrix)
    kept = values > SMALL * max(float(values[-1]), 1e-300)
    return vectors[:, kept] * np.sqrt(values[kept])


def discrepancy_gain(prepared: PreparedProblem, expansion: Expansion, family: list[Floats]) -> Floats:
    """Ln evidence gained by a discrepancy on top of a hypothesis, per noise factor."""
    factors = prepared.doubt.factor
    if not family or not expansion.finite:
        return np.full(factors.size, -np.inf)
    if expansion.shared.shape[1] == prepared.rows.shared.shape[1]:
        return gains(prepared, expansion, family, factors)
    # errors of the model itself do not grow with those of the laboratory: every factor has its own balance
    scaled = [replace(prepared, variance=factor**2 * prepared.variance) for factor in factors]
    return np.concatenate([gains(each, expansion, family, np.ones(1)) for each in scaled])


def gains(prepared: PreparedProblem, expansion: Expansion, family: list[Floats], factors: Floats) -> Floats:
    """Ln evidence gained at every noise factor where one balance of errors serves all of them."""
    left = projected_residual(prepared, expansion)
    terms, amplitude = [], np.array(AMPLITUDES)[:, np.newaxis] ** 2
    for factor in family:
        values, vectors = np.linalg.eigh(factor.T @ left.project(factor))
        values = np.maximum(values, 1e-12)
        squares = (vectors.T @ (factor.T @ left.free)) ** 2 / values
        loss = -0.5 * np.sum(np.log1p(amplitude * values), axis=1)
        gained = 0.5 * (amplitude * values / (1.0 + amplitude * values) @ squares)
        terms.append(loss[:, np.newaxis] + gained[:, np.newaxis] / factors**2)
    stacked = np.concatenate(terms, axis=0)
    return log_sum_exp(stacked, axis=0) - np.log(stacked.shape[0])
