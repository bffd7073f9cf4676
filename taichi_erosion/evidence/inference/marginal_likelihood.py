"""Marginal likelihood of each hypothesis, from a Laplace expansion about its own best fit.

    ln Z = ln int p(psi) exp(-1/2 S(psi) - 1/2 ln |A| + ln box) dpsi - sum ln s_i

with S the misfit after recalibration at strength psi, A = D^T D, box the share of the posterior within the
bounds, and every stated sd possibly wrong by a factor f over which the evidence is averaged. The strength is
integrated on a grid, so that the bound psi >= 0 is exact; the calibrated numbers by Laplace's method.

Reference: Kass & Raftery (1995), J. Am. Stat. Assoc. 90, 773.
"""

from dataclasses import dataclass, replace
from itertools import combinations
from math import inf

import numpy as np
from scipy import interpolate, special

from taichi_erosion.evidence.data.linear_algebra import (
    ColumnRows,
    Whitening,
    log_box,
    log_sum_exp,
    projection,
    stack,
)
from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.map_fit import Fit, Objective, deviance
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.models.predictor import paired_change

GRIDS = (33, 21, 11, 7)  # strengths per effect at which sets of one, two, three, four effects are integrated
COARSE = 2  # effects up to which the grid has a coarse part over the whole range
NEAR = 3.0  # posterior sd about the best strength within which nodes of a noisy path count in full
WIDTHS = (4.0, 4.0, 3.5, 3.0)  # posterior sd that the fine part of the grid spans to either side
NARROWEST = 0.05  # posterior sd that the slopes tell, below which no grid is laid
MOVED = 0.5  # posterior sd by which the judging likelihood may lie beside a grid that is kept
BOUND = 1e-3  # of a prior sd, or of the maximum of a strength: closer to an end a number is called bound
UNDERCUT, UNDERCUT_NOISY = 0.5, 2.0  # misfit by which an expansion may lie below the fit it starts from [1]
DIGITS = 12  # of strengths behind the point, beyond which two of them are one
NODES = (-2.0, -1.0, 0.0, 1.0, 2.0)  # of a path, in posterior sd about the best strength
MOST_LEVELS = 6  # observables whose sets of free levels are all tried


@dataclass(frozen=True)
class PathRuns:
    """Runs of the model along the strength of one effect, the calibrated numbers following."""

    nodes: Floats  # strengths
    change: Floats  # (nodes, n), of the mean
    best: float  # strength of the fit
    spread: float  # posterior sd of the strength
    ridge: Floats  # (p,), change of the calibrated numbers per unit of strength


@dataclass(frozen=True)
class Path:
    """Change of the mean along the strength of one effect, the calibrated numbers following."""

    runs: PathRuns
    grid: Floats  # strengths
    change: Floats  # (strengths, n)
    shift: Floats  # (strengths, p), of the calibrated numbers
    log_prior: Floats  # ln of prior density times cell width


@dataclass(frozen=True)
class Expansion:
    """One hypothesis about its best fit, its mean simulated with fresh seeds."""

    fit: Fit
    mean: Floats  # (n,)
    jacobian: Floats  # (n, p), of the mean per prior sd
    paths: tuple[Path, ...]
    local: Floats  # (n, effects), derivative of the mean along each strength
    shared: Floats  # (n, q), errors of one sd that rows share: of instruments, and of the model itself here
    moved: Floats  # (n,), of the mean by conditions at their most probable values

    @property
    def finite(self) -> bool:
        """Whether the model works at the best fit."""
        return bool(np.all(np.isfinite(self.mean)))

    @property
    def slopes(self) -> Floats:
        """Derivative of the mean (n, effects + p) along every strength, then every calibrated number."""
        return np.hstack([self.local, self.jacobian])

    @property
    def log_prior(self) -> Floats:
        """Ln prior (columns,) of all strengths side by side."""
        prior = np.zeros(1)
        for path in self.paths:
            prior = np.add.outer(prior, path.log_prior).ravel()
        return prior

    @property
    def cell_widths(self) -> Floats:
        """Width (columns,) of the cell about all strengths side by side."""
        width = np.ones(1)
        for path in self.paths:
            width = np.multiply.outer(width, cell_width(path.grid)).ravel()
        return width


