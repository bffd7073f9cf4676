"""Tests of the members of a set of effects: is each of them needed beside the others?

Each member is left out and the rest calibrated anew. Its gain is the ln Bayes factor of the set over the
rest. The family-wise p is the chance that the best of all effects that could have been added to the rest
gains as much where the rest lacks nothing; the null is simulated as in `familywise_test.py`, with signatures
on top of the rest.

Reference: Westfall & Young (1993), Resampling-Based Multiple Testing, ch. 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.problem import Floats
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.familywise_test import null_residuals
from taichi_erosion.evidence.inference.goodness_of_fit import misfit_p
from taichi_erosion.evidence.inference.refit import FittedHypothesis, total_evidence
from taichi_erosion.evidence.inference.search.effect_sets import Names, Search, left_out
from taichi_erosion.evidence.inference.verdict import Decision

LEAST = 3  # effects of a set whose members are tested again


@dataclass(frozen=True)
class MemberTest:
    """One member of a set against the rest of it."""

    name: str
    rest: Names  # the others
    gain: float  # ln Bayes factor of the set over the rest
    p: float  # family-wise

    @property
    def needed(self) -> bool:
        """Whether chance seldom gives as much."""
        return self.p < levels.MEMBER_LEVEL


def needed_decision(
    search: Search, decision: Decision, factors: Floats, seed: int
) -> tuple[Decision, list[MemberTest]]:
    """The decision without members that are not needed, and the last test of each that was asked.

    The least needed one goes first, then the others are asked anew. `factors` are draws of the noise factor.
    """
    told: dict[str, MemberTest] = {}
    while True:
        item, asked = members_asked(search, decision)
        if item is None:
            return decision, list(told.values())
        tests = [member_test(search, item, name, factors, seed) for name in asked]
        told |= {test.name: test for test in tests}
        weakest = max(tests, key=lambda test: (test.p, -test.gain))
        smaller = decision if weakest.needed else without(search, decision, weakest)
        if smaller == decision:
            return decision, list(told.values())
        decision = smaller


def members_asked(search: Search, decision: Decision) -> tuple[FittedHypothesis | None, Sequence[str]]:
    """The fitted set and those of its members that are tested; None where there are fewer than LEAST.

    Beside members that are sure, the likeliest one of a group is asked.
    """
    sure = decision.named
    if decision.verdict == "present":
        item = search.found.get(search.sorted(sure))
        return (item, sure) if item is not None and item.usable and len(sure) >= LEAST else (None, ())
    if decision.verdict != "group" or len(sure) < LEAST - 1:
        return None, ()
    larger = [item for item in search.of_size(len(sure) + 1) if set(sure) < set(item.names)]
    larger = [item for item in larger if set(item.names) <= set(decision.group)]
    best = max(larger, key=lambda item: total_evidence(search.prepared, item), default=None)
    return best, () if best is None else [name for name in best.names if name not in sure]


def without(search: Search, decision: Decision, test: MemberTest) -> Decision:
    """The decision without a member that chance could have added.

    Where the rest leaves a misfit, something is needed in its place: one of those that do about as well.
    """
    rest = search.found[test.rest]
    if not levels.fails(misfit_p(search.prepared, rest.expansion)):
        return Decision("present", test.rest)
    best = max(instead(search, test).values())
    close = [name for name, gain in instead(search, test).items() if gain > best - levels.MEMBER_BEHIND]
    if decision.verdict == "group" or len(close) < 2:
        return decision
    return Decision("group", test.rest, (*test.rest, *close))


def instead(search: Search, test: MemberTest) -> dict[str, float]:
    """Ln evidence of each fitted set that has one more effect than the rest, by this effect."""
    size = len(test.rest) + 1
    larger = [item for item in search.of_size(size) if set(test.rest) < set(item.names)]
    return {
        next(name for name in item.names if name not in test.rest): total_evidence(search.prepared, item)
        for item in larger
    }


def member_test(search: Search, item: FittedHypothesis, name: str, factors: Floats, seed: int) -> MemberTest:
    """One member left out."""
    prepared, rest = search.prepared, left_out(search, item, name)
    on_top = search.screen_on(rest)
    gain = total_evidence(prepared, item) - total_evidence(prepared, rest)
    noise = null_residuals(prepared, on_top, factors, np.random.default_rng(seed))
    drawn = [each.log_bayes(noise) for each in on_top.resolved]
    most = np.max(drawn, axis=0) if drawn else np.zeros(factors.size)
    return MemberTest(name, rest.names, gain, float((1.0 + np.sum(most >= gain)) / (1.0 + factors.size)))
