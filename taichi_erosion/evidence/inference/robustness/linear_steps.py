"""Evidence of a hypothesis after its errors or rows have changed: linear about its fit, or fitted again.

The best numbers and strengths t move then: in the linear expansion about the fit t_0 to t_1, and the misfit S
falls by

    F = S(t_0) - S_linear(t_1)

Where a hypothesis fits badly t_1 lies far away, and the fall in the model may differ from F. Half of the
excess of F over the same fall before the change is the most by which ln evidence can be too large. Where it
exceeds TRUSTED the model is evaluated at t_1, within its ranges. Where its misfit falls by F there, the
expansion moves there; where it does not, the hypothesis is fitted again, from t_1, from t_0 and from the
prior.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import Projection, projection
from taichi_erosion.evidence.data.problem import Floats, expected_strength
from taichi_erosion.evidence.inference.map_fit import Fit, Objective, deviance, fit
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem

TRUSTED = 1.0  # ln evidence that a linear step may add, or by which the model may differ from it
BEHIND = 8.0  # ln evidence behind the best from which a hypothesis does not count, prior included


@dataclass(frozen=True)
class LinearStep:
    """Step of a hypothesis to its best numbers and strengths after a change, linear about its fit."""

    start: Floats  # (p + k,), numbers and strengths at the fit
    end: Floats  # (p + k,), within their ranges
    fall: float  # of the misfit that it predicts


def linear_evidence(prepared: PreparedProblem, expansion: Expansion) -> float:
    """Ln marginal likelihood of a hypothesis about its best fit, averaged over the noise factors."""
    return prepared.doubt.averaged(evidence_by_factor(prepared, expansion))


def evidence_by_factor(prepared: PreparedProblem, expansion: Expansion) -> Floats:
    """The same at every noise factor f, linear in the calibrated numbers and strengths.

        ln Z = -sum ln(f s_i) - |M e+|^2 / 2 f^2 - 1/2 ln |D^T D|

    The noise factor f scales rows and prior alike. Censored rows stand as ordinary ones in their weights.
    """
    part, below = stacked_fit(prepared, expansion)
    free, plain = part.free(below), ~prepared.rows.censored
    misfit, factor = float(free @ free), prepared.doubt.factor
    volume = float(np.sum(np.log(prepared.sd[plain]))) + prepared.log_correlation + 0.5 * part.log_determinant
    return -plain.sum() * np.log(factor) - 0.5 * misfit / factor**2 - volume


def stacked_fit(prepared: PreparedProblem, expansion: Expansion) -> tuple[Projection, Floats]:
    """Columns D of strengths, in units of their prior, of numbers and of shared errors; e+ at the fit."""
    fit, rows = expansion.fit, prepared.rows
    scales = strength_scales(prepared, expansion)
    work = prepared.working(expansion.mean)
    white = prepared.whitening(work)
    columns = white(np.hstack([expansion.local * scales, expansion.jacobian]))
    start = np.concatenate([fit.psi / scales, fit.x])
    below = np.concatenate([work.residual, -start, np.zeros(rows.shared.shape[1])])
    return projection(columns, white(rows.shared)), below


def strength_scales(prepared: PreparedProblem, expansion: Expansion) -> Floats:
    """Prior scale of every strength of a hypothesis."""
    return np.array([max(prepared.candidate(name).prior_scale, 1e-9) for name in expansion.fit.names])


def linear_step(prepared: PreparedProblem, expansion: Expansion) -> LinearStep:
    """The step to the best numbers and strengths of a linear expansion, shared errors at their best.

    Censored rows stand as ordinary ones in the fall of the misfit, as in the expansion.
    """
    part, below = stacked_fit(prepared, expansion)
    best, loose, count = expansion.fit, expansion.fit.psi.size, expansion.fit.x.size
    change = part.solve(below)[: loose + count]
    start, scales = np.concatenate([best.x, best.psi]), strength_scales(prepared, expansion)
    moved = np.concatenate([change[loose:], change[:loose] * scales])
    whole = Objective(prepared, best.names, prepared.seeds.scoring, best.beyond)
    work, free = prepared.working(expansion.mean), part.free(below)
    prior = below[work.residual.size : work.residual.size + loose + count]
    shared = prepared.whitening(work)(prepared.rows.shared)
    fixed = deviance(work.residual, shared, np.zeros(work.residual.size)) + float(prior @ prior)
    return LinearStep(start, np.clip(start + moved, whole.low, whole.high), fixed - float(free @ free))


def misfit(prepared: PreparedProblem, expansion: Expansion, mean: Floats, position: Floats) -> float:
    """Misfit of a mean at some numbers and strengths, prior included; infinite where the model fails."""
    residual = prepared.white(prepared.rows.z - mean)
    if not np.all(np.isfinite(residual)):
        return np.inf
    count, scales = position.size - expansion.fit.psi.size, strength_scales(prepared, expansion)
    prior = np.concatenate([position[:count], position[count:] / scales])
    return deviance(residual, prepared.white_shared, prepared.white_reach) + float(prior @ prior)


def doubtful_step(
    before: PreparedProblem, old: Expansion, now: PreparedProblem, expansion: Expansion
) -> LinearStep | None:
    """The linear step of a hypothesis where it predicts more than TRUSTED beyond that before the change."""
    step = linear_step(now, expansion)
    if step.fall <= 2.0 * TRUSTED:
        return None
    return step if step.fall - linear_step(before, old).fall > 2.0 * TRUSTED else None


def settled(
    prepared: PreparedProblem, expansion: Expansion, step: LinearStep, mean: Callable[[Fit], Floats]
) -> Expansion | Fit:
    """The expansion about where the step ends, if the model falls as predicted; else another fit.

    `mean` evaluates the model over the rows of the expansion.
    """
    x, psi = np.split(step.end, [expansion.fit.x.size])
    there = replace(expansion.fit, x=x, psi=psi)
    moved = mean(there) + expansion.moved
    at_start = misfit(prepared, expansion, expansion.mean, step.start)
    at_end = misfit(prepared, expansion, moved, step.end)
    if abs(at_start - at_end - step.fall) < 2.0 * TRUSTED:
        return replace(expansion, fit=there, mean=moved)
    expected = [expected_strength(prepared.candidate(name)) for name in there.names]
    starts = [step.end, step.start, np.append(prepared.prior_mean, expected)]
    return fit(prepared, there.names, starts, beyond=there.beyond)
