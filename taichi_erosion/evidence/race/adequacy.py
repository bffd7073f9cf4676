"""Whether rows refute an explanation: the test that a name, an agreement and an adoption have in common.

    p = E_f[P(chi^2_n >= y^T V(f)^-1 y)],    ln f ~ N(0, doubt^2)

V holds errors of known size, levels, sources and groups of rows, and the scatter f over what is stated: no
smooth discrepancy counts as chance. Doses of a mechanism are held where the model has gone: what linear rows
promise beyond has not been seen. Where measurements are repeated, the rows must also lie no farther from
the explanation than their repeats scatter (`lack_of_fit_p` of `answers/summary.py`).
"""

from dataclasses import replace

import numpy as np
from scipy import special

from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.race.fit import Fit
from taichi_erosion.evidence.race.priors import ADEQUATE

NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(7)  # of a normal distribution


def discrepancies(fit: Fit) -> Bools:
    """Scales (k,) of smooth discrepancies, which are no chance and no part of an explanation."""
    kinds = [block.kind for block in fit.blocks]
    return np.array([*(kind == "discrepancy" for kind in kinds), *(False,) * (fit.scales.size - len(kinds))])


def residual(fit: Fit) -> Floats:
    """Whitened rows (n,) less an explanation with its levels, sources and groups at their best."""
    now = fit.evidence.solved
    left_out = np.append(discrepancies(fit), False)[now.rows.block]
    return now.rows.y - now.rows.columns @ np.where(left_out, 0.0, now.tau * now.centre)


def misfit_p(fit: Fit, levels: bool) -> float:
    """Chance of as large a misfit of the rows; `levels`, sources and groups as large as they are in the fit.

    Otherwise they have the size that their priors expect.
    """
    rows = fit.evidence.solved.rows
    usual = [b.kind == "preparation" or not levels for b in fit.blocks] + [True] * rows.scatters
    u = np.where(usual, rows.scales.start, fit.scales)
    u = np.where(discrepancies(fit), -np.inf, u)
    if fit.dose is not None:
        own = rows.block == len(fit.blocks) - 1
        rows = replace(rows, y=rows.y - rows.columns[:, own] @ fit.dose.coefficients)
        u[len(fit.blocks) - 1] = -np.inf
    doubt = np.nan_to_num(rows.scales.doubt)
    size = [rows.y @ rows.solved(u + z * doubt).precision[0] for z in NODES]
    return float(WEIGHTS @ special.chdtrc(rows.y.size, np.maximum(size, 0.0)) / WEIGHTS.sum())


def is_adequate(fit: Fit, least: float = ADEQUATE) -> bool:
    """Whether the rows do not refute a fit."""
    return misfit_p(fit, levels=True) >= least
