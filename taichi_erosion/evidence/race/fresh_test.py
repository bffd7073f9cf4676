"""Test of an answer by fresh runs: does it stand where simulations take the place of their emulator?

Three explanations are simulated at their settings: the likeliest of those of which the answer is true, of
those that contradict it, and the bare model. Each stands for all of its kind k,

    P'(k) ~ P(k) Z'_k / Z_k

Z_k its evidence by the emulator, Z'_k with the mean of fresh runs and their scatter in place of the mean of
the emulator and its errors; slopes stay. The answer is contradicted where P' is below SURE although as many
runs of a right emulator would have kept it, or where an emulator is off by more than its errors (Bonferroni).

References: Bastos & O'Hagan (2009), Technometrics 51, 425 (diagnostics of emulators); Jeffreys (1961), Theory
of Probability, 5.0 (Bayes factors).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.problem import Floats, Progress
from taichi_erosion.evidence.emulator.fresh_runs import FreshCampaign, FreshRuns, Request, Setting
from taichi_erosion.evidence.race.decision import Decision
from taichi_erosion.evidence.race.expansion import Acting
from taichi_erosion.evidence.race.fit import Fit, Hypothesis, Race
from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.race.priors import SURE
from taichi_erosion.evidence.race.record import Decided, FreshPart, GapPart, Outcome

Simulate = Callable[[Sequence[Setting], Sequence[Request], Floats, Progress], FreshCampaign]
OFF = 0.01  # chance of a gap below which an emulator is off: a right answer is lost one time in a hundred
MOST_FAILED = 0.5  # share of the runs, above which those with a value are no fair sample


@dataclass(frozen=True)
class Kind:
    """Explanations that say the same of an answer, and a set of effects that stands for them."""

    race: Race
    log_weight: float  # ln of prior times evidence of all
    fits: tuple[Fit, ...]  # of the set, alone and beside what no list holds; the first is simulated

    @property
    def names(self) -> Acting:
        """Effects that act."""
        return self.fits[0].hypothesis.names

    def log_evidence(self, mean: Floats, columns: Floats) -> float:
        """Ln of prior times evidence with a simulated mean and its errors; NaN: the emulator's."""
        at, known = self.fits[0], np.isfinite(mean)[:, np.newaxis]
        errors = self.race.model.errors(self.names, at.v)
        before = self.race.prepared.rows.shared.shape[1]
        own = slice(
            before, before + self.race.prepared.predictor.model_errors(*where(self.race, at)).shape[1]
        )
        errors[:, own] = np.where(known, 0.0, errors[:, own])
        about = replace(
            at,
            mean=np.where(known[:, 0], mean, at.mean),
            errors=np.hstack([errors, np.where(known, columns, 0.0)]),
        )
        found = []
        for each in self.fits:
            now = replace(about, hypothesis=each.hypothesis, blocks=each.blocks, log_prior=each.log_prior)
            found.append(score(self.race.solved(now, start=each.scales, fresh=True)))
        return float(log_sum_exp(np.array(found)))


def where(race: Race, fit: Fit) -> tuple[Floats, dict[str, float]]:
    """Calibrated numbers on their axes, and strengths."""
    model = race.model
    return model.numbers(fit.v[: model.count]), model.strengths(fit.hypothesis.names, fit.v)


def setting_of(race: Race, fit: Fit) -> Setting:
    """What a fit has the simulator do."""
    return Setting(*race.prepared.predictor.setting(*where(race, fit)))


def score(fit: Fit) -> float:
    """Ln of prior times evidence."""
    return fit.log_evidence + fit.log_prior


def is_true(decision: Decision, hypothesis: Hypothesis) -> bool:
    """Whether all that is named acts in an explanation, and one of the group."""
    acting, group = {*hypothesis.names, hypothesis.kind}, set(decision.group)
    return set(decision.named) <= acting and (not group or bool(group & acting))


def kinds_of(race: Race, decision: Decision) -> list[Kind]:
    """The answer, what contradicts it, and no effect at all: each with the likeliest of constant strength."""
    kinds: dict[str, list[Fit]] = {"answer": [], "rival": [], "bare": []}
    for hypothesis, fit in race.fits.items():
        bare = not hypothesis.names and fit.dose is None
        kinds["answer" if is_true(decision, hypothesis) else "bare" if bare else "rival"].append(fit)
    found = []
    for fits in kinds.values():
        able = sorted((each for each in fits if each.refined and each.dose is None), key=score, reverse=True)
        if able:
            own = tuple(each for each in able if each.hypothesis.names == able[0].hypothesis.names)
            found.append(Kind(race, float(log_sum_exp(np.array(list(map(score, fits))))), own))
    return found


