"""Score screen: the signature of each candidate against the residual of a fitted hypothesis, without refits.

Signatures have finite strength: infinitesimal ones are below replicate noise. What calibration can imitate is
projected out, and the rest is compared with the residual along the whole path of strengths.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Bools, Candidate, Floats, expected_strength
from taichi_erosion.evidence.inference.marginal_likelihood import (
    Expansion,
    ProjectedResidual,
    log_prior,
    projected_residual,
    smooth_path,
)
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.verdict_levels import UNRESOLVED_NOISE
from taichi_erosion.evidence.models.predictor import paired_change

STEPS = (0.25, 0.5, 1.0, 2.0)  # strengths of a path, in units of the expected one
QUICK_STEPS = (0.5, 1.0)
GRID = 25  # strengths at which a candidate is compared with chance, closest near 0
PEAK = np.linspace(-4.0, 4.0, 9)  # further strengths, in sd about the one that fits the residual best


@dataclass(frozen=True)
class Signature:
    """One candidate's path of strengths, whitened."""

    name: str
    grid: Floats  # strengths
    log_prior: Floats
    raw: Floats  # (strengths, n)
    free: Floats  # (strengths, n + p + q), what calibration cannot imitate
    norm: float  # of the free part at expected strength, noise removed
    absorption: float  # share of the signature that calibration can imitate
    noise: float  # share of the free energy that is replicate noise

    @property
    def resolved(self) -> bool:
        """Whether there is a signature, and more of it than replicate noise."""
        return self.norm > 0.0 and self.noise < UNRESOLVED_NOISE

    @cached_property
    def energy(self) -> Floats:
        """Square of the free part, strength by strength."""
        return np.einsum("ij,ij->i", self.free, self.free)

    def at(self, strength: float) -> int:
        """Index of the nearest strength."""
        return int(np.argmin(np.abs(self.grid - strength)))

    def fall(self, residuals: Floats) -> Floats:
        """Fall of the misfit D(psi) = 2 r g(psi) - |g(psi)|^2 for projected residuals (n + p + q, ...)."""
        energy = self.energy.reshape(-1, *(1,) * (residuals.ndim - 1))
        return 2.0 * self.free @ residuals - energy

    def log_bayes(self, residuals: Floats) -> Floats:
        """Ln of evidence over that of the base: the fall of the misfit averaged over the prior of psi."""
        prior = self.log_prior.reshape(-1, *(1,) * (residuals.ndim - 1))
        return log_sum_exp(0.5 * self.fall(residuals) + prior, axis=0)

    def likely_strength(self, residual: Floats) -> float:
        """Strength that leaves least of a projected residual, its prior included."""
        return float(self.grid[int(np.argmax(0.5 * self.fall(residual) + self.log_prior))])


@dataclass(frozen=True)
class Screen:
    """All candidates against a calibrated hypothesis."""

    base: Expansion
    left: ProjectedResidual
    signatures: tuple[Signature, ...]
    seed_correlation: Floats  # (n,), between paired runs; NaN without noise

    @property
    def residual(self) -> Floats:
        """Projected residual (n + p + q,)."""
        return self.left.stacked

    @property
    def resolved(self) -> list[Signature]:
        """Signatures of which there is more than replicate noise."""
        return [signature for signature in self.signatures if signature.resolved]

    def signature(self, name: str) -> Signature:
        return next(signature for signature in self.signatures if signature.name == name)


def screen(prepared: PreparedProblem, base: Expansion) -> Screen:
    """Signatures of all other candidates on top of a fitted hypothesis, mostly the bare model."""
    left = projected_residual(prepared, base)
    others = [each for each in prepared.problem.candidates if each.name not in base.fit.names]
    runs = [runs_along(prepared, base, candidate) for candidate in others]
    signatures = [signature(prepared, each, path, left) for each, path in zip(others, runs, strict=True)]
    correlation = known_mean(np.array([path.correlation for path in runs]), prepared.rows.size)
    return Screen(base, left, tuple(signatures), correlation)


def known_mean(table: Floats, width: int) -> Floats:
    """Mean of every column's finite entries; NaN where there are none."""
    table = table.reshape(-1, width)
    known = np.isfinite(table)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, table, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


@dataclass(frozen=True)
class StrengthRuns:
    """Change of the mean by one candidate at a few strengths, from paired runs."""

    nodes: Floats  # strengths
    change: Floats  # (nodes, n)
    correlation: Floats  # (n,), of paired runs; NaN without noise
    variance: Floats | None  # (n,), of the change at the largest strength; None without noise


