"""What each candidate would do to the measurements, and whether they ask for it: one pass without refitting.

Signatures have finite strength: infinitesimal ones drown in replicate noise. What calibration can imitate is
projected out, and the rest is compared with the residual along the whole path of strengths.
"""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import (
    log_sum_exp,
    projection,
    stack,
    stack_signature,
    working,
)
from taichi_erosion.evidence.data.problem import Bools, Candidate, Floats, expected_strength
from taichi_erosion.evidence.inference.levels import UNRESOLVED_NOISE
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, log_prior, smooth_path
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
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
    failed: int  # strengths at which the model failed

    @property
    def resolved(self) -> bool:
        """Whether there is a signature, and more of it than replicate noise."""
        return self.norm > 0.0 and self.noise < UNRESOLVED_NOISE


@dataclass(frozen=True)
class Screen:
    """All candidates against a calibrated hypothesis."""

    base: Expansion
    residual: Floats  # (n + p + q), free
    signatures: tuple[Signature, ...]
    seed_correlation: Floats  # (n,), between paired runs; NaN without noise
    basis: Floats

    def signature(self, name: str) -> Signature:
        """Signature of one candidate."""
        return next(signature for signature in self.signatures if signature.name == name)


def screen(prepared: PreparedProblem, base: Expansion) -> Screen:
    """Signatures of all other candidates on top of a fitted hypothesis, mostly the bare model."""
    work = working((prepared.rows.z - base.mean) / prepared.sd, prepared.rows.censored)
    scale, loose = work.weight / prepared.sd, base.local.shape[1]
    slopes = np.hstack([base.local, base.jacobian]) * scale[:, np.newaxis]
    part = projection(slopes, base.shared * scale[:, np.newaxis], loose)
    x = np.concatenate([np.zeros(loose), base.fit.x])
    residual = part.free(stack(work.residual, x, base.shared.shape[1]))
    signatures = []
    pairs: list[Floats] = []
    for candidate in prepared.problem.candidates:
        if candidate.name not in base.fit.names:
            path = runs_along(prepared, base, candidate)
            signatures.append(signature(prepared, candidate, path, Whitening(scale, part.basis, residual)))
            pairs.append(path.correlation)
    return Screen(
        base, residual, tuple(signatures), known_mean(np.array(pairs), prepared.rows.size), part.basis
    )


