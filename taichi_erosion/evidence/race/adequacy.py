"""Whether rows refute an explanation: the test that a name, an agreement and an adoption have in common.

    p = E_f[P(chi^2_(n - r) >= y^T V(f)^-1 y - SS / f^2)],    f ~ N(ln f; 0, doubt^2) f^-r exp(-SS / 2 f^2)

V holds errors of known size, levels, sources and groups of rows, and the scatter f over what is stated: no
smooth discrepancy counts as chance. Rows that repeat one another say by their squares SS about their means,
of r degrees of freedom, what f is; they have no other part in p. Doses of a mechanism are held where the
model has gone: what linear rows promise beyond has not been seen. Where measurements are repeated, the rows
must also lie no farther from the explanation than their repeats scatter (`lack_of_fit_p` of
`answers/summary.py`).
"""

from dataclasses import replace

import numpy as np
from scipy import special

from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.race.fit import Fit
from taichi_erosion.evidence.race.priors import ADEQUATE

PREPARED = ("preparation", "batch")  # kinds of blocks
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(7)  # of a normal distribution


def fit_residual(fit: Fit) -> Floats:
    """Whitened rows (n,) less an explanation with its levels, sources and groups at their best.

    What repeats of one set-up have in common is part of it: a preparation would take any lack of fit.
    """
    now = fit.evidence.solution
    places = [k for k, block in enumerate(fit.blocks) if block.kind in ("discrepancy", *PREPARED)]
    exclusions = np.isin(now.rows.block, places)
    return now.rows.y - now.rows.columns @ np.where(exclusions, 0.0, now.tau * now.centre)


def chi_square_of_fit(fit: Fit) -> float:
    """Misfit of all rows: weighted squares of what an explanation leaves."""
    return float(fit.evidence.solution.rows.weight @ fit_residual(fit) ** 2)


def pure_error_of_repeats(fit: Fit) -> tuple[Floats, Floats]:
    """Squares of repeated rows about their means and their degrees of freedom, by scatter (k,)."""
    rows = fit.evidence.solution.rows
    squares, freedom = np.zeros(rows.count_scatters), np.zeros(rows.count_scatters)
    for block in (block for block in fit.blocks if block.kind == "preparation"):
        for repeats in block.columns.T > 0.0:
            repeats &= rows.scatter >= 0
            if (count := int(repeats.sum())) > 1:
                y, weight, k = rows.y[repeats], rows.weight[repeats], rows.scatter[repeats][0]
                squares[k] += weight @ (y - np.average(y, weights=weight)) ** 2
                freedom[k] += count - 1
    return squares, freedom * (squares > 1e-12)  # equal rows, as those pasted twice, tell no scatter


def misfit_p_value(fit: Fit, levels: bool) -> float:
    """Chance of as large a misfit of the rows; `levels`, sources and groups as large as they are in the fit.

    Otherwise they have the size that their priors expect.
    """
    rows = fit.evidence.solution.rows
    usual = [b.kind in PREPARED or not levels for b in fit.blocks] + [True] * rows.count_scatters
    u = np.where(usual, rows.scales.initial, fit.scales)
    u[[k for k, block in enumerate(fit.blocks) if block.kind in ("discrepancy", "dose")]] = -np.inf
    if fit.dose is not None:
        factors = rows.block == len(fit.blocks) - 1
        rows = replace(rows, y=rows.y - rows.columns[:, factors] @ fit.dose.coefficients)
    doubt = np.nan_to_num(rows.scales.doubt)
    size = np.array([rows.y @ rows.at_scales(u + z * doubt).whitened[0] for z in NODES])
    squares, freedom = pure_error_of_repeats(fit)
    ln_f = np.outer(NODES, doubt[rows.block_count :])
    repeats = np.exp(-2.0 * ln_f) @ squares
    share = np.log(WEIGHTS) - ln_f @ freedom - 0.5 * repeats
    share = np.exp(share - share.max())
    chance = special.chdtrc(rows.y.size - freedom.sum(), np.maximum(size - repeats, 0.0))
    return float(share @ chance / share.sum())


def is_adequate(fit: Fit, least: float = ADEQUATE) -> bool:
    """Whether the rows do not refute a fit."""
    return misfit_p_value(fit, levels=True) >= least