def runs_along(prepared: PreparedProblem, base: Expansion, candidate: Candidate) -> StrengthRuns:
    """Paired runs of one candidate from strength 0 to its maximum."""
    x, mask, predictor = base.fit.x, prepared.mask(candidate.name), prepared.predictor
    nodes = strength_nodes(prepared, candidate, mask)
    present, seeds = base.fit.acting(), prepared.seeds.signature
    bare = predictor.predict(x, present, seeds)
    acting = [predictor.predict(x, {**present, candidate.name: float(v)}, seeds) for v in nodes[1:]]
    change = np.array([paired_change(run, bare, predictor) for run in (bare, *acting)])
    change[:, ~mask] = 0.0
    good = np.all(np.isfinite(change), axis=1)
    correlation, variance = np.full(mask.size, np.nan), None
    if acting:
        correlation, variance = paired_noise(prepared, bare, acting[-1])
    return StrengthRuns(nodes[good], change[good], correlation, variance)


def strength_nodes(prepared: PreparedProblem, candidate: Candidate, mask: Bools) -> Floats:
    """Strengths at which the model is run; 0 alone for a candidate that cannot act."""
    unit = expected_strength(candidate)
    if not mask.any() or unit <= 0.0:
        return np.zeros(1)
    steps = QUICK_STEPS if prepared.quick else STEPS
    wanted = np.array([0.0, *(step * unit for step in steps), candidate.maximum])
    return np.unique(np.clip(wanted, 0.0, candidate.maximum))


def comparison_grid(
    prepared: PreparedProblem, candidate: Candidate, path: StrengthRuns, left: ProjectedResidual
) -> tuple[Floats, Floats]:
    """Strengths of a path, and the whitened signature there.

    Chance makes weak effects, of strength about 1 / |M g|, so that the grid is closest near 0. A strong
    effect is known to a small part of its strength, so that the grid is fine about the best one too.
    """

    def white(grid: Floats) -> Floats:
        return left.white(smooth_path(prepared, path.nodes, path.change, 0.0, grid).T).T

    top = float(path.nodes[-1])
    unit = min(expected_strength(candidate), top)
    coarse = np.unique(np.append(top * np.linspace(0.0, 1.0, GRID) ** 2, unit))
    raw = white(coarse)
    if coarse.size < 3:
        return coarse, raw
    free = left.project_signature(raw)
    best = int(np.argmax(2.0 * free @ left.stacked - np.einsum("ij,ij->i", free, free)))
    below, above = max(best - 1, 0), min(best + 1, coarse.size - 1)
    step = coarse[above] - coarse[below]
    spread = step / max(float(np.linalg.norm(free[above] - free[below])), 1e-300)
    peak = coarse[best] + min(spread, 0.25 * step) * PEAK
    grid = np.unique(np.concatenate([coarse, np.clip(peak, 0.0, top)]))
    return grid, white(grid)


def signature(
    prepared: PreparedProblem, candidate: Candidate, path: StrengthRuns, left: ProjectedResidual
) -> Signature:
    """One candidate's path on the grid of strengths, with its norm at its expected strength."""
    grid, raw = comparison_grid(prepared, candidate, path, left)
    free = left.project_signature(raw)
    at = int(np.argmin(np.abs(grid - expected_strength(candidate))))
    variance = None if path.variance is None else left.white.variance(path.variance)
    norm, absorption, noise = denoised_norm(raw[at], free[at], left.row_basis, variance)
    prior = log_prior(grid, candidate.prior_scale, float(grid[-1]))
    return Signature(candidate.name, grid, prior, raw, free, norm, absorption, noise)


def paired_noise(prepared: PreparedProblem, bare: Floats, acting: Floats) -> tuple[Floats, Floats | None]:
    """Seed correlation of paired runs, and the variance of their mean difference, row by row."""
    if not prepared.noisy or bare.shape[0] < 2:
        return np.full(bare.shape[1], np.nan), None
    spread = np.var(acting - bare, axis=0, ddof=1)
    spread = np.where(np.isfinite(spread), spread, 0.0)
    pooled = np.zeros_like(spread)
    for _, rows in prepared.by_observable():
        pooled[rows] = spread[rows].mean()
    own = np.var(bare, axis=0, ddof=1) + np.var(acting, axis=0, ddof=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.where(own > 0.0, 1.0 - spread / own, np.nan)
    return correlation, pooled / bare.shape[0]


def denoised_norm(
    raw: Floats, free: Floats, row_basis: Floats, noise: Floats | None
) -> tuple[float, float, float]:
    """|M g| without the part that replicate noise adds, absorption 1 - |M g| / |g|, and that noise's share.

    |g|^2 true = |g|^2 - tr(M cov g)
    """
    whole, left = float(raw @ raw), float(free @ free)
    noise_left = 0.0
    if noise is not None:
        acts = raw != 0.0
        leverage = np.einsum("ij,ij->i", row_basis, row_basis)
        noise_left = float(np.sum((noise * (1.0 - leverage))[acts]))
        whole -= float(np.sum(noise[acts]))
    share = noise_left / left if left > 0.0 else 0.0
    left = max(left - noise_left, 0.0)
    whole = max(whole, left)
    absorption = 1.0 - np.sqrt(left / whole) if whole > 0.0 else 0.0
    return float(np.sqrt(left)), float(absorption), min(share, 1.0)
