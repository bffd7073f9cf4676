"""Calibrated numbers and strengths averaged over all explanations, not read off the likeliest one.

    p(t | y) = sum_h P(h | y) p(t | h, y)

over the sets of effects, the accounts of the errors and the factors of the noise, each with its posterior
probability, and within each of them over

    a smooth discrepancy of every kernel and amplitude: with it calibrated numbers are less certain, since a
    part of what they explain may be discrepancy;
    levels: an instrument, or the code, that is off at all conditions alike, which a calibrated number
    imitates. Where they were not weighed before they have their prior PRIOR_LEVEL and every width of
    LEVEL_WIDTHS alike; the rows decide as far as they can.

Every part is normal about the fit of its hypothesis (`model_discrepancy.LinearRows`), but for strengths
without a discrepancy, which have their likelihood on a grid. Numbers are cut at their ranges.

Reference: Hoeting et al. (1999), Stat. Sci. 14, 382 (model averaging); Kennedy & O'Hagan (2001), J. R. Stat.
Soc. B 63, 425, and Brynjarsdottir & O'Hagan (2014), Inverse Probl. 30, 114007 (why numbers calibrated
without a discrepancy are too sure of themselves).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import log

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Integers
from taichi_erosion.evidence.data.transforms import effect_of
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.intervals.mixtures import Mixture, Tabulated, joined, tabulated
from taichi_erosion.evidence.inference.marginal_likelihood import level_sets
from taichi_erosion.evidence.inference.model_discrepancy import (
    AMPLITUDES,
    PINNED,
    Kernels,
    LinearPosterior,
    LinearRows,
    linear_rows,
)
from taichi_erosion.evidence.inference.prepared_problem import LEVEL_WIDTHS, PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis
from taichi_erosion.evidence.inference.screen import Signature

LEAST_SHARE = 1e-3  # of the probability, below which a hypothesis or a noise factor is left out
LEAST_PART = 1e-6  # below which a normal distribution is left out


@dataclass(frozen=True)
class WeighedHypothesis:
    """A fitted hypothesis with ln of its weight at every noise factor, without and with a discrepancy."""

    prepared: PreparedProblem
    item: FittedHypothesis
    family: Kernels
    plain: Floats  # (factors,)
    smooth: Floats  # (factors,)

    @property
    def names(self) -> tuple[str, ...]:
        """Acting effects."""
        return self.item.names

    @property
    def log_weight(self) -> float:
        """Ln of the whole weight."""
        return float(log_sum_exp(np.concatenate([self.plain, self.smooth])))


@dataclass(frozen=True)
class WeighedSignature:
    """One more candidate beside a fitted hypothesis, by its signature alone."""

    prepared: PreparedProblem
    item: FittedHypothesis
    signature: Signature
    residual: Floats  # projected, of the hypothesis
    plain: Floats  # (factors,), ln weight

    @property
    def names(self) -> tuple[str, ...]:
        """Acting effects."""
        return (*self.item.names, self.signature.name)

    @property
    def log_weight(self) -> float:
        """Ln of the whole weight."""
        return float(log_sum_exp(self.plain))


Weighed = WeighedHypothesis | WeighedSignature


@dataclass(frozen=True)
class Part:
    """Strengths and calibrated numbers under one hypothesis."""

    names: tuple[str, ...]
    weight: Floats  # (k,), of normal distributions
    mean: Floats  # (k, p), of the calibrated numbers in prior sd
    sd: Floats  # (k, p)
    strengths: tuple[Mixture | Tabulated, ...]  # one for each effect


def alone(prepared: PreparedProblem, item: FittedHypothesis, family: Kernels) -> WeighedHypothesis:
    """One hypothesis by itself: it is right, or right but for a smooth discrepancy."""
    rest = levels.PRIOR_REMAINDER
    if not item.names:
        rest = levels.PRIOR_OUTSIDE / (levels.PRIOR_NONE + levels.PRIOR_OUTSIDE)
    plain = prepared.doubt.log_weight + item.scored.log_evidence
    return WeighedHypothesis(prepared, item, family, plain + log(1.0 - rest), plain + item.gain + log(rest))


@dataclass(frozen=True)
class Average:
    """What all explanations together say."""

    prepared: PreparedProblem
    parts: tuple[Part, ...]

    def number(self, index: int) -> Mixture | None:
        """Distribution of one calibrated number, in prior sd; that of an effect's own where it acts."""
        axis = self.prepared.axes[index]
        owner = effect_of(axis.name)
        listed = set(self.prepared.problem.candidate_names)
        own = [each for each in self.parts if owner not in listed or owner in each.names]
        if not own:
            return None
        weight = np.concatenate([each.weight for each in own])
        mean, sd = (
            np.concatenate([table[:, index] for table in kind])
            for kind in zip(*((e.mean, e.sd) for e in own), strict=True)
        )
        return Mixture(weight, mean, sd, axis.low, axis.high)

    def strength(self, name: str, maximum: float) -> Mixture | None:
        """Distribution of the strength of an effect where it acts."""
        own = [part.strengths[part.names.index(name)] for part in self.parts if name in part.names]
        return joined(own, 0.0, maximum) if own else None


