"""Evidence of rows that are linear in everything unknown, and the posterior of all of it.

    y = X b + e,   b_j ~ N(0, tau_j^2),   e_i ~ N(0, kappa_o^2 / w_i)

Columns X are slopes along calibrated numbers and strengths and errors of known size (tau = 1), then blocks of
errors, each with a tau of its own; kappa_o is the scatter of observable o over what is stated, w_i the weight
of a row. With B = tau X^T K X tau, K = diag(w / kappa^2), A = 1 + B, h = tau X^T K y,

    c = A^-1 h,   cov = A^-1,   ln Z = -1/2 (y^T K y - h^T c) - 1/2 ln |A| - sum n_o ln kappa_o

for u = (ln tau, ln kappa). Its slopes follow from E[b^2] (Fisher's identity), its expected curvature from
tau X^T V^-1 X tau = 1 - A^-1; u is found by scoring and integrated by Laplace's method.

References: Rasmussen & Williams (2006), Gaussian Processes, 5.4 (evidence); Longford (1987), Biometrika 74,
817 (scoring of variance components); Tierney & Kadane (1986), J. Am. Stat. Assoc. 81, 82 (Laplace).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import log, pi

import numpy as np
from scipy import linalg

from taichi_erosion.evidence.data.problem import Floats, Integers
from taichi_erosion.evidence.race.priors import BAD_ROW, BAD_SD, SLIP

BLUNDERS = len(BAD_SD)  # ways of being bad; then come a value ten times too large and one too small
CHANCES = (BAD_ROW,) * BLUNDERS + (SLIP, SLIP)
ODDS = np.log([chance / (1.0 - chance) for chance in CHANCES])


@dataclass(frozen=True)
class Scales:
    """Priors of scales u = ln sigma: half-Cauchy, half-normal, or normal in u about 0 (of a scatter)."""

    names: tuple[str, ...]
    cauchy: Floats  # (k,), scale of the half-Cauchy; NaN where it is another
    normal: Floats  # (k,), scale of the half-normal
    doubt: Floats  # (k,), sd of ln sigma

    @staticmethod
    def empty() -> "Scales":
        return Scales((), *np.zeros((3, 0)))

    @cached_property
    def initial(self) -> Floats:
        """Scales at their priors, where every search begins."""
        return np.log(np.where(np.isfinite(self.doubt), 1.0, np.fmax(self.cauchy, self.normal)))

    def log_prior_of_scales(self, u: Floats) -> tuple[float, Floats, Floats]:
        """Ln density of u, its slope and minus its curvature."""
        with np.errstate(invalid="ignore", divide="ignore"):
            far, wide, off = u - np.log(self.cauchy), u - np.log(self.normal), u / self.doubt
            square = np.exp(2.0 * wide)
            tables = (
                (self.cauchy, -np.log(pi * np.cosh(far)), -np.tanh(far), np.cosh(far) ** -2),
                (self.normal, 0.5 * log(2.0 / pi) + wide - 0.5 * square, 1.0 - square, 2.0 * square),
                (self.doubt, -0.5 * off**2 - np.log(self.doubt), -off / self.doubt, self.doubt**-2),
            )
        densities = np.zeros((3, u.size))
        for logs, *rows in tables:
            densities = np.where(np.isfinite(logs), rows, densities)
        return float(densities[0].sum()), densities[1], densities[2]

    def __add__(self, other: "Scales") -> "Scales":
        pairs = ((self.cauchy, other.cauchy), (self.normal, other.normal), (self.doubt, other.doubt))
        return Scales(self.names + other.names, *map(np.concatenate, pairs))


def one_scale(name: str, cauchy: float = np.nan, normal: float = np.nan, doubt: float = np.nan) -> Scales:
    return Scales((name,), np.array([cauchy]), np.array([normal]), np.array([doubt]))


@dataclass(frozen=True)
class LinearRows:
    """Whitened rows y (n,) and columns X (n, q)."""

    y: Floats
    columns: Floats
    block: Integers  # (q,), scale of every column; -1 where it is 1
    scatter: Integers  # (n,), scale of the scatter of every row, counted from the first of these; -1: 1
    scales: Scales  # of the blocks, then of the scatters
    weight: Floats  # (n,)
    slips: Floats  # (n, 2), what a value ten times too large, or too small, adds to y; NaN where it is none

    @cached_property
    def block_count(self) -> int:
        return len(self.scales.names) - self.count_scatters

    @cached_property
    def count_scatters(self) -> int:
        return int(np.sum(np.isfinite(self.scales.doubt)))

    @cached_property
    def block_membership(self) -> Floats:
        """Columns (q, blocks) that belong to each block, as 0 and 1."""
        return (self.block[:, np.newaxis] == np.arange(self.block_count)).astype(np.float64)

    @cached_property
    def normal_equation_products(self) -> tuple[Floats, Floats, Floats, Floats]:
        """X^T w X, X^T w y, y^T w y and numbers of rows, for each scatter and, last, for rows without one."""
        parts = [self.scatter == k for k in (*range(self.count_scatters), -1)]
        each = [(self.columns[rows], self.y[rows], self.weight[rows]) for rows in parts]
        squares = np.array([(x * w[:, np.newaxis]).T @ x for x, _, w in each])
        projections = np.array([(x * w[:, np.newaxis]).T @ y for x, y, w in each])
        energy = np.array([w @ y**2 for _, y, w in each])
        return squares, projections, energy, np.array([float(w.size) for _, _, w in each])

    def correct_bad_rows(self, bad: Mapping[int, int]) -> "LinearRows":
        """The same with BAD_SD times the error of blunders, and slips of the decimal point moved back."""
        weight = self.weight.copy()
        weight[[*bad]] /= np.array([*BAD_SD, 1.0, 1.0])[[*bad.values()]] ** 2
        return replace(self, weight=weight, y=self.y - self.slips_of(bad))

    def slips_of(self, bad: Mapping[int, int]) -> Floats:
        """What slips of the decimal point add to each row (n,)."""
        ways = np.array([bad.get(row, 0) - BLUNDERS for row in range(self.y.size)])
        return np.where(ways < 0, 0.0, self.slips[np.arange(ways.size), ways])

    def at_scales(self, u: Floats) -> "LinearPosterior":
        """Posterior and ln evidence at scales u. Raises numpy.linalg.LinAlgError far outside their range."""
        tau = np.exp(np.append(u, 0.0)[self.block])
        share = np.append(np.exp(-2.0 * u[self.block_count :]), 1.0)
        squares, projections, energy, counts = self.normal_equation_products
        each = squares * (share[:, None, None] * np.outer(tau, tau))
        matrix = each.sum(axis=0)
        matrix[np.diag_indices(tau.size)] += 1.0
        factor = linalg.cholesky(matrix, lower=True, check_finite=False)
        inverse = linalg.cho_solve((factor, True), np.eye(tau.size), check_finite=False)
        vector = tau * (share @ projections)
        centre = inverse @ vector
        volume = float(np.sum(np.log(np.diag(factor)))) + float(counts[:-1] @ u[self.block_count :])
        fit = float(share @ energy - vector @ centre)
        log_likelihood = -0.5 * fit - volume + 0.5 * float(np.sum(np.log(self.weight)))
        return LinearPosterior(self, u, tau, centre, inverse, each, log_likelihood)


@dataclass(frozen=True)
class LinearPosterior:
    """Everything unknown at fixed scales."""

    rows: LinearRows
    u: Floats
    tau: Floats  # (q,)
    centre: Floats  # (q,), b / tau
    inverse: Floats  # (q, q), covariance of b / tau
    products: Floats  # (scatters + 1, q, q), tau X^T K X tau of the rows of each
    log_likelihood: float

    def scales_for(self, others: Scales) -> Floats:
        """Scales of these names here; at their priors where there is none."""
        sizes = dict(zip(self.rows.scales.names, self.u, strict=True))
        return np.array([sizes.get(name, u) for name, u in zip(others.names, others.initial, strict=True)])

    @property
    def value(self) -> float:
        """Ln of likelihood times prior of the scales."""
        return self.log_likelihood + self.rows.scales.log_prior_of_scales(self.u)[0]

    def gradient_and_curvature(self) -> tuple[Floats, Floats]:
        """Slopes of `value` along u, and minus its expected curvature."""
        rows, inverse, owner = self.rows, self.inverse, self.rows.block_membership
        count, k = rows.block_count, rows.count_scatters
        squares, projections, energy, counts = rows.normal_equation_products
        _, slope, bend = rows.scales.log_prior_of_scales(self.u)
        gradient, curvature = slope.copy(), np.zeros((self.u.size,) * 2)
        gradient[:count] += owner.T @ (self.centre**2 + np.diag(inverse) - 1.0)
        rest = np.eye(inverse.shape[0]) - inverse
        curvature[:count, :count] = 2.0 * owner.T @ rest**2 @ owner
        share, best = np.exp(-2.0 * self.u[count:]), self.tau * self.centre
        shift = inverse @ self.products[:k]
        for o in range(k):
            remainder = energy[o] - 2.0 * best @ projections[o] + best @ squares[o] @ best
            gradient[count + o] += share[o] * remainder + np.trace(shift[o]) - counts[o]
            cross = 2.0 * owner.T @ np.einsum("ij,ji->i", shift[o], inverse)
            curvature[:count, count + o] = curvature[count + o, :count] = cross
            for other in range(k):
                curvature[count + o, count + other] = 2.0 * np.sum(shift[o] * shift[other].T)
            curvature[count + o, count + o] += 2.0 * counts[o] - 4.0 * np.trace(shift[o])
        curvature[np.diag_indices(self.u.size)] += np.maximum(bend, 0.02)
        return gradient, curvature

    @cached_property
    def log_evidence(self) -> float:
        """Ln Z with the scales integrated out, without the constants that all hypotheses share."""
        _, curvature = self.gradient_and_curvature()
        return self.value + 0.5 * self.u.size * log(2.0 * pi) - 0.5 * float(np.linalg.slogdet(curvature)[1])

    @cached_property
    def whitened(self) -> tuple[Floats, Floats]:
        """Residual V^-1 y (n,) and the diagonal of V^-1 (n,)."""
        share = self.inverse_variance_of_rows
        design = self.rows.columns * self.tau
        residual = share * (self.rows.y - design @ self.centre)
        return residual, share - share**2 * np.einsum("ij,jk,ik->i", design, self.inverse, design)

    @property
    def inverse_variance_of_rows(self) -> Floats:
        """K, one over the variance of the error of each row alone."""
        share = np.append(np.exp(-2.0 * self.u[self.rows.block_count :]), 1.0)
        return self.rows.weight * share[self.rows.scatter]

    def project(self, columns: Floats) -> tuple[Floats, Floats]:
        """G^T V^-1 y (k,) and G^T V^-1 G (k, k) of other columns G (n, k)."""
        share = self.inverse_variance_of_rows[:, np.newaxis] * columns
        cross = share.T @ (self.rows.columns * self.tau)
        return columns.T @ self.whitened[0], columns.T @ share - cross @ self.inverse @ cross.T


def optimise_scales(rows: LinearRows, u: Floats, steps: int) -> LinearPosterior:
    """Scales by at most so many steps of scoring from u, each of which raises the posterior."""
    now = rows.at_scales(u)
    for _ in range(steps):
        gradient, curvature = now.gradient_and_curvature()
        curvature[np.diag_indices(u.size)] += 0.1
        move = np.clip(np.linalg.solve(curvature, gradient), -1.2, 1.2)
        for share in (1.0, 0.35, 0.12, 0.04):
            then = rows.at_scales(np.clip(now.u + share * move, -5.0, 8.0))
            if then.value > now.value - 1e-9:
                break
        else:
            break
        gain, now = then.value - now.value, then
        if gain < 0.02:
            break
    return now


@dataclass(frozen=True)
class Evidence:
    """Posterior of one hypothesis with the rows that it finds bad."""

    solution: LinearPosterior
    bad: Mapping[int, int]  # row -> way of being bad, of CHANCES
    log_evidence: float


def row_evidence(rows: LinearRows, u: Floats, steps: int, sizes: int = 1) -> Evidence:
    """Evidence with every row that is likelier bad than not, summed over one more.

    Where the scatter grows beyond its doubt, a slip of the decimal point may be the cause, or with all
    `sizes` of blunders any bad row: it is tried.
    """
    evidence, k = evidence_beside_bad_rows(rows, u, steps, {}, sizes), rows.block_count
    narrow = np.append(evidence.solution.u[:k], np.zeros(u.size - k))
    if np.any(evidence.solution.u[k:] > rows.scales.doubt[k:]):
        bad, _ = add_worst_row(rows.at_scales(narrow), {}, sizes)
        tried = sizes == BLUNDERS or max(bad.values()) >= BLUNDERS
        other = evidence_beside_bad_rows(rows, narrow, steps, bad, sizes) if tried else evidence
        return max(evidence, other, key=lambda each: each.log_evidence)
    return evidence


def evidence_beside_bad_rows(
    rows: LinearRows, u: Floats, steps: int, bad: Mapping[int, int], sizes: int
) -> Evidence:
    """The same with some rows that are bad, at most one in six, by blunders of the first `sizes`."""
    most = max(1, rows.y.size // 6)
    while True:
        now = optimise_scales(rows.correct_bad_rows(bad), u, steps)
        more, gain = add_worst_row(now, bad, sizes)
        if np.max(gain) < 1.0 or len(bad) >= most:
            break
        bad, u = more, now.u
    odds = float(ODDS[[*bad.values()]].sum())
    total = now.log_evidence + odds + float(np.log1p(np.sum(np.exp(np.minimum(gain, 30.0)))))
    return Evidence(now, bad, total)


def add_worst_row(now: LinearPosterior, bad: Mapping[int, int], sizes: int) -> tuple[dict[int, int], Floats]:
    """Bad rows with the worst of the others, and ln of o L (n, k) of each row and way of being bad.

    o are the odds of a bad row; with P = V^-1 and a = P y of a blunder, e its additional variance, and of a
    slip s of the decimal point

        L = (1 + e P_ii)^-1/2 exp(1/2 e a_i^2 / (1 + e P_ii)),    L = exp(s a_i - 1/2 s^2 P_ii)
    """
    residual, diagonal = (each[:, np.newaxis] for each in now.whitened)
    extra = (np.square(BAD_SD) - 1.0) / now.inverse_variance_of_rows[:, np.newaxis]
    grown = 1.0 + extra * diagonal
    blunder = -0.5 * np.log(grown) + 0.5 * extra * residual**2 / grown
    slip = now.rows.slips * residual - 0.5 * now.rows.slips**2 * diagonal
    gain = ODDS + np.nan_to_num(np.hstack([blunder, slip]), nan=-np.inf)
    gain[:, sizes:BLUNDERS] = gain[[*bad]] = gain[now.rows.scatter < 0] = -np.inf
    row, way = np.unravel_index(np.argmax(gain), gain.shape)
    return {**bad, int(row): int(way)}, gain
