"""One hypothesis: the model about a setting, all errors integrated out, and the way to its best setting.

    z = m(v) + J (v' - v) + F u + e      ->      y = W (z - m + J v) = X b + e,   X = W [J, errors, F]

W whitens by the stated errors of the rows. A step goes to the best v' of this linear model, by a share that
does not raise the misfit; slopes J are finite differences, then rank-one updates. A censored row stands as an
ordinary row of its residual and curvature; something unlisted acts on it, errors in common do not.

References: Broyden (1965), Math. Comput. 19, 577 (updates); Tobin (1958), Econometrica 26, 24 (limits).
"""

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from scipy.special import logsumexp

from taichi_erosion.evidence.data.comparison_rows import ComparisonRows
from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers
from taichi_erosion.evidence.data.transforms import from_scale, to_scale
from taichi_erosion.evidence.models.prepared_problem import PreparedProblem
from taichi_erosion.evidence.race.blocks import EACH_SET_UP, Block, columns_of, error_blocks, unlisted_blocks
from taichi_erosion.evidence.race.expansion import Acting, RaceModel
from taichi_erosion.evidence.race.linear_evidence import (
    BLUNDERS,
    Evidence,
    LinearRows,
    Scales,
    one_scale,
    row_evidence,
)
from taichi_erosion.evidence.race.priors import SEED

OUTSIDE = "outside_library"  # what no list holds: its name where a mechanism has its own
UNLISTED = {OUTSIDE, EACH_SET_UP}
POOR = 4.0  # misfit a row from which a fit may have gone astray
STARTS, WIDE = 10, 2.0  # other starts of it for every number, and their sd over that of the prior
SLACK = 2.0  # of a misfit, by which a step may raise it: the noise of a few seeds
FAR = 1.5  # farthest step of one coordinate
STILL = 0.1  # squared length of a step, in posterior sd, that is not made
MOST_STEPS, TRIES, FIRMER = 8, 8, 4.0  # of a fit, of one of its steps, and the factor by which damping grows
GAINS = (0.5, 2.0)  # of a step over what slopes promise, between which they are updated


def axis_to_dose(w: Floats) -> Floats:
    return np.where(w > 0.0, np.expm1(np.maximum(w, 0.0)), w)


@dataclass(frozen=True)
class Hypothesis:
    """Effects that act, and what acts beside them that is no effect of constant strength."""

    names: Acting
    extra: Acting = ()  # mechanisms, or one of UNLISTED alone
    along: str = ""  # condition with which these act; of something unlisted empty: with all

    @property
    def acting(self) -> frozenset[str]:
        """What acts: effects, mechanisms, something unlisted."""
        return frozenset((*self.names, *self.extra))

    def without(self, name: str) -> "Hypothesis":
        return replace(self, names=tuple(each for each in self.names if each != name))

    def doses_of(self, w: Floats) -> Conditions:
        """Doses of every mechanism, from those of all on their axis."""
        return dict(zip(self.extra, axis_to_dose(w).reshape(len(self.extra), -1), strict=True))


@dataclass(frozen=True)
class Doses:
    """Doses of m mechanisms in all n rows, one mechanism after the other, on their axis w."""

    w: Floats  # (m n,)
    slope: Floats  # (m n,), of the mean along w
    factor: Floats  # (m n, r), L of their prior

    @property
    def coefficients(self) -> Floats:
        """Coefficients (r,) b of w = L b."""
        return np.asarray(np.linalg.lstsq(self.factor, self.w, rcond=None)[0], dtype=np.float64)

    def change(self, each: Floats, n: int) -> Floats:
        """Change (n, ...) of the mean where the doses change by (m n, ...)."""
        return np.sum((self.slope * each.T).T.reshape(-1, n, *each.shape[1:]), axis=0)


@dataclass(frozen=True)
class Expansion:
    """A hypothesis, linear about a setting."""

    hypothesis: Hypothesis
    v: Floats  # numbers, strengths
    mean: Floats  # (n,), of the model there
    jacobian: Floats  # (n, d)
    errors: Floats  # (n, q), of known size
    blocks: tuple[Block, ...]
    log_prior: float = 0.0
    is_optimum: bool = False
    dose: Doses | None = None


