"""Errors that nobody stated, as explanations beside effects: of sources, of batches, of rows, of the scatter.

Every account replaces the stated errors by others, and all hypotheses are weighed on it anew:

    source   rows of one source share an error of sd tau, by observable        V + tau_o^2 S_o S_o^T
    batch    the same for rows of one `group`                                  V + tau_o^2 B_o B_o^T
    rows     a few rows have an error of OUTLIER sd beside the stated one
    scatter  true over stated sd differs between observables or grows along a condition; or a source that
             states no sd scatters otherwise than the median row of the others, with which it counts

What an account leaves open (tau, which rows, the growth) is estimated by the marginal likelihood of the
hypotheses fitted with stated errors, linear about their best fits, and the choice has its cost:
ln of the mean likelihood over the grid, less that of the best. tau^2 is its posterior mean, so that
few batches do not count as none. Where a linear step is in doubt (`linear_steps.py`) the hypothesis is fitted
with the errors that were found, and these are estimated once more.

Reference: Harville (1977), J. Am. Stat. Assoc. 72, 320 (variance components); Box & Tiao (1968), Biometrika
55, 119 (rows with a larger variance).
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from math import log
from typing import Literal

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp, projection
from taichi_erosion.evidence.data.problem import Bools, Floats
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.map_fit import Fit
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, expand
from taichi_erosion.evidence.inference.model_discrepancy import condition_axes
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, level_shape
from taichi_erosion.evidence.inference.robustness.linear_steps import (
    BEHIND,
    doubtful_step,
    linear_evidence,
    settled,
)

Kind = Literal["source", "batch", "rows", "scatter"]
Sharing = tuple[
    str, tuple[str, ...], Floats
]  # observable, labels, columns (n, labels) of errors of one row's sd

TAUS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # sd of a shared error over the typical sd of a row
ROUNDS = 2  # in which the size of every error is found, the others kept
LEAST_BATCHES, LEAST_SHARING = 3, 3  # batches of an observable, and rows beyond the first of each
OUTLIER = 8.0  # sd of the further error of a row that is off, in stated sd
MOST_OUTLIERS, SHARE_OUTLIERS = 4, 0.1  # rows that may be off
FACTORS = (1.5, 2.25, 3.4)  # true over stated sd of one observable
GROWTHS = (-0.8, -0.4, 0.4, 0.8)  # change of ln sd per sd of a condition
SCATTER_STEPS = 2  # of the kind above, one on top of the other
UNSTATED = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0)  # sd of a source that states none over that median


@dataclass(frozen=True)
class Reference:
    """A hypothesis fitted with stated errors, by which accounts are estimated."""

    expansion: Expansion
    log_prior: float


@dataclass(frozen=True)
class ErrorAccount:
    """A problem with other errors than stated."""

    kind: Kind
    prepared: PreparedProblem
    stated_variance: Floats  # (n,), of the rows with stated errors
    log_odds: float  # ln of its prior over that of the stated errors, and of what its estimates cost
    gain: float  # ln evidence over the stated errors by the linear estimate, `log_odds` included
    rows: tuple[int, ...] = ()  # that are off
    shared: tuple["SharedError", ...] = ()
    scatter: tuple["UnevenScatter", ...] = ()
    unstated: tuple["UnstatedScatter", ...] = ()


@dataclass(frozen=True)
class SharedError:
    """Random effects of one observable: by source, or by batch."""

    observable: str
    labels: tuple[str, ...]
    tau: float  # sd of the shared error over the typical sd of a row
    first: int  # column of the shared errors that belongs to the first label


@dataclass(frozen=True)
class UnevenScatter:
    """True over stated sd: a factor of one observable, or growth along a condition."""

    place: str  # observable or condition
    log_factor: float  # ln of true over stated sd, or of its change over the range of the condition
    along: bool  # a condition


@dataclass(frozen=True)
class UnstatedScatter:
    """Scatter of a source that states none, in one observable."""

    observable: str
    source: str
    factor: float  # its sd over the median of the stated ones


Estimate = Callable[[PreparedProblem, Sequence[Reference], float], ErrorAccount | None]


def error_accounts(prepared: PreparedProblem, references: Sequence[Reference]) -> list[ErrorAccount]:
    """Accounts that could change the answer, the most promising first."""
    stated = reference_evidence(prepared, references)
    estimates: tuple[Estimate, ...] = (
        partial(shared_account, "source"),
        partial(shared_account, "batch"),
        rows_account,
        scatter_account,
        unstated_account,
    )
    found = [guarded(estimate, prepared, references, stated) for estimate in estimates]
    near = [each for each in found if each is not None and each.gain > -levels.ACCOUNT_BEHIND]
    return sorted(near, key=lambda each: -each.gain)


def guarded(
    estimate: Estimate, prepared: PreparedProblem, references: Sequence[Reference], stated: float
) -> ErrorAccount | None:
    """An account; about fits with its own errors where a linear step to these is in doubt."""
    found = estimate(prepared, references, stated)
    if found is None or found.gain <= -levels.ACCOUNT_BEHIND:
        return None
    there = settled_references(prepared, found.prepared, references)
    same = all(new is old for new, old in zip(there, references, strict=True))
    return found if same else estimate(prepared, there, stated)


def settled_references(
    before: PreparedProblem, now: PreparedProblem, references: Sequence[Reference]
) -> list[Reference]:
    """The references; those in doubt that count about their best numbers and strengths with other errors."""
    worth = [each.log_prior + linear_evidence(now, each.expansion) for each in references]
    return [
        settled_reference(before, now, each) if own > max(worth) - BEHIND else each
        for each, own in zip(references, worth, strict=True)
    ]


def settled_reference(before: PreparedProblem, now: PreparedProblem, reference: Reference) -> Reference:
    """A reference; where its linear step is in doubt, about its best values with other errors."""
    old = reference.expansion
    step = doubtful_step(before, old, now, old)
    if step is None:
        return reference

    def mean(there: Fit) -> Floats:
        return now.predictor.mean(there.x, there.acting(), now.seeds.scoring)

    found = settled(now, old, step, mean)
    expansion = found if isinstance(found, Expansion) else expand(now, found)
    return replace(reference, expansion=expansion) if expansion.finite else reference


def reference_evidence(prepared: PreparedProblem, references: Sequence[Reference]) -> float:
    """Ln marginal likelihood of some errors, linear about the hypotheses fitted with stated ones."""
    found = [each.log_prior + linear_evidence(prepared, each.expansion) for each in references]
    return float(log_sum_exp(np.array(found)))


def sharing_columns(prepared: PreparedProblem, kind: Kind) -> Iterator[Sharing]:
    """Every observable with rows that share an error, its labels, and columns of errors of one row's sd.

    Which source or batch is right is not known: their mean is as uncertain as their errors make it, and so
    are calibrated numbers that follow it.
    """
    named = np.array(prepared.rows.source_names if kind == "source" else prepared.rows.group)
    for observable, chosen in prepared.by_observable():
        names, counts = np.unique(named[chosen], return_counts=True)
        least = 2 if kind == "source" else LEAST_BATCHES
        if names.size < least or chosen.sum() - names.size < LEAST_SHARING or counts.max() < 2:
            continue
        columns = (named[:, np.newaxis] == names) & chosen[:, np.newaxis]
        unit = float(np.median(prepared.sd[chosen]))
        shape = level_shape(observable, prepared.rows.z)[:, np.newaxis]
        yield observable.name, tuple(names.tolist()), unit * columns * shape


def shared_account(
    kind: Kind, prepared: PreparedProblem, references: Sequence[Reference], stated: float
) -> ErrorAccount | None:
    """Random effects of sources or batches with estimated variances; None where rows tell nothing of them."""
    likelihood = partial(reference_evidence, references=references)
    sharing = list(sharing_columns(prepared, kind))
    if not sharing:
        return None
    chosen, cost = likely_sizes(
        lambda taus: likelihood(with_taus(prepared, sharing, taus)), np.zeros(len(sharing)), np.array(TAUS)
    )
    there = with_taus(prepared, sharing, chosen)
    odds = log(levels.ODDS_SOURCE if kind == "source" else levels.ODDS_BATCH) + cost
    shared, first = list[SharedError](), prepared.rows.shared.shape[1]
    for (name, names, _), tau in zip(sharing, chosen, strict=True):
        shared.append(SharedError(name, names, float(tau), first))
        first += len(names)
    return ErrorAccount(
        kind, there, prepared.variance, odds, likelihood(there) - stated + odds, shared=tuple(shared)
    )


def likely_sizes(likelihood: Callable[[Floats], float], start: Floats, grid: Floats) -> tuple[Floats, float]:
    """Sizes of several errors (k,), the root of the mean square of each over a grid, and ln of their cost.

    They are found one after the other, ROUNDS times, the others kept. The cost is the mean likelihood over
    the grid, less the best, of every size in the last round.
    """
    chosen, cost = start.copy(), 0.0
    for _ in range(ROUNDS):
        cost = 0.0
        for index in range(chosen.size):
            trials = [np.where(np.arange(chosen.size) == index, size, chosen) for size in grid]
            found = np.array([likelihood(trial) for trial in trials])
            chosen[index] = float(np.sqrt(np.exp(found - log_sum_exp(found)) @ grid**2))
            cost += float(log_sum_exp(found)) - log(grid.size) - float(found.max())
    return chosen, cost


def with_taus(prepared: PreparedProblem, sharing: Sequence[Sharing], taus: Floats) -> PreparedProblem:
    """The same with shared errors of these sizes."""
    acting = [tau * columns for (*_, columns), tau in zip(sharing, taus, strict=True)]
    shared = np.hstack([prepared.rows.shared, *acting])
    return replace(prepared, rows=replace(prepared.rows, shared=shared))


def with_variances(prepared: PreparedProblem, factor: Floats) -> PreparedProblem:
    """The same with the laboratory's variance of every row times a factor, by errors of its own."""
    return prepared.with_rows(replace(prepared.rows, variance=prepared.rows.variance * factor))


