"""Listed effects that are stronger than the list allows.

A fit that ends at the largest strength of the list, and would go on, is repeated with a range REACH times as
wide. Its prior is a half-normal of the scale of the maximum, and it has the share PRIOR_BEYOND of the prior
of its set: the price of leaving the list.
"""

from collections.abc import Sequence

import numpy as np

from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.inference.map_fit import fit
from taichi_erosion.evidence.inference.marginal_likelihood import BOUND, expand, projected_residual
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis, scored_expansion

FALL = 6.0  # of the misfit that the wider range must bring: what its prior costs, twice ln 20


def with_stronger(
    prepared: PreparedProblem, items: Sequence[FittedHypothesis], family: list[Floats]
) -> list[FittedHypothesis]:
    """Fits beyond the list of those hypotheses that end at a largest strength and would go on.

    None for a model that is known from runs within the list alone: it says nothing beyond them.
    """
    if prepared.predictor.uncertainty is not None:
        return []
    found = []
    for item in items:
        if not item.usable or item.fit.beyond or not any(at_maximum(prepared, item)):
            continue
        wide = fit(prepared, item.names, [np.append(item.fit.x, item.fit.psi)], beyond=True)
        if wide.misfit < item.fit.misfit - FALL and stronger(prepared, wide.acting()):
            found.append(scored_expansion(prepared, expand(prepared, wide), family))
    return found


def at_maximum(prepared: PreparedProblem, item: FittedHypothesis) -> list[bool]:
    """Whether each strength ends at the largest of the list and would go on."""
    stuck = projected_residual(prepared, item.expansion).stuck
    ends = [psi > (1.0 - BOUND) * prepared.candidate(name).maximum for name, psi in item.fit.acting().items()]
    return [bool(end and held) for end, held in zip(ends, stuck, strict=False)]


def stronger(prepared: PreparedProblem, acting: dict[str, float]) -> list[str]:
    """Effects whose strength exceeds the largest of the list."""
    return [name for name, psi in acting.items() if psi > prepared.candidate(name).maximum]
