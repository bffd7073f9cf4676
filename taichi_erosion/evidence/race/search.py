"""Search of the hypotheses: nothing, sets of effects, each with or without something that is not in the list.

Every fit is a Gauss-Newton step of numbers and strengths with all blocks of errors integrated out; its slopes
are finite differences, then rank-one updates. A set grows by one effect from the best sets of its size, and
each member of the best one is tried against every other effect. Whatever has been fitted when the budget of
settings is spent is an answer.

References: Broyden (1965), Math. Comput. 19, 577 (updates); Madigan & Raftery (1994), J. Am. Stat. Assoc. 89,
1535 (only what is not far less likely than the best is visited).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from math import comb, log

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Integers
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.race.blocks import Block, nuisance, unlisted, zeros
from taichi_erosion.evidence.race.expansion import Acting, RaceModel
from taichi_erosion.evidence.race.linear_evidence import Evidence, LinearRows, Scales, evidence, scale
from taichi_erosion.evidence.race.priors import DOUBT, KEEP, MOST, NEAR, NOTHING, STEP, UNLISTED

UNLISTED_KEY = "?"  # what no list holds; else a mechanism, or an effect whose strength varies, stands there
SLACK = 2.0  # of a misfit, by which a step may raise it: the noise of a few seeds
FAR = 1.5  # farthest step of one coordinate
STILL = 0.1  # squared length of a step, in posterior sd, that is not made


@dataclass(frozen=True)
class Hypothesis:
    """Effects that act, and what acts beside them that is no effect of constant strength."""

    names: Acting
    beyond: str = ""


@dataclass(frozen=True)
class Doses:
    """Doses of a mechanism in all rows, and what they change; w = ln(1 + dose)."""

    w: Floats  # (n,)
    slope: Floats  # (n,), of the mean along w
    factor: Floats  # (n, r), L of their prior
    axis: str  # condition along which they vary


@dataclass(frozen=True)
class Fit:
    """A hypothesis, linear about its best setting."""

    hypothesis: Hypothesis
    v: Floats  # numbers, strengths
    mean: Floats  # (n,), of the model there
    jacobian: Floats  # (n, d)
    errors: Floats  # (n, q), of known size
    evidence: Evidence
    blocks: tuple[Block, ...]
    refined: bool = False
    log_prior: float = 0.0
    dose: Doses | None = None

    @property
    def log_evidence(self) -> float:
        return self.evidence.log_evidence

    @property
    def target(self) -> Floats:
        """Best setting of the linear model."""
        return self.evidence.solved.centre[: self.v.size]

    @property
    def covariance(self) -> Floats:
        """Covariance (d, d) of numbers and strengths."""
        return self.evidence.solved.inverse[: self.v.size, : self.v.size]


@dataclass
class Race:
    """All hypotheses of one table."""

    prepared: PreparedProblem
    model: RaceModel
    blocks: tuple[Block, ...] = ()
    scatter: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    scatter_scales: Scales | None = None
    fits: dict[Hypothesis, Fit] = field(default_factory=dict)
    stopped: bool = False  # at the budget

    def __post_init__(self) -> None:
        p = self.prepared
        known = np.ones(p.rows.size, dtype=np.bool_)
        self.blocks = tuple(nuisance(p.rows, known, p.sd))
        self.large = tuple(unlisted(self.blocks))
        self.zeros = zeros(p.rows, p.sd)
        self.scatter = np.where(p.rows.censored, -1, p.rows.which)
        parts = []
        for index, observable in enumerate(p.rows.observables):
            freedom = float(p.rows.noise[observable.name].repeats)
            if np.any(self.scatter == index):
                parts.append(scale(f"scatter {observable.name}", doubt=(DOUBT**-2 + 2.0 * freedom) ** -0.5))
            else:
                self.scatter = np.where(self.scatter > index, self.scatter, self.scatter)
        used = np.unique(self.scatter[self.scatter >= 0])
        self.scatter = np.where(self.scatter >= 0, np.searchsorted(used, self.scatter), -1)
        self.scatter_scales = sum(parts[1:], parts[0])
        self.white = {id(b): p.white(b.columns) for b in (*self.blocks, *self.large)}

    # -- one hypothesis

    def linear(self, fit: Fit) -> tuple[LinearRows, float]:
        """Its rows, and what censored ones add to the evidence: these have no error in common with others."""
        p = self.prepared
        work = p.working(fit.mean)
        jacobian = p.white(fit.jacobian) if fit.v.size else np.zeros((fit.mean.size, 0))
        fixed = p.white(fit.errors) if fit.errors.size else np.zeros((fit.mean.size, 0))
        white = [self.white[id(b)] if id(b) in self.white else p.white(b.columns) for b in fit.blocks]
        sizes = [0] * len(white) if not white else [each.shape[1] for each in white]
        linear = jacobian @ fit.v + (0.0 if fit.dose is None else p.white(fit.dose.slope * fit.dose.w))
        shared = np.hstack([fixed, *white])
        shared[p.rows.censored] = 0.0
        block = np.repeat(np.arange(-1, len(sizes)), [jacobian.shape[1] + fixed.shape[1], *sizes])
        scales = sum((b.scale for b in fit.blocks[1:]), fit.blocks[0].scale) + self.scatter_scales
        columns = np.hstack([jacobian * work.weight[:, np.newaxis], shared])
        y = work.residual + work.weight * linear
        extra = 0.5 * float(np.sum(work.residual**2)) - 0.5 * work.deviance
        return LinearRows(y, columns, block, self.scatter, scales, np.ones(y.size)), extra

    def solved(self, fit: Fit, steps: int = 8, start: Floats | None = None, fresh: bool = False) -> Fit:
        """The fit with its evidence about its present setting."""
        rows, extra = self.linear(fit)
        found = evidence(rows, rows.scales.start if start is None else start, steps)
        if fresh and start is not None:
            other = evidence(rows, rows.scales.start, steps)
            found = max(found, other, key=lambda each: each.log_evidence)
        return replace(fit, evidence=replace(found, log_evidence=found.log_evidence + extra))

    def start_of(self, fit: Fit) -> Floats | None:
        """Scales of a fit."""
        return None if fit.evidence is None else fit.evidence.solved.u

    def moved(self, fit: Fit, most: int, steps: int = 6) -> Fit:
        """Gauss-Newton steps, with rank-one updates of the slopes."""
        names, p = fit.hypothesis.names, self.prepared
        for _ in range(most):
            step = np.clip(fit.target - fit.v, -FAR, FAR)
            if step @ np.linalg.solve(fit.covariance + 1e-6 * np.eye(step.size), step) < STILL:
                break
            before = self.misfit(fit, fit.mean, fit.v)
            for share in (1.0, 0.4, 0.16, 0.06):
                v = fit.v + share * step
                mean = self.model.mean(names, v)
                if np.all(np.isfinite(mean)) and self.misfit(fit, mean, v) < before + SLACK:
                    break
            if not np.all(np.isfinite(mean)):
                break
            gone = v - fit.v
            jacobian = fit.jacobian
            if np.abs(gone).max() > 0.1:
                jacobian = jacobian + np.outer(mean - fit.mean - jacobian @ gone, gone) / (gone @ gone)
            fit = replace(fit, v=v, mean=mean, jacobian=jacobian)
            fit = self.solved(fit, steps, self.start_of(fit))
        return fit

    def misfit(self, fit: Fit, mean: Floats, v: Floats) -> float:
        """Misfit of a mean with all errors but those of numbers and strengths at their best, + |v|^2."""
        now, p = fit.evidence.solved, self.prepared
        work, shared = p.working(mean), np.arange(now.tau.size) >= fit.v.size
        if fit.dose is not None:
            shared &= now.rows.block != len(fit.blocks) - 1
        own, share = now.rows.columns[:, shared] * now.tau[shared], now.row_share
        matrix = own.T @ (share[:, None] * own) + np.eye(own.shape[1])
        vector = own.T @ (share * work.residual)
        limits = work.deviance - float(np.sum(work.residual**2))
        return float(share @ work.residual**2 - vector @ np.linalg.solve(matrix, vector) + v @ v) + limits

    def refined(self, fit: Fit) -> Fit:
        """Numbers and strengths first with the scales at their priors, so that no level takes what an effect
        explains; then all of them, with slopes where they end."""
        names = fit.hypothesis.names
        fit = self.moved(self.solved(fit, 0), 1, 0)
        fit = replace(fit, jacobian=self.model.jacobian(names, fit.v, fit.mean))
        fit = self.moved(self.solved(fit, 0), 3, 0)
        fit = replace(fit, jacobian=self.model.jacobian(names, fit.v, fit.mean), errors=self.model.errors(names, fit.v))
        fit = self.moved(self.solved(fit, start=self.start_of(fit), fresh=True), 2)
        return self.kept(replace(fit, refined=True))

    def sharpened(self, fit: Fit) -> Fit:
        """Slopes at the optimum, the steps that follow, and the mean of many seeds."""
        names = fit.hypothesis.names
        fit = replace(fit, jacobian=self.model.jacobian(names, fit.v, fit.mean), errors=self.model.errors(names, fit.v))
        fit = self.moved(self.solved(fit, start=self.start_of(fit), fresh=True), 2)
        if self.model.noisy:
            fit = replace(fit, mean=self.model.sure_mean(names, fit.v))
            fit = self.solved(fit, start=self.start_of(fit))
        return self.kept(fit)

    def kept(self, fit: Fit) -> Fit:
        """The fit, which replaces an earlier one of its hypothesis."""
        old = self.fits.get(fit.hypothesis)
        if old is None or fit.refined >= old.refined:
            self.fits[fit.hypothesis] = fit
        return fit

    def bare(self) -> Fit:
        """Nothing is missing."""
        v = np.zeros(self.model.count)
        mean = self.model.mean((), v)
        jacobian = self.model.jacobian((), v, mean)
        fit = Fit(Hypothesis(()), v, mean, jacobian, self.model.errors((), v), None, self.blocks, log_prior=self.prior_of(Hypothesis(())))
        return self.sharpened(self.refined(self.moved(self.solved(fit, 0), 3, 0)))

    def with_effect(self, parent: Fit, name: str) -> Fit | None:
        """The parent's optimum with one more effect at its typical strength: one setting of the model."""
        names = tuple(sorted((*parent.hypothesis.names, name)))
        if Hypothesis(names, parent.hypothesis.beyond) in self.fits:
            return None
        at = self.model.count + names.index(name)
        for t in (0.0, -1.0, -2.0, -4.0):
            v = np.insert(parent.v, at, t)
            mean = self.model.mean(names, v)
            if np.all(np.isfinite(mean)):
                break
        else:
            return None
        jacobian = np.insert(parent.jacobian, at, 0.8 * (mean - parent.mean), axis=1)
        hypothesis = Hypothesis(names, parent.hypothesis.beyond)
        prior = self.prior_of(hypothesis)
        fit = Fit(hypothesis, v, mean, jacobian, parent.errors, None, parent.blocks, log_prior=prior)
        return self.kept(self.solved(fit, 5))

    def beside(self, parent: Fit, key: str, blocks: Sequence[Block]) -> Fit:
        """The parent with other blocks, of something that is not in the list or an instrument's zero."""
        hypothesis = Hypothesis(parent.hypothesis.names, key)
        if hypothesis in self.fits:
            return self.fits[hypothesis]
        prior = self.prior_of(hypothesis)
        fit = replace(parent, hypothesis=hypothesis, blocks=tuple(blocks), log_prior=prior)
        return self.kept(self.moved(self.solved(fit, 10), 2))

    def with_unlisted(self, parent: Fit) -> None:
        """The parent beside something that is not in the list, and beside the zero of each instrument."""
        self.beside(parent, UNLISTED_KEY, self.large)
        for zero in self.zeros:
            self.beside(parent, f"zero|{zero.observable}", (*self.blocks, zero))

    # -- all of them

    @property
    def log_prior_mechanism(self) -> float:
        """Ln prior of one mechanism: what no list holds is a mechanism, or one step more unlikely."""
        return log((1.0 - STEP) * UNLISTED * (1.0 - STEP) / len(self.prepared.problem.mechanisms))

    def prior_of(self, hypothesis: Hypothesis) -> float:
        """Ln prior of a set of effects, alone or beside what no list holds."""
        share = log(STEP) if hypothesis.beyond and self.prepared.problem.mechanisms else 0.0
        if hypothesis.beyond.startswith("zero"):
            share = log(STEP) - log(max(len(self.zeros), len(self.prepared.problem.mechanisms)))
        return log_prior(hypothesis, len(self.model.candidates)) + share

    def posterior(self) -> dict[Hypothesis, float]:
        """Probability of every hypothesis that was visited."""
        scores = np.array([fit.log_evidence + fit.log_prior for fit in self.fits.values()])
        share = np.exp(scores - log_sum_exp(scores))
        return dict(zip(self.fits, map(float, share), strict=True))

    def likely(self, least: float, wanted: Callable[[Fit], bool] = lambda _: True) -> list[Fit]:
        """Fits of at least some probability, best first."""
        share = self.posterior()
        found = [fit for key, fit in self.fits.items() if share[key] >= least and wanted(fit)]
        return sorted(found, key=lambda fit: -share[fit.hypothesis])


