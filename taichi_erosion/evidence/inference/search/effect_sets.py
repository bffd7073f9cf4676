"""Sets of two to four effects, found by steps and refitted in the model.

Pairs are searched in two ways. Algebra on the paths at the bare model's best fit ranks all of them at once;
it fails where one effect is so strong that this fit means nothing. So the best singles, where they leave a
misfit, are taken for granted in turn, and the others are screened against what each of them leaves. The same
step adds a third and a fourth effect to the best sets. Of the best set every effect is left out in turn
(backward), and the others are screened for one that does better in its place (swap).

Tests of the members of a set of effects: is each of them needed beside the others?

Each member is left out and the rest calibrated anew. Its gain is the ln Bayes factor of the set over the
rest. The family-wise p is the chance that the best of all effects that could have been added to the rest
gains as much where the rest lacks nothing; the null is simulated as in `familywise_test.py`, with signatures
on top of the rest.

Reference: Westfall & Young (1993), Resampling-Based Multiple Testing, ch. 2.

Listed effects that are stronger than the list allows.

A fit that ends at the largest strength of the list, and would go on, is repeated with a range REACH times as
wide. Its prior is a half-normal of the scale of the maximum, and it has the share PRIOR_BEYOND of the prior
of its set: the price of leaving the list.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Progress
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.familywise_test import null_residuals
from taichi_erosion.evidence.inference.goodness_of_fit import misfit_p
from taichi_erosion.evidence.inference.map_fit import GOOD_ENOUGH, Fit, fit
from taichi_erosion.evidence.inference.marginal_likelihood import BOUND, Expansion, projected_residual
from taichi_erosion.evidence.inference.model_discrepancy import Kernels
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.refit import GAIN, WITHIN, FittedHypothesis, scored_fit, total_evidence
from taichi_erosion.evidence.inference.screen import Screen, screen
from taichi_erosion.evidence.inference.verdict import Decision

FALL = 6.0  # of the misfit that the wider range must bring: what its prior costs, twice ln 20
PAIRS, PAIRS_QUICK = 6, 3  # refitted out of the screen of the bare model, at most
FIRSTS, FURTHER = 3, 3  # singles taken for granted, and effects tried on top of each
LEADERS = 2  # larger sets that are taken for granted
BEHIND = 2.0 * (WITHIN + 2.0)  # misfit behind the best set of its size, beyond which a set is not weighed
EXCHANGES = 2  # rounds of backward and swap steps
SWAPS = 1  # effects tried in the place of another

Names = tuple[str, ...]
LEAST = 3  # effects of a set whose members are tested again


def with_stronger(
    prepared: PreparedProblem, items: Sequence[FittedHypothesis], family: Kernels
) -> list[FittedHypothesis]:
    """Fits beyond the list of those hypotheses that end at a largest strength and would go on."""
    wide = [stronger_fit(prepared, item.expansion) for item in items if item.usable]
    return [scored_fit(prepared, best, family) for best in wide if best is not None]


def stronger_fit(prepared: PreparedProblem, expansion: Expansion) -> Fit | None:
    """The fit of a hypothesis beyond the list, where it is clearly better; else None.

    None too for a model that is known from runs within the list alone: it says nothing beyond them.
    """
    best = expansion.fit
    if prepared.predictor.uncertainty is not None or best.beyond or not any(at_maximum(prepared, expansion)):
        return None
    wide = fit(prepared, best.names, [np.append(best.x, best.psi)], beyond=True)
    better = wide.misfit < best.misfit - FALL and stronger(prepared, wide.acting())
    return wide if better else None


def at_maximum(prepared: PreparedProblem, expansion: Expansion) -> list[bool]:
    """Whether each strength ends at the largest of the list and would go on."""
    stuck, acting = projected_residual(prepared, expansion).stuck, expansion.fit.acting()
    ends = [psi > (1.0 - BOUND) * prepared.candidate(name).maximum for name, psi in acting.items()]
    return [bool(end and held) for end, held in zip(ends, stuck, strict=False)]


def stronger(prepared: PreparedProblem, acting: dict[str, float]) -> list[str]:
    """Effects whose strength exceeds the largest of the list."""
    return [name for name, psi in acting.items() if psi > prepared.candidate(name).maximum]


@dataclass(frozen=True)
class Search:
    """What has been fitted and screened so far."""

    prepared: PreparedProblem
    family: Kernels  # kernels of the smooth discrepancy
    found: dict[Names, FittedHypothesis]
    fits: dict[Names, Fit] = field(default_factory=dict)  # of all sets that were tried
    screens: dict[Names, Screen] = field(default_factory=dict)

    def sorted(self, names: Sequence[str]) -> Names:
        """Names in the order of the candidates."""
        order = self.prepared.problem.candidate_names
        return tuple(sorted(names, key=order.index))

    def of_size(self, size: int) -> list[FittedHypothesis]:
        """Usable hypotheses of so many effects, least misfit first."""
        fitted = (each for each in self.found.values() if each.usable and len(each.names) == size)
        return sorted(fitted, key=lambda each: each.fit.misfit)

    def screen_on(self, item: FittedHypothesis) -> Screen:
        """All other candidates against what a set leaves."""
        if item.names not in self.screens:
            self.screens[item.names] = screen(self.prepared, item.expansion)
        return self.screens[item.names]


def fit_sets(
    prepared: PreparedProblem,
    screened: Screen,
    singles: Sequence[FittedHypothesis],
    family: Kernels,
    progress: Progress,
) -> Search:
    """Singles with the better fits that steps find, and all sets of more effects that they find."""
    search = Search(prepared, family, leading(singles))
    fit_pairs(search, screened, progress)
    for size in range(3, levels.MOST_EFFECTS + 1):
        leaders = search.of_size(size - 1)[: 1 if prepared.quick else LEADERS]
        if not leaders or explains(prepared, leaders[0]):
            break
        progress(f"refitting sets of {size} effects", 0.7 + 0.05 * size)
        for leader in leaders:
            further_effects(search, leader)
        weigh(search, size)
        exchange(search, size)
    return search


def leading(items: Sequence[FittedHypothesis]) -> dict[Names, FittedHypothesis]:
    """One fit of every set: beyond the largest strengths of the list where there is one."""
    found: dict[Names, FittedHypothesis] = {}
    for item in items:
        if item.names not in found or item.fit.beyond:
            found[item.names] = item
    return found


def explains(prepared: PreparedProblem, item: FittedHypothesis) -> bool:
    """Whether a set leaves so little that no further effect is searched."""
    return misfit_p(prepared, item.expansion) > levels.SECOND_EFFECT_LEVEL


def fit_pairs(search: Search, screened: Screen, progress: Progress) -> None:
    """The pairs that either search finds."""
    prepared, singles = search.prepared, search.of_size(1)
    for first in singles[: 1 if prepared.quick else FIRSTS]:
        if explains(prepared, first):
            break
        progress(f"refitting with {first.names[0]} and another effect", 0.65)
        further_effects(search, first)
    for pair, starts in promising_pairs(prepared, screened, singles).items():
        progress(f"refitting with {pair[0]} and {pair[1]}", 0.7)
        try_set(search, pair, starts[1:] or starts, False)
    weigh(search, 2)
    exchange(search, 2)


def try_set(search: Search, names: Names, starts: list[Floats], beyond: bool) -> None:
    """Best fit of a set from further starts."""
    best = fit(search.prepared, names, starts[:2], beyond=beyond)
    if names not in search.fits or best.misfit < search.fits[names].misfit:
        search.fits[names] = best


def weigh(search: Search, size: int) -> None:
    """Evidence of the fitted sets of one size that are not far behind the best of them."""
    own = [best for names, best in search.fits.items() if len(names) == size]
    least = min((best.misfit for best in own), default=0.0)
    for best in own:
        known = search.found.get(best.names)
        if best.misfit < least + BEHIND and (known is None or known.fit.misfit > best.misfit):
            item = scored_fit(search.prepared, best, search.family)
            search.found.update(leading([item, *with_stronger(search.prepared, [item], search.family)]))


def further_effects(search: Search, item: FittedHypothesis, without: str = "", most: int = FURTHER) -> None:
    """Sets of one more effect out of the screen of what a set leaves, strongest first."""
    rest = search.screen_on(item)
    gains = [(float(s.log_bayes(rest.residual)), s) for s in rest.resolved if s.name != without]
    gains = sorted((each for each in gains if each[0] > GAIN), key=lambda each: -each[0])
    for gain, signature in gains[:most]:
        if gain < gains[0][0] - WITHIN:
            break
        strengths = {**item.fit.acting(), signature.name: signature.likely_strength(rest.residual)}
        names = search.sorted(tuple(strengths))
        if without and names in search.fits:
            continue
        position = np.concatenate([item.fit.x, [strengths[name] for name in names]])
        try_set(search, names, [position], item.fit.beyond)


def exchange(search: Search, size: int) -> None:
    """Backward and swap steps about the best set of one size, until it stays the best."""
    for _ in range(EXCHANGES):
        best = search.of_size(size)
        if not best:
            return
        for name in best[0].names:
            further_effects(search, left_out(search, best[0], name), without=name, most=SWAPS)
        weigh(search, size)
        if search.of_size(size)[0].names == best[0].names:
            return


def left_out(search: Search, item: FittedHypothesis, name: str) -> FittedHypothesis:
    """A set without one of its effects, calibrated anew from where the set lies."""
    rest = item.fit.acting()
    del rest[name]
    names = search.sorted(tuple(rest))
    position = np.concatenate([item.fit.x, [rest[each] for each in names]])
    best = fit(search.prepared, names, [position], beyond=item.fit.beyond)
    known = search.found.get(names)
    if known is None or best.misfit < known.fit.misfit - GOOD_ENOUGH:
        search.fits[names] = best
        search.found[names] = scored_fit(search.prepared, best, search.family)
        search.screens.pop(names, None)
    return search.found[names]


def promising_pairs(
    prepared: PreparedProblem, screened: Screen, singles: Sequence[FittedHypothesis]
) -> dict[Names, list[Floats]]:
    """Pairs that the screen of the bare model ranks clearly above their members, with starts of their fit."""
    ranked = pair_screen(screened)
    alone = {s.name: float(s.log_bayes(screened.residual)) for s in screened.signatures}
    best = max((value for value, _ in ranked.values()), default=0.0)
    clear = [
        pair
        for pair in sorted(ranked, key=lambda pair: -ranked[pair][0])
        if ranked[pair][0] > max(alone[name] for name in pair) + GAIN and ranked[pair][0] > best - WITHIN
    ]
    fits = {each.names[0]: each.fit for each in singles}
    starts: dict[Names, list[Floats]] = {}
    for pair in clear[: PAIRS_QUICK if prepared.quick else PAIRS]:
        strengths = ranked[pair][1]
        starts[pair] = [np.concatenate([screened.base.fit.x, strengths])]
        for place, name in enumerate(pair):
            if name in fits:
                moved = strengths.copy()
                moved[place] = fits[name].psi[0]
                starts[pair].append(np.concatenate([fits[name].x, moved]))
    return starts


def pair_screen(screened: Screen) -> dict[Names, tuple[float, Floats]]:
    """Ln Bayes factor and likely strengths (2,) of every pair, by algebra on the paths alone.

    D(a, b) = D_a + D_b - 2 g_a g_b for effects that act independently on the comparison scale.
    """
    resolved = [(s, s.fall(screened.residual)) for s in screened.resolved]
    results: dict[Names, tuple[float, Floats]] = {}
    for (first, one), (second, other) in combinations(resolved, 2):
        fall = one[:, np.newaxis] + other[np.newaxis, :] - 2.0 * first.free @ second.free.T
        value = 0.5 * fall + first.log_prior[:, np.newaxis] + second.log_prior[np.newaxis, :]
        i, j = np.unravel_index(int(np.argmax(value)), value.shape)
        strengths = np.array([first.grid[i], second.grid[j]])
        results[(first.name, second.name)] = (float(log_sum_exp(value)), strengths)
    return results


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
