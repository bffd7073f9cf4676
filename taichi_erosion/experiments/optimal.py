"""D-optimal runs: those that make the determinant of X'X largest.

    det(X'X + x x') = det(X'X) (1 + d),   d = x' (X'X)^-1 x

so a run is worth adding where the variance d of the prediction is largest; afterwards every added run is
exchanged for a better one until none is left. The optimum is a local one.

Reference: Fedorov (1972), Theory of Optimal Experiments; Mitchell (1974), Technometrics 16, 203.
"""

from collections.abc import Sequence

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.table import Floats
from taichi_erosion.experiments.terms import Term, model_matrix

RIDGE = 1e-6  # keeps X'X invertible until enough runs are there; no effect on which full-rank set is best [1]
WORTHWHILE = 1e-9  # relative gain of the determinant below which no run is exchanged [1]


def best_additions(present: Floats, candidates: Floats, terms: Sequence[Term], runs: int) -> Floats:
    """Candidates to add to the points that are present, [runs, factors]."""
    if runs < 1:
        raise BadInput(f"D-optimal: {runs} added runs; needs at least 1")
    fixed, choices = model_matrix(present, terms), model_matrix(candidates, terms)
    information = fixed.T @ fixed + RIDGE * np.eye(choices.shape[1])
    chosen: list[int] = []
    for _ in range(runs):
        chosen.append(worthiest(information, choices)[0])
        information = information + np.outer(choices[chosen[-1]], choices[chosen[-1]])
    exchange(information, choices, chosen)
    points = candidates[chosen]
    if np.linalg.matrix_rank(model_matrix(np.concatenate([present, points]), terms)) < choices.shape[1]:
        raise BadInput(
            f"D-optimal: {len(present)} + {runs} runs cannot fit {choices.shape[1]} coefficients; add more"
        )
    return points


def worthiest(information: Floats, choices: Floats) -> tuple[int, float]:
    """Candidate of the largest variance d, and d."""
    variance = np.einsum("ij,ji->i", choices, np.linalg.solve(information, choices.T))
    best = int(np.argmax(variance))
    return best, float(variance[best])


def exchange(information: Floats, choices: Floats, chosen_out: list[int]) -> None:
    """Take out each chosen run and put in the best one, until a whole round changes nothing."""
    changed = True
    while changed:
        changed = False
        for place, old in enumerate(chosen_out):
            without = information - np.outer(choices[old], choices[old])
            new, worth = worthiest(without, choices)
            kept = float(choices[old] @ np.linalg.solve(without, choices[old]))
            if worth > kept + WORTHWHILE * (1.0 + kept):
                chosen_out[place], changed = new, True
                information = without + np.outer(choices[new], choices[new])