def average(prepared: PreparedProblem, weighed: Sequence[Weighed], asked: bool = False) -> Average:
    """All parts of all hypotheses; `asked`: free levels are among the hypotheses already."""
    usable = [each for each in weighed if each.item.usable]
    logs = np.array([each.log_weight for each in usable])
    total = float(log_sum_exp(logs))
    kept = [each for each, weight in zip(usable, logs, strict=True) if weight > total + log(LEAST_SHARE)]
    parts = [part for each in kept for part in parts_of(each, total, asked)]
    return Average(prepared, tuple(parts))


def parts_of(each: Weighed, total: float, asked: bool) -> Iterator[Part]:
    """Parts of one hypothesis, weights over exp(total)."""
    if isinstance(each, WeighedSignature):
        yield screened_part(each, total)
        return
    rows, least = linear_rows(each.prepared, each.item.expansion), each.log_weight + log(LEAST_SHARE)
    plain, smooth = (np.flatnonzero(weight > least) for weight in (each.plain, each.smooth))
    if plain.size:
        yield from plain_parts(each, rows, plain, total, asked)
    if smooth.size and each.family.count:
        terms = rows.terms(each.family, np.array(AMPLITUDES))
        solved = terms.solved(rows.away, rows.precision, each.prepared.doubt.factor[smooth])
        share = solved.log_evidence - log_sum_exp(solved.log_evidence, axis=0)
        yield normal_part(each.prepared, each.item, solved, np.exp(share + each.smooth[smooth] - total))


def normal_part(
    prepared: PreparedProblem, item: FittedHypothesis, solved: LinearPosterior, weight: Floats
) -> Part:
    """Normal distributions about the fit of a hypothesis; weights (terms, factors)."""
    fit, kept, weight = item.fit, weight.ravel() > LEAST_PART, weight.ravel()
    count, own = len(fit.names), len(fit.names) + fit.x.size
    size = solved.change.shape[2]
    change = solved.change.reshape(weight.size, size)[kept, :own]
    variance = np.einsum("tfii->tfi", solved.covariance).reshape(weight.size, size)[kept, :own]
    mean, sd, weight = np.concatenate([fit.psi, fit.x]) + change, np.sqrt(variance), weight[kept]
    strengths = tuple(
        Mixture(weight, mean[:, k], sd[:, k], 0.0, prepared.candidate(name, fit.beyond).maximum)
        for k, name in enumerate(fit.names)
    )
    return Part(fit.names, weight, mean[:, count:], sd[:, count:], strengths)


def plain_parts(
    each: WeighedHypothesis, rows: LinearRows, factors: Integers, total: float, asked: bool
) -> Iterator[Part]:
    """Parts without a discrepancy: with levels as the account has them, or else none and some off."""
    weight, noise = np.exp(each.plain[factors] - total), each.prepared.doubt.factor[factors]
    if each.prepared.levels:
        solved, log_share = own_levels(each.prepared, each.item, rows, noise)
        part = normal_part(each.prepared, each.item, solved, weight * np.exp(log_share))
        yield replace(part, strengths=grid_part(each, factors, weight).strengths)
    elif asked:
        yield grid_part(each, factors, weight)
    else:
        solved, log_share = further_levels(each.prepared, each.item, rows, noise)
        log_share += log(levels.PRIOR_LEVEL / (1.0 - levels.PRIOR_LEVEL))
        none = -np.logaddexp(0.0, log_sum_exp(log_share, axis=0))
        yield grid_part(each, factors, weight * np.exp(none))
        yield normal_part(each.prepared, each.item, solved, weight * np.exp(log_share + none))


