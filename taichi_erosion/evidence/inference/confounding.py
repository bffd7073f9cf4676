"""Confounding: effects that these measurements do not separate, and numbers that imitate an effect."""

from collections.abc import Mapping

import numpy as np
from scipy.cluster import hierarchy
from scipy.spatial.distance import squareform

from taichi_erosion.evidence.data.problem import Floats, expected_strength
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.screen import Screen
from taichi_erosion.evidence.inference.verdict_levels import ABSORBED, SEPARATION


def separations(
    prepared: PreparedProblem, screened: Screen, strengths: Mapping[str, float]
) -> tuple[list[str], Floats]:
    """Delta_ab = min over strengths of |g_a - psi g_b|, the sd between two effects when the rival may adapt.

    For straight paths this is |g_a| sin phi_ab; an effect and its opposite are no twins: strengths are >= 0.
    """
    resolved = screened.resolved
    distance = np.zeros((len(resolved), len(resolved)))
    for i, first in enumerate(resolved):
        strength = strengths.get(first.name, expected_strength(prepared.candidate(first.name)))
        for j, second in enumerate(resolved):
            gap = second.free - first.free[first.at(strength)]
            distance[i, j] = np.sqrt(np.min(np.einsum("ij,ij->i", gap, gap))) if i != j else 0.0
    return [s.name for s in resolved], np.minimum(distance, distance.T)


def confounded_effects(
    prepared: PreparedProblem, screened: Screen, strengths: Mapping[str, float]
) -> dict[str, tuple[str, ...]]:
    """Every effect with the others of its group: complete linkage, cut at SEPARATION."""
    names, distance = separations(prepared, screened, strengths)
    if len(names) < 2:
        return {name: () for name in names}
    tree = hierarchy.linkage(squareform(distance, checks=False), method="complete")
    cluster = hierarchy.fcluster(tree, SEPARATION, criterion="distance")
    return {
        name: tuple(other for k, other in enumerate(names) if cluster[k] == cluster[i] and k != i)
        for i, name in enumerate(names)
    }


def absorbed_by(prepared: PreparedProblem, screened: Screen) -> dict[str, str]:
    """The calibrated number that imitates each effect best, where calibration imitates most of it."""
    best = {}
    slopes = prepared.white(screened.base.jacobian)
    for signature in screened.signatures:
        if signature.absorption >= ABSORBED and slopes.shape[1]:
            raw = signature.raw[signature.at(expected_strength(prepared.candidate(signature.name)))]
            norms = np.linalg.norm(slopes, axis=0) * max(float(np.linalg.norm(raw)), 1e-300)
            cosine = np.abs(slopes.T @ raw) / np.maximum(norms, 1e-300)
            best[signature.name] = prepared.axes[int(np.argmax(cosine))].name
    return best
