"""A question put to a study: at once where a function answers, in rounds of simulations where scenes do.

What a round was about is kept beside the results: a command that is given again, or was stopped, makes the
same rounds without asking, and later questions use the runs of earlier ones.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256
from typing import Generic, Literal, TypeVar

from taichi_erosion.evidence.answers import documents
from taichi_erosion.evidence.data.findings import Adoption, Comparison, Discovery, HypothesisFit
from taichi_erosion.evidence.data.problem import Progress
from taichi_erosion.evidence.data.transforms import EFFECTS, STRENGTH
from taichi_erosion.evidence.emulator.design import RefinementPoint
from taichi_erosion.evidence.emulator.training_runs import (
    emulated_study,
    initial_training_runs,
    refined_training_runs,
    within_budget,
)
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.scene.load import file_text

MOST_EXPLANATIONS = 3  # about which a round simulates
MOST_CLOSER = 2  # rounds beyond the planned ones, about what an answer must not pass over
BudgetName = Literal["quick", "full"]
Found = TypeVar("Found")
Rounds = dict[str, list[list[RefinementPoint]]]  # question -> its rounds


def nothing_due(_: object) -> list[RefinementPoint]:
    """Of an answer that counts as it is."""
    return []


@dataclass(frozen=True)
class Asked(Generic[Found]):
    """A question, and what it makes worth a closer look."""

    name: str
    question: Callable[[Study], Found]
    about: Callable[[Found], list[RefinementPoint]]
    effects: Sequence[str] = ()  # that it needs to know
    ahead: bool = False  # whether it looks at conditions that were not measured but could be
    # to be simulated about before the answer counts
    due: Callable[[Found], list[RefinementPoint]] = nothing_due


def answered(
    study: Study, budget: BudgetName, asked: Asked[Found], progress: Progress
) -> tuple[Found, Study]:
    """The answer, and the study as it was when it was given.

    Scenes are simulated about what each answer leaves standing and must not pass over, and then the
    question is put again.
    """
    rehearsal = initial_training_runs(study, asked.effects, budget, asked.ahead)
    if rehearsal is None:
        return asked.question(study), study
    past, key = read_rounds(study), f"{asked.name} {budget}"
    own = past.pop(key, [])
    for name, rounds in past.items():
        for number, about in enumerate(rounds):
            rehearsal = refined_training_runs(rehearsal, about, f"{name}|{number}")
    alike = [rounds for name, rounds in past.items() if name.endswith(budget)]
    seen = {set_of(explanation) for rounds in alike for about in rounds for explanation in about}
    for number, about in enumerate(own):
        rehearsal = refined_training_runs(rehearsal, about, f"{key}|{number}")
    while True:
        ready = emulated_study(rehearsal, progress)
        found = asked.question(ready)
        if len(own) < rehearsal.amount.rounds:
            about = [e for e in asked.about(found) if set_of(e) not in seen]
        else:
            known = seen | {set_of(e) for about in own for e in about}
            about = [e for e in asked.due(found) if set_of(e) not in known]
            done = len(own) >= rehearsal.amount.rounds + MOST_CLOSER
            if done or not about or not within_budget(rehearsal, about):
                return found, ready
        rehearsal = refined_training_runs(rehearsal, about, f"{key}|{len(own)}")
        own.append(about)
        keep_rounds(study, {**past, key: own})


def set_of(explanation: RefinementPoint) -> frozenset[str]:
    """Effects that act in an explanation."""
    return frozenset(name for name, strength in explanation.effects.items() if strength > 0.0)


def read_rounds(study: Study) -> Rounds:
    """What earlier rounds were about; none where the study or its table has changed since."""
    document = documents.recall(study.results, study.path.stem, documents.ROUNDS)
    if document is None or document.get("of") != state_of(study):
        return {}
    return {
        name: [[RefinementPoint(**entry) for entry in about] for about in rounds]
        for name, rounds in document["rounds"].items()
    }


def keep_rounds(study: Study, rounds: Rounds) -> None:
    """Keep what the rounds were about."""
    plain = {
        name: [[asdict(explanation) for explanation in about] for about in parts]
        for name, parts in rounds.items()
    }
    documents.keep(study.results, study.path.stem, documents.ROUNDS, {"of": state_of(study), "rounds": plain})


def state_of(study: Study) -> str:
    """Digest of a study file and its measurements."""
    return sha256(f"{study.digest}|{file_text(study.path, str(study.path))}".encode()).hexdigest()[:16]


def last_budget(study: Study) -> BudgetName:
    """How much the last discovery of a study of scenes spent; its runs are there already."""
    if study.file.study.model is not None:
        return study.problem.budget.name
    last = documents.recall(study.results, study.path.stem, "discover")
    return "full" if last is not None and last.get("budget") == "full" else "quick"


def about_comparison(found: Comparison) -> list[RefinementPoint]:
    """The calibrated bare model."""
    return [explanation({name: fitted.value for name, fitted in found.parameters.items()}, {})]


def about_discovery(found: Discovery) -> list[RefinementPoint]:
    """The likeliest explanations, the bare model among them."""
    bare = [survivor for survivor in found.survivors if not survivor.names]
    others = [survivor for survivor in found.survivors if survivor.names]
    return [
        explanation(survivor.parameters, survivor.strengths)
        for survivor in [*bare, *others][:MOST_EXPLANATIONS]
    ]


def due_before_outside(found: Discovery) -> list[RefinementPoint]:
    """The closest single effect and pair, before something that no candidate describes is blamed."""
    if found.verdict != "outside_library":
        return []
    return [explanation(survivor.parameters, survivor.strengths) for survivor in found.closest]


def about_adoption(found: Adoption) -> list[RefinementPoint]:
    """The model before and after, and with the controls."""
    fits: list[HypothesisFit | None] = [found.base, found.added, found.best_wrong, found.random_wrong]
    return [
        explanation(
            {name: fitted.value for name, fitted in fit.parameters.items()},
            {name: fitted.value for name, fitted in fit.strengths.items()},
        )
        for fit in fits
        if fit is not None
    ]


def explanation(parameters: Mapping[str, float], strengths: Mapping[str, float]) -> RefinementPoint:
    """Calibrated numbers and strengths; the strength of an adopted effect may stand among the numbers."""
    numbers, effects = {}, dict(strengths)
    for name, value in parameters.items():
        if name.startswith(EFFECTS) and name.endswith(STRENGTH):
            effects[name[len(EFFECTS) : -len(STRENGTH)]] = value
        else:
            numbers[name] = value
    return RefinementPoint(numbers, effects)
