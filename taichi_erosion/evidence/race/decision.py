"""The decision, one rule: what has a probability of SURE is said.

An effect is named if the explanations that hold it have SURE together; effects that these measurements do not
tell apart are one group if one of them acts with SURE; a mechanism, or at most three, likewise; "not in the
list" is said if what no list holds has SURE. Else nothing is named, and the probabilities are told. A name
that the best of all candidates could have by chance (`predictive_check`) is not given.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.race.predictive_check import familywise_p
from taichi_erosion.evidence.race.priors import FAMILYWISE, KEEP, SURE
from taichi_erosion.evidence.race.search import Hypothesis

Verdict = Literal["present", "group", "none_detected", "outside_library"]
MOST_TOLD = 3  # of a group: more is no answer


@dataclass(frozen=True)
class Decision:
    """What is said, and the probabilities behind it."""

    verdict: Verdict
    named: tuple[str, ...]  # effects that act
    group: tuple[str, ...]  # of which one acts
    mechanisms: tuple[str, ...]  # of which one acts, best first
    none: float  # probability that nothing is missing
    outside: float  # that something acts that is not in the list, and no effect of it
    inclusion: dict[str, float]  # of every effect, that it acts
    varying: dict[str, float]  # of every effect, that it acts with a strength that varies
    beyond: dict[str, float]  # of every mechanism
    zeros: dict[str, float]  # of every instrument, that its zero is off
    familywise: float


def decide(posterior: Posterior) -> Decision:
    """The decision on a race."""
    race, share = posterior.race, posterior.probability
    effects, mechanisms = list(race.model.candidates), [m.name for m in race.prepared.problem.mechanisms]
    inclusion = {name: probability(posterior, [name]) for name in effects}
    beyond = {name: probability(posterior, [name]) for name in mechanisms}
    none = sum(p for h, p in share.items() if not h.names and h.beyond.partition("|")[0] in ("", "zero"))
    outside = sum(p for h, p in share.items() if not h.names and h.beyond.partition("|")[0] in ("?", *mechanisms))
    named = tuple(name for name in effects if inclusion[name] >= SURE)
    group = smallest(posterior, [name for name in effects if name not in named], inclusion, len(effects) // 2)
    together = inclusion | beyond
    told = () if named or group else smallest(posterior, list(together), together, MOST_TOLD)
    best = race.fits[max(share, key=lambda h: share[h])]
    chance = familywise_p(race, best) if named or group else 1.0
    if (named or group) and chance > FAMILYWISE:
        named, group = (), ()
    verdict: Verdict = "none_detected"
    if group:
        verdict = "group"
    elif named:
        verdict = "present"
    elif outside >= SURE or set(told) - set(effects):
        verdict = "outside_library"
    return Decision(
        verdict,
        named,
        group,
        told if verdict == "outside_library" else (),
        none,
        outside,
        inclusion,
        {name: sum(p for h, p in share.items() if h.beyond.partition("|")[0] == name) for name in effects},
        beyond,
        {z.observable: sum(p for h, p in share.items() if h.beyond == f"zero|{z.observable}") for z in race.zeros},
        chance,
    )


def probability(posterior: Posterior, names: Iterable[str]) -> float:
    """Probability that one of some effects or mechanisms acts."""
    wanted = set(names)
    return sum(p for h, p in posterior.probability.items() if acts(h, wanted))


def acts(hypothesis: Hypothesis, names: set[str]) -> bool:
    """Whether one of some effects or mechanisms acts."""
    return bool(names & set(hypothesis.names)) or hypothesis.beyond.partition("|")[0] in names


def smallest(posterior: Posterior, names: Sequence[str], single: dict[str, float], most: int) -> tuple[str, ...]:
    """The fewest of some effects, likeliest first, of which one acts with SURE; none where more are needed."""
    ranked = sorted(names, key=lambda name: -single[name])
    for count in range(1, most + 1):
        if probability(posterior, ranked[:count]) >= SURE:
            return tuple(name for name in ranked[:count] if single[name] > KEEP)
    return ()
