"""Refits in the model itself: single effects that the screen cannot dismiss, then pairs of effects.

Pairs are searched in two ways. Algebra on the paths at the bare model's best fit ranks all of them at once;
it fails where one effect is so strong that this fit means nothing. So the best singles, where they leave a
misfit, are taken for granted in turn, and the others are screened against what each of them leaves.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Progress, expected_strength
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.familywise_test import FamilywiseTest
from taichi_erosion.evidence.inference.goodness_of_fit import explained_share, misfit_p, misfit_p_by_noise
from taichi_erosion.evidence.inference.map_fit import GOOD_ENOUGH, Fit, fit
from taichi_erosion.evidence.inference.marginal_likelihood import (
    BOUND,
    Expansion,
    ScoredHypothesis,
    expand,
    score,
)
from taichi_erosion.evidence.inference.model_discrepancy import discrepancy_gain
from taichi_erosion.evidence.inference.posterior import Hypothesis, log_prior_of
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.screen import Screen, screen

WITHIN = 8.0  # ln Bayes factor behind the best at which a candidate or a pair is still refitted
SINGLES, SINGLES_QUICK = (3, 8), (2, 4)  # refitted, at least and at most
GAIN = 0.5  # ln Bayes factor by which a pair must beat its better member in the screen
PAIRS, PAIRS_QUICK = 6, 3
FIRSTS, SECONDS = 3, 3  # singles taken for granted, and second effects tried on top of each

Starts = dict[tuple[str, str], list[Floats]]  # joint positions from which a pair is refitted


@dataclass(frozen=True)
class FittedHypothesis:
    """A set of effects fitted in the model, with its evidence."""

    scored: ScoredHypothesis
    gain: Floats  # ln evidence that a smooth discrepancy adds, per noise factor

    @property
    def names(self) -> tuple[str, ...]:
        return self.fit.names

    @property
    def fit(self) -> Fit:
        return self.scored.expansion.fit

    @property
    def expansion(self) -> Expansion:
        return self.scored.expansion

    @property
    def usable(self) -> bool:
        """Whether the model works at the best fit."""
        return bool(self.scored.likelihoods)


def scored_expansion(
    prepared: PreparedProblem, expansion: Expansion, family: list[Floats]
) -> FittedHypothesis:
    """Evidence of an expansion, scored with fresh seeds, without and with a smooth discrepancy."""
    return FittedHypothesis(score(prepared, expansion), discrepancy_gain(prepared, expansion, family))


def shortlist(prepared: PreparedProblem, screened: Screen, test: FamilywiseTest) -> list[str]:
    """Names of the candidates worth a refit, best first."""
    least, most = SINGLES_QUICK if prepared.quick else SINGLES
    order = [int(i) for i in np.argsort(-test.observed) if screened.signatures[int(i)].resolved]
    best = test.observed[order[0]] if order else 0.0
    near = [i for i in order if test.observed[i] > best - WITHIN]
    return [screened.signatures[i].name for i in (near if len(near) >= least else order[:least])[:most]]


def fit_singles(
    prepared: PreparedProblem, screened: Screen, names: list[str], family: list[Floats], progress: Progress
) -> list[FittedHypothesis]:
    """All shortlisted singles; every candidate from further starts too where none of them fits.

    The screen relies on the slopes at the bare model's best fit. A large missing effect drives that fit to
    where slopes mean little, and the screen may then dismiss the very effect that is missing.
    """
    singles: dict[str, FittedHypothesis] = {}
    for index, name in enumerate(names):
        progress(f"refitting with {name}", 0.2 + 0.4 * index / max(len(names), 1))
        base, strength = screened.base.fit, screened.signature(name).likely_strength(screened.residual)
        best = fit(prepared, (name,), [np.append(base.x, strength)])
        if best.misfit > base.misfit:  # a fit is no worse than the bare model, its own case at strength 0
            best = fit(prepared, (name,), [np.append(base.x, 0.0)])
        singles[name] = scored_expansion(prepared, expand(prepared, best), family)
    left = (misfit_p(prepared, each.expansion) for each in singles.values() if each.usable)
    if prepared.quick or not all(map(levels.fails, left)):
        return list(singles.values())
    for signature in screened.signatures:
        if signature.resolved:
            progress(f"refitting with {signature.name} from another start", 0.6)
            refit_from_other_starts(prepared, singles, screened, signature.name, family)
    return list(singles.values())


def refit_from_other_starts(
    prepared: PreparedProblem,
    singles: dict[str, FittedHypothesis],
    screened: Screen,
    name: str,
    family: list[Floats],
) -> None:
    """The prior mean and the leader's calibration as further starts; the best fit is kept."""
    unit = expected_strength(prepared.candidate(name))
    leader = min((each.fit for each in singles.values()), key=lambda best: best.misfit)
    strength = leader.psi[0] if leader.names == (name,) else 0.5 * unit
    starts = [np.append(prepared.prior_mean, unit), np.append(leader.x, strength)]
    if name not in singles:
        starts.append(np.append(screened.base.fit.x, unit))
    best = fit(prepared, (name,), starts)
    if name not in singles or best.misfit < singles[name].fit.misfit - GOOD_ENOUGH:
        singles[name] = scored_expansion(prepared, expand(prepared, best), family)