def with_scatter(prepared: PreparedProblem, factor: Floats) -> PreparedProblem:
    """The same with all of the laboratory's scatter changed so, correlations kept."""
    return prepared.with_rows(prepared.rows.rescattered(factor))


def rows_account(
    prepared: PreparedProblem, references: Sequence[Reference], stated: float
) -> ErrorAccount | None:
    """The rows that are off, one after the other while each is worth its prior."""
    size, likelihood = prepared.rows.size, partial(reference_evidence, references=references)
    factor, off, best = np.ones(size), list[int](), stated
    for _ in range(max(1, min(MOST_OUTLIERS, int(SHARE_OUTLIERS * size)))):
        there = with_variances(prepared, factor)
        worst = {worst_row(there, each.expansion, off) for each in references}
        trials = []
        for row in worst:
            trial = factor.copy()
            trial[row] = 1.0 + OUTLIER**2
            trials.append((likelihood(with_variances(prepared, trial)), row))
        found, row = max(trials)
        if found - best < -log(levels.ODDS_ROW):
            break
        best, factor[row] = found, 1.0 + OUTLIER**2
        off.append(row)
    if not off:
        return None
    odds = len(off) * log(levels.ODDS_ROW)
    there = with_variances(prepared, factor)
    gain = best - stated + odds
    return ErrorAccount("rows", there, prepared.variance, odds, gain, rows=tuple(sorted(off)))


