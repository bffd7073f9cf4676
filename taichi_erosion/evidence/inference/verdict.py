"""From probabilities to words: what may be named, what is a group, what the data cannot tell."""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.findings import Verdict
from taichi_erosion.evidence.inference.levels import (
    ALONE,
    CREDIBLE,
    FAMILYWISE_LEVEL,
    NAME_ODDS,
    NONE_LIMIT,
    RIVAL_MISFIT,
    SURE,
    TESTABLE_POWER,
    TESTABLE_SHARE,
    fails,
)
from taichi_erosion.evidence.inference.posterior import NONE, OUTSIDE, Posterior, label
from taichi_erosion.evidence.inference.refit import FittedHypothesis


@dataclass(frozen=True)
class Decision:
    """The verdict and whom it names."""

    verdict: Verdict
    named: tuple[str, ...]
    group: tuple[str, ...]


def detected(believed: Posterior, p: float, p_misfit: float) -> bool:
    """Whether anything at all is missing: unlikely by chance, and clearly likelier than not.

    `p` is that of the best signature, `p_misfit` the least of the misfit as a whole and of its worst place.
    """
    return believed.probability[NONE] < NONE_LIMIT and (p < FAMILYWISE_LEVEL or fails(p_misfit))


def decide(
    believed: Posterior, judged: list[FittedHypothesis], p: float, p_misfit: float, powers: list[float]
) -> Decision:
    """Verdict of the whole study: the likeliest of nothing, something unknown, something named."""
    named_mass = 1.0 - believed.probability[NONE] - believed.probability[OUTSIDE]
    likeliest = max(named_mass, believed.probability[OUTSIDE])
    if not detected(believed, p, p_misfit) or likeliest < believed.probability[NONE]:
        testable = np.mean([power >= TESTABLE_POWER for power in powers]) if powers else 0.0
        return Decision("none_detected" if testable >= TESTABLE_SHARE else "not_testable", (), ())
    if believed.probability[OUTSIDE] > named_mass:
        return Decision("outside_library", (), ())
    return name(believed, judged, named_mass)


def adequate_decision(decision: Decision, believed: Posterior, p_left: float) -> Decision:
    """The decision, but that a name which leaves a misfit must be clearly likelier than something unlisted.

    An effect of the list imitates one that is not there, and takes most of the misfit away: its probability
    then is that of the best of the list. Odds of three to one are the least that count as positive evidence.

    Reference: Kass & Raftery (1995), J. Am. Stat. Assoc. 90, 773, section 3.2.
    """
    outside = believed.probability[OUTSIDE]
    named = 1.0 - believed.probability[NONE] - outside
    if decision.verdict in ("present", "group") and fails(p_left) and named < NAME_ODDS * outside:
        return Decision("outside_library", (), ())
    return decision


def name(believed: Posterior, judged: list[FittedHypothesis], mass: float) -> Decision:
    """Effects that stand alone, and those among which the data do not decide."""
    share = {effect: value / mass for effect, value in believed.inclusion.items()}
    ranked = sorted(share.items(), key=lambda item: -item[1])
    sure = [effect for effect, value in ranked if value >= SURE and value * mass >= ALONE]
    rivals = equal_rivals(judged, sure)
    if sure and not rivals and not second_effect_open(believed, sure, mass):
        return Decision("present", tuple(sure), ())
    group = credible_group(believed, mass)
    group = tuple(dict.fromkeys([*group, *sure, *rivals]))
    alone = tuple(effect for effect in sure if not rivals)
    return Decision("group", alone if alone else (group[0],), group)


def second_effect_open(believed: Posterior, sure: list[str], mass: float) -> bool:
    """Whether a second effect acts too, but which one is open."""
    pairs = sum(value for key, value in believed.probability.items() if "+" in key and key.split("+")[0])
    return len(sure) == 1 and pairs / mass > 0.5


def equal_rivals(judged: list[FittedHypothesis], sure: list[str]) -> list[str]:
    """Singles that fit as well as the one that stands alone; its probability may come from priors only."""
    if len(sure) != 1:
        return []
    misfit = {item.names[0]: item.scored.expansion.fit.misfit for item in judged if len(item.names) == 1}
    best = misfit.get(sure[0])
    if best is None:
        return []
    return [other for other, value in misfit.items() if other != sure[0] and value < best + RIVAL_MISFIT]


def credible_group(believed: Posterior, mass: float) -> list[str]:
    """Effects of the smallest set of named explanations that holds CREDIBLE of their probability."""
    named = {k: v for k, v in believed.probability.items() if k not in (NONE, OUTSIDE)}
    effects, total = [], 0.0
    for key, value in sorted(named.items(), key=lambda item: -item[1]):
        effects += [effect for effect in key.split("+") if effect not in effects]
        total += value / mass
        if total >= CREDIBLE:
            break
    return effects


def best_hypothesis(
    believed: Posterior, judged: list[FittedHypothesis], decision: Decision
) -> tuple[str, ...]:
    """The set of effects whose calibration is reported."""
    if decision.verdict not in ("present", "group", "unstable"):
        return ()
    done = [item.names for item in judged]
    return max(done, key=lambda names: believed.probability.get(label(names), 0.0), default=())
