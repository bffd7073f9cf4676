"""How well each hypothesis explains the measurements: its evidence, from an expansion about its own best fit.

    ln Z = ln int p(psi) exp(-1/2 S(psi) - 1/2 ln |A| + ln box) dpsi - sum ln s_i

with S the misfit after recalibration at strength psi, A = D^T D, box the share of the posterior within the
bounds, and every stated sd possibly wrong by a factor f over which the evidence is averaged. The strength is
integrated on a grid, so that the bound psi >= 0 is exact; the calibrated numbers by Laplace's method.

Reference: Kass & Raftery (1995), J. Am. Stat. Assoc. 90, 773.
"""

from dataclasses import dataclass
from math import inf

import numpy as np
from scipy import interpolate, special

from taichi_erosion.evidence.algebra import Projection, log_box, projection, stack, working
from taichi_erosion.evidence.calibrate import Fit, Objective
from taichi_erosion.evidence.examination import Examination
from taichi_erosion.evidence.problem import Floats

GRID = 33  # strengths at which a single effect is integrated
PAIR_GRID = 13  # per effect of a pair
WIDTH = 4.0  # posterior sd that the fine part of the grid spans to either side
NODES = (-2.0, -1.0, 0.0, 1.0, 2.0)  # of a path, in posterior sd about the best strength


@dataclass(frozen=True)
class Path:
    """Change of the mean along the strength of one effect, from the best fit."""

    grid: Floats  # strengths
    change: Floats  # (strengths, n)
    log_prior: Floats  # ln of prior density times cell width


@dataclass(frozen=True)
class Expansion:
    """One hypothesis about its best fit, judged with fresh seeds."""

    fit: Fit
    mean: Floats  # (n,)
    jacobian: Floats  # (n, p), of the mean per prior sd
    paths: tuple[Path, ...]
    local: Floats  # (n, effects), derivative of the mean along each strength


@dataclass(frozen=True)
class Surface:
    """Evidence of one hypothesis at one noise factor, strength by strength."""

    log_likelihood: Floats  # (columns,), calibrated numbers integrated out
    change: Floats  # (p, columns), best calibrated numbers minus the expansion point
    covariance: Floats  # (p, p)


def expand(exam: Examination, fit: Fit) -> Expansion:
    """Slopes and paths of one hypothesis with the signature seeds, its mean with the judging seeds."""
    position = np.concatenate([fit.x, fit.psi])
    objective = Objective(exam, fit.names, exam.seeds.signature)
    centre = objective.mean(position)
    slopes = objective.jacobian(position, centre, central=exam.problem.budget.name == "full")
    slopes = slopes * exam.sd[:, np.newaxis] / objective.scale
    count = len(exam.axes)
    mean = exam.predictor.mean(fit.x, fit.acting(), exam.seeds.judging)
    spread = strength_sd(exam, slopes, count)
    paths = tuple(
        path_of(exam, fit, centre, index, float(spread[index])) for index in range(len(fit.names))
    )
    return Expansion(fit, mean, slopes[:, :count], paths, slopes[:, count:])


def strength_sd(exam: Examination, slopes: Floats, count: int) -> Floats:
    """Posterior sd of each strength from the slopes; infinite where the effect does nothing."""
    if slopes.shape[1] == count:
        return np.zeros(0)
    white = slopes / exam.sd[:, np.newaxis]
    order = np.hstack([white[:, count:], white[:, :count]])
    loose = slopes.shape[1] - count
    covariance = projection(order, exam.rows.shared / exam.sd[:, np.newaxis], loose).covariance()
    return np.sqrt(np.diag(covariance)[:loose])


def path_of(exam: Examination, fit: Fit, centre: Floats, index: int, spread: float) -> Path:
    """Path along one strength, the others at their best."""
    name = fit.names[index]
    candidate, best = exam.candidate(name), float(fit.psi[index])
    spread = min(spread, 0.5 * candidate.maximum)
    wanted = [best + node * spread for node in NODES] + [0.0, candidate.maximum]
    nodes = np.unique(np.round(np.clip(wanted, 0.0, candidate.maximum), 12))
    changes = []
    for node in nodes:
        acting = {**fit.acting(), name: float(node)}
        changes.append(exam.predictor.mean(fit.x, acting, exam.seeds.signature) - centre)
    change = np.array(changes)
    good = np.all(np.isfinite(change), axis=1)
    nodes, change = nodes[good], change[good]
    change[:, ~exam.mask(name)] = 0.0
    grid = strength_grid(nodes[0], nodes[-1], best, spread, GRID if len(fit.names) == 1 else PAIR_GRID)
    return Path(grid, smooth_path(exam, nodes, change, best, grid), log_prior(grid, candidate.prior_scale))