@dataclass(frozen=True)
class StrengthLikelihood:
    """Likelihood of one hypothesis at one noise factor, strength by strength."""

    log_likelihood: Floats  # (columns,), calibrated numbers integrated out
    position: Floats  # (p, columns), best calibrated numbers
    covariance: Floats  # (p, p)
    levels: Floats  # (q, columns), best free levels, in prior sd
    level_covariance: Floats  # (..., q, q), the same for all columns or one for each


@dataclass(frozen=True)
class ScoredHypothesis:
    """Evidence of one hypothesis over the grid of noise factors."""

    expansion: Expansion
    likelihoods: tuple[StrengthLikelihood, ...]  # per noise factor; none where the model fails
    log_evidence: Floats  # per noise factor


@dataclass(frozen=True)
class ProjectedResidual:
    """Whitened residual of a hypothesis, and the part that neither calibration nor effects can remove."""

    whole: Floats  # (n,), shared errors at their best
    stacked: Floats  # (n + p + q,), projected
    basis: Floats  # (n + p + q, p + q) of what is projected out
    white: Whitening  # of the rows about this residual
    stuck: Bools  # (effects + p,), strengths and numbers at an end of their range that would leave it
    promised: float  # misfit that the slopes promise to remove beyond what the fit has removed

    @property
    def free(self) -> Floats:
        """Projected residual of the rows (n,)."""
        return self.stacked[: self.whole.size]

    @property
    def row_basis(self) -> Floats:
        """Rows of the basis that belong to measurements (n, p + q)."""
        return self.basis[: self.whole.size]

    @property
    def own(self) -> Floats:
        """The same over the sd of every row alone (n,), whatever it is correlated with."""
        return self.white.unmixed(self.free)

    def project(self, columns: Floats) -> Floats:
        """Whitened columns (n, ...) without what calibration can imitate."""
        return columns - self.row_basis @ (self.row_basis.T @ columns)

    def project_signature(self, raw: Floats) -> Floats:
        """Whitened signatures (strengths, n) stacked and projected (strengths, n + p + q)."""
        below = np.vstack([raw.T, np.zeros((self.stacked.size - raw.shape[1], raw.shape[0]))])
        return (below - self.basis @ (self.basis.T @ below)).T


def projected_residual(prepared: PreparedProblem, expansion: Expansion) -> ProjectedResidual:
    """Residual of one hypothesis; strengths of its effects are fitted without a prior.

    What ends at a bound and would leave its range cannot move, and so removes no misfit (active set).
    """
    work = prepared.working(expansion.mean)
    white, loose = prepared.whitening(work), expansion.local.shape[1]
    columns = white(expansion.slopes)
    shared = white(expansion.shared)
    x = np.concatenate([np.zeros(loose), expansion.fit.x])
    below = stack(work.residual, x, shared.shape[1])
    stuck = outward(prepared, expansion, columns, shared, below)
    columns[:, stuck] = 0.0
    part, alone = projection(columns, shared, loose), projection(columns[:, :0], shared)
    size = work.residual.size
    stacked, fixed = part.free(below), alone.free(np.delete(below, slice(size, size + x.size)))
    promised = (
        float(fixed @ fixed) - float(stacked @ stacked) + float(np.sum(expansion.fit.x[~stuck[loose:]] ** 2))
    )
    return ProjectedResidual(fixed[:size], stacked, part.basis, white, stuck, promised)


