"""The candidates that the screen cannot dismiss, refitted in the model itself and judged with fresh seeds."""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Progress, expected_strength
from taichi_erosion.evidence.inference.familywise_test import FamilywiseTest
from taichi_erosion.evidence.inference.goodness_of_fit import (
    chi_square,
    misfit_chances,
    misfit_p,
    residuals_of,
)
from taichi_erosion.evidence.inference.levels import EXPLAINED_SHARE, REJECTION_LEVEL, fails
from taichi_erosion.evidence.inference.map_fit import GOOD_ENOUGH, STEPS, STEPS_QUICK, Fit, fit
from taichi_erosion.evidence.inference.marginal_likelihood import ScoredHypothesis, expand, score
from taichi_erosion.evidence.inference.model_discrepancy import Kernel, discrepancy_gain
from taichi_erosion.evidence.inference.posterior import Hypothesis, log_prior_of
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.screen import Screen, Signature

WITHIN = 8.0  # ln Bayes factor behind the best at which a candidate is still refitted
LEAST = 3
MOST = 8
LEAST_QUICK, MOST_QUICK = 2, 4


@dataclass(frozen=True)
class FittedHypothesis:
    """A hypothesis refitted in the model."""

    names: tuple[str, ...]
    scored: ScoredHypothesis
    gain: Floats  # ln evidence that a smooth remainder adds, per noise factor


def quick(prepared: PreparedProblem) -> bool:
    return prepared.problem.budget.name == "quick"


def chosen_singles(prepared: PreparedProblem, found: Screen, seen: FamilywiseTest) -> list[str]:
    """Names of the candidates worth a refit, best first."""
    least, most = (LEAST_QUICK, MOST_QUICK) if quick(prepared) else (LEAST, MOST)
    order = [int(i) for i in np.argsort(-seen.observed) if found.signatures[int(i)].resolved]
    best = seen.observed[order[0]] if order else 0.0
    near = [i for i in order if seen.observed[i] > best - WITHIN]
    return [found.signatures[i].name for i in (near if len(near) >= least else order[:least])[:most]]


def likely_strength(signature: Signature, residual: Floats) -> float:
    """Strength on a signature's path that leaves least, its prior included."""
    free = signature.free
    fall = 2.0 * free @ residual - np.einsum("ij,ij->i", free, free)
    return float(signature.grid[int(np.argmax(0.5 * fall + signature.log_prior))])


def evaluated(prepared: PreparedProblem, best: Fit, family: list[Kernel]) -> FittedHypothesis:
    """Expansion and evidence of a refitted hypothesis."""
    expansion = expand(prepared, best)
    return FittedHypothesis(
        best.names, score(prepared, expansion), discrepancy_gain(prepared, expansion, family)
    )


def refit(prepared: PreparedProblem, names: tuple[str, ...], starts: list[Floats]) -> Fit:
    """Recalibration of one hypothesis in the model itself."""
    return fit(prepared, names, starts, STEPS_QUICK if quick(prepared) else STEPS)


def fit_singles(
    prepared: PreparedProblem, found: Screen, names: list[str], family: list[Kernel], progress: Progress
) -> list[FittedHypothesis]:
    """All shortlisted singles; every candidate from a second start too where none of them fits.

    The screen stands on the slopes at the bare model's best fit. A large missing effect drives that fit to
    where slopes mean little, and the screen may then dismiss the very effect that is missing.
    """
    judged: dict[str, FittedHypothesis] = {}
    for index, name in enumerate(names):
        progress(f"refitting with {name}", 0.2 + 0.4 * index / max(len(names), 1))
        start = np.append(found.base.fit.x, likely_strength(found.signature(name), found.residual))
        judged[name] = evaluated(
            prepared, nested(prepared, found.base.fit, refit(prepared, (name,), [start])), family
        )
    if quick(prepared) or explained_well(prepared, list(judged.values())):
        return list(judged.values())
    for signature in found.signatures:
        if signature.resolved:
            progress(f"refitting with {signature.name} from another start", 0.6)
            refit_from_other_starts(prepared, judged, found, signature, family)
    return list(judged.values())


def nested(prepared: PreparedProblem, base: Fit, best: Fit) -> Fit:
    """A fit that is no worse than the bare model, which it holds at strength 0: from there where it is."""
    if best.misfit <= base.misfit:
        return best
    return refit(prepared, best.names, [np.append(base.x, np.zeros(len(best.names)))])


