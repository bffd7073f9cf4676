"""The row of every candidate: present, excluded above a strength, or not testable, and why."""

from dataclasses import dataclass
from math import nan

import numpy as np

from taichi_erosion.evidence.algebra import stack_signature
from taichi_erosion.evidence.evidence import Expansion
from taichi_erosion.evidence.examination import Examination
from taichi_erosion.evidence.findings import EffectFinding, Fitted, Status
from taichi_erosion.evidence.held_out import HeldOut
from taichi_erosion.evidence.intervals import upper_strength
from taichi_erosion.evidence.posterior import Posterior
from taichi_erosion.evidence.screen import NOISE_LIMIT, Signature, expected_strength
from taichi_erosion.evidence.significance import Significance, power
from taichi_erosion.evidence.unknown import free_residual
from taichi_erosion.evidence.verdict import TESTABLE, Decision


@dataclass(frozen=True)
class Remaining:
    """One candidate against what the final hypothesis leaves unexplained."""

    norm: float  # of its signature at expected strength, beyond calibration and named effects
    absorption: float
    best: float  # strength that would fit the rest best
    upper: float  # strength excluded with 95 %


def remaining(exam: Examination, final: Expansion, signature: Signature) -> Remaining:
    """Signature projected on what neither calibration nor the named effects can imitate.

    What the model leaves unexplained beyond noise could hide an effect too: the noise is taken to be as large
    as the misfit per degree of freedom.
    """
    residual, basis = free_residual(exam, final)
    freedom = exam.rows.size - float(np.sum(basis[: exam.rows.size] ** 2))
    excess = max(1.0, float(residual @ residual) / max(freedom, 1.0))
    whole = stack_signature(signature.raw.T, basis.shape[0] - exam.rows.size, 0)
    free = (whole - basis @ (basis.T @ whole)).T
    at = int(np.argmin(np.abs(signature.grid - expected_strength(exam.candidate(signature.name)))))
    kept = max(1.0 - signature.noise, 0.0) ** 0.5
    norm, size = float(np.linalg.norm(free[at])), float(np.linalg.norm(whole[:, at]))
    fall = 2.0 * free[:, : exam.rows.size] @ residual - np.einsum("ij,ij->i", free, free)
    return Remaining(
        norm * kept / excess**0.5,
        1.0 - norm / size if size > 0.0 else 0.0,
        float(signature.grid[int(np.argmax(fall))]),
        upper_strength(signature.grid, 0.5 * fall / excess),
    )


@dataclass(frozen=True)
class Verdicts:
    """What all rows of the table share."""

    decision: Decision
    believed: Posterior
    seen: Significance
    final: Expansion
    fitted: dict[str, Fitted]  # strengths of the final hypothesis and of the shortlist
    held_out: dict[str, HeldOut]


def effect_table(
    exam: Examination, signatures: tuple[Signature, ...], known: Verdicts
) -> dict[str, EffectFinding]:
    """One finding per candidate, in the study's order."""
    return {
        signature.name: effect_finding(exam, signature, index, known)
        for index, signature in enumerate(signatures)
    }


def effect_finding(exam: Examination, signature: Signature, index: int, known: Verdicts) -> EffectFinding:
    """What is known about one candidate."""
    name, decision = signature.name, known.decision
    acts = name in known.final.fit.names
    rest = remaining(exam, known.final, signature) if not acts else None
    norm = signature.norm if rest is None else rest.norm
    absorption = signature.absorption if rest is None else rest.absorption
    strong = power(norm, known.seen.threshold) if norm > 0.0 else 0.0
    status = status_of(name, decision, strong)
    strength = known.fitted.get(name) if status == "present" or name in decision.group or acts else None
    if strength is None:
        upper = rest.upper if rest is not None else nan
        strength = Fitted(rest.best if rest is not None else 0.0, 0.0, upper, False)
    held = known.held_out.get(name, HeldOut(nan, nan))
    return EffectFinding(
        status=status,
        strength=strength.value,
        strength_low=strength.low,
        strength_high=strength.high,
        log_bayes_factor=known.believed.log_bayes.get(name, 0.0),
        power=strong,
        absorption=absorption,
        signature_norm=norm,
        probability=known.believed.inclusion.get(name, 0.0),
        p=float(known.seen.step_down[index]),
        held_out_gain=held.gain,
        held_out_error=held.error,
        sentence=effect_words(signature, status, strength, decision, absorption),
    )


def status_of(name: str, decision: Decision, strong: float) -> Status:
    """Present only what stands alone; silence means absence only where the effect would have been seen."""
    if name in decision.named:
        return "present"
    if name in decision.group or strong < TESTABLE:
        return "not_testable"
    return "excluded"


def effect_words(
    signature: Signature, status: Status, strength: Fitted, decision: Decision, absorption: float
) -> str:
    """One sentence about one candidate."""
    name = signature.name
    if status == "present":
        words = "consistent with the measurements at strength"
        return f"{name}: {words} {strength.value:.2g} ({strength.low:.2g} to {strength.high:.2g})"
    if name in decision.group:
        others = ", ".join(other for other in decision.group if other != name)
        return f"{name}: explains the misfit, but is not distinguished from {others}"
    if status == "excluded":
        return f"{name}: excluded above strength {strength.high:.2g}"
    if not np.any(signature.raw):
        return f"{name}: cannot act in any measured condition"
    if signature.noise > NOISE_LIMIT and signature.norm <= 1.0:
        return f"{name}: its signature is not resolved from the model's own scatter; more seeds would tell"
    if absorption > 0.8:
        share = f"{absorption:.0%} imitated"
        return f"{name}: hardly distinguishable from a change of the calibrated numbers ({share})"
    return f"{name}: not testable with these measurements"
