"""Decision rules: what may be named, what is a group, what the data cannot decide."""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.findings import NAMING, NONE, OUTSIDE, Verdict
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.posterior import Posterior, label
from taichi_erosion.evidence.inference.refit import FittedHypothesis

IDLE = 1e-3  # strength below which an effect is taken not to act [1]


@dataclass(frozen=True)
class Decision:
    """The verdict and the effects that it names."""

    verdict: Verdict
    named: tuple[str, ...] = ()
    group: tuple[str, ...] = ()

    @property
    def accepted(self) -> set[str]:
        return {*self.named, *self.group}


def withdrawn(decision: Decision) -> Decision:
    """The decision where the answer changes with the runs of the model: no name, its effects in one group."""
    return Decision("unstable", (), tuple(dict.fromkeys((*decision.named, *decision.group))))


def detected(posterior: Posterior, p: float, p_misfit: float) -> bool:
    """Whether anything at all is missing: unlikely by chance, and clearly likelier than not.

    `p` is that of the best signature, `p_misfit` the least of the misfit as a whole and of its worst place.
    """
    unlikely = p < levels.FAMILYWISE_LEVEL or levels.fails(p_misfit)
    return unlikely and posterior.probability[NONE] < levels.NONE_LIMIT


def decide(
    posterior: Posterior, refits: list[FittedHypothesis], p: float, p_misfit: float, powers: list[float]
) -> Decision:
    """Verdict of the whole study: the likeliest of nothing, something unknown, something named."""
    none, outside, named = posterior.probability[NONE], posterior.probability[OUTSIDE], posterior.named
    if not detected(posterior, p, p_misfit) or max(named, outside) < none:
        testable = np.mean([power >= levels.TESTABLE_POWER for power in powers]) if powers else 0.0
        return Decision("none_detected" if testable >= levels.TESTABLE_SHARE else "not_testable")
    return Decision("outside_library") if outside > named else name_effects(posterior, refits)


def adequate_decision(decision: Decision, posterior: Posterior, p_left: float) -> Decision:
    """The decision, but that a name which leaves a misfit must be clearly likelier than something unlisted.

    An effect of the list imitates one that is not there, and takes most of the misfit away: its probability
    then is that of the best of the list. Odds of three to one are the least that count as positive evidence.

    Reference: Kass & Raftery (1995), J. Am. Stat. Assoc. 90, 773, section 3.2.
    """
    unlikely = posterior.named < levels.NAME_ODDS * posterior.probability[OUTSIDE]
    if decision.verdict in NAMING and levels.fails(p_left) and unlikely:
        return Decision("outside_library")
    return decision


def acting_decision(decision: Decision, final: FittedHypothesis) -> Decision:
    """The decision without names whose fitted strength is 0: they explain nothing."""
    idle = {name for name, strength in final.fit.acting().items() if strength < IDLE}
    if decision.verdict != "present" or not idle & set(decision.named):
        return decision
    left = tuple(name for name in decision.named if name not in idle)
    return Decision("present", left) if left else Decision("outside_library")


def name_effects(posterior: Posterior, refits: list[FittedHypothesis]) -> Decision:
    """Effects that stand alone, and those among which the data do not decide."""
    mass = posterior.named
    share = {effect: value / mass for effect, value in posterior.inclusion.items()}
    ranked = sorted(share.items(), key=lambda item: -item[1])
    sure = [effect for effect, value in ranked if value >= levels.SURE and value * mass >= levels.ALONE]
    rivals = [other for other in equal_rivals(refits, sure) if share.get(other, 0.0) > levels.PLAUSIBLE]
    if sure and not rivals and not further_effect_open(posterior, sure):
        return Decision("present", tuple(sure))
    group = tuple(dict.fromkeys([*credible_group(posterior), *sure, *rivals]))
    return Decision("group", tuple(sure) if sure and not rivals else (), group)


def further_effect_open(posterior: Posterior, sure: list[str]) -> bool:
    """Whether one more effect acts than those that are sure, but which one is open."""
    sizes = {key: len(key.split("+")) for key in posterior.probability if key not in (NONE, OUTSIDE)}
    larger = sum(posterior.probability[key] for key, size in sizes.items() if size > len(sure))
    return larger / posterior.named > 0.5


def equal_rivals(refits: list[FittedHypothesis], sure: list[str]) -> list[str]:
    """Singles that fit as well as the one that stands alone; its probability may come from priors only."""
    misfit = {item.names[0]: item.fit.misfit for item in refits if len(item.names) == 1}
    if len(sure) != 1 or sure[0] not in misfit:
        return []
    limit = misfit[sure[0]] + levels.RIVAL_MISFIT
    return [other for other, value in misfit.items() if other != sure[0] and value < limit]


def credible_group(posterior: Posterior) -> list[str]:
    """Effects of the smallest set of named explanations that holds levels.CREDIBLE of their probability."""
    named = {k: v for k, v in posterior.probability.items() if k not in (NONE, OUTSIDE)}
    effects, total = [], 0.0
    for key, value in sorted(named.items(), key=lambda item: -item[1]):
        effects += [effect for effect in key.split("+") if effect not in effects]
        total += value / posterior.named
        if total >= levels.CREDIBLE:
            break
    return effects


def best_hypothesis(
    posterior: Posterior, refits: list[FittedHypothesis], decision: Decision
) -> tuple[str, ...]:
    """The set of effects whose calibration is reported."""
    if decision.verdict not in ("present", "group", "unstable"):
        return ()
    done = [item.names for item in refits]
    return max(done, key=lambda names: posterior.probability.get(label(names), 0.0), default=())