def outward(
    prepared: PreparedProblem, expansion: Expansion, columns: Floats, shared: Floats, below: Floats
) -> Bools:
    """Strengths and numbers at an end of their range whose best values lie beyond it, the others free."""
    fit, loose = expansion.fit, expansion.local.shape[1]
    maxima = np.array([prepared.candidate(name, fit.beyond).maximum for name in fit.names])
    low = np.concatenate([fit.psi < BOUND * maxima, fit.x - prepared.low < BOUND])
    high = np.concatenate([maxima - fit.psi < BOUND * maxima, prepared.high - fit.x < BOUND])
    stuck = np.zeros(low.size, dtype=np.bool_)
    for _ in range(low.size if np.any(low | high) else 0):
        moving = np.where(stuck, 0.0, columns)
        change = projection(moving, shared, loose).solve(below)[: low.size]
        out = ~stuck & ((low & (change < 0.0)) | (high & (change > 0.0)))
        if not out.any():
            break
        stuck |= out
    return stuck


def expand(prepared: PreparedProblem, best: Fit) -> Expansion:
    """Slopes and paths of one hypothesis with the signature seeds, its mean with the scoring seeds."""
    stated = prepared
    prepared = prepared.with_model_errors(best.x, best.acting(), moved=True)
    slopes = slopes_of(prepared, best)
    count = len(prepared.axes)
    mean = prepared.predictor.mean(best.x, best.acting(), prepared.seeds.scoring)
    spread, ridge = strength_sd(prepared, slopes, count)
    paths = tuple(
        path_of(prepared, best, index, float(spread[index]), ridge[:, index])
        for index in range(len(best.names))
    )
    moved = np.zeros(mean.size)
    if prepared.predictor is not stated.predictor:
        moved = mean - stated.predictor.mean(best.x, best.acting(), stated.seeds.scoring)
    return Expansion(best, mean, slopes[:, :count], paths, slopes[:, count:], prepared.rows.shared, moved)


def slopes_of(prepared: PreparedProblem, best: Fit) -> Floats:
    """Derivative of the mean along every calibrated number, in prior sd, then every strength (n, p + k)."""
    objective = Objective(prepared, best.names, prepared.seeds.signature, best.beyond)
    slopes = objective.slopes(np.concatenate([best.x, best.psi]), central=not prepared.quick)
    return slopes / objective.scale


def strength_sd(prepared: PreparedProblem, slopes: Floats, count: int) -> tuple[Floats, Floats]:
    """Posterior sd of each strength, and the shift of the calibrated numbers per unit of it, from the slopes.

    The ridge dx/dpsi = cov(x, psi) / var(psi) is where rivals compete: at fixed numbers a strength far from
    the best one leaves the range in which slopes mean anything.
    """
    loose = slopes.shape[1] - count
    if loose == 0:
        return np.zeros(0), np.zeros((count, 0))
    white = prepared.white(slopes)
    order = np.hstack([white[:, count:], white[:, :count]])
    covariance = projection(order, prepared.white_shared, loose).covariance()
    variance = np.diag(covariance)[:loose]
    return np.sqrt(variance), covariance[loose : loose + count, :loose] / variance


def path_of(prepared: PreparedProblem, fit: Fit, index: int, spread: float, ridge: Floats) -> Path:
    """Path along one strength and its ridge, the other strengths at their best."""
    name, seeds = fit.names[index], prepared.seeds.signature
    candidate, best = prepared.candidate(name, fit.beyond), float(fit.psi[index])
    spread = min(spread, 0.5 * candidate.maximum)
    wanted = [best + node * spread for node in NODES] + [0.0, candidate.maximum]
    nodes = np.array(sorted({round(min(max(node, 0.0), candidate.maximum), DIGITS) for node in wanted}))
    changes, predictor = [], prepared.predictor
    bare = predictor.predict(fit.x, fit.acting(), seeds)
    for node in nodes:
        x = np.clip(fit.x + ridge * (node - best), prepared.low, prepared.high)
        runs = predictor.predict(x, {**fit.acting(), name: float(node)}, seeds)
        changes.append(paired_change(runs, bare, predictor))
    change = np.array(changes)
    good = np.all(np.isfinite(change), axis=1)
    found = PathRuns(nodes[good], change[good], best, spread, ridge)
    return path_on(prepared, fit, index, found, strength_grid(found, len(fit.names), best, spread))