def strength_grid(low: float, high: float, best: float, spread: float, count: int) -> Floats:
    """Fine about the best strength, coarse over the rest of the allowed range."""
    fine = np.linspace(max(low, best - WIDTH * spread), min(high, best + WIDTH * spread), (2 * count) // 3)
    return np.unique(np.concatenate([np.linspace(low, high, count - fine.size), fine]))


def smooth_path(exam: Examination, nodes: Floats, change: Floats, best: float, grid: Floats) -> Floats:
    """Path between nodes: monotone cubic without noise, else a polynomial through the best fit."""
    if nodes.size < 2:
        return np.zeros((grid.size, change.shape[1]))
    if not exam.noisy or nodes.size < 4:
        return np.asarray(interpolate.PchipInterpolator(nodes, change, axis=0)(grid))
    scale = max(float(np.ptp(nodes)), 1e-300)
    powers = np.arange(1, min(3, nodes.size - 2) + 1)
    basis = ((nodes - best) / scale)[:, np.newaxis] ** powers
    coefficients = np.linalg.lstsq(basis, change, rcond=None)[0]
    return ((grid - best) / scale)[:, np.newaxis] ** powers @ coefficients


def log_prior(grid: Floats, scale: float) -> Floats:
    """ln of half-normal density times trapezoid width, normalised on the grid's range."""
    width = np.gradient(grid) if grid.size > 1 else np.ones(1)
    if grid.size > 1:
        width[[0, -1]] *= 0.5
    weight = -0.5 * (grid / max(scale, 1e-9)) ** 2 + np.log(np.maximum(width, 1e-300))
    return weight - special.logsumexp(weight)


def columns_of(expansion: Expansion) -> tuple[Floats, Floats]:
    """Changes of the mean (n, columns) and ln prior weights over all strengths of a hypothesis."""
    paths = expansion.paths
    if not paths:
        return np.zeros((expansion.mean.size, 1)), np.zeros(1)
    if len(paths) == 1:
        return paths[0].change.T, paths[0].log_prior
    first, second = paths
    change = first.change[:, np.newaxis, :] + second.change[np.newaxis, :, :]
    prior = first.log_prior[:, np.newaxis] + second.log_prior[np.newaxis, :]
    return change.reshape(-1, expansion.mean.size).T, prior.ravel()


def scaled_sd(exam: Examination, factor: float) -> Floats:
    """sd of judged residuals if the laboratory's is wrong by a factor."""
    simulated = exam.variance - exam.rows.variance
    return np.sqrt(factor**2 * exam.rows.variance + simulated)


def surface(exam: Examination, expansion: Expansion, factor: float) -> Surface:
    """Evidence along all strengths at one noise factor."""
    sd, x = scaled_sd(exam, factor), expansion.fit.x
    change, _ = columns_of(expansion)
    residual = (exam.rows.z - expansion.mean)[:, np.newaxis] - change
    residual /= sd[:, np.newaxis]
    jacobian, shared = expansion.jacobian / sd[:, np.newaxis], exam.rows.shared / sd[:, np.newaxis]
    level = -float(np.sum(np.log(sd[~exam.rows.censored])))
    if not exam.rows.censored.any():
        part = projection(jacobian, shared)
        return summed(exam, part, stack(residual, x, shared.shape[1]), x, level)
    pieces = []
    for column in residual.T:
        work = working(column, exam.rows.censored)
        part = projection(jacobian * work.weight[:, np.newaxis], shared * work.weight[:, np.newaxis])
        stacked = stack(work.residual[:, np.newaxis], x, shared.shape[1])
        above = work.deviance - float(work.residual @ work.residual)
        pieces.append(summed(exam, part, stacked, x, level - 0.5 * above))
    return Surface(
        np.concatenate([piece.log_likelihood for piece in pieces]),
        np.hstack([piece.change for piece in pieces]),
        pieces[int(np.argmax([piece.log_likelihood[0] for piece in pieces]))].covariance,
    )


def summed(exam: Examination, part: Projection, stacked: Floats, x: Floats, level: float) -> Surface:
    """Closed form for rows that are all ordinary."""
    count = len(exam.axes)
    free = part.free(stacked)
    misfit = np.einsum("ij,ij->j", free, free)
    covariance = part.covariance()[:count, :count]
    change = np.asarray(part.solve(stacked))[:count] if part.triangle.size else np.zeros((0, stacked.shape[1]))
    value = level - 0.5 * misfit - 0.5 * part.log_determinant
    if count:
        sd = np.sqrt(np.diag(covariance))
        value = value + log_box(exam.low - x, exam.high - x, change, sd)
    return Surface(value, change, covariance)


@dataclass(frozen=True)
class Scored:
    """Evidence of one hypothesis over the grid of noise factors."""

    expansion: Expansion
    surfaces: tuple[Surface, ...]
    log_evidence: Floats  # per noise factor


def score(exam: Examination, expansion: Expansion) -> Scored:
    """ln Z of a hypothesis for every noise factor; -inf where the model fails at its best fit."""
    if not np.all(np.isfinite(expansion.mean)):
        return Scored(expansion, (), np.full(exam.doubt.factor.size, -inf))
    _, prior = columns_of(expansion)
    surfaces = tuple(surface(exam, expansion, float(factor)) for factor in exam.doubt.factor)
    values = np.array([special.logsumexp(s.log_likelihood + prior) for s in surfaces])
    return Scored(expansion, surfaces, values)
