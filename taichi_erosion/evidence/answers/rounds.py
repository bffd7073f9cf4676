"""Rounds of simulations until an answer rests on runs about its own explanations.

A function answers at once; scenes answer in rounds. The points of each round are stored beside the results: a
command that is given again, or was stopped, makes the same rounds without new answers, and later commands use
the runs of earlier ones.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Generic, TypeVar

from taichi_erosion.evidence.answers import files
from taichi_erosion.evidence.answers.set_up import blocked
from taichi_erosion.evidence.data.problem import Progress
from taichi_erosion.evidence.data.transforms import EFFECTS, STRENGTH
from taichi_erosion.evidence.emulator import training_runs
from taichi_erosion.evidence.emulator.design import Setting
from taichi_erosion.evidence.emulator.fresh_runs import FreshSimulator, fresh_count
from taichi_erosion.evidence.emulator.plan_cost import WORTH_TELLING, function_cost, plan_cost, shares
from taichi_erosion.evidence.emulator.training_runs import TrainingRuns
from taichi_erosion.evidence.models.load_study import BudgetName, Study
from taichi_erosion.evidence.models.plugin import NameMapping
from taichi_erosion.scene.load import file_text

MOST_POINTS = 3  # explanations about which a round simulates
MOST_REQUIRED = 4  # rounds beyond the planned ones, about points that an answer requires
Found = TypeVar("Found")
Points = list[Setting]
Rounds = dict[str, list[Points]]  # command and budget -> its rounds
Acting = set[frozenset[str]]  # sets of effects about which runs were made
FRESH = "seed "  # first word of the names of rounds with other seeds than the study's


@dataclass(frozen=True)
class FreshTest:
    """Fresh runs for an answer, and what can follow where they contradict it."""

    simulator: FreshSimulator
    schedule: Callable[[Points], int]  # puts a round about some points before the next answer; its runs


@dataclass(frozen=True)
class Question(Generic[Found]):
    """A function of the study, and the points about which its answer needs simulations."""

    name: str
    answer: Callable[[Study, Progress], Found]
    points: Callable[[Found], Points]
    effects: Sequence[str] = ()  # that it needs
    most: int = MOST_POINTS  # points of a round
    ahead: bool = False  # whether it needs conditions that were not measured but could be
    required: Callable[[Found], Points] = lambda _: []  # to be simulated about before the answer counts
    beyond: Callable[[Found], bool] = lambda _: False  # whether mechanisms are to be tried before it counts
    decided: Callable[[Found], bool] = lambda _: True  # whether a larger plan would change nothing
    # the answer after its test by fresh runs, and the keys of these; None: it needs no test
    tested: Callable[[Found, FreshTest, Progress], tuple[Found, frozenset[str]]] | None = None


def answered(
    study: Study, plans: Sequence[BudgetName], question: Question[Found], progress: Progress
) -> tuple[Found, Study]:
    """The answer by the first plan that decides, and the study as it was when it was given.

    The runs of a plan are among those of the next.
    """
    budget, *larger = plans
    share = [1.0] * len(plans)
    found, ready = answered_by(budget, study, question, part_of(progress, share, 0))
    if larger and ready.simulations is not None and not (question.decided(found) or blocked(ready.faults)):
        study.options.announce("These runs do not decide; more are made.")
        return answered(study, larger, question, part_of(progress, share, 1))
    return found, replace(ready, options=replace(ready.options, budget=budget))


def answered_by(
    budget: BudgetName, study: Study, question: Question[Found], progress: Progress
) -> tuple[Found, Study]:
    """The answer by one plan, and the study as it was when it was given.

    Scenes are simulated about the plausible and the required points of each answer, and then the question is
    answered again. What that costs at most is announced before the first run.
    """
    first = training_runs.initial_training_runs(study, question.effects, budget, question.ahead)
    if first is None:
        announce(study, function_cost(study, len(question.effects)))
        return question.answer(study, progress), study
    rounds = read_rounds(study)
    runs, own, key, earlier = replayed(first, rounds, question, budget)
    left = max(runs.plan_size.rounds - len(own), 0)
    cost = plan_cost(runs, left, question.most, test_cost(runs, question, own, key))
    announce(study, cost.sentence if cost.seconds >= WORTH_TELLING else "")
    phases, phase = cost.phases, 0
    while True:
        ready = training_runs.emulated_study(runs, part_of(progress, phases, phase))
        found = question.answer(ready, part_of(progress, phases, phase + 1))
        phase += 2
        while (points := next_points(runs, question, found, own, earlier)) == []:
            own.append([])  # a round about nothing new changes no answer
        if points is None:
            rounds = {**rounds, key: own}
            write_rounds(study, rounds)
            wider = (
                None
                if runs.mechanisms or blocked(ready.faults) or not question.beyond(found)
                else training_runs.with_mechanisms(runs)
            )
            if wider is None or not wider.mechanisms or training_runs.room_left(wider) < 0:
                steps = part_of(progress, phases, len(phases) - 1)
                return after_test(question, found, ready, RoundsOf(runs, rounds, key), steps)
            runs = wider
            cost = plan_cost(runs, 0, 0)
            study.options.announce(f"No listed effect suffices. {cost.sentence}")
            phases = [*phases[:phase], *cost.phases, *phases[phase:]]
            continue
        runs = training_runs.refined_training_runs(runs, points, f"{key}|{len(own)}")
        own.append(points)
        write_rounds(study, {**rounds, key: own})


def announce(study: Study, cost: str) -> None:
    """Tell what an answer costs before it, where it costs much."""
    if cost:
        study.options.announce(cost)


@dataclass(frozen=True)
class RoundsOf:
    """The rounds of one question, and all runs of its study."""

    runs: TrainingRuns
    rounds: Rounds
    key: str


def test_cost(runs: TrainingRuns, question: Question[Found], own: list[Points], key: str) -> int:
    """Most runs that the test of an answer takes; none where it was made after the same rounds."""
    known = read_fresh(runs.study).get(key)
    if question.tested is None or (known is not None and known["rounds"] == len(own)):
        return 0
    return fresh_count(runs, runs.plan_size.fresh)


def after_test(
    question: Question[Found], found: Found, ready: Study, made: RoundsOf, progress: Progress
) -> tuple[Found, Study]:
    """The answer after its test by fresh runs, and the study with these counted."""
    if question.tested is None:
        return found, ready
    study, runs, own = made.runs.study, made.runs, made.rounds[made.key]
    count, known = len(own), read_fresh(study)
    mapping = ready.problem.model
    assert isinstance(mapping, NameMapping)

    def schedule(points: Points) -> int:
        if not training_runs.within_budget(runs, points):
            return 0
        write_rounds(study, {**made.rounds, made.key: [*own, points]})
        return runs.plan_size.round * len(points) * len(runs.scenes)

    keys = frozenset(key for entry in known.values() for key in entry["runs"])
    fresh = FreshTest(FreshSimulator(runs, mapping, keys, runs.plan_size.fresh), schedule)
    found, used = question.tested(found, fresh, progress)
    if not used:
        return found, ready
    earlier = known[made.key]["runs"] if made.key in known else []
    entry = {"rounds": count, "runs": sorted({*earlier, *used})}
    write_rounds(study, read_rounds(study), {**known, made.key: entry})
    return found, replace(ready, simulations=(ready.simulations or 0) + len(used))


def replayed(
    runs: TrainingRuns, rounds: Rounds, question: Question[Found], budget: BudgetName
) -> tuple[TrainingRuns, list[Points], str, Acting]:
    """Runs with those of earlier rounds; rounds of this question, their key, effects of other questions."""
    study, known = runs.study, training_runs.known_effects(runs.study.problem)
    key = f"{study.fresh}{question.name} {budget}"
    past = {name: made for name, made in rounds.items() if name != key and is_of(study, name)}
    own = list(rounds.get(key, []))
    for name, made in [*past.items(), (key, own)]:
        for number, points in enumerate(made):
            spent = name.rpartition(" ")[2]
            if not runs.mechanisms and any(set(point.effects) - set(known) for point in points):
                runs = training_runs.with_mechanisms(runs)
            runs = training_runs.refined_training_runs(runs, points, f"{name}|{number}", spent)
    tests = {each for entry in read_fresh(study).values() for each in entry["runs"]}
    runs = replace(runs, elsewhere=runs.elsewhere + len(tests))
    alike = [made for name, made in past.items() if name.endswith(budget)]
    return runs, own, key, {acting(point) for made in alike for points in made for point in points}


def next_points(
    runs: TrainingRuns, question: Question[Found], found: Found, own: list[Points], earlier: Acting
) -> Points | None:
    """Points of the next round, none where the cap has no room for it; None where the answer counts."""
    if len(own) < runs.plan_size.rounds:
        points = [point for point in question.points(found) if acting(point) not in earlier]
        return points if training_runs.within_budget(runs, points) else []
    known = earlier | {acting(point) for points in own for point in points}
    points = [point for point in question.required(found) if acting(point) not in known]
    done = len(own) >= runs.plan_size.rounds + MOST_REQUIRED
    return None if done or not points or not training_runs.within_budget(runs, points) else points


def part_of(progress: Progress, phases: Sequence[float], phase: int) -> Progress:
    """Progress of one phase as part of the whole plan."""
    before, own = shares(phases, phase)
    return lambda words, share: progress(words, before + own * share)


def is_of(study: Study, name: str) -> bool:
    """Whether rounds of this name belong to the seeds that a study uses."""
    return name.startswith(study.fresh) if study.fresh else not name.startswith(FRESH)


def acting(point: Setting) -> frozenset[str]:
    """Effects and mechanisms that act at a point."""
    return frozenset(name for name, strength in point.effects.items() if strength != 0.0)


def read_rounds(study: Study) -> Rounds:
    """Points of earlier rounds; none where the study or its table has changed since."""
    document = files.read_document(rounds_file(study))
    if document is None or document.get("of") != state_of(study):
        return {}
    return {
        name: [[Setting(**entry) for entry in points] for points in rounds]
        for name, rounds in document["rounds"].items()
    }


def read_fresh(study: Study) -> dict[str, Any]:
    """Fresh runs that were made by question: after how many of its rounds, and their keys."""
    document = files.read_document(rounds_file(study))
    if document is None or document.get("of") != state_of(study):
        return {}
    return document.get("fresh", {})


def write_rounds(study: Study, rounds: Rounds, fresh: Mapping[str, Any] | None = None) -> None:
    """Store the points of all rounds, and the fresh runs by question; as stored where none are given."""
    plain = {name: [[asdict(point) for point in points] for points in each] for name, each in rounds.items()}
    tests = read_fresh(study) if fresh is None else dict(fresh)
    files.write_document(rounds_file(study), {"of": state_of(study), "rounds": plain, "fresh": tests})


def rounds_file(study: Study) -> Path:
    """What the rounds of a study were about."""
    return files.document_file(study.results, study.path.stem, files.ROUNDS)


def state_of(study: Study) -> str:
    """Digest of a study file, its measurements and its effect files."""
    known = [study.digest, file_text(study.path, str(study.path))]
    known += [file.digest for file in study.effect_files]
    return sha256("|".join(known).encode()).hexdigest()[:16]


def last_plan(study: Study) -> Sequence[BudgetName]:
    """Plan that was asked for, else that of the last discovery: its runs are there already."""
    if study.options.budget is not None:
        return (study.options.budget,)
    last = files.read_reply(study.results, study.path.stem, "discover")
    return ("full",) if last is not None and last.about["budget"] == "full" else ("quick",)


def refinement_point(parameters: Mapping[str, float], strengths: Mapping[str, float]) -> Setting:
    """Calibrated numbers and strengths; the strength of an adopted effect may stand among the numbers."""
    numbers, effects = {}, dict(strengths)
    for name, value in parameters.items():
        if name.startswith(EFFECTS) and name.endswith(STRENGTH):
            effects[name[len(EFFECTS) : -len(STRENGTH)]] = value
        else:
            numbers[name] = value
    return Setting(numbers, effects)
