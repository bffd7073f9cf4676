"""Least squares with a prior for many columns of residuals at once, at any factor f of their scatter.

    A = D^T W D / f^2 + 1,   g = D^T W r / f^2 - x,   t = A^-1 g,   misfit = r^T W r / f^2 + |x|^2 - g^T t

with D the slopes, r the residuals and x where every column starts from its prior mean. An ordinary row has
W = 1, so that one matrix serves every column. Censored rows have, column by column, the residual and weight
of `linear_algebra.working`, and their deviance in place of r^T W r.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import Working, working
from taichi_erosion.evidence.data.problem import Bools, Floats


@dataclass(frozen=True)
class ColumnSolution:
    """Best change of every column, and the least misfit."""

    misfit: Floats  # (columns,)
    change: Floats  # (d, columns), t
    covariance: Floats  # (d, d), or (columns, d, d) where rows are censored
    log_determinant: Floats  # of A, () or (columns,)

    def of(self, column: int) -> Floats:
        """Covariance of one column (d, d)."""
        return self.covariance if self.covariance.ndim == 2 else self.covariance[column]

    def sd(self, count: int) -> Floats:
        """Standard deviations of the first numbers (count, columns), or (count, 1) alike for all columns."""
        variance = np.einsum("...ii->...i", self.covariance)[..., :count].T
        return np.sqrt(variance if variance.ndim == 2 else variance[:, np.newaxis])


@dataclass(frozen=True)
class ColumnRows:
    """Rows whitened at factor 1; what does not depend on the factor is computed once."""

    design: Floats  # D (n, d)
    residual: Floats  # (n, columns)
    reach: Floats  # (n,), of censored values; 0 of ordinary ones

    @cached_property
    def censored(self) -> Bools:
        return self.reach != 0.0

    @cached_property
    def ordinary(self) -> tuple[Floats, Floats, Floats]:
        """D^T D (d, d), D^T r (d, columns) and |r|^2 (columns,) of the ordinary rows."""
        design, residual = self.design[~self.censored], self.residual[~self.censored]
        return design.T @ design, design.T @ residual, np.einsum("ij,ij->j", residual, residual)

    @cached_property
    def outer(self) -> Floats:
        """Products of the slopes of each censored row (m, d * d)."""
        design = self.design[self.censored]
        return (design[:, :, np.newaxis] * design[:, np.newaxis, :]).reshape(design.shape[0], -1)

    def working(self, factor: float) -> Working:
        """Residuals, weights and deviances of the censored rows."""
        return working(self.residual[self.censored] / factor, self.reach[self.censored] / factor)

    def solved(self, x: Floats, factor: float) -> ColumnSolution:
        """All columns that start at x (d, columns)."""
        matrix, vector, square = self.ordinary
        matrix, vector = matrix / factor**2 + np.eye(x.shape[0]), vector / factor**2 - x
        misfit = square / factor**2 + np.einsum("ij,ij->j", x, x)
        if self.censored.any():
            work = self.working(factor)
            size, weight = x.shape[0], work.weight / factor
            matrix = matrix + (weight.T**2 @ self.outer).reshape(-1, size, size)
            vector = vector + self.design[self.censored].T @ (weight * work.residual)
            misfit = misfit + work.deviances
        covariance = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        change = covariance @ vector if covariance.ndim == 2 else (covariance @ vector.T[..., None])[..., 0].T
        misfit = misfit - np.einsum("ij,ij->j", vector, change)
        return ColumnSolution(misfit, change, covariance, np.asarray(np.linalg.slogdet(matrix)[1]))
