"""The rival "none of these": a smooth discrepancy beside what a hypothesis explains itself.

    delta ~ GP(0, lambda^2 K)

with K built from one condition at a time, or all of them, within each observable. About the best fit the
rows are linear in the strengths and calibrated numbers t, so that with whitened columns D, residual e at t_0,
prior precision P and V = 1 + lambda^2 K

    A = D^T V^-1 D + P,   b = D^T V^-1 e - P t_0,   Q = e^T V^-1 e + t_0^T P t_0 - b^T A^-1 b
    gain = -1/2 (ln |V| + ln |A| - ln |A_0|) + (Q_0 - Q) / 2 f^2

is its evidence over that of the hypothesis without it (index 0: lambda = 0; f: factor of all errors). What
the hypothesis can imitate gains nothing. V^-1 = 1 - U diag(lambda^2 d / (1 + lambda^2 d)) U^T comes from the
eigenvectors U and eigenvalues d of K, which serve every hypothesis; no simulation is needed. With such a
rival probabilities cannot polarise onto a wrong name.

Reference: Kennedy & O'Hagan (2001), J. R. Stat. Soc. B 63, 425; Plumlee & Joseph (2018), Stat. Sinica 28, 601
(what calibration imitates is no discrepancy).
"""

from dataclasses import dataclass, replace
from math import log

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import Whitening, log_sum_exp
from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, projected_residual
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.predictor import standard_axis

LENGTHS = (0.5, 1.0, 2.0)  # of the kernel, in sd of a condition
AMPLITUDES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # sd of the discrepancy over that of the noise
SMALL = 1e-5  # eigenvalues below this share of the largest are dropped
LOOSE = 1e-12  # prior precision of a strength, over the square of its unit
PINNED = 1e12  # prior precision of what is held


def condition_axes(prepared: PreparedProblem) -> dict[str, Floats]:
    """Conditions that vary, standardised; by their logarithm where they span a wide positive range."""
    axes = {name: standard_axis(column) for name, column in prepared.rows.conditions.items()}
    return {name: values for name, values in axes.items() if values is not None}


@dataclass(frozen=True)
class Kernels:
    """Eigenvectors and eigenvalues of k kernels over n rows, whitened."""

    vectors: Floats  # (k, n, n)
    values: Floats  # (k, n)

    @property
    def count(self) -> int:
        """Number of kernels."""
        return int(self.values.shape[0])

    def rescaled(self, before: Whitening, now: Whitening, kept: Bools | None = None) -> "Kernels":
        """The same for rows with another whitening, or for those of them that are kept."""
        roots = self.vectors * np.sqrt(self.values)[:, np.newaxis]
        chosen = np.ones(before.sd.size, dtype=np.bool_) if kept is None else kept
        if before.root is None and now.root is None:
            roots = roots[:, chosen] * (before.sd[chosen] / now.sd)[:, np.newaxis]
        else:
            plain = np.linalg.inv(before(np.eye(before.sd.size))) @ roots
            roots = now(np.eye(now.sd.size)) @ plain[:, chosen]
        return spectra(roots @ np.swapaxes(roots, 1, 2))


NO_KERNELS = Kernels(np.zeros((0, 0, 0)), np.zeros((0, 0)))


def spectra(matrices: Floats) -> Kernels:
    """Eigenvectors and eigenvalues of kernels (k, n, n)."""
    values, vectors = np.linalg.eigh(matrices)
    return Kernels(vectors, np.maximum(values, 0.0))


