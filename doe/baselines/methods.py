"""Usual ways to find a missing effect, each with the same inputs as `discover` and with nothing tuned.

Correlation: the bare model is calibrated, and the effect is named whose change of the measured values, at
its expected strength, correlates best with the residuals, where that correlation has p < 0.05 after
Bonferroni's correction for the number of candidates.

BIC: the bare model and the model with each single effect are calibrated; the one with the least

    BIC = S + k ln n

wins, with S the misfit of the calibrated model, k the number of strengths and n the rows.

Discrepancy: a Gaussian process per observable takes up what the calibrated model leaves,

    z = m(x_0) + J (x - x_0) + delta(c) + eps,   delta ~ GP(0, a^2 exp(-d^2 / 2 l^2)),   x ~ N(0, 1)

with d summed over all conditions, a and l averaged over a grid. Something is missing where "a > 0" has a
probability of 0.95 or more, after even odds. It has no names; what it names here is the effect whose change
correlates best with the mean of the discrepancy.

Reference: Schwarz (1978), Ann. Stat. 6, 461 (BIC); Kennedy & O'Hagan (2001), J. R. Stat. Soc. B 63, 425.
"""

from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Problem, expected_strength
from taichi_erosion.evidence.data.transforms import axis_value
from taichi_erosion.evidence.inference.map_fit import fit, fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, expand
from taichi_erosion.evidence.inference.model_discrepancy import AMPLITUDES, LENGTHS, condition_axes
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.inference.screen import Screen, screen

LEVEL = 0.05  # of the correlation, for all candidates together
SURE = 0.95  # probability of a discrepancy from which something is said to be missing
REACH = float(stats.norm.ppf(0.95))  # sd of a normal 90 % interval
LEAST_ROWS = 3  # of a correlation


