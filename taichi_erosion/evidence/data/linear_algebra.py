"""Least squares with a prior: the projection onto what calibration cannot imitate.

With whitened residual e, Jacobian J of the calibrated numbers x (prior N(0, 1)) and C of the shared errors
(one sd each), everything stands in stacked rows

    D = [J C; I 0; 0 I],   e+ = [e; -x; 0],   M = 1 - D (D^T D)^-1 D^T

so that |M e+|^2 is the misfit after recalibration and M g the part of a signature g that calibration cannot
absorb.

Least squares with a prior for many columns of residuals at once, at any factor f of their scatter.

    A = D^T W D / f^2 + 1,   g = D^T W r / f^2 - x,   t = A^-1 g,   misfit = r^T W r / f^2 + |x|^2 - g^T t

with D the slopes, r the residuals and x where every column starts from its prior mean. An ordinary row has
W = 1, so that one matrix serves every column. Censored rows have, column by column, the residual and weight
of `linear_algebra.working`, and their deviance in place of r^T W r.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from taichi_erosion.evidence.data.problem import Bools, Floats


@dataclass(frozen=True)
class Projection:
    """Orthogonal basis of the columns of calibration and shared errors."""

    basis: Floats  # Q (n + p + q, p + q)
    triangle: Floats  # R, D = Q R
    size: int  # n

    def free(self, stacked: Floats) -> Floats:
        """M v: the part that calibration and shared errors cannot absorb."""
        return stacked - self.basis @ (self.basis.T @ stacked)

    def solve(self, stacked: Floats) -> Floats:
        """Least-squares change of the calibrated numbers and shared errors that removes v."""
        if not self.triangle.size:
            return np.zeros((0, *stacked.shape[1:]))
        return np.asarray(np.linalg.solve(self.triangle, self.basis.T @ stacked), dtype=np.float64)

    def covariance(self) -> Floats:
        """(D^T D)^-1."""
        inverse = np.linalg.inv(self.triangle) if self.triangle.size else np.zeros((0, 0))
        return inverse @ inverse.T


def projection(jacobian: Floats, shared: Floats, loose: int = 0) -> Projection:
    """Projection for whitened columns; the first `loose` columns have no prior (strengths of effects)."""
    if not jacobian.shape[1] + shared.shape[1]:
        return Projection(np.zeros((jacobian.shape[0], 0)), np.zeros((0, 0)), jacobian.shape[0])
    columns = np.hstack([jacobian, shared])
    prior = np.eye(columns.shape[1])
    prior[:loose] *= 1e-6  # keeps the triangle regular when a signature vanishes
    basis, triangle = np.linalg.qr(np.vstack([columns, prior]))
    return Projection(basis, triangle, jacobian.shape[0])


def stack(residual: Floats, x: Floats, shared: int) -> Floats:
    """e+ = [e; -x; 0] for one residual or for columns of residuals."""
    if residual.ndim == 1:
        return np.concatenate([residual, -x, np.zeros(shared)])
    below = np.vstack(
        [np.repeat(-x[:, np.newaxis], residual.shape[1], 1), np.zeros((shared, residual.shape[1]))]
    )
    return np.vstack([residual, below])


@dataclass(frozen=True)
class Whitening:
    """Changes of the rows in independent errors of unit variance: R^-1/2 (v / s), with V = s R s.

    The symmetric root keeps every whitened row as near to its own row as can be, and a row that is correlated
    with no other one as it is.

    Reference: Kessy, Lewin & Strimmer (2018), Am. Stat. 72, 309 (ZCA-cor).
    """

    sd: Floats  # (n,), s
    weight: Floats | None = None  # (n,), or (k, n), of censored rows the root of their curvature; None: 1
    root: Floats | None = None  # (n, n), R^-1/2; None: no rows are correlated

    @property
    def scale(self) -> Floats:
        """Factor of each row before correlations are removed."""
        return 1.0 / self.sd if self.weight is None else self.weight / self.sd

    def __call__(self, rows: Floats) -> Floats:
        """Whitened rows (n,) or (n, columns); (k, n, columns) where the weights are (k, n)."""
        if self.weight is None:
            own = rows / (self.sd if rows.ndim == 1 else self.sd[:, np.newaxis])
        else:
            own = rows * (self.scale if rows.ndim == 1 else self.scale[..., np.newaxis])
        return own if self.root is None else np.asarray(self.root @ own, dtype=np.float64)

    def unmixed(self, white: Floats) -> Floats:
        """R^1/2 v: of whitened residuals (n, ...) those over the sd of every row alone.

        Of factors of such residuals it makes those of whitened ones.
        """
        return white if self.root is None else np.asarray(np.linalg.solve(self.root, white), dtype=np.float64)

    def back(self, white: Floats) -> Floats:
        """Rows (n,) out of whitened ones."""
        own = self.unmixed(white)
        return np.asarray((own if self.weight is None else own / self.weight) * self.sd, dtype=np.float64)

    def variance(self, variance: Floats) -> Floats:
        """Variances (n,) of whitened rows whose independent errors have these variances."""
        own = variance * self.scale**2
        return own if self.root is None else np.asarray(self.root**2 @ own, dtype=np.float64)


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


def log_sum_exp(values: Floats, axis: int | None = None) -> Floats:
    """Ln sum exp without overflow; plain and fast for the small tables used here."""
    if axis is None and np.isfinite(largest := values.max()):
        return np.asarray(np.log(np.sum(np.exp(values - largest))) + largest)
    top = np.max(values, axis=axis, keepdims=True)
    top = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        total = np.log(np.sum(np.exp(values - top), axis=axis, keepdims=True)) + top
    return np.squeeze(total, axis=axis) if axis is not None else np.asarray(total.reshape(()))