def kernels(prepared: PreparedProblem) -> Kernels:
    """One kernel per length and condition, and one over all conditions together.

    They are whitened by the typical noise of each observable.
    """
    axes, size = condition_axes(prepared), prepared.rows.size
    if not axes:
        return NO_KERNELS
    same = prepared.rows.which[:, np.newaxis] == prepared.rows.which[np.newaxis, :]
    typical = np.ones(size)
    for _, rows in prepared.by_observable():
        typical[rows] = np.median(prepared.sd[rows])
    height = typical / prepared.sd
    squares = [squared_distance(values, 1.0) for values in axes.values()]
    if len(squares) > 1:
        squares.append(np.sum(squares, axis=0))
    lengths = np.array(LENGTHS)[:, np.newaxis, np.newaxis, np.newaxis]
    found = np.exp(-0.5 * np.array(squares) / lengths**2).reshape(-1, size, size)
    found = np.where(same, found, 0.0) * np.outer(height, height)
    if prepared.white.root is not None:
        found = prepared.white.root @ found @ prepared.white.root
    return spectra(found)


def squared_distance(values: Floats, length: float) -> Floats:
    """Squared distance along one axis over the squared length."""
    return ((values[:, np.newaxis] - values[np.newaxis, :]) / length) ** 2


def low_rank(matrix: Floats) -> Floats:
    """Factor B with K = B B^T to within SMALL."""
    values, vectors = np.linalg.eigh(matrix)
    kept = values > SMALL * max(float(values[-1]), 1e-300)
    return vectors[:, kept] * np.sqrt(values[kept])


@dataclass(frozen=True)
class LinearRows:
    """Whitened rows about the fit of a hypothesis, linear in its strengths, numbers and shared errors."""

    columns: Floats  # (n, d)
    residual: Floats  # (n,), at the fit
    away: Floats  # (d,), fit less prior mean
    precision: Floats  # (d,), of the prior

    def terms(self, family: Kernels, amplitudes: Floats) -> "LinearTerms":
        """The model with a discrepancy, for every kernel and amplitude; amplitude 0: without one."""
        raised = amplitudes[:, np.newaxis] ** 2 * family.values[:, np.newaxis]  # (k, a, n)
        share, turned = raised / (1.0 + raised), self.columns.T @ family.vectors  # (k, d, n)
        left = self.residual @ family.vectors  # (k, n)
        weighted = turned[:, np.newaxis] * share[:, :, np.newaxis]  # (k, a, d, n)
        matrix = self.columns.T @ self.columns - weighted @ np.swapaxes(turned, 1, 2)[:, np.newaxis]
        vector = self.columns.T @ self.residual - (weighted @ left[:, np.newaxis, :, np.newaxis])[..., 0]
        square = self.residual @ self.residual - (share @ (left**2)[:, :, np.newaxis])[..., 0]
        size, volume = self.away.size, np.sum(np.log1p(raised), axis=2)
        return LinearTerms(
            matrix.reshape(volume.size, size, size),
            vector.reshape(volume.size, size),
            square.ravel(),
            volume.ravel(),
        )

    def plain(self) -> "LinearTerms":
        """The model without a discrepancy, as one term."""
        columns, residual = self.columns, self.residual
        return LinearTerms(
            (columns.T @ columns)[np.newaxis],
            (columns.T @ residual)[np.newaxis],
            np.array([residual @ residual]),
            np.zeros(1),
        )


@dataclass(frozen=True)
class LinearTerms:
    """D^T V^-1 D, D^T V^-1 e, e^T V^-1 e and ln |V| for some covariances V (terms)."""

    matrix: Floats  # (terms, d, d)
    vector: Floats  # (terms, d)
    square: Floats  # (terms,)
    volume: Floats  # (terms,)

    def repeated(self, count: int) -> "LinearTerms":
        """A single term so many times, for as many priors."""
        return LinearTerms(*(np.repeat(each, count, axis=0) for each in vars(self).values()))

    def solved(self, away: Floats, precision: Floats, factors: Floats) -> "LinearPosterior":
        """Posterior at noise factors f of the rows, with priors of some precision (d,) or (terms, d)."""
        precision = np.broadcast_to(precision, self.vector.shape)
        scale = factors[:, np.newaxis] ** -2.0
        prior = precision[:, np.newaxis, :, np.newaxis] * np.eye(away.size)
        matrix = self.matrix[:, np.newaxis] * scale[:, np.newaxis] + prior
        vector = self.vector[:, np.newaxis] * scale - (precision * away)[:, np.newaxis]
        inverse = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
        change = (inverse @ vector[..., np.newaxis])[..., 0]
        start = self.square[:, np.newaxis] * scale[:, 0] + (precision @ away**2)[:, np.newaxis]
        volume = self.volume[:, np.newaxis] + np.linalg.slogdet(matrix)[1]
        volume = volume - np.sum(np.log(precision), axis=1)[:, np.newaxis]
        return LinearPosterior(change, inverse, start - np.sum(vector * change, axis=2), volume)