@dataclass(frozen=True)
class Told:
    """What one method says of one study."""

    flagged: bool  # something is missing
    named: str = ""
    parameters: dict[str, tuple[float, float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Calibrated:
    """The calibrated bare model and what each candidate would change."""

    prepared: PreparedProblem
    base: Expansion
    screened: Screen
    residual: Floats  # whitened, (n,)


def told_by_all(problem: Problem, seed: int) -> dict[str, Told]:
    """Answers of all baselines."""
    prepared, best, _ = fit_base(prepare(problem, problem.visible(), seed))
    base = expand(prepared, best)
    work = prepared.working(base.mean)
    ready = Calibrated(prepared, base, screen(prepared, base), work.residual)
    return {"correlation": correlation(ready), "BIC": least_bic(ready), "discrepancy": discrepancy(ready)}


def best_correlated(ready: Calibrated, values: Floats) -> tuple[str, float]:
    """Candidate whose change of the rows correlates best with some whitened values, and that correlation."""
    best, name = 0.0, ""
    for signature in ready.screened.signatures:
        at = signature.at(expected_strength(ready.prepared.candidate(signature.name)))
        change = signature.raw[at]
        if np.std(change) > 0.0 and np.std(values) > 0.0:
            found = float(np.corrcoef(change, values)[0, 1])
            best, name = (found, signature.name) if found > best else (best, name)
    return name, best


def correlation(ready: Calibrated) -> Told:
    """The effect that correlates best with the residuals, where chance would not make it."""
    count, n = len(ready.screened.signatures), ready.residual.size
    name, best = best_correlated(ready, ready.residual)
    if not name or n < LEAST_ROWS:
        return Told(False)
    t = best * np.sqrt((n - 2) / max(1.0 - best**2, 1e-300))
    p = count * float(stats.t.sf(t, n - 2))
    return Told(True, name) if p < LEVEL else Told(False)


def least_bic(ready: Calibrated) -> Told:
    """The single effect, or none, of the least BIC."""
    prepared, base = ready.prepared, ready.base.fit
    best, name = base.misfit, ""
    for signature in ready.screened.signatures:
        strength = signature.likely_strength(ready.screened.residual)
        start = np.append(base.x, strength)
        value = fit(prepared, (signature.name,), [start]).misfit + np.log(prepared.rows.size)
        best, name = (value, signature.name) if value < best else (best, name)
    return Told(bool(name), name)


def discrepancy(ready: Calibrated) -> Told:
    """Whether a discrepancy is there, which effect it resembles, and the calibrated numbers beside it."""
    prepared, x = ready.prepared, ready.base.fit.x
    work = prepared.working(ready.base.mean)
    slopes = ready.base.jacobian * (work.weight / prepared.sd)[:, np.newaxis]
    residual = work.residual + slopes @ x
    tried = [posterior_with(residual, slopes, kernel) for kernel in scaled_kernels(prepared)]
    logs = np.array([each.log_evidence for each in tried])
    prior = np.append(np.log(0.5), np.full(logs.size - 1, np.log(0.5 / max(logs.size - 1, 1))))
    weight = np.exp(logs + prior - log_sum_exp(logs + prior))
    mean = np.sum([w * each.position for w, each in zip(weight, tried, strict=True)], axis=0)
    second = np.sum(
        [w * (np.diag(e.covariance) + e.position**2) for w, e in zip(weight, tried, strict=True)], axis=0
    )
    smooth = np.sum([w * each.smooth for w, each in zip(weight, tried, strict=True)], axis=0)
    numbers = numbers_of(prepared, mean, np.sqrt(np.maximum(second - mean**2, 0.0)))
    if 1.0 - weight[0] < SURE:
        return Told(False, "", numbers)
    return Told(True, best_correlated(ready, smooth)[0], numbers)


def numbers_of(prepared: PreparedProblem, mean: Floats, sd: Floats) -> dict[str, tuple[float, float, float]]:
    """Calibrated numbers with their 90 % intervals."""
    found = {}
    for j, axis in enumerate(prepared.axes):
        points = np.clip(mean[j] + REACH * sd[j] * np.array([0.0, -1.0, 1.0]), axis.low, axis.high)
        value, low, high = (axis_value(axis, float(point)) for point in points)
        found[axis.name] = (value, low, high)
    return found


def scaled_kernels(prepared: PreparedProblem) -> list[Floats]:
    """Covariances (n, n) of a discrepancy in sd of the rows: none, then every amplitude and length."""
    axes = condition_axes(prepared)
    none = np.zeros((prepared.rows.size, prepared.rows.size))
    if not axes:
        return [none]
    position = np.column_stack(list(axes.values()))
    square = np.sum((position[:, np.newaxis] - position[np.newaxis]) ** 2, axis=2)
    same = prepared.rows.which[:, np.newaxis] == prepared.rows.which[np.newaxis]
    return [
        none,
        *(
            np.where(same, amplitude**2 * np.exp(-0.5 * square / length**2), 0.0)
            for amplitude in AMPLITUDES
            for length in LENGTHS
        ),
    ]


@dataclass(frozen=True)
class LinearPosterior:
    """Calibrated numbers and discrepancy of a linear model, given one kernel."""

    log_evidence: float
    position: Floats  # (p,)
    covariance: Floats  # (p, p)
    smooth: Floats  # (n,), mean of the discrepancy


def posterior_with(residual: Floats, slopes: Floats, kernel: Floats) -> LinearPosterior:
    """Normal posterior of r = J x + delta + eps with x ~ N(0, 1), eps ~ N(0, 1), delta ~ N(0, kernel)."""
    whole = np.eye(residual.size) + kernel + slopes @ slopes.T
    solved = np.linalg.solve(whole, residual)
    log_evidence = -0.5 * float(residual @ solved) - 0.5 * float(np.linalg.slogdet(whole)[1])
    covariance = np.eye(slopes.shape[1]) - slopes.T @ np.linalg.solve(whole, slopes)
    return LinearPosterior(log_evidence, slopes.T @ solved, covariance, kernel @ solved)