@dataclass(frozen=True, kw_only=True)
class Fit(Expansion):
    evidence: Evidence

    @property
    def log_evidence(self) -> float:
        return self.evidence.log_evidence

    @property
    def linear_target(self) -> Floats:
        return self.evidence.solution.centre[: self.v.size]

    @property
    def setting_covariance(self) -> Floats:
        return self.evidence.solution.inverse[: self.v.size, : self.v.size]

    @property
    def w(self) -> Floats:
        """Doses on their axis; 0 without a mechanism."""
        return np.zeros(self.mean.size) if self.dose is None else self.dose.w

    @property
    def row_doses_of(self) -> Conditions:
        return {} if self.dose is None else self.hypothesis.doses_of(self.dose.w)

    @property
    def scales(self) -> Floats:
        return self.evidence.solution.u


def log_joint(fit: Fit) -> float:
    """Ln of prior times evidence."""
    return fit.log_evidence + fit.log_prior


def row_scatter(prepared: PreparedProblem, doubt: float) -> tuple[Integers, Scales]:
    """Scatter of every row by number, -1 for censored ones, and its prior.

    Preparations differ by about half of the scatter of repeats: means of n by (1 + n / 4)^1/2 more.
    """
    rows = prepared.rows
    used = np.unique(rows.which[~rows.censored])
    index = np.where(rows.censored, -1, np.searchsorted(used, rows.which))
    names = [rows.observables[k].name for k in used]
    repeats = [np.nanmedian(rows.noise[name].scatter.variance) / rows.noise[name].lab ** 2 for name in names]
    wide = [float(np.hypot(doubt, 0.5 * np.log1p(0.25 * n))) for n in repeats]
    parts = [one_scale(f"scatter {name}", doubt=sd) for name, sd in zip(names, wide, strict=True)]
    return index.astype(np.int64), sum(parts, Scales.empty())


def slips_of_decimal_point(rows: ComparisonRows, sd: Floats) -> Floats:
    """What a value ten times too large, and one ten times too small, adds to each whitened row (n, 2).

    NaN for limits and means of several rows; `sd` (n,) is NaN where rows have errors in common.
    """
    change = np.full((rows.size, 2), np.nan)
    for index, observable in enumerate(rows.observables):
        single = (rows.which == index) & ~rows.censored & [len(each) == 1 for each in rows.lines]
        value = from_scale(observable, rows.z[single])[:, np.newaxis] * np.array([0.1, 10.0])
        change[single] = (rows.z[single, np.newaxis] - to_scale(observable, value)) / sd[single, np.newaxis]
    return change


