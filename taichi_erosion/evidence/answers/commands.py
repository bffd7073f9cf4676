"""Commands of the evidence loop: a study file in, a document out, which is stored in the results folder.

A function answers at once; scenes answer in rounds of simulations. The points of each round are stored beside
the results: a command that is given again, or was stopped, makes the same rounds without new answers, and
later commands use the runs of earlier ones.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from time import perf_counter
from typing import Generic, Literal, TypeVar

from threadpoolctl import threadpool_limits

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers import documents
from taichi_erosion.evidence.answers.adopt import adopt, write_adopted_study
from taichi_erosion.evidence.answers.compare import compare
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.answers.documents import Command, Document
from taichi_erosion.evidence.answers.next_experiments import next_experiments
from taichi_erosion.evidence.data.findings import Adoption, Comparison, Discovery, Estimate, HypothesisFit
from taichi_erosion.evidence.data.held_out_rows import openings, record_opening
from taichi_erosion.evidence.data.problem import Laboratory, Progress
from taichi_erosion.evidence.data.transforms import EFFECTS, STRENGTH
from taichi_erosion.evidence.emulator import training_runs
from taichi_erosion.evidence.emulator.design import RefinementPoint
from taichi_erosion.evidence.models.load_study import Study, load_study
from taichi_erosion.scene.load import file_text

MOST_POINTS = 3  # explanations about which a round simulates
MOST_REQUIRED = 2  # rounds beyond the planned ones, about points that an answer requires
BudgetName = Literal["quick", "full"]
Found = TypeVar("Found")
Points = list[RefinementPoint]
Rounds = dict[str, list[Points]]  # command and budget -> its rounds


@contextmanager
def open_study(path: Path, budget: BudgetName | None = None) -> Iterator[Study]:
    """A study whose runs are safe in its store when the block is left, however it is left.

    Matrices are multiplied on one thread: on several their last bits would depend on how many there are, and
    with them the choice of the next runs.
    """
    with threadpool_limits(1, user_api="blas"):
        study = load_study(path, budget)
        try:
            yield study
        finally:
            study.store.commit()


def compare_study(path: Path, progress: Progress) -> Document:
    """Where the model fails."""
    start = perf_counter()
    with open_study(path) as study:
        seed = study.file.study.seed
        question = Question(
            "compare", lambda ready: compare(ready.problem, progress, seed), comparison_points
        )
        found, ready = answered(study, last_budget(study), question, progress)
        return stored(ready, "compare", documents.record(found), start)


def discover_study(path: Path, budget: BudgetName | None, progress: Progress) -> Document:
    """Which effect is missing."""
    start = perf_counter()
    with open_study(path, budget) as study:
        seed, spent = study.file.study.seed, study.problem.budget.name

        def answer(ready: Study) -> Discovery:
            return discover(ready.problem, seed, ready.problem.budget, progress)

        question = Question("discover", answer, discovery_points, names_of(study), required=required_points)
        found, ready = answered(study, spent, question, progress)
        if study.file.study.model is not None or not study.file.laboratory.ranges:
            found = with_experiments(ready, found)
        adopted = documents.read_answer(study.results, path.stem, "adopt")
        vault = adopted["vault"] if adopted and adopted.get("digest") == study.digest[:12] else None
        document = documents.record(found) | ({"vault": vault} if vault else {}) | {"budget": spent}
        return stored(ready, "discover", document, start)


def adopt_study(path: Path, effect: str, progress: Progress) -> Document:
    """The error before and after an effect is added, on data that no fit has seen; writes the new study."""
    start = perf_counter()
    with open_study(path) as study:
        names, seed = names_of(study), study.file.study.seed
        if effect not in names:
            raise BadInput(f"{path}: {effect} is no candidate; there are: {', '.join(names) or 'none'}")

        def answer(ready: Study) -> Adoption:
            return adopt(ready.problem, effect, seed, progress)

        question = Question(f"adopt {effect}", answer, adoption_points, names)
        found, ready = answered(study, last_budget(study), question, progress)
        count = openings(study.results, study.digest)
        if len(study.problem.vault.rows):
            count = record_opening(study.results, study.digest, effect)
        written = write_adopted_study(study, found)
        document = documents.adopt_document(found, count, str(written))
        before = list(study.file.adopted)
        if not documents.ladder(study.results):
            documents.extend_ladder(study.results, rung(before, found.base))
        documents.extend_ladder(study.results, rung([*before, effect], found.added))
        return stored(ready, "adopt", document, start)


def next_study(path: Path, progress: Progress) -> Document:
    """The experiments that would decide."""
    start = perf_counter()
    with open_study(path) as study:
        seed, budget = study.file.study.seed, last_budget(study)

        def answer(ready: Study) -> Discovery:
            found = discover(ready.problem, seed, ready.problem.budget, progress)
            return with_experiments(ready, found)

        question = Question("next", answer, discovery_points, names_of(study), ahead=True)
        found, ready = answered(study, budget, question, progress)
        document = {"next_experiments": documents.plain([asdict(each) for each in found.next_experiments])}
        return stored(ready, "next", document, start)


def stored(study: Study, command: Command, document: Document, start: float) -> Document:
    """A document in the results folder, with its study and what all of it has cost."""
    document = documents.study_document(study) | document
    if study.simulations is not None:
        document |= {"runs": study.simulations, "wall_s": perf_counter() - start}
    documents.write_document(documents.document_file(study.results, study.path.stem, command), document)
    return document


def names_of(study: Study) -> list[str]:
    """Candidates of a study."""
    return [candidate.name for candidate in study.problem.candidates]


def with_experiments(study: Study, found: Discovery) -> Discovery:
    """A discovery with the experiments that the study's laboratory could make next."""
    stated = study.file.laboratory
    laboratory = Laboratory(ranges=dict(stated.ranges), costs=dict(stated.costs), repeats=stated.repeats)
    return replace(found, next_experiments=tuple(next_experiments(study.problem, found, laboratory)))