def worst_row(prepared: PreparedProblem, expansion: Expansion, off: Sequence[int]) -> int:
    """The row without which a hypothesis, its numbers and strengths refitted, loses most of its misfit."""
    work = prepared.working(expansion.mean)
    white = prepared.whitening(work)
    columns = white(expansion.slopes)
    part = projection(columns, white(prepared.rows.shared), expansion.local.shape[1])
    below = np.concatenate(
        [
            work.residual,
            np.zeros(expansion.local.shape[1]),
            -expansion.fit.x,
            np.zeros(prepared.rows.shared.shape[1]),
        ]
    )
    free, own = part.free(below)[: part.size], white.lone_squares(part.basis[: part.size])
    fall = (white.lone().T @ free) ** 2 / np.maximum(own, 1e-3)
    fall[list(off)] = -1.0
    return int(np.argmax(fall))


def scatter_options(prepared: PreparedProblem) -> list[tuple[UnevenScatter, Floats]]:
    """Every kind of uneven scatter that is tried, with ln of true over stated sd (n,)."""
    found = []
    if len(list(prepared.by_observable())) > 1:
        for (observable, chosen), factor in product(prepared.by_observable(), FACTORS):
            uneven = UnevenScatter(observable.name, log(factor), False)
            found.append((uneven, np.where(chosen, log(factor), 0.0)))
    for (name, axis), growth in product(condition_axes(prepared).items(), GROWTHS):
        found.append((UnevenScatter(name, growth * float(np.ptp(axis)), True), growth * axis))
    return found