def log_prior(hypothesis: Hypothesis, candidates: int) -> float:
    """Ln prior of a set of effects, alone or beside something that is not in the list."""
    size = len(hypothesis.names)
    most = min(MOST, candidates)
    each = log(comb(candidates, size))
    if not hypothesis.beyond:
        if not size:
            return log(NOTHING)
        whole = sum(STEP**k for k in range(1, most + 1))
        return log((1.0 - NOTHING - UNLISTED) * STEP**size / whole) - each
    return log(UNLISTED * (1.0 - STEP) * STEP**size) - each


def of_size(size: int) -> Callable[[Fit], bool]:
    """Whether a fit is a plain set of so many effects."""
    return lambda fit: not fit.hypothesis.beyond and len(fit.hypothesis.names) == size


def search(race: Race) -> None:
    """Nothing, singles, sets grown from the best ones, and each beside something that is not in the list."""
    bare, effects = race.bare(), list(race.model.candidates)
    race.with_unlisted(bare)
    for single in [race.with_effect(bare, name) for name in effects]:
        if single is not None:
            race.refined(single)
    for size in range(1, min(MOST, len(effects))):
        grow(race, size, effects)
    best = race.likely(KEEP, lambda fit: bool(fit.hypothesis.names) and not fit.hypothesis.beyond)[:3]
    smaller = {without(fit.hypothesis.names, n) for fit in best for n in fit.hypothesis.names}
    for names in sorted((smaller | {fit.hypothesis.names for fit in best}) - {()}):
        if Hypothesis(names) in race.fits:
            race.with_unlisted(race.fits[Hypothesis(names)])
    done: set[Hypothesis] = set()
    for _ in range(2):
        for fit in race.likely(KEEP, lambda fit: fit.dose is None)[:5]:
            if fit.hypothesis not in done:
                done.add(fit.hypothesis)
                race.sharpened(fit)