def fit_pairs(
    prepared: PreparedProblem,
    screened: Screen,
    singles: list[FittedHypothesis],
    family: list[Floats],
    progress: Progress,
) -> list[FittedHypothesis]:
    """The pairs that either search finds, refitted; none where one effect explains as much as two."""
    starts = promising_pairs(prepared, screened, singles)
    for pair, position in second_effects(prepared, singles).items():
        starts[pair] = position + starts.get(pair, [])
    pairs = []
    for index, (pair, positions) in enumerate(starts.items()):
        progress(f"refitting with {pair[0]} and {pair[1]}", 0.7 + 0.2 * index / len(starts))
        best = fit(prepared, pair, positions[:2])
        pairs.append(scored_expansion(prepared, expand(prepared, best), family))
    return pairs


def second_effects(prepared: PreparedProblem, singles: list[FittedHypothesis]) -> Starts:
    """Second effects that explain the residuals of the best singles, strongest first."""
    ranked = sorted((each for each in singles if each.usable), key=lambda each: each.fit.misfit)
    order = [candidate.name for candidate in prepared.problem.candidates]
    starts: Starts = {}
    for first in ranked[: 1 if prepared.quick else FIRSTS]:
        if misfit_p(prepared, first.expansion) > levels.SECOND_EFFECT_LEVEL:
            break
        rest = screen(prepared, first.expansion)
        gains = [(float(s.log_bayes(rest.residual)), s) for s in rest.signatures if s.resolved]
        gains = sorted((item for item in gains if item[0] > GAIN), key=lambda item: -item[0])
        for _, second in gains[:SECONDS]:
            strength = {**first.fit.acting(), second.name: second.likely_strength(rest.residual)}
            one, other = sorted(strength, key=order.index)
            position = np.concatenate([first.fit.x, [strength[one], strength[other]]])
            starts.setdefault((one, other), []).append(position)
    return starts


def promising_pairs(prepared: PreparedProblem, screened: Screen, singles: list[FittedHypothesis]) -> Starts:
    """Pairs that the screen of the bare model ranks clearly above their members."""
    ranked = pair_screen(screened)
    alone = {s.name: float(s.log_bayes(screened.residual)) for s in screened.signatures}
    best = max((value for value, _ in ranked.values()), default=0.0)
    clear = [
        pair
        for pair in sorted(ranked, key=lambda pair: -ranked[pair][0])
        if ranked[pair][0] > max(alone[pair[0]], alone[pair[1]]) + GAIN and ranked[pair][0] > best - WITHIN
    ]
    fits = {each.names[0]: each.fit for each in singles}
    starts: Starts = {}
    for pair in clear[: PAIRS_QUICK if prepared.quick else PAIRS]:
        strengths = ranked[pair][1]
        starts[pair] = [np.concatenate([screened.base.fit.x, strengths])]
        for place, name in enumerate(pair):
            if name in fits:
                moved = strengths.copy()
                moved[place] = fits[name].psi[0]
                starts[pair].append(np.concatenate([fits[name].x, moved]))
    return starts