def known_mean(table: Floats, width: int) -> Floats:
    """Mean of every column's finite entries; NaN where there are none."""
    table = table.reshape(-1, width)
    seen = np.isfinite(table)
    count = seen.sum(axis=0)
    return np.where(count > 0, np.where(seen, table, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


@dataclass(frozen=True)
class Runs:
    """What one candidate does to the mean at a few strengths, from paired runs."""

    nodes: Floats  # strengths
    change: Floats  # (nodes, n)
    failed: int  # strengths at which the model failed
    correlation: Floats  # (n,), of paired runs; NaN without noise
    variance: Floats | None  # (n,), of the change at the largest strength; None without noise


def runs_along(prepared: PreparedProblem, base: Expansion, candidate: Candidate) -> Runs:
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
    return Runs(nodes[good], change[good], int(np.sum(~good)), correlation, variance)


def strength_nodes(prepared: PreparedProblem, candidate: Candidate, mask: Bools) -> Floats:
    """Strengths at which the model is run; 0 alone for a candidate that cannot act."""
    steps = QUICK_STEPS if prepared.problem.budget.name == "quick" else STEPS
    unit = expected_strength(candidate)
    if not mask.any() or unit <= 0.0:
        return np.zeros(1)
    wanted = np.array([0.0, *(step * unit for step in steps), candidate.maximum])
    return np.unique(np.clip(wanted, 0.0, candidate.maximum))


@dataclass(frozen=True)
class Whitening:
    """From changes of the mean to free signatures, and the free residual they are compared with."""

    scale: Floats  # (n,)
    basis: Floats
    residual: Floats

    def raw(self, prepared: PreparedProblem, path: Runs, grid: Floats) -> Floats:
        """Whitened signature along a grid of strengths."""
        return smooth_path(prepared, path.nodes, path.change, 0.0, grid) * self.scale

    def free(self, raw: Floats) -> Floats:
        """What calibration cannot imitate of it."""
        below = stack_signature(raw.T, self.residual.size - raw.shape[1], 0)
        return (below - self.basis @ (self.basis.T @ below)).T


def strength_grid(
    prepared: PreparedProblem, candidate: Candidate, path: Runs, white: Whitening
) -> tuple[Floats, Floats]:
    """Strengths of a path, and the whitened signature there.

    Chance makes weak effects, of strength about 1 / |M g|, so that the grid is closest near 0. A strong
    effect is known to a small part of its strength, so that the grid is fine about the best one too.
    """
    top = float(path.nodes[-1])
    unit = min(expected_strength(candidate), top)
    coarse = np.unique(np.append(top * np.linspace(0.0, 1.0, GRID) ** 2, unit))
    raw = white.raw(prepared, path, coarse)
    if coarse.size < 3:
        return coarse, raw
    free = white.free(raw)
    best = int(np.argmax(2.0 * free @ white.residual - np.einsum("ij,ij->i", free, free)))
    near = free[min(best + 1, coarse.size - 1)] - free[max(best - 1, 0)]
    step = coarse[min(best + 1, coarse.size - 1)] - coarse[max(best - 1, 0)]
    spread = step / max(float(np.linalg.norm(near)), 1e-300)
    peak = coarse[best] + min(spread, 0.25 * step) * PEAK
    grid = np.unique(np.concatenate([coarse, np.clip(peak, 0.0, top)]))
    return grid, white.raw(prepared, path, grid)


def signature(prepared: PreparedProblem, candidate: Candidate, path: Runs, white: Whitening) -> Signature:
    """One candidate's path on the grid of strengths, with what it amounts to at its expected strength."""
    grid, raw = strength_grid(prepared, candidate, path, white)
    free = white.free(raw)
    at = int(np.argmin(np.abs(grid - expected_strength(candidate))))
    variance = None if path.variance is None else path.variance * white.scale**2
    norm, absorption, noise = cleaned_norm(raw[at], free[at], white.basis, variance)
    prior = log_prior(grid, candidate.prior_scale)
    return Signature(candidate.name, grid, prior, raw, free, norm, absorption, noise, path.failed)


def paired_noise(prepared: PreparedProblem, bare: Floats, acting: Floats) -> tuple[Floats, Floats | None]:
    """Seed correlation of paired runs, and the variance of their mean difference, row by row."""
    nothing = np.full(bare.shape[1], np.nan)
    if not prepared.noisy or bare.shape[0] < 2:
        return nothing, None
    difference = acting - bare
    spread = np.var(difference, axis=0, ddof=1)
    spread = np.where(np.isfinite(spread), spread, 0.0)
    pooled = np.zeros_like(spread)
    for index in np.unique(prepared.rows.which):
        rows = prepared.rows.which == index
        pooled[rows] = spread[rows].mean()
    own = np.var(bare, axis=0, ddof=1) + np.var(acting, axis=0, ddof=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.where(own > 0.0, 1.0 - spread / own, np.nan)
    return correlation, pooled / bare.shape[0]


def cleaned_norm(
    raw: Floats, free: Floats, basis: Floats, noise: Floats | None
) -> tuple[float, float, float]:
    """|M g| without the part that replicate noise adds, absorption 1 - |M g| / |g|, and that noise's share.

    |g|^2 true = |g|^2 - tr(M cov g)
    """
    whole, left = float(raw @ raw), float(free @ free)
    noise_left = 0.0
    if noise is not None:
        acts = raw != 0.0
        leverage = np.einsum("ij,ij->i", basis[: raw.size], basis[: raw.size])
        noise_left = float(np.sum((noise * (1.0 - leverage))[acts]))
        whole -= float(np.sum(noise[acts]))
    share = noise_left / left if left > 0.0 else 0.0
    left = max(left - noise_left, 0.0)
    whole = max(whole, left)
    absorption = 1.0 - np.sqrt(left / whole) if whole > 0.0 else 0.0
    return float(np.sqrt(left)), float(absorption), min(share, 1.0)


def log_bayes(signature_: Signature, residuals: Floats) -> Floats:
    """Ln of evidence over that of the base, for columns of free residuals (n + p + q, columns).

    D(psi) = 2 r g(psi) - |g(psi)|^2 is the fall of the misfit; it is averaged over the prior of psi.
    """
    fall = (
        2.0 * signature_.free @ residuals
        - np.einsum("ij,ij->i", signature_.free, signature_.free)[:, np.newaxis]
    )
    return log_sum_exp(0.5 * fall + signature_.log_prior[:, np.newaxis], axis=0)