def strength_grid(runs: PathRuns, effects: int, centre: float, spread: float) -> Floats:
    """Strengths of one path: fine about a centre; of one or two effects coarse over the whole range."""
    low, high, count, width = runs.nodes[0], runs.nodes[-1], GRIDS[effects - 1], WIDTHS[effects - 1] * spread
    fine_count = (2 * count) // 3 if effects <= COARSE else count
    fine = np.linspace(max(low, centre - width), min(high, centre + width), fine_count)
    if effects > COARSE:
        return fine
    whole = np.concatenate([np.linspace(low, high, count - fine.size), fine, [centre]])
    return np.unique(np.asarray(np.round(whole, DIGITS), dtype=np.float64))


def path_on(prepared: PreparedProblem, fit: Fit, index: int, runs: PathRuns, grid: Floats) -> Path:
    """A path on some strengths, from runs that were made."""
    candidate = prepared.candidate(fit.names[index], fit.beyond)
    shift = fit.x + np.outer(grid - runs.best, runs.ridge)
    shift = np.clip(shift, prepared.low, prepared.high) - fit.x
    smooth = smooth_path(prepared, runs.nodes, runs.change, runs.best, grid, NEAR * runs.spread)
    prior = log_prior(grid, candidate.prior_scale, candidate.maximum)
    return Path(runs, grid, smooth, shift, prior)


def smooth_path(
    prepared: PreparedProblem,
    nodes: Floats,
    change: Floats,
    best: float,
    grid: Floats,
    near: float | None = None,
) -> Floats:
    """Path between nodes: monotone cubic without noise, else a polynomial through the best fit.

    Nodes farther than `near` from the best strength count less, so that the ends of the range do not bend the
    path where the likelihood is.
    """
    if nodes.size < 2:
        return np.zeros((grid.size, change.shape[1]))
    if not prepared.noisy or nodes.size < 4:
        return np.asarray(interpolate.PchipInterpolator(nodes, change, axis=0)(grid))
    scale = max(float(np.ptp(nodes)), 1e-300)
    powers = np.arange(1, min(3, nodes.size - 2) + 1)
    basis = ((nodes - best) / scale)[:, np.newaxis] ** powers
    weight = np.ones(nodes.size) if near is None else 1.0 / np.hypot(1.0, (nodes - best) / max(near, 1e-300))
    weighted = weight[:, np.newaxis]
    coefficients = np.linalg.lstsq(weighted * basis, weighted * change, rcond=None)[0]
    return ((grid - best) / scale)[:, np.newaxis] ** powers @ coefficients


def cell_width(grid: Floats) -> Floats:
    """Trapezoid widths of a grid; 1 for a single point."""
    if grid.size < 2:
        return np.ones(grid.size)
    width = np.gradient(grid)
    width[[0, -1]] *= 0.5
    return width


def log_prior(grid: Floats, scale: float, maximum: float) -> Floats:
    """Ln of half-normal density on [0, maximum] times trapezoid width; a single strength has it all."""
    if grid.size < 2:
        return np.zeros(grid.size)
    scale = max(scale, 1e-9)
    inside = 0.5 * np.sqrt(2.0 * np.pi) * scale * special.erf(maximum / scale / np.sqrt(2.0))
    width = np.log(np.maximum(cell_width(grid), 1e-300))
    return width - 0.5 * (grid / scale) ** 2 - np.log(inside)


@dataclass(frozen=True)
class StrengthColumns:
    """All strengths of a hypothesis side by side."""

    change: Floats  # (n, columns)
    x: Floats  # (p, columns), calibrated numbers from which each column starts
    log_prior: Floats  # (columns,)
    penalty: Floats  # (columns,), (psi / scale)^2 of the half-normal prior
    centre: int  # column nearest to the best fit