def grow(race: Race, size: int, effects: Sequence[str]) -> None:
    """Sets of one more effect than `size`, from the best of that size, then swaps of the best of them."""
    parents = race.likely(0.1 * KEEP, of_size(size))[: MOST - size]
    if not parents and size == 1:  # two weak ones may be strong together
        parents = sorted(filter(of_size(1), race.fits.values()), key=lambda fit: -fit.log_evidence)[:2]
    for parent in parents:
        add_each(race, parent, effects)
    refine(race, size + 1, 6)
    best = race.likely(10.0 * KEEP, of_size(size + 1))[:1]
    for fit in best:
        for name in fit.hypothesis.names:
            rest = race.fits.get(Hypothesis(without(fit.hypothesis.names, name)))
            if rest is not None:
                add_each(race, rest, effects)
        refine(race, size + 1, 4)


def add_each(race: Race, parent: Fit, effects: Sequence[str]) -> None:
    """Every effect beside a set."""
    for name in effects:
        if name not in parent.hypothesis.names:
            race.with_effect(parent, name)


def refine(race: Race, size: int, most: int) -> None:
    """The likeliest sets of one size that have been seen from afar alone."""
    for fit in race.likely(0.2 * KEEP, lambda fit: of_size(size)(fit) and not fit.refined)[:most]:
        race.refined(fit)


def without(names: Acting, name: str) -> Acting:
    """A set without one of its effects."""
    return tuple(each for each in names if each != name)