def pair_screen(screened: Screen) -> dict[tuple[str, str], tuple[float, Floats]]:
    """Ln Bayes factor and likely strengths (2,) of every pair, by algebra on the paths alone.

    D(a, b) = D_a + D_b - 2 g_a g_b for effects that act independently on the comparison scale.
    """
    resolved = [(s, s.fall(screened.residual)) for s in screened.signatures if s.resolved]
    results = {}
    for (first, one), (second, other) in combinations(resolved, 2):
        fall = one[:, np.newaxis] + other[np.newaxis, :] - 2.0 * first.free @ second.free.T
        value = 0.5 * fall + first.log_prior[:, np.newaxis] + second.log_prior[np.newaxis, :]
        i, j = np.unravel_index(int(np.argmax(value)), value.shape)
        strengths = np.array([first.grid[i], second.grid[j]])
        results[(first.name, second.name)] = (float(log_sum_exp(value)), strengths)
    return results


def hypotheses(
    prepared: PreparedProblem,
    base: FittedHypothesis,
    screened: Screen,
    test: FamilywiseTest,
    refits: list[FittedHypothesis],
) -> list[Hypothesis]:
    """Every explanation with its evidence; candidates that were not refitted keep their screened one.

    Probability goes to those that are likelier than others, even where the measurements reject them all. So
    a rejected one does not count for its names, but for something outside the list that it resembles. A
    candidate that no measured condition lets act has no probability; the others share its prior.
    """
    able = {signature.name for signature in screened.signatures if np.any(signature.raw)}
    count, bare = len(able), base.scored.log_evidence
    listed = [
        Hypothesis((), False, log_prior_of((), False, max(count, 1)), bare),
        Hypothesis((), True, log_prior_of((), True, max(count, 1)), bare + base.gain, rejected=True),
    ]
    done = {each.names for each in refits}
    for index, signature in enumerate(screened.signatures):
        if signature.name in able and (names := (signature.name,)) not in done:
            evidence = screened_evidence(base, test, refits, screened, index)
            listed.append(Hypothesis(names, False, log_prior_of(names, False, count), evidence))
    for each in refits:
        rejected = not mean_misfit_p(prepared, each) > levels.REJECTION_LEVEL
        evidence, prior = each.scored.log_evidence, log_prior_of(each.names, False, count)
        listed.append(Hypothesis(each.names, False, prior, evidence, rejected))
        if len(each.names) == 1:
            share = explained_share(prepared, base.expansion, each.expansion)
            prior = log_prior_of(each.names, True, count)
            acts = bool(each.fit.psi[0] > BOUND * prepared.candidate(each.names[0]).maximum)
            rejected = rejected or not (acts and share > levels.EXPLAINED_SHARE)
            listed.append(Hypothesis(each.names, True, prior, evidence + each.gain, rejected))
    return listed


def mean_misfit_p(prepared: PreparedProblem, item: FittedHypothesis) -> float:
    """Chance of the misfit that a hypothesis leaves, averaged over its posterior of the noise factor."""
    if not item.usable:
        return 0.0
    weight = prepared.doubt.log_weight + item.scored.log_evidence
    chances = misfit_p_by_noise(prepared, item.expansion, prepared.doubt.factor)
    return float(np.exp(weight - log_sum_exp(weight)) @ chances)


def screened_evidence(
    base: FittedHypothesis, test: FamilywiseTest, refits: list[FittedHypothesis], screened: Screen, index: int
) -> Floats:
    """Evidence of a candidate that the screen dismissed: as far behind the best refitted one as it was there.

    A screen over a large misfit promises more than a refit can keep, to all candidates alike. None is worse
    than the base by more than the prior of its weakest strengths, where it is the base.
    """
    own, least = float(test.observed[index]), float(screened.signatures[index].log_prior[0])
    bare = base.scored.log_evidence
    observed = {s.name: float(value) for s, value in zip(screened.signatures, test.observed, strict=True)}
    singles = [each for each in refits if len(each.names) == 1]
    if not singles or own <= 0.0:
        return bare + min(own, 0.0)
    best = max(singles, key=lambda each: observed[each.names[0]])
    behind = max(observed[best.names[0]] - own, 0.0)
    return np.clip(best.scored.log_evidence - behind, bare + min(least, own), bare + own)
