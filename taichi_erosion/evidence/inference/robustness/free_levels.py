"""Sets of levels that may be off while the others are not, weighed from the fit with all of them free."""

from itertools import combinations

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.inference import verdict_levels as levels

MOST_LEVELS = 6  # observables whose sets of free levels are all tried


def level_sets(count: int) -> tuple[list[list[int]], Floats]:
    """Sets of levels that may be off while the others are 0, never none of them, and ln of their priors.

    Of many observables only single ones, pairs, and all of them at once.
    """
    sizes = range(1, count + 1) if count <= MOST_LEVELS else (1, 2, count)
    sets = [list(chosen) for size in sizes for chosen in combinations(range(count), size)]
    each = levels.PRIOR_LEVEL_EACH
    log_prior = np.array([len(c) * np.log(each) + (count - len(c)) * np.log1p(-each) for c in sets])
    return sets, log_prior - log_sum_exp(log_prior)


def log_level_sets(best: Floats, covariance: Floats) -> Floats:
    """Ln evidence (sets, columns) with only some levels off over that with all of them free, priors included.

        Z(S) / Z(all) = N(0; mu, C) / N(0; 0, 1)    over the levels that are not in S

    Reference: Dickey (1971), Ann. Math. Stat. 42, 204.
    """
    sets, log_prior = level_sets(best.shape[0])
    found = np.repeat(log_prior[:, np.newaxis], best.shape[1], axis=1)
    for row, chosen in enumerate(sets):
        rest = [k for k in range(best.shape[0]) if k not in chosen]
        if rest:
            part, mean = covariance[..., rest, :][..., rest], best[rest].T
            solved = (np.linalg.inv(part) @ mean[:, :, np.newaxis])[..., 0]
            squares = np.einsum("ci,ci->c", mean, solved)
            found[row] -= 0.5 * (squares + np.linalg.slogdet(part)[1])
    return found


def log_level_share(best: Floats, covariance: Floats) -> Floats:
    """Ln evidence (columns,) averaged over the sets of levels that may be off, over that with all free."""
    return log_sum_exp(log_level_sets(best, covariance), axis=0)