@dataclass
class Race:
    """All hypotheses of one table that have been visited."""

    prepared: PreparedProblem
    model: RaceModel
    fits: dict[Hypothesis, Fit] = field(default_factory=dict)
    all_singles: bool = False  # whether every effect has been, once
    out_of_budget: bool = False  # at the budget of settings

    def __post_init__(self) -> None:
        rows, sd, self.priors = self.prepared.rows, self.prepared.row_sd, self.model.priors
        finite = np.ones(rows.size, dtype=np.bool_)
        self.blocks = tuple(error_blocks(rows, finite, sd, self.priors))
        self.large = unlisted_blocks(rows, finite, self.blocks, self.priors, self.prepared.problem.unread)
        self.scatter, self.scatter_scales = row_scatter(self.prepared, self.priors.doubt)
        independent = self.prepared.error_correlation_of_rows is None
        self.slips = slips_of_decimal_point(rows, sd if independent else np.full(sd.size, np.nan))

    def linear(self, at: Expansion) -> tuple[LinearRows, float]:
        """Rows of an expansion, and what censored ones add to its evidence."""
        p = self.prepared
        work, columns = p.working_residuals(at.mean), p.whiten(np.hstack([at.jacobian, at.errors]))
        jacobian, fixed = columns[:, : at.v.size], columns[:, at.v.size :]
        white = [p.whiten(columns_of(block, at.jacobian[:, : self.model.count])) for block in at.blocks]
        parts = [work.weight if b.kind == "unlisted" else 1.0 * ~p.rows.censored for b in at.blocks]
        white = [each * size[:, np.newaxis] for each, size in zip(white, parts, strict=True)]
        block = np.repeat(np.arange(-1, len(white)), [columns.shape[1], *(each.shape[1] for each in white)])
        dosed = 0.0 if at.dose is None else p.whiten(at.dose.change(at.dose.w, at.mean.size))
        y, x = work.residual + work.weight * (jacobian @ at.v + dosed), jacobian * work.weight[:, np.newaxis]
        scales = sum((b.scale for b in at.blocks), Scales.empty()) + self.scatter_scales
        whole = np.hstack([x, fixed * ~p.rows.censored[:, np.newaxis], *white])
        rows = LinearRows(y, whole, block, self.scatter, scales, np.ones(y.size), self.slips)
        return rows, 0.5 * float(np.sum(work.residual**2)) - 0.5 * work.censored_deviance

    def fit_at_scales(
        self, at: Expansion, steps: int = 8, start: Floats | None = None, fresh: bool = False, sizes: int = 1
    ) -> Fit:
        """The evidence of an expansion; scales from `start`, with `fresh` from priors and large ones too."""
        rows, extra = self.linear(at)
        starts = [rows.scales.initial if start is None else start]
        if fresh:  # a large scatter is an optimum too, where rows share their errors
            shared = np.isin(rows.scales.names, ("source", "preparation", "batch", "group"))
            starts += [rows.scales.initial + size * shared for size in (0.0, 3.0)]
        solutions = (row_evidence(rows, u, steps, sizes) for u in starts)
        solution = max(solutions, key=lambda each: each.log_evidence)
        settings: dict[str, Any] = {each.name: getattr(at, each.name) for each in fields(Expansion)}
        return Fit(**settings, evidence=replace(solution, log_evidence=solution.log_evidence + extra))

    def misfit(self, fit: Fit, mean: Floats, v: Floats) -> float:
        """Misfit of a mean with all errors at their best, but numbers, strengths and doses held, + |v|^2."""
        now, work = fit.evidence.solution, self.prepared.working_residuals(mean)
        shared = np.arange(now.tau.size) >= fit.v.size
        if fit.dose is not None:
            shared &= now.rows.block != len(fit.blocks) - 1
        residual, share = now.rows.columns[:, shared] * now.tau[shared], now.inverse_variance_of_rows
        matrix = residual.T @ (share[:, None] * residual) + np.eye(residual.shape[1])
        gap = work.residual - now.rows.slips_of(fit.evidence.bad)
        vector = residual.T @ (share * gap)
        limits = work.censored_deviance - float(np.sum(work.residual**2))
        return float(share @ gap**2 - vector @ np.linalg.solve(matrix, vector) + v @ v) + limits

    def gauss_newton(self, fit: Fit, most: int, steps: int = 6, sizes: int = 1) -> Fit:
        """At most so many damped steps to a better setting, each with so many steps of the scales.

        Slopes are updated where a step gains what they promise, else taken anew.
        """
        damping, fresh = 0.0, False
        for _ in range(most):
            step = self.newton_step(fit, damping)
            if step is None and fresh:
                break
            if step is None:
                fit, fresh = self.fit_at_scales(self.renew_slopes(fit), steps, fit.scales, sizes=sizes), True
                continue
            v, mean, damping, gain, share = step
            if fresh := not (GAINS[0] < share < GAINS[1] or gain < 0.1 * SLACK):
                fit = self.renew_slopes(replace(fit, v=v, mean=mean))
            else:
                move = v - fit.v
                turn = np.outer(mean - fit.mean - fit.jacobian @ move, move) / max(move @ move, 1e-6)
                fit = replace(fit, v=v, mean=mean, jacobian=fit.jacobian + turn)
            fit = self.fit_at_scales(fit, steps, fit.scales, sizes=sizes)
            if gain < (SLACK if self.model.noisy else 0.1 * SLACK):
                break
        return fit

    def newton_step(self, fit: Fit, damping: float) -> tuple[Floats, Floats, float, float, float] | None:
        """Setting, mean, damping, gain and gain over what slopes promise, of a step; None where it is none.

        (H + damping diag H) step = H (target - v), H the precision of the numbers.
        """
        precision = np.linalg.inv(fit.setting_covariance + 1e-6 * np.eye(fit.v.size))
        pull = precision @ (fit.linear_target - fit.v)
        if (fit.linear_target - fit.v) @ pull < STILL:
            return None
        before, slack = self.misfit(fit, fit.mean, fit.v), SLACK * self.model.noisy
        for _ in range(TRIES):
            matrix = precision + damping * np.diag(np.diag(precision))
            step = np.clip(np.linalg.solve(matrix, pull), -FAR, FAR)
            v, expected = fit.v + step, float(2.0 * step @ pull - step @ precision @ step)
            mean = self.model.predict_mean(fit.hypothesis.names, v)
            if np.all(np.isfinite(mean)):
                gain = before - self.misfit(fit, mean, v)
                if gain > 0.1 * expected - slack:
                    share = gain / max(expected, 1e-9)
                    factor = 1.0 / FIRMER if share > 0.75 else FIRMER if share < 0.25 else 1.0
                    return v, mean, damping * factor, gain, share
            damping = max(FIRMER * damping, 0.1)
        return None

    def renew_slopes(self, fit: Fit) -> Fit:
        """The fit with slopes and errors of known size at its setting."""
        names = fit.hypothesis.names
        jacobian = self.model.jacobian(names, fit.v, fit.mean)
        return replace(fit, jacobian=jacobian, errors=self.model.errors(names, fit.v))

    def optimise_setting(self, fit: Fit) -> Fit:
        """The best setting, first with the scales at their priors: no level takes what an effect explains.

        It starts where the misfit is less, here or at the prior of the numbers: elsewhere they may have taken
        what is missing.
        """
        start = np.zeros(fit.v.size)
        anew = replace(fit, v=start, mean=self.model.predict_mean(fit.hypothesis.names, start))
        fits = [self.fit_at_scales(each, 0) for each in (fit, anew) if np.all(np.isfinite(each.mean))]
        fit = min(fits, key=lambda each: self.misfit(each, each.mean, each.v))
        fit = self.gauss_newton(self.fit_at_scales(self.renew_slopes(fit), 0), MOST_STEPS, 0)
        fit = self.gauss_newton(self.fit_at_scales(self.renew_slopes(fit), start=fit.scales, fresh=True), 2)
        return self.store_fit(replace(self.try_bad_row(fit), is_optimum=True))

    def try_bad_row(self, fit: Fit) -> Fit:
        """The fit, or a better one beside a bad row where rows scatter more than is likely."""
        now = fit.evidence.solution
        if not np.any(now.u > np.nan_to_num(now.rows.scales.doubt, nan=np.inf)):
            return fit
        start = self.fit_at_scales(fit, start=fit.scales, sizes=BLUNDERS)
        other = self.gauss_newton(start, 2, sizes=BLUNDERS)
        return max(fit, other, key=lambda each: each.log_evidence)

    def polish(self, fit: Fit) -> Fit:
        """Steps from slopes at the optimum, then slopes where they end and the mean of many seeds."""
        fit = self.gauss_newton(self.fit_at_scales(self.renew_slopes(fit), start=fit.scales, fresh=True), 2)
        last = self.renew_slopes(fit)
        if self.model.noisy:
            last = replace(last, mean=self.model.precise_mean(fit.hypothesis.names, fit.v))
        return self.store_fit(self.try_bad_row(self.fit_at_scales(last, start=fit.scales)))

    def store_fit(self, fit: Fit) -> Fit:
        """The fit, which replaces an earlier one of its hypothesis."""
        old = self.fits.get(fit.hypothesis)
        if old is None or fit.is_optimum >= old.is_optimum:
            self.fits[fit.hypothesis] = fit
        return fit

    @property
    def bare(self) -> Fit:
        return self.fits[Hypothesis(())]

    def effect_sets(self, *sizes: int) -> list[Fit]:
        """Plain sets of so many effects, by default of any number."""
        return [f for h, f in self.fits.items() if not h.extra and (not sizes or len(h.names) in sizes)]

    def fit_bare_model(self, log_prior: float) -> Fit:
        """Nothing is missing; also from levels as large as they may be, where a unit is wrong.

        Where the fit is poor it is tried from the best of some draws of the numbers too, wider than their
        prior: beyond a threshold slopes lead nowhere.
        """
        start = self.bare_expansion(np.zeros(self.model.count), log_prior)
        first = self.fit_at_scales(start, 0)
        optimum = self.optimise_from_start(first)
        if first.v.size and self.misfit(first, optimum.mean, optimum.v) > POOR * optimum.mean.size:
            draws = WIDE * np.random.default_rng(SEED).standard_normal((STARTS * first.v.size, first.v.size))
            size = [self.misfit(first, self.model.predict_mean((), v), v) for v in draws]
            best = draws[int(np.argmin(np.nan_to_num(size, nan=np.inf)))]
            alternative = self.fit_at_scales(self.bare_expansion(best, log_prior), 0)
            optimum = self.best_of(optimum, self.optimise_from_start(alternative))
        free = self.fit_at_scales(start, 20)
        if free.log_evidence > optimum.log_evidence:
            optimum = self.best_of(optimum, self.polish(replace(self.gauss_newton(free, 6), is_optimum=True)))
        return optimum

    def optimise_from_start(self, start: Fit) -> Fit:
        return self.polish(self.optimise_setting(self.gauss_newton(start, 3, 0)))

    def best_of(self, some: Fit, other: Fit) -> Fit:
        return self.store_fit(max(some, other, key=lambda each: each.log_evidence))

    def bare_expansion(self, v: Floats, log_prior: float) -> Expansion:
        mean = self.model.predict_mean((), v)
        slopes, errors = self.model.jacobian((), v, mean), self.model.errors((), v)
        return Expansion(Hypothesis(()), v, mean, slopes, errors, self.blocks, log_prior)

    def add_effect(self, parent: Fit, name: str, log_prior: float) -> Fit | None:
        """The parent's optimum with one more effect, linear in its strength: one setting of the model.

        None where the model has no value with it, or no other one than without it.
        """
        names = tuple(sorted((*parent.hypothesis.names, name)))
        at = self.model.count + names.index(name)
        for t in (0.0, -1.0, -2.0, -4.0):
            v = np.insert(parent.v, at, t)
            mean = self.model.predict_mean(names, v, parent.row_doses_of)
            if np.all(np.isfinite(mean)):
                break
        if not np.all(np.isfinite(mean)) or np.array_equal(mean, parent.mean):
            return None
        jacobian = np.insert(parent.jacobian, at, self.priors.spread * (mean - parent.mean), axis=1)
        start = replace(parent.hypothesis, names=names), v, mean, jacobian, parent.errors, parent.blocks
        return self.fit_at_scales(Expansion(*start, log_prior, dose=parent.dose), 5)

    def fit_without_effect(self, parent: Fit, name: str, log_prior: float) -> Fit:
        """The better of the fit without one of the parent's effects, if known, and one from its optimum."""
        hypothesis = parent.hypothesis.without(name)
        at = self.model.count + parent.hypothesis.names.index(name)
        v, jacobian = np.delete(parent.v, at), np.delete(parent.jacobian, at, axis=1)
        mean = self.model.predict_mean(hypothesis.names, v)
        start = replace(parent, hypothesis=hypothesis, v=v, mean=mean, jacobian=jacobian, log_prior=log_prior)
        fit_known = self.fits.get(hypothesis)
        fit = self.optimise_setting(self.fit_at_scales(start, 0)) if np.all(np.isfinite(mean)) else fit_known
        return self.best_of(fit or parent, fit_known or fit or parent)

    def posterior_probabilities(self) -> dict[Hypothesis, float]:
        scores = np.array([*map(log_joint, self.fits.values())])
        return dict(zip(self.fits, map(float, np.exp(scores - logsumexp(scores))), strict=True))

    def likeliest_fits(self, least: float) -> list[Fit]:
        """Fits of at least some probability, best first."""
        share = self.posterior_probabilities()
        fits = [fit for key, fit in self.fits.items() if share[key] >= least]
        return sorted(fits, key=lambda fit: -share[fit.hypothesis])
