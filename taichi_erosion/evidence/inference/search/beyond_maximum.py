"""Listed effects that are stronger than the list allows.

A fit that ends at the largest strength of the list, and would go on, is repeated with a range REACH times as
wide. Its prior is a half-normal of the scale of the maximum, and it has the share PRIOR_BEYOND of the prior
of its set: the price of leaving the list.
"""

from collections.abc import Sequence

import numpy as np

from taichi_erosion.evidence.inference.map_fit import Fit, fit
from taichi_erosion.evidence.inference.marginal_likelihood import BOUND, Expansion, projected_residual
from taichi_erosion.evidence.inference.model_discrepancy import Kernels
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis, scored_fit

FALL = 6.0  # of the misfit that the wider range must bring: what its prior costs, twice ln 20


def with_stronger(
    prepared: PreparedProblem, items: Sequence[FittedHypothesis], family: Kernels
) -> list[FittedHypothesis]:
    """Fits beyond the list of those hypotheses that end at a largest strength and would go on."""
    wide = [stronger_fit(prepared, item.expansion) for item in items if item.usable]
    return [scored_fit(prepared, best, family) for best in wide if best is not None]


def stronger_fit(prepared: PreparedProblem, expansion: Expansion) -> Fit | None:
    """The fit of a hypothesis beyond the list, where it is clearly better; else None.

    None too for a model that is known from runs within the list alone: it says nothing beyond them.
    """
    best = expansion.fit
    if prepared.predictor.uncertainty is not None or best.beyond or not any(at_maximum(prepared, expansion)):
        return None
    wide = fit(prepared, best.names, [np.append(best.x, best.psi)], beyond=True)
    better = wide.misfit < best.misfit - FALL and stronger(prepared, wide.acting())
    return wide if better else None


def at_maximum(prepared: PreparedProblem, expansion: Expansion) -> list[bool]:
    """Whether each strength ends at the largest of the list and would go on."""
    stuck, acting = projected_residual(prepared, expansion).stuck, expansion.fit.acting()
    ends = [psi > (1.0 - BOUND) * prepared.candidate(name).maximum for name, psi in acting.items()]
    return [bool(end and held) for end, held in zip(ends, stuck, strict=False)]


def stronger(prepared: PreparedProblem, acting: dict[str, float]) -> list[str]:
    """Effects whose strength exceeds the largest of the list."""
    return [name for name, psi in acting.items() if psi > prepared.candidate(name).maximum]