def grid_part(each: WeighedHypothesis, factors: Integers, weight: Floats) -> Part:
    """Strengths on their grid, and calibrated numbers at every node of it."""
    scored, names = each.item.scored, each.names
    found = [scored.likelihoods[int(k)] for k in factors]
    logs = np.array([likelihood.log_likelihood for likelihood in found])

    def share(weighed: Floats) -> Floats:
        whole = np.exp(weighed - log_sum_exp(weighed, axis=1)[:, np.newaxis])
        return whole * weight[:, np.newaxis]

    flat, own = share(logs + np.log(scored.expansion.cell_widths)), share(logs + scored.expansion.log_prior)
    table = flat.sum(axis=0).reshape([path.grid.size for path in scored.expansion.paths])
    strengths = tuple(
        tabulated(path.grid, table.sum(axis=tuple(k for k in range(len(names)) if k != index)))
        for index, path in enumerate(scored.expansion.paths)
    )
    mean = np.array([likelihood.position.T for likelihood in found])  # (factors, columns, p)
    sd = np.sqrt([np.diag(likelihood.covariance) for likelihood in found])[:, np.newaxis] + 0.0 * mean
    kept = own.ravel() > LEAST_PART
    count = mean.shape[2]
    return Part(
        names,
        own.ravel()[kept],
        mean.reshape(own.size, count)[kept],
        sd.reshape(own.size, count)[kept],
        strengths,
    )


def own_levels(
    prepared: PreparedProblem, item: FittedHypothesis, rows: LinearRows, noise: Floats
) -> tuple[LinearPosterior, Floats]:
    """Free levels of an account: every set of them that may be off, and ln of its share (sets, factors)."""
    first = len(item.names) + len(prepared.axes)
    sets, log_prior = level_sets(len(prepared.levels))
    precision = np.tile(rows.precision, (len(sets), 1))
    for row, chosen in enumerate(sets):
        rest = [first + k for k in range(len(prepared.levels)) if k not in chosen]
        precision[row, rest] = PINNED
    terms = rows.plain()
    solved = terms.repeated(len(sets)).solved(rows.away, precision, noise)
    logs = log_prior[:, np.newaxis] + solved.log_evidence
    return solved, logs - log_sum_exp(logs, axis=0)


def further_levels(
    prepared: PreparedProblem, item: FittedHypothesis, rows: LinearRows, noise: Floats
) -> tuple[LinearPosterior, Floats]:
    """Levels beside the errors of an account: every set and width of them, and ln of their shares.

    A share is prior times evidence over the evidence without any level (sets * widths, factors).
    """
    columns = prepared.whitening(prepared.working(item.expansion.mean))(prepared.level_columns())
    size, count = rows.away.size, columns.shape[1]
    wider = LinearRows(
        np.hstack([rows.columns, columns]),
        rows.residual,
        np.append(rows.away, np.zeros(count)),
        np.append(rows.precision, np.full(count, PINNED)),
    )
    sets, log_prior = level_sets(count)
    choices = list(product(range(len(sets)), LEVEL_WIDTHS))
    precision = np.tile(wider.precision, (len(choices) + 1, 1))
    for row, (index, width) in enumerate(choices):
        precision[row, [size + k for k in sets[index]]] = width**-2.0
    solved = wider.plain().repeated(len(choices) + 1).solved(wider.away, precision, noise)
    logs = solved.log_evidence[:-1] - solved.log_evidence[-1]
    prior = log_prior[[index for index, _ in choices]] - log(len(LEVEL_WIDTHS))
    kept = LinearPosterior(*(each[:-1] for each in vars(solved).values()))
    return kept, prior[:, np.newaxis] + logs


def screened_part(each: WeighedSignature, total: float) -> Part:
    """Calibrated numbers beside a further candidate at every strength that the screen tried."""
    signature, fit = each.signature, each.item.fit
    kept = np.flatnonzero(each.plain > each.log_weight + log(LEAST_SHARE))
    rows, noise = linear_rows(each.prepared, each.item.expansion), each.prepared.doubt.factor[kept]
    plain = rows.plain()
    covariance = plain.solved(rows.away, rows.precision, noise).covariance[0]  # (factors, d, d)
    scale = noise[:, np.newaxis, np.newaxis] ** -2.0
    vector = plain.vector - signature.raw @ rows.columns  # (strengths, d)
    count, own = len(fit.names), len(fit.names) + fit.x.size
    change = ((vector * scale - rows.precision * rows.away) @ covariance)[..., :own]
    size = change.shape[0] * change.shape[1]
    mean = (np.concatenate([fit.psi, fit.x]) + change).reshape(size, own)
    sd = np.sqrt(np.einsum("fii->fi", covariance)[:, np.newaxis, :own] + 0.0 * change).reshape(size, own)
    logs = signature.log_prior + 0.5 * signature.fall(each.residual) * scale[:, 0]
    weight = np.exp(logs - log_sum_exp(logs, axis=1)[:, np.newaxis] + each.plain[kept, np.newaxis] - total)
    flat, table = weight.ravel(), tabulated(signature.grid, weight.sum(axis=0))
    strengths = (
        Mixture(flat, mean[:, k], sd[:, k], 0.0, each.prepared.candidate(name, fit.beyond).maximum)
        for k, name in enumerate(fit.names)
    )
    return Part(each.names, flat, mean[:, count:], sd[:, count:], (*strengths, table))
