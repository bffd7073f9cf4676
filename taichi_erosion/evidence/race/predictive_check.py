"""Posterior-predictive check of a name: is the best of all candidates better than chance alone makes it?

    z_k = g_k^T P y / (g_k^T P g_k)^1/2,   P = V^-1 under nothing,   z ~ N(0, R),   R = corr of g under P

g_k are the signatures of all candidates about the bare model, V has the errors that the best explanation
leaves; p is the chance that max_k z_k is as large as it was. Candidates that imitate each other count once.

Reference: Westfall & Young (1993), Resampling-Based Multiple Testing, 2.3 (max-T).
"""

import numpy as np

from taichi_erosion.evidence.race.fit import Fit, Hypothesis, Race

DRAWS = 4000


def familywise_p(race: Race, best: Fit) -> float:
    """Chance of a candidate as good as the best one if nothing acts and errors are those of `best`."""
    bare = race.fits[Hypothesis(())]
    singles = [fit for key, fit in race.fits.items() if len(key.names) == 1 and not key.beyond]
    if not singles:
        return 1.0
    rows, _ = race.linear(bare)
    known = dict(zip(best.evidence.solved.rows.scales.names, best.evidence.solved.u, strict=True))
    u = np.array(
        [known.get(name, start) for name, start in zip(rows.scales.names, rows.scales.start, strict=True)]
    )
    signatures = np.column_stack([race.prepared.white(fit.jacobian[:, -1]) for fit in singles])
    along, gram = rows.with_bad(best.evidence.bad).solved(u).against(signatures)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-12))
    seen = size > 1e-3
    if not seen.any():
        return 1.0
    observed = float(np.max((along / size)[seen]))
    correlation = (gram / np.outer(size, size))[np.ix_(seen, seen)]
    values, vectors = np.linalg.eigh(correlation)
    draws = np.random.default_rng(0).standard_normal((DRAWS, values.size))
    largest = np.max(draws * np.sqrt(np.maximum(values, 0.0)) @ vectors.T, axis=1)
    return float((1 + np.sum(largest >= observed)) / (1 + DRAWS))