def columns_of(prepared: PreparedProblem, expansion: Expansion) -> StrengthColumns:
    """Changes of the mean, calibrated numbers and ln prior weights over all strengths of a hypothesis."""
    fit, x = expansion.fit, expansion.fit.x
    change, shift, size = np.zeros((1, expansion.mean.size)), np.zeros((1, x.size)), 1
    penalty, centre = np.zeros(1), 0
    for name, path, psi in zip(fit.names, expansion.paths, fit.psi, strict=True):
        scale = max(prepared.candidate(name, fit.beyond).prior_scale, 1e-9)
        size *= path.grid.size
        change = (change[:, np.newaxis] + path.change).reshape(size, -1)
        shift = (shift[:, np.newaxis] + path.shift).reshape(size, x.size)
        penalty = np.add.outer(penalty, (path.grid / scale) ** 2).ravel()
        centre = centre * path.grid.size + int(np.argmin(np.abs(path.grid - psi)))
    start = np.clip(x + shift, prepared.low, prepared.high)
    return StrengthColumns(change.T, start.T, expansion.log_prior, penalty, centre)


@dataclass(frozen=True)
class StrengthRows:
    """A hypothesis at all its strengths side by side."""

    expansion: Expansion
    columns: StrengthColumns
    rows: ColumnRows  # slopes of calibrated numbers and shared errors, residuals at every strength


def strength_rows(prepared: PreparedProblem, expansion: Expansion) -> StrengthRows:
    """Rows of a hypothesis, whitened at noise factor 1."""
    columns = columns_of(prepared, expansion)
    residual = prepared.white((prepared.rows.z - expansion.mean)[:, np.newaxis] - columns.change)
    design = prepared.white(np.hstack([expansion.jacobian, expansion.shared]))
    return StrengthRows(expansion, columns, ColumnRows(design, residual, prepared.white_reach))


def score(prepared: PreparedProblem, expansion: Expansion) -> ScoredHypothesis:
    """Ln Z of a hypothesis for every noise factor; -inf where the model fails at its best fit."""
    factors = prepared.doubt.factor
    if not expansion.finite:
        return ScoredHypothesis(expansion, (), np.full(factors.size, -inf))
    at = judged_grids(prepared, strength_rows(prepared, expansion))
    found = tuple(likelihood(prepared, at, float(factor)) for factor in factors)
    values = np.array([log_sum_exp(each.log_likelihood + at.columns.log_prior) for each in found])
    return ScoredHypothesis(at.expansion, found, values)


def judged_grids(prepared: PreparedProblem, at: StrengthRows) -> StrengthRows:
    """The same with every path's grid about what the judging likelihood says, where it lies elsewhere.

    A grid is laid about the fit, which other seeds made; between kinks its slopes may tell a wrong width.
    """
    paths, fit = at.expansion.paths, at.expansion.fit
    if not paths:
        return at
    factor = float(prepared.doubt.factor[int(np.argmax(prepared.doubt.log_weight))])
    table = likelihood(prepared, at, factor).log_likelihood + at.columns.log_prior
    table = np.exp(table - log_sum_exp(table)).reshape([path.grid.size for path in paths])
    moved = []
    for index, path in enumerate(paths):
        share = table.sum(axis=tuple(k for k in range(len(paths)) if k != index))
        centre = float(share @ path.grid)
        spread = float(np.sqrt(max(share @ (path.grid - centre) ** 2, 0.0)))
        spread = max(spread, NARROWEST * path.runs.spread)  # below, the grid does not resolve it
        same = abs(centre - path.runs.best) < MOVED * spread and abs(spread / path.runs.spread - 1.0) < MOVED
        if same:
            moved.append(path)
            continue
        grid = strength_grid(path.runs, len(paths), centre, spread)
        moved.append(path_on(prepared, fit, index, path.runs, grid))
    if all(new is path for new, path in zip(moved, paths, strict=True)):
        return at
    return strength_rows(prepared, replace(at.expansion, paths=tuple(moved)))