def rung(effects: list[str], fit: HypothesisFit) -> Document:
    """One rung of the error ladder: the errors per row with some effects in the model."""
    errors = {"chi2_fitted": fit.chi2, "chi2_held_out": fit.vault_chi2, "rmse_held_out": fit.vault_rmse}
    return documents.plain({"effects": effects} | errors)


@dataclass(frozen=True)
class Question(Generic[Found]):
    """A function of the study, and the points about which its answer needs simulations."""

    name: str
    answer: Callable[[Study], Found]
    points: Callable[[Found], Points]
    effects: Sequence[str] = ()  # that it needs
    ahead: bool = False  # whether it needs conditions that were not measured but could be
    required: Callable[[Found], Points] = lambda _: []  # to be simulated about before the answer counts


def answered(
    study: Study, budget: BudgetName, question: Question[Found], progress: Progress
) -> tuple[Found, Study]:
    """The answer, and the study as it was when it was given.

    Scenes are simulated about the plausible and the required points of each answer, and then the question is
    answered again.
    """
    runs = training_runs.initial_training_runs(study, question.effects, budget, question.ahead)
    if runs is None:
        return question.answer(study), study
    past, key = read_rounds(study), f"{question.name} {budget}"
    own = past.pop(key, [])
    for name, rounds in [*past.items(), (key, own)]:
        for number, points in enumerate(rounds):
            runs = training_runs.refined_training_runs(runs, points, f"{name}|{number}")
    alike = [rounds for name, rounds in past.items() if name.endswith(budget)]
    earlier = {acting(point) for rounds in alike for points in rounds for point in points}
    while True:
        ready = training_runs.emulated_study(runs, progress)
        found = question.answer(ready)
        if len(own) < runs.plan_size.rounds:
            points = [point for point in question.points(found) if acting(point) not in earlier]
        else:
            known = earlier | {acting(point) for points in own for point in points}
            points = [point for point in question.required(found) if acting(point) not in known]
            done = len(own) >= runs.plan_size.rounds + MOST_REQUIRED
            if done or not points or not training_runs.within_budget(runs, points):
                return found, ready
        runs = training_runs.refined_training_runs(runs, points, f"{key}|{len(own)}")
        own.append(points)
        write_rounds(study, {**past, key: own})


def acting(point: RefinementPoint) -> frozenset[str]:
    """Effects that act at a point."""
    return frozenset(name for name, strength in point.effects.items() if strength > 0.0)


def read_rounds(study: Study) -> Rounds:
    """Points of earlier rounds; none where the study or its table has changed since."""
    document = documents.read_answer(study.results, study.path.stem, documents.ROUNDS)
    if document is None or document.get("of") != state_of(study):
        return {}
    return {
        name: [[RefinementPoint(**entry) for entry in points] for points in rounds]
        for name, rounds in document["rounds"].items()
    }


def write_rounds(study: Study, rounds: Rounds) -> None:
    """Store the points of all rounds."""
    plain = {name: [[asdict(point) for point in points] for points in each] for name, each in rounds.items()}
    file = documents.document_file(study.results, study.path.stem, documents.ROUNDS)
    documents.write_document(file, {"of": state_of(study), "rounds": plain})


def state_of(study: Study) -> str:
    """Digest of a study file and its measurements."""
    return sha256(f"{study.digest}|{file_text(study.path, str(study.path))}".encode()).hexdigest()[:16]


def last_budget(study: Study) -> BudgetName:
    """How much the last discovery of a study of scenes spent; its runs are there already."""
    if study.file.study.model is not None:
        return study.problem.budget.name
    last = documents.read_answer(study.results, study.path.stem, "discover")
    return "full" if last is not None and last.get("budget") == "full" else "quick"


def comparison_points(found: Comparison) -> Points:
    """The calibrated bare model."""
    return [refinement_point(values(found.parameters), {})]


def discovery_points(found: Discovery) -> Points:
    """The likeliest explanations, the bare model first."""
    likely = sorted(found.survivors, key=lambda each: bool(each.names))
    return [refinement_point(each.parameters, each.strengths) for each in likely[:MOST_POINTS]]


def required_points(found: Discovery) -> Points:
    """The closest single effect and pair, before the verdict is something that no candidate describes."""
    closest = found.closest if found.verdict == "outside_library" else ()
    return [refinement_point(each.parameters, each.strengths) for each in closest]


def adoption_points(found: Adoption) -> Points:
    """The model before and after, and with the controls."""
    return [refinement_point(values(fit.parameters), values(fit.strengths)) for fit in found.fits]


def values(estimates: Mapping[str, Estimate]) -> dict[str, float]:
    """Estimates without their intervals."""
    return {name: estimate.value for name, estimate in estimates.items()}


def refinement_point(parameters: Mapping[str, float], strengths: Mapping[str, float]) -> RefinementPoint:
    """Calibrated numbers and strengths; the strength of an adopted effect may stand among the numbers."""
    numbers, effects = {}, dict(strengths)
    for name, value in parameters.items():
        if name.startswith(EFFECTS) and name.endswith(STRENGTH):
            effects[name[len(EFFECTS) : -len(STRENGTH)]] = value
        else:
            numbers[name] = value
    return RefinementPoint(numbers, effects)
