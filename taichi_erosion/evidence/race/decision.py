"""The decision, one rule: what has a probability of SURE is said.

An effect is named if the explanations that hold it have SURE together; effects that these measurements do not
tell apart are one group if one of them acts with SURE; a mechanism, or at most three, likewise; "not in the
list" is said if what no list holds has SURE. Else nothing is named, and the probabilities are told. A name
that the best of all candidates could have by chance by max-T is not given, nor one whose fit the rows refute,
nor one of which a condition that no effect reads imitates the change: either may act.

The check, max-T, of the changes g_k that candidates make alone, fitted, with P = V^-1 under nothing and
the errors that the best explanation leaves; candidates that imitate each other count once:

    z_k = g_k^T P y / (g_k^T P g_k)^1/2,   z ~ N(0, R),   R = corr of g under P,   p = P(max z >= observed)

Other priors of hypotheses reweight the evidence (`sensitivity`); under other ones of strengths, doses and
errors likely explanations are solved anew, with y' = y - X ln r / s for strengths expected r times as large.

Reference: Westfall & Young (1993), Resampling-Based Multiple Testing, 2.3 (max-T).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from math import log

import numpy as np

from taichi_erosion.evidence.race.adequacy import is_adequate
from taichi_erosion.evidence.race.expansion import Acting
from taichi_erosion.evidence.race.fit import OUTSIDE, Fit, Hypothesis, Race, log_joint, row_scatter
from taichi_erosion.evidence.race.linear_evidence import optimise_scales
from taichi_erosion.evidence.race.posterior import Posterior, quantiles
from taichi_erosion.evidence.race.priors import DRAWS, FAMILYWISE, KEEP, SEED, SURE, Priors
from taichi_erosion.evidence.race.search import can_tell_apart, imitates, prior
from taichi_erosion.evidence.record import DecisionPart, Verdict

MOST_TOLD = 3  # of a group: more is no answer
VARIED = ("nothing", "unlisted", "step", "typical", "dose", "errors")  # priors, of the first three their odds
ERRORS = ("near", "small", "large", "doubt")
TOLD = ("verdict", "named", "group", "acting_mechanisms", "together")
SCALES = {"discrepancy": "small", "unlisted": "large", "dose": "dose"}  # others: near
STEPS = 4  # of the scales of an explanation that is solved anew


@dataclass(frozen=True, kw_only=True)
class Decision(DecisionPart):
    """What is said, and the probabilities behind it."""

    inclusion: dict[str, float]  # of every effect, that it acts
    beyond: dict[str, float]  # of every mechanism

    @property
    def decision_record(self) -> DecisionPart:
        return DecisionPart(**{entry.name: getattr(self, entry.name) for entry in fields(DecisionPart)})

    @property
    def core(self) -> frozenset[str]:
        """What acts where the answer is true; of mechanisms that are not told apart the first."""
        return frozenset((*self.named, *self.acting_mechanisms[: None if self.together else 1]))


def decide_cause(posterior: Posterior) -> Decision:
    race = posterior.race
    effects, mechanisms = list(race.model.candidates), [m.name for m in race.prepared.problem.mechanisms]
    inclusion = {name: any_acts(posterior, [name]) for name in effects}
    beyond = {name: any_acts(posterior, [name]) for name in mechanisms}
    outside = any_acts(posterior, [OUTSIDE, *mechanisms])
    named = tuple(name for name in effects if inclusion[name] >= SURE)
    group = smallest_group(posterior, [n for n in effects if n not in named], inclusion, len(effects) // 2)
    chance = familywise_p(race, posterior.best_fit) if named or group else 1.0
    refuted: tuple[str, ...] = ()
    if by_chance := bool(named or group) and chance > FAMILYWISE:
        named, group = (), ()
    fits = {name: [f for f in race.fits.values() if name in f.hypothesis.acting] for name in mechanisms}
    likeliest = {name: max(some, key=log_joint) for name, some in fits.items() if some}
    sound = {name: beyond[name] for name, fit in likeliest.items() if is_adequate(fit, FAMILYWISE)}
    both = tuple(name for name, p in sound.items() if p >= SURE)
    second_causes = both or (OUTSIDE,) * (any_acts(posterior, [OUTSIDE]) >= SURE)
    if (named or group) and not rows_do_not_refute(posterior, named, group, second_causes):
        named, group, refuted = (), (), (*named, *group)
    imitators = imitating_conditions(race, named, group)
    left = tuple(name for name in named if name not in imitators)
    named, group = ((), ()) if {*group} & {*imitators} else (left, group)
    single = sound if refuted or imitators or named or by_chance else inclusion | sound
    leading = both if both or group else smallest_group(posterior, list(single), single, MOST_TOLD)
    verdict: Verdict = "group" if group else "present" if named else "none_detected"
    if both or (verdict == "none_detected" and (outside >= SURE or set(leading) & set(mechanisms))):
        verdict = "outside_library"
    leading = leading if verdict == "outside_library" else ()
    return Decision(
        verdict=verdict,
        named=named,
        group=group,
        acting_mechanisms=leading,
        together=len(both) > 1,
        refuted=refuted,
        imitators=imitators,
        probabilities=probabilities_of_explanations(posterior, {*effects, *mechanisms}),
        p=chance,
        unlisted=outside,
        inclusion=inclusion,
        beyond=beyond,
    )


def probabilities_of_explanations(posterior: Posterior, names: set[str]) -> dict[str, float]:
    """Probabilities by explanation; a set beside something unlisted counts as the set."""
    table = {"none": 0.0, "each_set_up": 0.0, "outside_library": 0.0}
    for hypothesis, p in posterior.probability.items():
        acting = (*hypothesis.names, *(each for each in hypothesis.extra if each in names))
        key = "+".join(acting or hypothesis.extra or ("none",))
        table[key] = table.get(key, 0.0) + p
    return table


def rows_do_not_refute(posterior: Posterior, named: Acting, group: Acting, beside: Acting) -> bool:
    """Whether the rows do not refute what is named, with one of the group, at strengths of the list.

    Alone, or `beside` what acts for sure and is not in the list; the rows agree with a name as with a model.
    """
    sets = [{*named, name} for name in group] or [{*named}]
    race, sets_of = posterior.race, [names | more for names in sets for more in (set[str](), {*beside})]
    fits = [fit for h, fit in race.fits.items() if h.acting in sets_of and can_tell_apart(race, fit)]
    if not fits:
        return False
    best = max(fits, key=lambda fit: fit.log_evidence)
    medians = {name: quantiles(*posterior.strength_draws(name))[1] for name in best.hypothesis.names}
    listed = all(medians[name] <= race.model.candidates[name].maximum for name in medians)
    return listed and is_adequate(best, 1.0 - SURE)


def imitating_conditions(race: Race, named: Acting, group: Acting) -> dict[str, Acting]:
    """Conditions that no effect reads of which a parabola makes what an effect does in these rows."""
    imitators = {}
    for name in (*named, *group):
        whole = Hypothesis(tuple(sorted({*named, name})))
        change = np.subtract(*(race.fits.get(h, race.bare).mean for h in (whole, whole.without(name))))
        alike = tuple(c for c in race.prepared.problem.unread if imitates(race, c, change))
        imitators |= {name: alike} if alike else {}
    return imitators


def fit_of_decision(posterior: Posterior, decision: Decision) -> Fit:
    """The likeliest explanation of what is told, of mechanisms of the first; of all where a group is told."""
    race = posterior.race
    if decision.verdict == "none_detected":
        return race.bare
    alone = race.fits.get(Hypothesis(tuple(sorted((*decision.named, *decision.imitators)))))
    if decision.verdict == "present" and alone is not None:
        return alone
    share = posterior.probability
    return race.fits[max([h for h in share if h.acting >= decision.core] or share, key=lambda h: share[h])]


def any_acts(posterior: Posterior, names: Sequence[str]) -> float:
    """Probability that one of some effects or mechanisms acts."""
    return sum(p for h, p in posterior.probability.items() if not h.acting.isdisjoint(names))


def smallest_group(posterior: Posterior, names: Sequence[str], p: dict[str, float], most: int) -> Acting:
    """The fewest of some effects, likeliest first, of which one acts with SURE; none if more are needed."""
    ranked = sorted(names, key=lambda name: -p[name])
    for count in range(1, most + 1):
        if any_acts(posterior, ranked[:count]) >= SURE:
            return tuple(name for name in ranked[:count] if p[name] > KEEP)
    return ()


def familywise_p(race: Race, best: Fit) -> float:
    """Chance of a candidate as good as the best one if nothing acts and errors are those of `best`."""
    bare, singles = race.bare, race.effect_sets(1)
    rows, _ = race.linear(bare)
    u = best.evidence.solution.scales_for(rows.scales)
    signatures = np.column_stack([race.prepared.whiten(fit.mean - bare.mean) for fit in singles])
    along, gram = rows.correct_bad_rows(best.evidence.bad).at_scales(u).project(signatures)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-12))
    observed = float(np.max(along / size))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    draws = np.random.default_rng(SEED).standard_normal((DRAWS, values.size))
    largest = np.max(draws * np.sqrt(np.maximum(values, 0.0)) @ vectors.T, axis=1)
    return float((1 + np.sum(largest >= observed)) / (1 + DRAWS))


def sensitivity(posterior: Posterior, decision: Decision) -> Iterator[tuple[str, Posterior, Decision]]:
    """Posterior and decision where one prior is halved, and doubled.

    `decision` may have changed by fresh runs: it stands wherever the race decides as under its own priors.
    """
    priors, usual = posterior.race.priors, decide_cause(posterior)
    for key in VARIED if usual.beyond else [key for key in VARIED if key != "dose"]:
        for factor in (0.5, 2.0):
            names = ERRORS if key == "errors" else (key,)
            sizes = {name: factor * getattr(priors, name) for name in names}
            odds = {name: p / (1.0 - p / factor + p) for name, p in sizes.items() if name in VARIED[:3]}
            there = reweight_priors(posterior, replace(priors, **sizes | odds))
            varied = decide_cause(there)
            if all(getattr(varied, part) == getattr(usual, part) for part in TOLD):
                varied = replace(varied, **{part: getattr(decision, part) for part in TOLD})
            yield key, there, varied


def reweight_priors(posterior: Posterior, priors: Priors) -> Posterior:
    """The posterior under other priors; likely explanations are solved anew, about the same settings."""
    race, usual, scores = posterior.race, posterior.race.priors, []
    for hypothesis, fit in race.fits.items():
        now, change = fit.evidence.solution, prior(race, hypothesis, priors) / prior(race, hypothesis, usual)
        scores.append(log_joint(fit) + log(change))
        names = (SCALES.get(name.partition(" ")[0], "near") for name in now.rows.scales.names)
        wider = np.array([getattr(priors, name) / getattr(usual, name) for name in names])
        shift = np.zeros(fit.v.size)
        shift[race.model.count :] = log(priors.typical / usual.typical) / usual.spread
        if posterior.probability[hypothesis] > 0.1 * KEEP and (np.any(shift) or np.any(wider != 1.0)):
            sizes = {name: wider * getattr(now.rows.scales, name) for name in ("cauchy", "normal")}
            sizes["doubt"] = now.rows.scales.doubt.copy()
            sizes["doubt"][now.rows.block_count :] = row_scatter(race.prepared, priors.doubt)[1].doubt
            y = now.rows.y - now.rows.columns[:, : fit.v.size] @ shift
            rows = replace(now.rows, y=y, scales=replace(now.rows.scales, **sizes))
            then, before = (optimise_scales(each, now.u, STEPS) for each in (rows, now.rows))
            scores[-1] += then.log_evidence - before.log_evidence
    share = np.exp(np.array(scores) - np.logaddexp.reduce(scores))
    return Posterior(race, dict(zip(race.fits, map(float, share), strict=True)))