def likelihood(prepared: PreparedProblem, at: StrengthRows, factor: float) -> StrengthLikelihood:
    """Likelihood along all strengths at one noise factor; slopes may not promise more than refits found."""
    columns, count = at.columns, len(prepared.axes)
    x, penalty, centre = columns.x, columns.penalty, columns.centre
    start = np.vstack([x, np.zeros((at.rows.design.shape[1] - count, x.shape[1]))])
    found, own = at.rows.solved(start, factor), slice(count, count + len(prepared.levels))
    shared, reach = at.rows.design[:, count:] / factor, prepared.white_reach / factor
    least = deviance(at.rows.residual[:, centre] / factor, shared, reach) + float(x[:, centre] @ x[:, centre])
    undercut = UNDERCUT_NOISY if prepared.noisy else UNDERCUT
    misfit = np.maximum(found.misfit + penalty, least + penalty[centre] - undercut) - penalty
    change, own_covariance = found.change[:count], found.covariance[..., own, own]
    volume = log_bound_share(prepared, x, change, found.sd(count)) - 0.5 * found.log_determinant
    if prepared.levels:
        volume = volume + log_level_share(found.change[own], own_covariance)
    level = -float(np.sum(np.log(factor * prepared.sd[~prepared.rows.censored]))) - prepared.log_correlation
    covariance = found.of(int(np.argmin(found.misfit)))[:count, :count]
    return StrengthLikelihood(
        level - 0.5 * misfit + volume, x + change, covariance, found.change[own], own_covariance
    )


def log_bound_share(prepared: PreparedProblem, x: Floats, change: Floats, sd: Floats) -> Floats:
    """Ln of the share of the posterior within the bounds of the calibrated numbers, column by column."""
    return log_box(prepared.low[:, np.newaxis] - x, prepared.high[:, np.newaxis] - x, change, sd)


def level_sets(count: int) -> tuple[list[list[int]], Floats]:
    """Sets of levels that may be off while the others are 0, never none of them, and ln of their priors.

    Of many observables only single ones, pairs, and all of them at once.
    """
    sizes = range(1, count + 1) if count <= MOST_LEVELS else (1, 2, count)
    sets = [list(chosen) for size in sizes for chosen in combinations(range(count), size)]
    each = levels.PRIOR_LEVEL_EACH
    log_prior = np.array([len(c) * np.log(each) + (count - len(c)) * np.log1p(-each) for c in sets])
    return sets, log_prior - log_sum_exp(log_prior)


def log_level_sets(best: Floats, covariance: Floats) -> Floats:
    """Ln evidence (sets, columns) with only some levels off over that with all of them free, priors included.

        Z(S) / Z(all) = N(0; mu, C) / N(0; 0, 1)    over the levels that are not in S

    Reference: Dickey (1971), Ann. Math. Stat. 42, 204.
    """
    sets, log_prior = level_sets(best.shape[0])
    found = np.repeat(log_prior[:, np.newaxis], best.shape[1], axis=1)
    for row, chosen in enumerate(sets):
        rest = [k for k in range(best.shape[0]) if k not in chosen]
        if rest:
            part, mean = covariance[..., rest, :][..., rest], best[rest].T
            solved = (np.linalg.inv(part) @ mean[:, :, np.newaxis])[..., 0]
            squares = np.einsum("ci,ci->c", mean, solved)
            found[row] -= 0.5 * (squares + np.linalg.slogdet(part)[1])
    return found


def log_level_share(best: Floats, covariance: Floats) -> Floats:
    """Ln evidence (columns,) averaged over the sets of levels that may be off, over that with all free."""
    return log_sum_exp(log_level_sets(best, covariance), axis=0)
