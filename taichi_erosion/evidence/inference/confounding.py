"""Which effects these measurements do not tell apart, and what a calibration can pass for."""

from collections.abc import Mapping

import numpy as np
from scipy.cluster import hierarchy
from scipy.spatial.distance import squareform

from taichi_erosion.evidence.data.problem import Floats, expected_strength
from taichi_erosion.evidence.inference.levels import ABSORBED, SEPARATION
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.screen import Screen, Signature


def at_strength(signature: Signature, strength: float) -> Floats:
    """Free signature at one strength."""
    return signature.free[int(np.argmin(np.abs(signature.grid - strength)))]


def separations(
    prepared: PreparedProblem, found: Screen, strengths: Mapping[str, float]
) -> tuple[list[str], Floats]:
    """Delta_ab = min over strengths of |g_a - psi g_b|, the sd between two effects when the rival may adapt.

    For straight paths this is |g_a| sin phi_ab; an effect and its opposite are no twins: strengths are >= 0.
    """
    acting = [s for s in found.signatures if s.resolved]
    names = [s.name for s in acting]
    distance = np.zeros((len(acting), len(acting)))
    for i, first in enumerate(acting):
        default = expected_strength(prepared.candidate(first.name))
        target = at_strength(first, strengths.get(first.name, default))
        for j, second in enumerate(acting):
            gap = second.free - target
            distance[i, j] = np.sqrt(np.min(np.einsum("ij,ij->i", gap, gap))) if i != j else 0.0
    return names, np.minimum(distance, distance.T)


def ambiguity(
    prepared: PreparedProblem, found: Screen, strengths: Mapping[str, float]
) -> dict[str, tuple[str, ...]]:
    """Groups by complete linkage, cut at SEPARATION; every effect with the others of its group."""
    names, distance = separations(prepared, found, strengths)
    if len(names) < 2:
        return {name: () for name in names}
    tree = hierarchy.linkage(squareform(distance, checks=False), method="complete")
    cluster = hierarchy.fcluster(tree, SEPARATION, criterion="distance")
    return {
        name: tuple(other for k, other in enumerate(names) if cluster[k] == cluster[i] and k != i)
        for i, name in enumerate(names)
    }


def absorbed_by(prepared: PreparedProblem, found: Screen) -> dict[str, str]:
    """The calibrated number that imitates each effect best, where calibration imitates most of it."""
    best = {}
    slopes = found.base.jacobian / prepared.sd[:, np.newaxis]
    for signature in found.signatures:
        if signature.absorption < ABSORBED or not slopes.shape[1]:
            continue
        at = signature.raw[
            int(np.argmin(np.abs(signature.grid - expected_strength(prepared.candidate(signature.name)))))
        ]
        norms = np.linalg.norm(slopes, axis=0) * max(float(np.linalg.norm(at)), 1e-300)
        cosine = np.abs(slopes.T @ at) / np.maximum(norms, 1e-300)
        best[signature.name] = prepared.axes[int(np.argmax(cosine))].name
    return best
