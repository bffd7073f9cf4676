"""Two effects at once: which pairs are worth a refit, and what they explain.

Pairs are sought in two ways. Algebra on the paths at the bare model's best fit ranks all of them at once; it
fails where one effect is so strong that this fit means nothing. So the best singles, where they leave a
misfit, are taken for granted in turn, and the others are screened against what each of them leaves.
"""

from itertools import combinations

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Progress
from taichi_erosion.evidence.inference.goodness_of_fit import misfit_p, residuals_of
from taichi_erosion.evidence.inference.levels import SECOND_EFFECT_LEVEL
from taichi_erosion.evidence.inference.model_discrepancy import Kernel
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import (
    WITHIN,
    FittedHypothesis,
    evaluated,
    likely_strength,
    quick,
    refit,
)
from taichi_erosion.evidence.inference.screen import Screen, Signature, screen

GAIN = 0.5  # ln Bayes factor by which a pair must beat its better member in the screen
PAIRS, PAIRS_QUICK = 6, 3
GRANTED, SECONDS = 3, 3  # singles taken for granted, and second effects tried on top of each

Starts = dict[tuple[str, str], list[Floats]]  # joint positions from which a pair is refitted


def fit_pairs(
    prepared: PreparedProblem,
    found: Screen,
    singles: list[FittedHypothesis],
    family: list[Kernel],
    progress: Progress,
) -> list[FittedHypothesis]:
    """The pairs that either way finds, refitted; none where one effect says as much as two."""
    starts = promising(prepared, found, singles)
    for pair, position in second_effects(prepared, singles).items():
        starts[pair] = position + starts.get(pair, [])
    judged = []
    for index, (pair, positions) in enumerate(starts.items()):
        progress(f"refitting with {pair[0]} and {pair[1]}", 0.7 + 0.2 * index / len(starts))
        judged.append(evaluated(prepared, refit(prepared, pair, positions[:2]), family))
    return judged


def second_effects(prepared: PreparedProblem, singles: list[FittedHypothesis]) -> Starts:
    """Second effects that what the best singles leave asks for, most of all first."""
    usable = [item for item in singles if item.scored.likelihoods]
    ranked = sorted(usable, key=lambda item: item.scored.expansion.fit.misfit)
    starts: Starts = {}
    for first in ranked[: 1 if quick(prepared) else GRANTED]:
        expansion = first.scored.expansion
        if misfit_p(residuals_of(prepared, expansion)) > SECOND_EFFECT_LEVEL:
            break
        rest = screen(prepared, expansion)
        asked = [(log_fall(s, rest.residual), s) for s in rest.signatures if s.resolved]
        asked = sorted((item for item in asked if item[0] > GAIN), key=lambda item: -item[0])
        for _, second in asked[:SECONDS]:
            order = in_order(prepared, first.names[0], second.name)
            strength = {
                first.names[0]: float(expansion.fit.psi[0]),
                second.name: likely_strength(second, rest.residual),
            }
            position = np.concatenate([expansion.fit.x, [strength[name] for name in order]])
            starts.setdefault(order, []).append(position)
    return starts


def in_order(prepared: PreparedProblem, first: str, second: str) -> tuple[str, str]:
    """A pair in the order of the candidates."""
    names = [candidate.name for candidate in prepared.problem.candidates]
    return (first, second) if names.index(first) < names.index(second) else (second, first)


def promising(prepared: PreparedProblem, found: Screen, singles: list[FittedHypothesis]) -> Starts:
    """Pairs that the screen of the bare model ranks clearly above their members."""
    screened = pair_screen(found)
    observed = {s.name: log_fall(s, found.residual) for s in found.signatures}
    clear = {
        pair: value
        for pair, value in screened.items()
        if value[0] > max(observed[pair[0]], observed[pair[1]]) + GAIN
    }
    best = max((value[0] for value in screened.values()), default=0.0)
    order = [
        pair for pair in sorted(clear, key=lambda pair: -clear[pair][0]) if clear[pair][0] > best - WITHIN
    ]
    fitted = {item.names[0]: item.scored.expansion.fit for item in singles}
    starts: Starts = {}
    for pair in order[: PAIRS_QUICK if quick(prepared) else PAIRS]:
        strengths = np.array(clear[pair][1:])
        starts[pair] = [np.concatenate([found.base.fit.x, strengths])]
        for place, name in enumerate(pair):
            if name in fitted:
                moved = strengths.copy()
                moved[place] = fitted[name].psi[0]
                starts[pair].append(np.concatenate([fitted[name].x, moved]))
    return starts


def pair_screen(found: Screen) -> dict[tuple[str, str], tuple[float, float, float]]:
    """Ln Bayes factor and likely strengths of every pair, by algebra on the paths alone.

    D(a, b) = D_a + D_b - 2 g_a g_b for effects that act independently on the comparison scale.
    """
    acting = [s for s in found.signatures if s.resolved]
    falls = [2.0 * s.free @ found.residual - np.einsum("ij,ij->i", s.free, s.free) for s in acting]
    results = {}
    for i, j in combinations(range(len(acting)), 2):
        first, second = acting[i], acting[j]
        fall = falls[i][:, np.newaxis] + falls[j][np.newaxis, :] - 2.0 * first.free @ second.free.T
        value = 0.5 * fall + first.log_prior[:, np.newaxis] + second.log_prior[np.newaxis, :]
        at = np.unravel_index(int(np.argmax(value)), value.shape)
        results[(first.name, second.name)] = (
            float(log_sum_exp(value)),
            float(first.grid[at[0]]),
            float(second.grid[at[1]]),
        )
    return results


def log_fall(signature: Signature, residual: Floats) -> float:
    """Ln Bayes factor of one signature in the screen."""
    fall = 2.0 * signature.free @ residual - np.einsum("ij,ij->i", signature.free, signature.free)
    return float(log_sum_exp(0.5 * fall + signature.log_prior))