def can_be_tested(decision: Decision) -> bool:
    """Whether an answer names effects."""
    return bool(decision.named or decision.group)


def fresh_test(
    posterior: Posterior, decision: Decision, simulate: Simulate, progress: Progress
) -> tuple[FreshPart, frozenset[str]]:
    """What fresh runs say of an answer that names effects, and the keys of these runs."""
    race = posterior.race
    kinds, asked = kinds_of(race, decision), race.prepared.predictor.requests
    made = simulate([setting_of(race, kind.fits[0]) for kind in kinds], asked, apart(race, kinds), progress)
    if not made.runs:
        return FreshPart("not_made", needed=len(made.keys)), frozenset()
    each = list(zip(kinds, made.runs, strict=True))
    as_emulated = [np.where(np.isfinite(run.mean), kind.fits[0].mean, np.nan) for kind, run in each]
    as_simulated = [run.mean for run in made.runs]

    def found(means: Sequence[Floats], factor: float = 1.0) -> Floats:
        rows = zip(each, means, strict=True)
        return np.array([kind.log_evidence(mean, factor * run.columns) for (kind, run), mean in rows])

    known, simulated = found([np.full_like(mean, np.nan) for mean in as_simulated]), found(as_simulated)
    expected, after = chance(kinds, found(as_emulated) - known), chance(kinds, simulated - known)
    alone = [found([run.values[k] for run in made.runs], sqrt(made.seeds)) for k in range(made.seeds)]
    gap, few = gap_of(race, kinds, made.runs), made.failed > MOST_FAILED * len(made.keys)
    part = FreshPart(
        "undecided" if few or not made.runs[0].tests else outcome_of(expected, after, gap),
        kinds[0].names,
        chance(kinds, 0.0 * known),
        expected,
        after,
        float(np.mean([chance(kinds, one - known) > 0.5 for one in alone])),
        {
            "+".join(kind.names) or "none": simulated[0] - own
            for kind, own in zip(kinds[1:], simulated[1:], strict=True)
        },
        gap,
        len(made.keys),
        made.seeds,
        made.failed,
    )
    return part, made.keys


def outcome_of(expected: float, simulated: float, gap: GapPart | None) -> Outcome:
    """The verdict on the answer."""
    if (gap is not None and gap.p < OFF) or expected >= SURE > simulated:
        return "contradicted"
    return "confirmed" if expected >= SURE else "undecided"


def chance(kinds: Sequence[Kind], change: Floats) -> float:
    """Probability of the answer, the first kind, after a change of the evidence of each."""
    total = np.array([kind.log_weight for kind in kinds]) + change
    return float(np.exp(total[0] - log_sum_exp(total)))


def apart(race: Race, kinds: Sequence[Kind]) -> Floats:
    """How far the explanations lie from the answer in every row, in sd of the measurement."""
    means = np.array([kind.fits[0].mean for kind in kinds])
    return np.sum(np.abs(means - means[0]), axis=0) / race.prepared.sd


def gap_of(race: Race, kinds: Sequence[Kind], runs: Sequence[FreshRuns]) -> GapPart | None:
    """The least likely gap of all observables under all explanations."""
    tests = [(t, name, k.names) for k, run in zip(kinds, runs, strict=True) for name, t in run.tests.items()]
    if not tests:
        return None
    worst, name, effects = min(tests, key=lambda each: each[0].p)
    at = {
        key: value for key, value in race.prepared.rows.conditions_at(worst.row).items() if np.isfinite(value)
    }
    told = (worst.emulated, worst.emulated_sd, worst.simulated, worst.simulated_sd)
    return GapPart(effects, name, at, *told, p=min(1.0, len(tests) * worst.p))


def after_test(decided: Decided, fresh: FreshPart) -> Decided:
    """What is said after the test: a name that is contradicted is not stable."""
    if fresh.outcome != "contradicted":
        return decided
    return replace(decided, verdict="unstable", named=(), group=(*decided.named, *decided.group))
