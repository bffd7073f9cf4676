"""Sets of effects that were not fitted, and the probability that they hold.

A screen puts every other effect f on top of a fitted set B. The evidence of B + f is as far behind that of
the best fitted set of this screen as the screen puts f behind,

    ln Z(B + f) = ln Z(B + v) - max(D_v - D_f, 0),    at most ln Z(B) + D_f

with D the ln Bayes factors of the screen and v the fitted one of largest D: a screen over a large misfit
promises more than a refit can keep, to all effects alike. Pairs come from the algebra on the bare model's
screen in the same way. Sets that are two steps away from every fitted one are not counted.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.posterior import log_prior_of
from taichi_erosion.evidence.inference.refit import FittedHypothesis, total_evidence
from taichi_erosion.evidence.inference.screen import Screen
from taichi_erosion.evidence.inference.search.effect_sets import Names, Search, pair_screen, try_set, weigh

SHARE = 0.01  # estimated probability from which a set is fitted after all
ROUNDS, MOST = 2, 4  # of such fits, and sets in each


@dataclass(frozen=True)
class SetEstimate:
    """A set that a screen suggests, with ln of its prior times its evidence, and a start of its fit."""

    names: Names
    log_joint: float
    start: Floats  # calibrated numbers, then strengths
    beyond: bool  # strengths may exceed the largest of the list


@dataclass(frozen=True)
class Suggestion:
    """An effect or a pair on top of a fitted set: what the screen says that it gains."""

    gain: float  # ln Bayes factor
    start: Floats
    beyond: bool


def complete(search: Search, screened: Screen, bare: FittedHypothesis) -> None:
    """Fits of the sets that the steps left out and that could hold SHARE of the probability."""
    for _ in range(0 if search.prepared.quick else ROUNDS):
        left = sorted(unvisited_sets(search, screened, bare).values(), key=lambda each: -each.log_joint)
        least = log_joint_of(search, screened, bare) + np.log(SHARE)
        wanted = [each for each in left if each.log_joint > least][:MOST]
        for each in wanted:
            try_set(search, each.names, [each.start], each.beyond)
        for size in {len(each.names) for each in wanted}:
            weigh(search, size)
        if not wanted:
            return


def able_count(screened: Screen) -> int:
    """How many candidates any measured condition lets act."""
    return max(sum(bool(np.any(signature.raw)) for signature in screened.signatures), 1)


def log_joint_of(search: Search, screened: Screen, bare: FittedHypothesis) -> float:
    """Ln of prior times evidence of the bare model and all sets that were weighed."""
    count = able_count(screened)
    items = [bare, *(item for item in search.found.values() if item.usable)]
    logs = [log_prior_of(item.names, False, count) + total_evidence(search.prepared, item) for item in items]
    return float(log_sum_exp(np.array(logs)))


def unvisited_sets(search: Search, screened: Screen, bare: FittedHypothesis) -> dict[Names, SetEstimate]:
    """Sets of two or more effects that were not fitted, as estimated."""
    count = able_count(screened)
    found: dict[Names, SetEstimate] = {}
    for names, value, suggestion in estimates(search, screened, bare):
        if names in search.found or names in search.fits or len(names) > min(levels.MOST_EFFECTS, count):
            continue
        price = np.log(levels.PRIOR_BEYOND) if suggestion.beyond else 0.0
        joint = float(value + price + log_prior_of(names, False, count))
        if names not in found or joint > found[names].log_joint:
            found[names] = SetEstimate(names, joint, suggestion.start, suggestion.beyond)
    return found


def estimates(
    search: Search, screened: Screen, bare: FittedHypothesis
) -> Iterator[tuple[Names, float, Suggestion]]:
    """Sets with their estimated ln evidence, from every screen that was made."""
    x = screened.base.fit.x
    pairs = {
        names: Suggestion(gain, np.concatenate([x, strengths]), False)
        for names, (gain, strengths) in pair_screen(screened).items()
    }
    yield from behind_best(search, total_evidence(search.prepared, bare), pairs)
    for base, on_top in search.screens.items():
        item = search.found.get(base)
        if item is not None and item.usable:
            own = suggestions(search, item, on_top)
            yield from behind_best(search, total_evidence(search.prepared, item), own)


def suggestions(search: Search, item: FittedHypothesis, on_top: Screen) -> dict[Names, Suggestion]:
    """Every other effect on top of a fitted set."""
    found = {}
    for each in on_top.resolved:
        strengths = {**item.fit.acting(), each.name: each.likely_strength(on_top.residual)}
        names = search.sorted(tuple(strengths))
        start = np.concatenate([item.fit.x, [strengths[name] for name in names]])
        gain = float(each.log_bayes(on_top.residual))
        found[names] = Suggestion(gain, start, item.fit.beyond)
    return found


def behind_best(
    search: Search, base: float, suggested: Mapping[Names, Suggestion]
) -> Iterator[tuple[Names, float, Suggestion]]:
    """Ln evidence of all sets of one screen, from that of its base and from what each gains in the screen."""
    fitted = [names for names in suggested if names in search.found and search.found[names].usable]
    best = max(fitted, key=lambda names: suggested[names].gain, default=None)
    for names, suggestion in suggested.items():
        value = base + suggestion.gain
        if best is not None:
            reached = total_evidence(search.prepared, search.found[best])
            value = min(value, reached - max(suggested[best].gain - suggestion.gain, 0.0))
        yield names, value, suggestion


def unvisited_share(
    search: Search, screened: Screen, bare: FittedHypothesis, total: float
) -> dict[str, float]:
    """Estimated probability of all sets that were not fitted, under "", and of those that hold each effect.

    `total` is ln of prior times evidence of everything that was weighed.
    """
    logs = {names: each.log_joint for names, each in unvisited_sets(search, screened, bare).items()}
    if not logs or not np.isfinite(total):
        return {}
    everything = log_sum_exp(np.array([total, *logs.values()]))
    shares: dict[str, float] = {}
    for names, value in logs.items():
        for name in ("", *names):
            shares[name] = shares.get(name, 0.0) + float(np.exp(value - everything))
    return shares