def refit_from_other_starts(
    prepared: PreparedProblem,
    judged: dict[str, FittedHypothesis],
    found: Screen,
    signature: Signature,
    family: list[Kernel],
) -> None:
    """The prior's middle and the leader's calibration as further starts; the best fit stays."""
    name, unit = signature.name, expected_strength(prepared.candidate(signature.name))
    middle = np.append(np.clip(np.zeros(len(prepared.axes)), prepared.low, prepared.high), unit)
    leader = min(judged.values(), key=lambda item: item.scored.expansion.fit.misfit).scored.expansion.fit
    starts = [middle, np.append(leader.x, leader.psi[0] if leader.names == (name,) else 0.5 * unit)]
    if name not in judged:
        starts.append(np.append(found.base.fit.x, unit))
    best = refit(prepared, (name,), starts)
    if name not in judged or best.misfit < judged[name].scored.expansion.fit.misfit - GOOD_ENOUGH:
        judged[name] = evaluated(prepared, best, family)


def explained_well(prepared: PreparedProblem, judged: list[FittedHypothesis]) -> bool:
    """Whether some hypothesis leaves no more than noise."""
    return any(
        not fails(misfit_p(residuals_of(prepared, item.scored.expansion)))
        for item in judged
        if item.scored.likelihoods
    )


def hypotheses(
    prepared: PreparedProblem,
    base: FittedHypothesis,
    found: Screen,
    seen: FamilywiseTest,
    judged: list[FittedHypothesis],
) -> list[Hypothesis]:
    """Every explanation with its evidence; candidates that were not refitted keep their screened one.

    Probability goes to those that are likelier than others, even where the measurements reject them all. So
    what is rejected is not told: it stands for something outside the list that it resembles.
    """
    count, bare = len(prepared.problem.candidates), base.scored.log_evidence
    listed = [
        Hypothesis((), False, log_prior_of((), False, max(count, 1)), bare),
        Hypothesis((), True, log_prior_of((), True, max(count, 1)), bare + base.gain, told=False),
    ]
    done = {item.names for item in judged}
    for index, signature in enumerate(found.signatures):
        if (signature.name,) not in done:
            value = unrefitted(base, seen, judged, found, index)
            listed.append(Hypothesis((signature.name,), False, log_prior_of(("a",), False, count), value))
    for item in judged:
        evidence, told = item.scored.log_evidence, mean_misfit_p(prepared, item) > REJECTION_LEVEL
        listed.append(Hypothesis(item.names, False, log_prior_of(item.names, False, count), evidence, told))
        if len(item.names) == 1:
            told = told and explained_share(prepared, base, item) > EXPLAINED_SHARE
            prior = log_prior_of(item.names, True, count)
            listed.append(Hypothesis(item.names, True, prior, evidence + item.gain, told))
    return listed


def mean_misfit_p(prepared: PreparedProblem, item: FittedHypothesis) -> float:
    """Chance of the misfit that a hypothesis leaves, over the noise factors that it believes in."""
    if not item.scored.likelihoods:
        return 0.0
    weight = prepared.doubt.log_weight + item.scored.log_evidence
    chances = misfit_chances(residuals_of(prepared, item.scored.expansion), prepared.doubt.factor)
    return float(np.exp(weight - log_sum_exp(weight)) @ chances)


def unrefitted(
    base: FittedHypothesis, seen: FamilywiseTest, judged: list[FittedHypothesis], found: Screen, index: int
) -> Floats:
    """Evidence of a candidate that the screen dismissed: as far behind the best refitted one as it was there.

    A screen over a large misfit promises more than a refit can keep, to all candidates alike. None is worse
    than the base by more than the prior of its weakest strengths, where it is the base.
    """
    own, least = float(seen.observed[index]), float(found.signatures[index].log_prior[0])
    rank = {signature.name: k for k, signature in enumerate(found.signatures)}
    singles = [item for item in judged if len(item.names) == 1]
    if not singles or own <= 0.0:
        return base.scored.log_evidence + min(own, 0.0)
    best = max(singles, key=lambda item: float(seen.observed[rank[item.names[0]]]))
    behind = max(float(seen.observed[rank[best.names[0]]]) - own, 0.0)
    bare = base.scored.log_evidence
    return np.clip(best.scored.log_evidence - behind, bare + min(least, own), bare + own)


def explained_share(prepared: PreparedProblem, base: FittedHypothesis, item: FittedHypothesis) -> float:
    """Share of the base model's excess misfit that an effect removes: (S_0 - S_k) / (S_0 - n)."""
    before, after = chi_square(prepared, base.scored.expansion), chi_square(prepared, item.scored.expansion)
    return (before - after) / max(before - prepared.rows.size, 1.0)
