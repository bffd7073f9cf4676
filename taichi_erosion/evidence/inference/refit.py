"""Refits in the model itself of single effects that the screen cannot dismiss; evidence of explanations.

`search/effect_sets.py` finds sets of several effects.
"""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Progress, expected_strength
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.familywise_test import FamilywiseTest
from taichi_erosion.evidence.inference.goodness_of_fit import explained_share, misfit_p, misfit_p_by_noise
from taichi_erosion.evidence.inference.map_fit import GOOD_ENOUGH, STEPS, Fit, fit
from taichi_erosion.evidence.inference.marginal_likelihood import (
    BOUND,
    Expansion,
    ScoredHypothesis,
    expand,
    score,
)
from taichi_erosion.evidence.inference.model_discrepancy import Kernels, discrepancy_gain
from taichi_erosion.evidence.inference.posterior import Hypothesis, log_prior_of
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.screen import Screen

WITHIN = 8.0  # ln Bayes factor behind the best at which a candidate or a pair is still refitted
SINGLES, SINGLES_QUICK = (3, 8), (2, 4)  # refitted, at least and at most
GAIN = 0.5  # ln Bayes factor by which a pair must beat its better member in the screen


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


def scored_expansion(prepared: PreparedProblem, expansion: Expansion, family: Kernels) -> FittedHypothesis:
    """Evidence of an expansion, scored with fresh seeds, without and with a smooth discrepancy."""
    return FittedHypothesis(score(prepared, expansion), discrepancy_gain(prepared, expansion, family))


def scored_fit(prepared: PreparedProblem, best: Fit, family: Kernels) -> FittedHypothesis:
    """Evidence of a fit about its best numbers and strengths."""
    return scored_expansion(prepared, expand(prepared, best), family)


def total_evidence(prepared: PreparedProblem, item: FittedHypothesis) -> float:
    """Ln evidence of a hypothesis, noise factors averaged."""
    return prepared.doubt.averaged(item.scored.log_evidence)


def shortlist(prepared: PreparedProblem, screened: Screen, test: FamilywiseTest) -> list[str]:
    """Names of the candidates worth a refit, best first."""
    least, most = SINGLES_QUICK if prepared.quick else SINGLES
    order = [int(i) for i in np.argsort(-test.observed) if screened.signatures[int(i)].resolved]
    best = test.observed[order[0]] if order else 0.0
    near = [i for i in order if test.observed[i] > best - WITHIN]
    return [screened.signatures[i].name for i in (near if len(near) >= least else order[:least])[:most]]


def fit_singles(
    prepared: PreparedProblem, screened: Screen, names: list[str], family: Kernels, progress: Progress
) -> list[FittedHypothesis]:
    """All shortlisted singles; where none of them fits, or the screen misleads, every candidate.

    The screen relies on the slopes at the bare model's best fit. A large missing effect drives that fit to
    where slopes mean little, and the screen may then dismiss the very effect that is missing, while another
    one imitates it.
    """
    singles: dict[str, FittedHypothesis] = {}
    for index, name in enumerate(names):
        progress(f"refitting with {name}", 0.2 + 0.4 * index / max(len(names), 1))
        base, strength = screened.base.fit, screened.signature(name).likely_strength(screened.residual)
        best = fit(prepared, (name,), [np.append(base.x, strength)])
        if best.misfit > base.misfit:  # a fit is no worse than the bare model, its own case at strength 0
            best = fit(prepared, (name,), [np.append(base.x, 0.0)])
        singles[name] = scored_fit(prepared, best, family)
    if not prepared.quick and none_fits(prepared, list(singles.values())):
        for name in (signature.name for signature in screened.resolved):
            progress(f"refitting with {name} from the prior mean", 0.6)
            start = np.append(prepared.prior_mean, expected_strength(prepared.candidate(name)))
            improve(prepared, singles, name, [start], family)
    elif misleading(screened, list(singles.values())):
        fit_all(prepared, screened, singles, family, progress)
    return list(singles.values())


def misleading(screened: Screen, items: list[FittedHypothesis]) -> bool:
    """Whether a refit took away another misfit than the screen told, by what would dismiss an effect."""
    told = {s.name: float(np.max(s.fall(screened.residual), initial=0.0)) for s in screened.resolved}
    found = {item.names[0]: screened.base.fit.misfit - item.fit.misfit for item in items}
    return any(abs(told[name] - fall) > 2.0 * WITHIN for name, fall in found.items() if name in told)


def fit_all(
    prepared: PreparedProblem,
    screened: Screen,
    singles: dict[str, FittedHypothesis],
    family: Kernels,
    progress: Progress,
) -> None:
    """Fits of all effects after a misleading screen; those that are better and not far behind are weighed."""
    for name in (signature.name for signature in screened.resolved):
        progress(f"refitting with {name} from the prior mean", 0.6)
        start = np.append(prepared.prior_mean, expected_strength(prepared.candidate(name)))
        best = fit(prepared, (name,), [start], STEPS)
        least = min((item.fit.misfit for item in singles.values()), default=np.inf)
        known = singles[name].fit.misfit if name in singles else least + 2.0 * WITHIN
        if best.misfit < known - GOOD_ENOUGH:
            singles[name] = scored_fit(prepared, best, family)


def none_fits(prepared: PreparedProblem, items: list[FittedHypothesis]) -> bool:
    """Whether every hypothesis leaves a misfit."""
    return all(levels.fails(misfit_p(prepared, each.expansion)) for each in items if each.usable)


def fit_from_other_starts(
    prepared: PreparedProblem,
    screened: Screen,
    found: list[FittedHypothesis],
    family: Kernels,
    progress: Progress,
) -> list[FittedHypothesis]:
    """The better fits of all singles, from the leader's calibration and from the bare model's."""
    singles = {item.names[0]: item for item in found if not item.fit.beyond}
    for name in (signature.name for signature in screened.resolved):
        progress(f"refitting with {name} from another start", 0.6)
        unit = expected_strength(prepared.candidate(name))
        fits = (each.fit for each in singles.values())
        leader = min(fits, key=lambda best: best.misfit, default=screened.base.fit)
        strength = leader.psi[0] if leader.names == (name,) else 0.5 * unit
        starts = [np.append(leader.x, strength), np.append(screened.base.fit.x, unit)]
        improve(prepared, singles, name, starts, family)
    return list(singles.values())


def improve(
    prepared: PreparedProblem,
    singles: dict[str, FittedHypothesis],
    name: str,
    starts: list[Floats],
    family: Kernels,
) -> None:
    """The fit of one effect from further starts, kept where it is better."""
    best = fit(prepared, (name,), starts)
    if name not in singles or best.misfit < singles[name].fit.misfit - GOOD_ENOUGH:
        singles[name] = scored_fit(prepared, best, family)


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
        price = np.log(levels.PRIOR_BEYOND) if each.fit.beyond else 0.0
        rejected = not mean_misfit_p(prepared, each) > levels.REJECTION_LEVEL
        evidence, prior = each.scored.log_evidence, price + log_prior_of(each.names, False, count)
        listed.append(Hypothesis(each.names, False, prior, evidence, rejected))
        if len(each.names) == 1:
            share = explained_share(prepared, base.expansion, each.expansion)
            prior = price + log_prior_of(each.names, True, count)
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
