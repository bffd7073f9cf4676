"""Estimates of calibrated numbers and strengths: values of the decided hypothesis, averaged intervals."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from math import log, nan

import numpy as np

from taichi_erosion.evidence.data.findings import Correlation, Estimate
from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.data.transforms import Axis, axis_value, effect_of
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.goodness_of_fit import calibration_covariance
from taichi_erosion.evidence.inference.intervals.mixtures import Mixture
from taichi_erosion.evidence.inference.intervals.model_averaging import (
    Average,
    Weighed,
    WeighedHypothesis,
    WeighedSignature,
    alone,
    average,
)
from taichi_erosion.evidence.inference.marginal_likelihood import Expansion, ScoredHypothesis
from taichi_erosion.evidence.inference.model_discrepancy import discrepancy_gain, kernels
from taichi_erosion.evidence.inference.pipeline import Analysis, WeighedAccount
from taichi_erosion.evidence.inference.posterior import (
    Hypothesis,
    log_prior_of,
    parameter_estimates,
    strength_estimates,
)
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import FittedHypothesis
from taichi_erosion.evidence.inference.screen import screen

LIKELY = 0.05  # probability of a set of effects from which one more is looked for beside it
ENDS = (levels.INTERVAL_TAIL, 1.0 - levels.INTERVAL_TAIL)


def averaged(found: Analysis) -> Average:
    """Numbers and strengths over all accounts and all explanations of an analysis.

    Free levels that lead are as they were fitted; where they do not, levels of every width are weighed beside
    each of the other explanations.
    """
    lead = max(found.accounts, key=lambda account: account.log_weight).kind
    accounts = [each for each in found.accounts if each.kind != "levels" or lead == "levels"]
    weighed = [each for account in accounts for each in weighed_account(account)]
    total = float(log_sum_exp(np.array([each.log_weight for each in weighed])))
    likely = [each for each in weighed if isinstance(each, WeighedHypothesis)]
    further = [one for each in likely for one in unseen(each, weighed, total)]
    return average(found.fitted.prepared, [*weighed, *further], lead == "levels")


def weighed_account(each: WeighedAccount) -> Iterator[Weighed]:
    """All explanations of one account; ln weights up to a constant that all accounts share."""
    fitted, account = each.account.fitted, each.account
    shift = each.log_weight - account.posterior.log_all + fitted.prepared.doubt.log_weight
    items = {item.names: item for item in (fitted.base, *fitted.refits)}
    nothing = np.full(shift.size, -np.inf)
    plain, smooth = ({names: nothing for names in items} for _ in range(2))
    for h in fitted.listed():
        if h.names in items:
            for table, weight in zip((plain, smooth), parted(h, items[h.names]), strict=True):
                table[h.names] = np.logaddexp(table[h.names], shift + weight)
        else:
            signature, residual = fitted.screened.signature(h.names[0]), fitted.screened.residual
            weight = shift + h.log_prior + h.log_evidence
            yield WeighedSignature(fitted.prepared, fitted.base, signature, residual, weight)
    for names, item in items.items():
        yield WeighedHypothesis(fitted.prepared, item, fitted.family, plain[names], smooth[names])


def unseen(each: WeighedHypothesis, weighed: Sequence[Weighed], total: float) -> Iterator[WeighedSignature]:
    """One more effect beside a likely set of effects, where no such set was fitted.

    The search fits sets whose further effect shows. One that calibration absorbs does not show, acts all the
    same with its prior probability, and moves calibrated numbers.
    """
    names, prepared = each.names, each.prepared
    if not names or not len(names) < levels.MOST_EFFECTS or each.log_weight < total + log(LIKELY):
        return
    fitted = {frozenset(one.names) for one in weighed if one.prepared is prepared}
    count = len(prepared.problem.candidates)
    rest = screen(prepared, each.item.expansion)
    for signature in rest.signatures:
        wider = (*names, signature.name)
        if not np.any(signature.raw) or frozenset(wider) in fitted:
            continue
        odds = log_prior_of(wider, False, count) - log_prior_of(names, False, count)
        scale = prepared.doubt.factor[:, np.newaxis] ** -2.0
        gain = 0.5 * signature.fall(rest.residual) * scale + signature.log_prior
        yield WeighedSignature(
            prepared, each.item, signature, rest.residual, each.plain + odds + log_sum_exp(gain, axis=1)
        )


def parted(h: Hypothesis, item: FittedHypothesis) -> tuple[Floats, Floats]:
    """Ln weights of an explanation without and with a discrepancy.

    What the measurements reject counts for something outside the list that it resembles: for a discrepancy.
    Sets of several effects are weighed without one; within their weight it has its share here.
    """
    weight, nothing = h.log_prior + h.log_evidence, np.full(h.log_evidence.size, -np.inf)
    if h.outside or (h.rejected and np.all(item.gain > -np.inf)):
        return nothing, weight
    if len(h.names) < 2:
        return weight, nothing
    odds = log(levels.PRIOR_REMAINDER / (1.0 - levels.PRIOR_REMAINDER)) + item.gain
    return weight - np.logaddexp(0.0, odds), weight - np.logaddexp(0.0, -odds)


def estimates_alone(
    prepared: PreparedProblem, scored: ScoredHypothesis, bare: Floats | None = None
) -> tuple[dict[str, Estimate], dict[str, Estimate]]:
    """Strengths and calibrated numbers of one hypothesis; intervals allow for a discrepancy and levels.

    `bare` are the numbers of the bare model, from which effects have moved them.
    """
    if not scored.likelihoods:
        return {}, {}
    family = kernels(prepared)
    item = FittedHypothesis(scored, discrepancy_gain(prepared, scored.expansion, family))
    whole = average(prepared, [alone(prepared, item, family)])
    return acting_strengths(whole, prepared, item), calibrated_numbers(whole, item, bare)


def calibrated_numbers(
    whole: Average, final: FittedHypothesis, bare: Floats | None = None
) -> dict[str, Estimate]:
    """Calibrated numbers at the values of one hypothesis with averaged 90 % intervals and remarks."""
    found = parameter_estimates(whole.prepared, final.scored)
    for index, axis in enumerate(whole.prepared.axes):
        mixture = whole.number(index)
        if axis.name in found and mixture is not None:
            low, high = (axis_value(axis, end) for end in ends(mixture))
            moved = nan if bare is None else float(final.fit.x[index] - bare[index])
            returned = bare is not None and abs(final.fit.x[index]) < min(abs(bare[index]), levels.NEAR_START)
            number = spanning(found[axis.name], min(low, high), max(low, high))
            found[axis.name] = remarked(
                number, moved, prior_share(axis, mixture), final.names, bool(returned)
            )
    return found


def prior_share(axis: Axis, mixture: Mixture) -> float:
    """Width of an interval over that of the prior of its number."""
    prior = Mixture(np.ones(1), np.zeros(1), np.ones(1), axis.low, axis.high)
    (low, high), (least, most) = ends(mixture), ends(prior)
    return float((high - low) / max(most - least, 1e-300))


def remarked(
    number: Estimate, moved: float, share: float, names: tuple[str, ...], returned: bool = False
) -> Estimate:
    """The estimate with what its prior and its way from the bare model say of it.

    `returned`: effects have moved it back to near its start.
    """
    words = []
    if share >= levels.UNIDENTIFIED:
        words.append("not identified by these measurements: the interval is about as wide as its prior")
    if abs(moved) >= levels.EFFECTIVE:
        entered = "when " + " and ".join(names) + " entered"
        told = "back to near its start: before, it stood in for what was missing"
        told = f", {told}" if returned else ": read it as an effective number"
        words.append(f"moved by {abs(moved):.2g} prior sd {entered}{told}")
    return replace(number, moved=moved, prior_share=share, remark="; ".join(words))


def correlations(prepared: PreparedProblem, expansion: Expansion) -> tuple[Correlation, ...]:
    """Correlations of strengths and calibrated numbers about the fit of one hypothesis, pair by pair.

    Numbers of a candidate that does not act are left out: the measurements do not depend on them.
    """
    covariance = calibration_covariance(prepared, expansion)
    sd = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    names = [*expansion.fit.names, *(axis.name for axis in prepared.axes)]
    table = covariance / np.outer(sd, sd)
    absent = set(prepared.problem.candidate_names) - set(expansion.fit.names)
    pairs = combinations([k for k, name in enumerate(names) if effect_of(name) not in absent], 2)
    return tuple(Correlation(names[i], names[j], float(table[i, j])) for i, j in pairs)


def acting_strengths(
    whole: Average, prepared: PreparedProblem, item: FittedHypothesis
) -> dict[str, Estimate]:
    """Strengths at the values of one hypothesis with averaged 90 % intervals, given that each effect acts."""
    found = strength_estimates(prepared, item.scored)
    for name, estimate in found.items():
        mixture = whole.strength(name, prepared.candidate(name, True).maximum)
        if mixture is not None:
            found[name] = spanning(estimate, *ends(mixture))
    return found


def ends(mixture: Mixture) -> tuple[float, float]:
    """Ends of the 90 % interval."""
    low, high = (mixture.quantile(level) for level in ENDS)
    return low, high


def spanning(estimate: Estimate, low: float, high: float) -> Estimate:
    """The estimate with another interval, its value in it."""
    return replace(estimate, low=min(low, estimate.value), high=max(high, estimate.value))
