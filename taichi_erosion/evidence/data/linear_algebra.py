"""Whitened rows, and limits among them as ordinary rows."""

from dataclasses import dataclass

import numpy as np
from scipy import special

from taichi_erosion.evidence.data.problem import Bools, Floats


@dataclass(frozen=True)
class Whitening:
    """Changes of the rows in independent errors of unit variance: R^-1/2 (v / s), with V = s R s.

    The symmetric root keeps every whitened row as near to its own row as can be, and a row that is correlated
    with no other one as it is.

    Reference: Kessy, Lewin & Strimmer (2018), Am. Stat. 72, 309 (ZCA-cor).
    """

    sd: Floats  # (n,), s
    root: Floats | None = None  # (n, n), R^-1/2; None: no rows are correlated

    def __call__(self, rows: Floats) -> Floats:
        """Whitened rows (n,) or (n, columns)."""
        own = rows / (self.sd if rows.ndim == 1 else self.sd[:, np.newaxis])
        return own if self.root is None else np.asarray(self.root @ own, dtype=np.float64)


@dataclass(frozen=True)
class Working:
    """Censored rows as ordinary ones: same deviance, slope and curvature at this point."""

    residual: Floats  # (n,) or (n, columns)
    weight: Floats  # factor of every row of the Jacobian
    deviances: Floats  # (columns,), -2 ln likelihood without its constant

    @property
    def deviance(self) -> float:
        """Deviance of a single column."""
        return float(self.deviances)


def working(residual: Floats, reach: Floats | Bools) -> Working:
    """Working residuals of one whitened residual, or of columns of them.

    `reach` is 0 for an ordinary row, and says where a censored value lies: -inf below its limit z (as True
    does), +inf above it, h between z - h and z + h, in sd. With the ends a < b of (that range - m) / s its
    deviance is -2 ln P, P = Phi(b) - Phi(a); l = (phi(b) - phi(a)) / P is its score and
    w = l^2 + (b phi(b) - a phi(a)) / P its curvature.

    Reference: Tobin (1958), Econometrica 26, 24.
    """
    spans = np.where(reach, -np.inf, 0.0) if reach.dtype == np.bool_ else np.asarray(reach, dtype=np.float64)
    censored = spans != 0.0
    if not censored.any():
        return Working(residual, np.ones_like(residual), np.sum(residual**2, axis=0))
    u = residual[censored]
    log_share, score, curvature = censored_terms(u, spans[censored].reshape(-1, *([1] * (u.ndim - 1))))
    weight, adjusted = np.ones_like(residual), residual.copy()
    weight[censored] = np.sqrt(curvature)
    adjusted[censored] = -score / np.sqrt(curvature)
    ordinary = np.sum(residual[~censored] ** 2, axis=0)
    return Working(adjusted, weight, ordinary - 2.0 * log_share.sum(axis=0))


def censored_terms(u: Floats, reach: Floats) -> tuple[Floats, Floats, Floats]:
    """Ln probability, score and curvature of censored values; both ends in the lower tail by symmetry."""
    if np.all(np.isinf(reach)):
        return one_sided_terms(u, np.where(reach > 0.0, -1.0, 1.0))
    low = np.where(reach == np.inf, u, np.where(reach == -np.inf, -np.inf, u - np.abs(reach)))
    high = np.where(reach == np.inf, np.inf, np.where(reach == -np.inf, u, u + np.abs(reach)))
    flip = low + high > 0.0
    a, b = np.where(flip, -high, low), np.where(flip, -low, high)
    log_upper = special.log_ndtr(b)
    below = np.minimum(special.log_ndtr(a) - log_upper, -1e-12)
    log_share = log_upper + np.log1p(-np.exp(below))
    density_a, density_b = (np.exp(-0.5 * x**2 - 0.5 * np.log(2.0 * np.pi) - log_share) for x in (a, b))
    ends = [np.where(np.isfinite(x), x, 0.0) * d for x, d in ((a, density_a), (b, density_b))]
    score = density_b - density_a
    curvature = np.clip(score**2 + ends[1] - ends[0], 1e-12, 1.0)
    return log_share, np.where(flip, -score, score), curvature


def one_sided_terms(u: Floats, sign: Floats) -> tuple[Floats, Floats, Floats]:
    """The same where every value is only below its limit (sign 1) or above it (-1): P = Phi(sign u)."""
    b = sign * u
    log_share = special.log_ndtr(b)
    score = np.exp(-0.5 * b**2 - 0.5 * np.log(2.0 * np.pi) - log_share)
    ends = np.where(np.isfinite(b), b, 0.0) * score
    return log_share, sign * score, np.clip(score**2 + ends, 1e-12, 1.0)