@dataclass(frozen=True)
class LinearPosterior:
    """Normal posterior of what the rows are linear in, for every term and noise factor."""

    change: Floats  # (terms, factors, d), of the best values from the fit
    covariance: Floats  # (terms, factors, d, d)
    misfit: Floats  # (terms, factors), rows and prior at their best
    volume: Floats  # (terms, factors), ln of the determinant of everything, over that of the scatter

    @property
    def log_evidence(self) -> Floats:
        """Ln marginal likelihood (terms, factors), up to what the scatter alone makes."""
        return -0.5 * (self.misfit + self.volume)


def linear_rows(prepared: PreparedProblem, expansion: Expansion) -> LinearRows:
    """The linear model; strengths have no prior, and what would leave its range is held at its end."""
    work, fit = prepared.working(expansion.mean), expansion.fit
    stuck = projected_residual(prepared, expansion).stuck
    white = prepared.whitening(work)
    columns = white(expansion.slopes)
    columns[:, stuck] = 0.0
    columns = np.hstack([columns, white(expansion.shared)])
    strengths, away = expansion.local.shape[1], np.zeros(columns.shape[1])
    away[strengths : strengths + fit.x.size] = np.where(stuck[strengths:], 0.0, fit.x)
    precision = np.ones(columns.shape[1])
    precision[:strengths] = LOOSE
    precision[: stuck.size][stuck] = PINNED
    return LinearRows(columns, work.residual, away, precision)


def discrepancy_gain(prepared: PreparedProblem, expansion: Expansion, family: Kernels) -> Floats:
    """Ln evidence gained by a discrepancy on top of a hypothesis, per noise factor."""
    factors = prepared.doubt.factor
    if not family.count or not expansion.finite:
        return np.full(factors.size, -np.inf)
    if expansion.shared.shape[1] == prepared.rows.shared.shape[1]:
        return gains(prepared, expansion, family, factors)
    # errors of the model itself do not grow with those of the laboratory: every factor has its own balance
    scaled = [scaled_errors(prepared, float(factor)) for factor in factors]
    return np.concatenate([gains(each, expansion, family, np.ones(1)) for each in scaled])


def scaled_errors(prepared: PreparedProblem, factor: float) -> PreparedProblem:
    """The same with all errors of rows times a factor."""
    rows = prepared.rows.rescattered(np.full(prepared.rows.size, factor**2))
    return replace(prepared, rows=rows, variance=factor**2 * prepared.variance)


def gains(prepared: PreparedProblem, expansion: Expansion, family: Kernels, factors: Floats) -> Floats:
    """Ln evidence gained at every noise factor where one balance of errors serves all of them."""
    rows, one = linear_rows(prepared, expansion), np.ones(1)
    bare = rows.plain().solved(rows.away, rows.precision, one)
    smooth = rows.terms(family, np.array(AMPLITUDES)).solved(rows.away, rows.precision, one)
    loss = -0.5 * (smooth.volume - bare.volume)
    gained = loss + 0.5 * (bare.misfit - smooth.misfit) / factors**2
    return log_sum_exp(gained, axis=0) - log(gained.shape[0])
