"""Maximum a posteriori fit of one hypothesis in the model: global search, then Levenberg-Marquardt steps.

The misfit is -2 ln(likelihood times prior) up to a constant, over the calibrated numbers x, in prior sd, and
the strengths psi of the acting effects; errors that rows share are at their best.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from math import inf

import numpy as np
from scipy.stats import qmc

from taichi_erosion.evidence.data.linear_algebra import working
from taichi_erosion.evidence.data.problem import Floats, Integers
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.predictor import paired_change, seed_mean

STEP = 0.1  # finite difference in prior sd
STEP_NOISY = 0.5  # the same where replicate noise blurs differences
STAGES = ((3.0, False), (0.5, False))  # shares of the step: coarse slopes see past kinks, fine ones finish
STAGES_NOISY = (
    (1.0, False),
    (1.0, True),
    (0.2, True),
)  # smoothed over the rows, then row by row, to both sides
TRIALS = 5  # of the damping, per step
GOOD_ENOUGH, GOOD_NOISY = 0.02, 0.1  # fall of the misfit below which no further step is made [1]
STEPS, STEPS_QUICK = 25, 5  # at most; kinks at the threshold of transport make some fits slow
SEARCH_POINTS = 10  # per calibrated number
STARTS, MOST_STARTS = 3, 7  # of the bare model; beyond the first only while the misfit is poor
POOR = 4.0  # misfit per row of a fit that may have gone astray, or whose model lacks much
MOVES = 3  # rounds in which conditions with errors are moved to their most probable values
LEVEL_ROUNDS = 3  # in which the priors of free levels are widened, at most
SEARCH_WIDTH = 2.0  # prior sd to either side
NEAR = 2.0  # sd within which a fitted value may stand for the measured one
SAME = 0.005  # relative spread of the sd below which it is called constant
DISAGREEMENT = 2.0  # posterior sd by which two starts may differ unreported


@dataclass(frozen=True)
class Fit:
    """Best calibration of one hypothesis."""

    names: tuple[str, ...]  # acting effects
    x: Floats
    psi: Floats  # their strengths
    misfit: float  # deviance + prior; infinite if the model fails here
    beyond: bool = False  # strengths may exceed the largest that the list allows

    def acting(self) -> dict[str, float]:
        return dict(zip(self.names, map(float, self.psi), strict=True))


def deviance(residual: Floats, shared: Floats, reach: Floats) -> float:
    """Deviance of a whitened residual (n,) with the whitened shared errors (n, q) at their best."""
    work = working(residual, reach)
    if not shared.shape[1]:
        return work.deviance
    columns = shared * work.weight[:, np.newaxis]
    slope = columns.T @ work.residual
    return work.deviance - float(slope @ np.linalg.solve(columns.T @ columns + np.eye(slope.size), slope))


@dataclass(frozen=True)
class Objective:
    """Misfit of one hypothesis as a function of the joint vector (x, psi)."""

    prepared: PreparedProblem
    names: tuple[str, ...]
    seeds: Integers
    beyond: bool = False  # strengths may exceed the largest that the list allows

    @cached_property
    def low(self) -> Floats:
        return np.concatenate([self.prepared.low, np.zeros(len(self.names))])

    @cached_property
    def high(self) -> Floats:
        maxima = [self.prepared.candidate(name, self.beyond).maximum for name in self.names]
        return np.concatenate([self.prepared.high, maxima])

    @cached_property
    def scale(self) -> Floats:
        """Prior sd of every entry."""
        own = [self.prepared.candidate(name, self.beyond) for name in self.names]
        widths = [max(candidate.prior_scale, 1e-9) for candidate in own]
        return np.concatenate([np.ones(len(self.prepared.axes)), widths])

    def split(self, position: Floats) -> tuple[Floats, dict[str, float]]:
        """Calibrated numbers and acting strengths out of one joint vector."""
        count = len(self.prepared.axes)
        return position[:count], dict(zip(self.names, map(float, position[count:]), strict=True))

    def mean(self, position: Floats) -> Floats:
        return self.prepared.predictor.mean(*self.split(position), self.seeds)

    def residual(self, position: Floats) -> Floats:
        return self.prepared.white(self.prepared.rows.z - self.mean(position))

    def misfit(self, position: Floats, residual: Floats) -> float:
        """Deviance + prior; infinite where the model fails."""
        if not np.all(np.isfinite(residual)):
            return inf
        prior = position / self.scale
        whole = deviance(residual, self.prepared.white_shared, self.prepared.white_reach)
        return whole + float(prior @ prior)

    def jacobian(self, position: Floats, central: bool, share: float = 1.0, raw: bool = False) -> Floats:
        """Derivatives of the whitened mean per prior sd."""
        return self.prepared.white(self.slopes(position, central, share, raw))

    def slopes(self, position: Floats, central: bool, share: float = 1.0, raw: bool = False) -> Floats:
        """Derivatives of the mean per prior sd, by finite differences that stay within bounds.

        Smoothed over the conditions where they are noisy, unless `raw`: a kink is in few rows.
        """
        columns = np.empty((self.prepared.rows.size, position.size))
        for j, scale in enumerate(self.scale):
            step = (STEP_NOISY if self.prepared.noisy else STEP) * scale * share
            down, at, up = (
                max(position[j] - step, self.low[j]),
                position[j],
                min(position[j] + step, self.high[j]),
            )
            if not central:
                down, up = (at, up) if up - at >= at - down else (down, at)
            columns[:, j] = self.difference(position, j, down, up, raw) * scale
        return columns

    def difference(self, position: Floats, j: int, down: float, up: float, raw: bool) -> Floats:
        """Slope of the mean along entry j; zero where the model fails or the entry cannot move."""
        if up <= down:
            return np.zeros(self.prepared.rows.size)
        ends = []
        for end in (down, up):
            moved = position.copy()
            moved[j] = end
            ends.append(self.prepared.predictor.predict(*self.split(moved), self.seeds))
        change = (
            seed_mean(ends[1]) - seed_mean(ends[0])
            if raw
            else paired_change(ends[1], ends[0], self.prepared.predictor)
        )
        return np.where(np.isfinite(change), change / (up - down), 0.0)


def newton_step(
    objective: Objective, position: Floats, residual: Floats, damping: float, slopes: Floats
) -> tuple[Floats, float]:
    """Next position of damped least squares within the bounds, and the fall of the misfit that it predicts.

    Entries that would leave their range are fixed at its end (active set).
    """
    prepared, scale, size = objective.prepared, objective.scale, position.size
    work = working(residual, prepared.white_reach)
    design = np.hstack([slopes, prepared.white_shared]) * work.weight[:, np.newaxis]
    matrix = design.T @ design + np.eye(design.shape[1])
    gradient = design.T @ work.residual
    gradient[:size] -= position / scale
    undamped = matrix.copy()
    matrix[np.diag_indices(size)] *= 1.0 + damping
    low, high = (objective.low - position) / scale, (objective.high - position) / scale
    step, free = np.linalg.solve(matrix, gradient), np.ones(matrix.shape[0], dtype=bool)
    for _ in range(size):
        inside = step[:size]
        out = free[:size] & ((inside < low) | (inside > high))
        if not out.any():
            break
        step[:size] = np.where(out, np.clip(inside, low, high), inside)
        free[:size] &= ~out
        fixed = ~free
        right = gradient[free] - matrix[np.ix_(free, fixed)] @ step[fixed]
        step[free] = np.linalg.solve(matrix[np.ix_(free, free)], right)
    predicted = float(2.0 * gradient @ step - step @ undamped @ step)
    return np.clip(position + step[:size] * scale, objective.low, objective.high), predicted


def refine(objective: Objective, start: Floats, steps: int) -> tuple[Floats, float]:
    """Position and misfit after damped Gauss-Newton steps, with finer slopes where coarse ones stall."""
    position = np.clip(start, objective.low, objective.high)
    residual = objective.residual(position)
    best, damping = objective.misfit(position, residual), 1e-3
    enough = GOOD_NOISY if objective.prepared.noisy else GOOD_ENOUGH
    stages = iter(STAGES_NOISY if objective.prepared.noisy else STAGES)
    share, raw = next(stages)
    for _ in range(steps):
        if best == inf:
            break
        slopes = objective.jacobian(position, central=raw, share=share, raw=raw)
        fall = 0.0
        for _ in range(TRIALS):
            trial, predicted = newton_step(objective, position, residual, damping, slopes)
            if predicted < enough:
                break
            trial_residual = objective.residual(trial)
            value = objective.misfit(trial, trial_residual)
            if value < best:
                fall, best, position, residual = best - value, value, trial, trial_residual
                damping *= 0.1
                break
            damping = max(damping, 1e-2) * 10.0
        if fall < enough:
            (share, raw), damping = next(stages, (0.0, False)), 1e-3
        if share == 0.0:
            break
    return position, best


def refined(
    prepared: PreparedProblem,
    names: tuple[str, ...],
    start: Floats,
    steps: int,
    seeds: Integers,
    beyond: bool = False,
) -> tuple[Floats, float]:
    """Best position from one start, and -2 ln of its likelihood times prior.

    Weights are fixed during the steps, or these would lead to where the model is least certain. A model with
    errors of its own has those of the start first, then those of what was found, conditions at their most
    probable values; the volume ln |1 + F^T V^-1 F| of its errors F separates sure fits from vague ones.
    """
    whole = Objective(prepared, names, seeds, beyond)
    there = prepared.with_model_errors(*whole.split(start))
    position, misfit = refine(replace(whole, prepared=there), start, steps)
    if not prepared.has_model_errors:
        return position, misfit
    movable = prepared.condition_errors is not None and prepared.condition_errors.movable
    for _ in range(MOVES if movable else 1):
        there = prepared.with_model_errors(*whole.split(position), moved=True)
        position, misfit = refine(replace(whole, prepared=there), position, steps)
    own = prepared.white(there.rows.shared[:, prepared.rows.shared.shape[1] :])
    return position, misfit + float(np.linalg.slogdet(np.eye(own.shape[1]) + own.T @ own)[1])


def fit(
    prepared: PreparedProblem,
    names: tuple[str, ...],
    starts: list[Floats],
    steps: int | None = None,
    beyond: bool = False,
) -> Fit:
    """Best of several starts of one hypothesis; by default as many steps as the budget allows."""
    steps = (STEPS_QUICK if prepared.quick else STEPS) if steps is None else steps
    results = [refined(prepared, names, start, steps, prepared.seeds.fitting, beyond) for start in starts]
    position, misfit = min(results, key=lambda result: result[1])
    count = len(prepared.axes)
    return Fit(names, position[:count], position[count:].copy(), misfit, beyond)


def fit_base(prepared: PreparedProblem, weighted: bool = False) -> tuple[PreparedProblem, Fit, list[str]]:
    """The bare model calibrated from a prior search and several starts; warnings where these disagree.

    Comes with the problem whose weights no longer depend on the noise of the values themselves, unless it is
    `weighted` so already.
    """
    seeds, steps = prepared.seeds.fitting, STEPS_QUICK if prepared.quick else STEPS
    searching = not prepared.quick and len(prepared.axes) > 0
    starts = [prepared.prior_mean, *(searched(prepared) if searching else [])]
    results: list[tuple[Floats, float]] = []
    for number, start in enumerate(starts):
        if number < STARTS or results[0][1] > POOR * prepared.rows.size:
            results.append(refined(prepared, (), start, steps, seeds))
            results.sort(key=lambda result: result[1])
    warnings = []
    if len(results) > 1 and results[1][1] < inf:
        gap = np.abs(results[0][0] - results[1][0]).max()
        if results[1][1] - results[0][1] > DISAGREEMENT**2 and gap > 0.1 * SEARCH_WIDTH:
            warnings.append("two starts of the calibration end at different places; the better one is used")
    if not weighted:
        prepared = reweighted(prepared, Objective(prepared, (), seeds).mean(results[0][0]))
    return prepared, fit(prepared, (), [results[0][0]], 2), warnings


def fit_free_levels(prepared: PreparedProblem, mean: Floats) -> tuple[PreparedProblem, Fit]:
    """The bare model calibrated with the level of every observable free, from what a mean leaves.

    A prior that the levels leave far behind is widened: a tension between the two is no misfit of the model.
    """
    widths = prepared.level_widths(mean)
    free = prepared.with_free_levels(widths)
    free, best, _ = fit_base(free, weighted=True)
    for _ in range(LEVEL_ROUNDS):
        there = prepared.predictor.mean(best.x, {}, prepared.seeds.fitting)
        wider = prepared.level_widths(there, widths)
        if wider == widths:
            break
        widths = wider
        free = prepared.with_free_levels(widths)
        best = fit(free, (), [best.x, free.prior_mean])
    return free, best


def reweighted(prepared: PreparedProblem, mean: Floats) -> PreparedProblem:
    """Variances of logarithmic rows taken at the fitted value instead of the measured one.

    sd / y is large where y came out low by chance, so low values weigh less and the fit is drawn upwards. The
    fitted value is trusted within NEAR sd of the measured one; a constant relative sd needs no change.
    """
    rows, factor = prepared.rows, np.ones(prepared.rows.size)
    for observable, chosen in prepared.by_observable():
        own = chosen & ~rows.censored & np.isfinite(mean)
        sd = np.sqrt(rows.variance[own])
        if observable.transform == "identity" or own.sum() == 0 or np.ptp(sd) < SAME * sd.max():
            continue
        z = rows.z[own]
        moved = np.clip(mean[own], z - NEAR * sd, z + NEAR * sd) - z
        factor[own] = np.exp(-2.0 * moved)
    return prepared.with_rows(rows.rescattered(factor))


def searched(prepared: PreparedProblem) -> list[Floats]:
    """Best points of a Sobol' sample of the prior, one seed each."""
    count = len(prepared.axes)
    low, high = np.maximum(prepared.low, -SEARCH_WIDTH), np.minimum(prepared.high, SEARCH_WIDTH)
    sampler = qmc.Sobol(count, scramble=False)
    points = low + (high - low) * sampler.random_base2(int(np.ceil(np.log2(SEARCH_POINTS * count))))
    objective = Objective(prepared, (), prepared.seeds.fitting[:1])
    values = [objective.misfit(point, objective.residual(point)) for point in points]
    return [points[int(k)] for k in np.argsort(values)[:MOST_STARTS]]
