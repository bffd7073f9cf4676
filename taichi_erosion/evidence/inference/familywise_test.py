"""Family-wise test: is the strongest candidate stronger than chance makes the strongest of so many?

The statistic is the largest ln Bayes factor among the candidates. Its distribution under "nothing is missing"
is simulated with the candidates' own correlated signatures, z* = G^T eps, at a noise level drawn from what
the residuals and repeats allow; this holds whatever the correlation and respects strength >= 0.

Reference: Westfall & Young (1993), Resampling-Based Multiple Testing, ch. 2 (step-down).
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.inference.model_discrepancy import condition_axes
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.screen import Screen
from taichi_erosion.evidence.inference.verdict_levels import FAMILYWISE_LEVEL

DRAWS = 2000  # of the null: a p of 0.05 is known to 0.005
DECOYS = 3
DECOY_LENGTH = 1.0  # of a made-up effect, in sd of the conditions


@dataclass(frozen=True)
class FamilywiseTest:
    """Outcome of the test."""

    observed: Floats  # (candidates,), ln Bayes factors; 0 where the signature is not resolved
    p: float  # of the strongest
    step_down: Floats  # (candidates,), adjusted
    threshold: float  # sd that a signature of unit noise must reach at FAMILYWISE_LEVEL
    decoy_rank: int


def familywise_test(
    prepared: PreparedProblem, screened: Screen, factors: Floats, seed: int
) -> FamilywiseTest:
    """Observed ln Bayes factors against their simulated maximum; `factors` are draws of the noise factor."""
    generator = np.random.default_rng(seed)
    noise = null_residuals(prepared, screened, factors, generator)
    signatures = screened.signatures
    if not signatures:
        return FamilywiseTest(np.zeros(0), 1.0, np.zeros(0), 0.0, 1)
    observed = np.array([s.log_bayes(screened.residual[:, np.newaxis])[0] for s in signatures])
    drawn = np.array([s.log_bayes(noise) for s in signatures])
    resolved = np.array([s.resolved for s in signatures])
    observed[~resolved], adjusted = 0.0, np.ones(observed.size)
    if not resolved.any():
        return FamilywiseTest(observed, 1.0, adjusted, 0.0, observed.size + 1)
    adjusted[resolved] = step_down(observed[resolved], drawn[resolved])
    rank = decoy_rank(prepared, screened, observed, generator)
    return FamilywiseTest(observed, float(adjusted.min()), adjusted, max_threshold(screened, noise), rank)


def null_residuals(
    prepared: PreparedProblem, screened: Screen, factors: Floats, generator: np.random.Generator
) -> Floats:
    """Projected residuals of a model that lacks nothing, columns of (n + p + q)."""
    noise = generator.standard_normal((screened.residual.size, factors.size))
    noise[: prepared.rows.size] *= factors
    basis = screened.left.basis
    return noise - basis @ (basis.T @ noise)


def step_down(observed: Floats, drawn: Floats) -> Floats:
    """Adjusted p of every candidate: each is compared with the maximum over itself and the weaker ones."""
    order = np.argsort(-observed)
    p, last = np.ones(observed.size), 0.0
    for rank, index in enumerate(order):
        maximum = drawn[order[rank:]].max(axis=0)
        last = max(last, (1.0 + np.sum(maximum >= observed[index])) / (1.0 + maximum.size))
        p[index] = last
    return p


def max_threshold(screened: Screen, noise: Floats) -> float:
    """Quantile of the largest projected residual [sd] that chance exceeds at FAMILYWISE_LEVEL."""
    units = []
    for signature in screened.resolved:
        norms = np.linalg.norm(signature.free, axis=1)
        at = int(np.argmax(norms))
        units.append(signature.free[at] / norms[at])
    if not units:
        return 0.0
    return float(np.quantile(np.max(np.array(units) @ noise, axis=0), 1.0 - FAMILYWISE_LEVEL))


def power(norm: float, threshold: float) -> float:
    """Chance that an effect of expected strength passes the family-wise test."""
    return float(special.ndtr(norm - threshold)) if norm > 0.0 else 0.0


def decoy_rank(
    prepared: PreparedProblem, screened: Screen, observed: Floats, generator: np.random.Generator
) -> int:
    """Rank of the best made-up effect among the candidates, 1 being the strongest of all.

    A decoy has a smooth random signature with the typical norm of the candidates; one that ranks high shows
    that names are being given to noise, or to something that no candidate describes.
    """
    axes, which = condition_axes(prepared), prepared.rows.which
    norms = [s.norm for s in screened.resolved]
    if not axes or not norms:
        return observed.size + 1
    position = np.column_stack(list(axes.values()))
    residual, basis = screened.residual, screened.left.basis
    strength = np.linspace(0.0, 2.0, 13)
    prior = -0.5 * strength**2
    best = -np.inf
    for _ in range(DECOYS):
        wave = generator.standard_normal((position.shape[1], len(prepared.rows.observables))) / DECOY_LENGTH
        phase = generator.uniform(0.0, 2.0 * np.pi, len(prepared.rows.observables))
        shape = np.sin(np.einsum("ij,ji->i", position, wave[:, which]) + phase[which])
        below = np.concatenate([prepared.white(shape), np.zeros(residual.size - prepared.rows.size)])
        free = below - basis @ (basis.T @ below)
        free *= np.median(norms) / max(float(np.linalg.norm(free)), 1e-300)
        fall = 2.0 * strength * float(free @ residual) - strength**2 * float(free @ free)
        best = max(best, float(log_sum_exp(0.5 * fall + prior - log_sum_exp(prior))))
    return 1 + int(np.sum(observed > best))
