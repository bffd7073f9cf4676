"""A race on scenes: rounds of simulations where its posterior is undecided, and the test of its answer.

A round simulates about the sets of effects that have KEEP of the probability, and only while a probability
that the decision rests on lies between 1 - SURE and SURE. Mechanisms are simulated where no set of listed
effects explains the rows.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from taichi_erosion.evidence.answers.fresh_test import fresh_test, kinds_of, setting_of
from taichi_erosion.evidence.answers.rounds import MOST_POINTS, FreshTest, Points, Question, refinement_point
from taichi_erosion.evidence.data.problem import Progress
from taichi_erosion.evidence.emulator.design import Setting
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.race.decision import Decision
from taichi_erosion.evidence.race.doses import from_axis
from taichi_erosion.evidence.race.expansion import Acting
from taichi_erosion.evidence.race.fit import Fit, Hypothesis
from taichi_erosion.evidence.race.posterior import Posterior, strained
from taichi_erosion.evidence.race.priors import KEEP, SURE
from taichi_erosion.evidence.race.record import Decided, FreshPart


@dataclass(frozen=True)
class RacedStudy:
    """The race of a study, with what fresh runs of its scenes say of it."""

    posterior: Posterior
    decision: Decision
    fresh: FreshPart | None = None  # None: nothing that fresh runs can test

    def about(self, fit: Fit) -> Setting:
        """The setting of a fit as the centre of a round."""
        setting = setting_of(self.posterior.race, fit)
        acting = {name: strength for name, strength in setting.effects.items() if strength > 0.0}
        return refinement_point(setting.parameters, acting)

    def about_doses(self, fit: Fit) -> Points:
        """Two settings of the mechanism of a fit: with its largest dose, and with half of it."""
        assert fit.dose is not None
        point, dose = self.about(fit), from_axis(fit.dose.w)
        top = float(dose[np.argmax(np.abs(dose))])
        return [
            replace(point, effects={**point.effects, fit.hypothesis.kind: share * top})
            for share in (1.0, 0.5)
        ]

    @property
    def about_bare(self) -> Setting:
        """The calibrated model as the centre of a round."""
        return self.about(self.posterior.race.bare)


def sets(posterior: Posterior) -> Mapping[Acting, float]:
    """Probability of every set of listed effects, whatever their strength does and what is beside them."""
    found: dict[Acting, float] = {}
    for hypothesis, p in posterior.probability.items():
        varying = (hypothesis.kind,) if hypothesis.kind in posterior.race.model.candidates else ()
        names = (*hypothesis.names, *varying)
        if names or hypothesis.kind in ("", "?"):
            found[names] = found.get(names, 0.0) + p
    return found


def undecided(found: Decision) -> bool:
    """Whether anything that could be said is neither sure nor as good as excluded."""
    stated = (found.none, found.outside, *found.inclusion.values(), *found.beyond.values())
    return any(1.0 - SURE < p < SURE for p in stated)


def settled(found: RacedStudy) -> bool:
    """Whether everything that could be said is, and new runs of the scene confirm it."""
    doubted = found.fresh is not None and found.fresh.outcome in ("contradicted", "undecided")
    return not undecided(found.decision) and not doubted


def points(found: RacedStudy) -> Points:
    """The likeliest sets of effects, the bare model first; none where more runs decide nothing."""
    share = sets(found.posterior)
    likely = [names for names in sorted(share, key=lambda names: -share[names]) if share[names] >= KEEP]
    if not undecided(found.decision) or len(likely) < 2:
        return []
    fits = found.posterior.race.fits
    return [found.about(fits[Hypothesis(names)]) for names in sorted(likely[:MOST_POINTS], key=bool)]


def required(found: RacedStudy) -> Points:
    """Before it is said that no list holds what acts: the closest effect and set, or likely mechanisms."""
    if found.decision.verdict != "outside_library":
        return []
    race = found.posterior.race
    doses: dict[str, Fit] = {}
    for fit in race.likely(KEEP, lambda fit: fit.hypothesis.kind in found.decision.beyond):
        doses.setdefault(fit.hypothesis.kind, fit)
    if doses:
        return [point for fit in [*doses.values()][:MOST_POINTS] for point in found.about_doses(fit)]
    fits = [fit for fit in race.fits.values() if fit.refined and not fit.hypothesis.beyond]
    single = [fit for fit in fits if len(fit.hypothesis.names) == 1]
    several = [fit for fit in fits if len(fit.hypothesis.names) > 1]
    best = [max(kind, key=lambda fit: fit.log_evidence) for kind in (single, several) if kind]
    return [found.about(fit) for fit in best]


def beyond(found: RacedStudy) -> bool:
    """Whether mechanisms are to be tried: the listed effects leave something open."""
    return strained(found.posterior.race)


def tested(found: RacedStudy, fresh: FreshTest, progress: Progress) -> tuple[RacedStudy, frozenset[str]]:
    """The answer with its test by fresh runs, and the keys of these.

    Where they contradict it, the next answer starts with a round about what was tested.
    """
    if not (found.decision.named or found.decision.group):
        return found, frozenset()
    part, keys = fresh_test(found.posterior, found.decision, fresh.simulator.simulate, progress)
    if part.outcome == "contradicted":
        about = [found.about(kind.fits[0]) for kind in kinds_of(found.posterior.race, found.decision)]
        part = replace(part, more_runs=fresh.schedule(about))
    return replace(found, fresh=part), keys


def after_test(decided: Decided, fresh: FreshPart) -> Decided:
    """What is said after the test: a name that is contradicted is not stable."""
    if fresh.outcome != "contradicted":
        return decided
    return replace(decided, verdict="unstable", named=(), group=(*decided.named, *decided.group))


def discovery_question(study: Study, answer: Callable[[Study, Progress], RacedStudy]) -> Question[RacedStudy]:
    """Which effect is missing, as a question that scenes answer in rounds."""
    ahead = bool(study.file.laboratory.ranges)
    names = study.problem.candidate_names
    return Question(
        "discover",
        answer,
        points,
        names,
        ahead=ahead,
        required=required,
        beyond=beyond,
        decided=settled,
        tested=tested,
    )
