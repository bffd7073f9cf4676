"""What each candidate would do to the measurements, and whether they ask for it: one pass without refitting.

Signatures have finite strength: infinitesimal ones drown in replicate noise. What calibration can imitate is
projected out, and the rest is compared with the residual along the whole path of strengths.
"""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.algebra import log_sum_exp, projection, stack, stack_signature, working
from taichi_erosion.evidence.evidence import Expansion, log_prior, smooth_path
from taichi_erosion.evidence.examination import Examination
from taichi_erosion.evidence.problem import Candidate, Floats
from taichi_erosion.evidence.smooth import paired_change

STEPS = (0.25, 0.5, 1.0, 2.0)  # strengths of a path, in units of the expected one
QUICK_STEPS = (0.5, 1.0)
GRID = 13  # strengths at which a candidate is compared with the residual
UNRESOLVED = 0.7  # share of noise from which a signature is not used at all
NOISE_LIMIT = 0.1  # share of a signature's energy that replicate noise may make up


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
        return self.norm > 0.0 and self.noise < UNRESOLVED


@dataclass(frozen=True)
class Screen:
    """All candidates against the calibrated base model."""

    base: Expansion
    residual: Floats  # (n + p + q), free
    signatures: tuple[Signature, ...]
    seed_correlation: Floats  # (n,), between paired runs; NaN without noise
    basis: Floats

    def signature(self, name: str) -> Signature:
        """Signature of one candidate."""
        return next(signature for signature in self.signatures if signature.name == name)


def expected_strength(candidate: Candidate) -> float:
    """Strength at which power is judged: the prior's scale, within the allowed range."""
    return min(candidate.prior_scale, candidate.maximum)


def screen(exam: Examination, base: Expansion) -> Screen:
    """Signatures of all candidates at the base fit."""
    work = working((exam.rows.z - base.mean) / exam.sd, exam.rows.censored)
    scale = work.weight / exam.sd
    part = projection(base.jacobian * scale[:, np.newaxis], exam.rows.shared * scale[:, np.newaxis])
    residual = part.free(stack(work.residual, base.fit.x, exam.rows.shared.shape[1]))
    signatures, correlations = [], []
    for candidate in exam.problem.candidates:
        found, correlation = signature(exam, base, candidate, scale, part.basis)
        signatures.append(found)
        correlations.append(correlation)
    pooled = np.full(exam.rows.size, np.nan)
    if correlations:
        table = np.array(correlations)
        seen = np.isfinite(table)
        total, count = np.where(seen, table, 0.0).sum(axis=0), seen.sum(axis=0)
        pooled = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return Screen(base, residual, tuple(signatures), pooled, part.basis)


def signature(
    exam: Examination, base: Expansion, candidate: Candidate, scale: Floats, basis: Floats
) -> tuple[Signature, Floats]:
    """Path of one candidate, and the measured correlation of its paired runs."""
    x, mask = base.fit.x, exam.mask(candidate.name)
    steps = QUICK_STEPS if exam.problem.budget.name == "quick" else STEPS
    unit = expected_strength(candidate)
    nodes = np.unique(
        np.clip([0.0, *(step * unit for step in steps), candidate.maximum], 0.0, candidate.maximum)
    )
    if not mask.any() or unit <= 0.0:
        nodes = nodes[:1]
    bare = exam.predictor.predict(x, {}, exam.seeds.signature)
    runs = [bare] + [
        exam.predictor.predict(x, {candidate.name: float(v)}, exam.seeds.signature) for v in nodes[1:]
    ]
    predictor = exam.predictor
    change = np.array([paired_change(run, bare, predictor.which, predictor.conditions) for run in runs])
    change[:, ~mask] = 0.0
    good = np.all(np.isfinite(change), axis=1)
    correlation, extra = (
        paired_noise(exam, bare, runs[-1]) if nodes.size > 1 else (np.full(mask.size, np.nan), None)
    )
    nodes, failed, change = nodes[good], int(np.sum(~good)), change[good]
    top = float(nodes[-1])
    grid = np.unique(np.concatenate([np.linspace(0.0, top, GRID), [min(unit, top)]]))
    raw = smooth_path(exam, nodes, change, 0.0, grid) * scale
    below = stack_signature(raw.T, x.size, exam.rows.shared.shape[1])
    free = (below - basis @ (basis.T @ below)).T
    at = int(np.argmin(np.abs(grid - unit)))
    norm, absorption, noise = cleaned_norm(
        exam, raw[at], free[at], basis, None if extra is None else extra * scale**2
    )
    found = Signature(
        candidate.name,
        grid,
        log_prior(grid, candidate.prior_scale),
        raw,
        free,
        norm,
        absorption,
        noise,
        failed,
    )
    return found, correlation


def paired_noise(exam: Examination, bare: Floats, acting: Floats) -> tuple[Floats, Floats | None]:
    """Seed correlation of paired runs, and the variance of their mean difference, row by row."""
    nothing = np.full(bare.shape[1], np.nan)
    if not exam.noisy or bare.shape[0] < 2:
        return nothing, None
    difference = acting - bare
    spread = np.var(difference, axis=0, ddof=1)
    spread = np.where(np.isfinite(spread), spread, 0.0)
    pooled = np.zeros_like(spread)
    for index in np.unique(exam.rows.which):
        rows = exam.rows.which == index
        pooled[rows] = spread[rows].mean()
    own = np.var(bare, axis=0, ddof=1) + np.var(acting, axis=0, ddof=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.where(own > 0.0, 1.0 - spread / own, np.nan)
    return correlation, pooled / bare.shape[0]


def cleaned_norm(
    exam: Examination, raw: Floats, free: Floats, basis: Floats, noise: Floats | None
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