def scatter_account(
    prepared: PreparedProblem, references: Sequence[Reference], stated: float
) -> ErrorAccount | None:
    """Scatter that differs between observables or grows along a condition."""
    options, likelihood = scatter_options(prepared), partial(reference_evidence, references=references)
    logs, best, cost, uneven = np.zeros(prepared.rows.size), stated, 0.0, list[UnevenScatter]()
    for _ in range(SCATTER_STEPS if options else 0):
        trials = [np.exp(2.0 * (logs + option)) for _, option in options]
        found = np.array([likelihood(with_scatter(prepared, trial)) for trial in trials])
        mean = float(log_sum_exp(found)) - log(found.size)
        if mean < best:
            break
        top = int(np.argmax(found))
        cost, best = cost + mean - float(found[top]), float(found[top])
        uneven.append(options[top][0])
        logs = logs + options[top][1]
    if not uneven:
        return None
    odds = log(levels.ODDS_SCATTER) + cost
    there = with_scatter(prepared, np.exp(2.0 * logs))
    return ErrorAccount(
        "scatter", there, prepared.variance, odds, best - stated + odds, scatter=tuple(uneven)
    )


def unstated_sources(prepared: PreparedProblem) -> Iterator[tuple[str, str, Bools]]:
    """Observable, source and rows of every source that states no sd of an observable, while others do."""
    labels, stated = np.array(prepared.rows.source_names), prepared.rows.stated
    for observable, chosen in prepared.by_observable():
        silent = set(labels[chosen]) - set(labels[chosen & stated])
        for source in sorted(silent) if np.any(chosen & stated) else ():
            yield observable.name, str(source), chosen & (labels == source)


def unstated_account(
    prepared: PreparedProblem, references: Sequence[Reference], stated: float
) -> ErrorAccount | None:
    """Scatter of sources that state none, by observable, in place of the median of the stated ones.

    None where every source states one. Nobody has said that it is that median: both have the same prior.
    """
    sources = list(unstated_sources(prepared))
    if not sources:
        return None

    def scattered(factors: Floats) -> PreparedProblem:
        sizes = np.ones(prepared.rows.size)
        for (*_, rows), factor in zip(sources, factors, strict=True):
            sizes[rows] = factor**2
        return with_scatter(prepared, sizes)

    def likelihood(factors: Floats) -> float:
        return reference_evidence(scattered(factors), references)

    chosen, cost = likely_sizes(likelihood, np.ones(len(sources)), np.array(UNSTATED))
    there = scattered(chosen)
    told = [
        UnstatedScatter(name, source, float(f)) for (name, source, _), f in zip(sources, chosen, strict=True)
    ]
    gain = reference_evidence(there, references) - stated + cost
    return ErrorAccount("scatter", there, prepared.variance, cost, gain, unstated=tuple(told))
