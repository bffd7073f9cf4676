"""Rounds of simulations until an answer rests on runs about its own explanations, and its test by fresh runs.

A function answers at once; scenes answer in rounds. A round simulates about the sets of effects that have
KEEP of the probability, and only while a probability that the decision rests on lies between 1 - SURE and
SURE. Mechanisms are simulated where no set of listed effects explains the rows.

The points of each round are stored beside the results: a command that is given again, or was stopped, makes
the same rounds without new answers, and later commands use the runs of earlier ones.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.evidence.answers import files, fresh_test
from taichi_erosion.evidence.answers.set_up import blocks_verdict, refuse_blocking
from taichi_erosion.evidence.data.problem import Progress
from taichi_erosion.evidence.data.transforms import effect_of_path, is_strength_path
from taichi_erosion.evidence.emulator import training_runs
from taichi_erosion.evidence.emulator.design import LEAST_DOSE, Setting
from taichi_erosion.evidence.emulator.fresh_runs import FreshSimulator, most_test_runs
from taichi_erosion.evidence.emulator.plan_cost import WORTH_TELLING, cost_in_words, plan_cost
from taichi_erosion.evidence.emulator.training_runs import TrainingRuns
from taichi_erosion.evidence.models.load_study import BudgetName, Study
from taichi_erosion.evidence.models.plugin import NameMapping
from taichi_erosion.evidence.race.decision import Decision
from taichi_erosion.evidence.race.expansion import Acting
from taichi_erosion.evidence.race.fit import UNLISTED, Fit, Race, log_joint
from taichi_erosion.evidence.race.outlook import JointRows
from taichi_erosion.evidence.race.posterior import Posterior, has_unexplained_misfit
from taichi_erosion.evidence.race.priors import KEEP, MOST, SURE
from taichi_erosion.evidence.record import FreshPart
from taichi_erosion.scene.load import read_text_of_file

MOST_POINTS = 3  # explanations about which a round simulates
MOST_REQUIRED = 4  # rounds beyond the planned ones, about effects or mechanisms that an answer requires
FRESH = "seed "  # first word of the names of rounds with other seeds than the study's
Points = list[Setting]
Rounds = dict[str, list[Points]]  # command and budget -> its rounds


@dataclass(frozen=True)
class StudyInference:
    """The race of a study, with what fresh runs of its scenes say of it."""

    posterior: Posterior
    decision: Decision
    fresh: FreshPart | None = None  # None: nothing that fresh runs can test
    query: JointRows | None = None  # new rows, with runs of the calibrated model
    query_runs: int = 0  # at these rows

    def points_at(self, *fits: Fit) -> Points:
        """Settings of fits as centres of a round, twice where doses vary; adopted effects may be numbers."""
        points = []
        for fit in fits:
            setting = fresh_test.run_setting(self.posterior.race, fit)
            acting = {name: strength for name, strength in setting.effects.items() if strength != 0.0}
            numbers = setting.parameters.items()
            acting |= {str(effect_of_path(path)): value for path, value in numbers if is_strength_path(path)}
            plain = {path: value for path, value in numbers if not is_strength_path(path)}
            points += [replace(setting, parameters=plain, effects=acting)] * (1 + bool(setting.doses))
        return points

    @property
    def bare_point(self) -> Setting:
        """The calibrated model as the centre of a round."""
        return self.points_at(self.posterior.race.bare)[0]


@dataclass(frozen=True)
class Question:
    """A function of the study, and the points about which its answer needs simulations."""

    name: str
    answer: Callable[[Study, Progress], StudyInference]
    points: Callable[[StudyInference], Points]
    effects: Sequence[str] = ()  # that it needs
    most_points: int = MOST_POINTS  # points of a round
    missing: bool = False  # whether it asks what is missing: required points and mechanisms are tried
    tested: bool = False  # by fresh runs
    query: Callable[[StudyInference], JointRows] | None = None  # new rows, at which the answer ends with runs
    query_sets: int = 0  # of their conditions, at most


def discovery_question(
    study: Study, answer: Callable[[Study, Progress], StudyInference], tested: bool = True
) -> Question:
    """Which effect is missing; without a test, which measurements would tell."""
    name, names = "discover" if tested else "next", study.problem.candidate_names
    return Question(name, answer, likeliest_explanation_points, names, missing=True, tested=tested)


def probability_of_sets(posterior: Posterior) -> Mapping[Acting, float]:
    """Probability of every set of effects and mechanisms, likeliest first, whatever is beside them."""
    probabilities: dict[Acting, float] = {}
    for hypothesis, p in posterior.probability.items():
        names = tuple(sorted(hypothesis.acting - UNLISTED))
        probabilities[names] = probabilities.get(names, 0.0) + p
    return dict(sorted(probabilities.items(), key=lambda each: -each[1]))


def closest_fit(race: Race, names: Acting) -> Fit:
    """The likeliest fit with exactly some effects and mechanisms."""
    return max((fit for h, fit in race.fits.items() if h.acting == {*names}), key=log_joint)


def has_open_question(decision: Decision) -> bool:
    """Whether anything that could be said is neither sure nor as good as excluded."""
    probabilities = [decision.probabilities["none"], decision.unlisted]
    probabilities += [*decision.inclusion.values(), *decision.beyond.values()]
    return any(1.0 - SURE < p < SURE for p in probabilities)


def is_final(inference: StudyInference) -> bool:
    """Whether everything that could be said is, and new runs of the scene confirm it."""
    doubted = inference.fresh is not None and inference.fresh.outcome in ("contradicted", "undecided")
    return not has_open_question(inference.decision) and not doubted


def likeliest_explanation_points(inference: StudyInference) -> Points:
    """The likeliest explanations, the bare model first; none where more runs decide nothing."""
    plausible = [names for names, p in probability_of_sets(inference.posterior).items() if p >= KEEP]
    if not has_open_question(inference.decision) or len(plausible) < 2:
        return []
    race = inference.posterior.race
    return inference.points_at(*(closest_fit(race, n) for n in sorted(plausible[:MOST_POINTS], key=bool)))


def points_before_unlisted_verdict(inference: StudyInference) -> Points:
    """Before it is said that no list holds what acts: the closest effect and set, or likely mechanisms."""
    if inference.decision.verdict != "outside_library":
        return []
    race, share = inference.posterior.race, probability_of_sets(inference.posterior)
    fits = [closest_fit(race, names) for names, p in share.items() if p >= KEEP]
    if dosed := [fit for fit in fits if fit.dose is not None]:
        return inference.points_at(*dosed[:MOST_POINTS])
    optima = [[f for f in race.effect_sets(*sizes) if f.is_optimum] for sizes in ((1,), range(2, MOST + 1))]
    return inference.points_at(*(max(kind, key=log_joint) for kind in optima if kind))


def answer_question(
    study: Study, plans: Sequence[BudgetName], question: Question, progress: Progress
) -> tuple[StudyInference, Study]:
    """The answer by the first plan that decides, and the study as it was when it was given.

    The runs of a plan are among those of the next.
    """
    budget, *larger = plans
    share = [1.0] * len(plans)
    inference, ready = answer_by_plan(budget, study, question, phase_progress(progress, share, 0))
    if larger and ready.simulations is not None and not (is_final(inference) or blocks_verdict(ready.faults)):
        study.options.announce("These runs do not decide; more are made.")
        return answer_question(study, larger, question, phase_progress(progress, share, 1))
    return inference, replace(ready, options=replace(ready.options, budget=budget))


def answer_by_plan(
    budget: BudgetName, study: Study, question: Question, progress: Progress
) -> tuple[StudyInference, Study]:
    """The answer by one plan, and the study as it was when it was given.

    Scenes are simulated about the plausible and the required points of each answer, and then the question is
    answered again. What that costs at most is announced before the first run.
    """
    first = training_runs.initial_training_runs(study, question.effects, budget)
    if first is None:
        if message := cost_in_words(study, len(question.effects)):
            study.options.announce(message)
        return question.answer(study, progress), study
    refuse_blocking(study, bool(question.effects) and question.name != "next")  # which asks for the rows
    key = f"{study.fresh}{question.name} {budget}"
    runs, own_rounds, earlier = add_stored_rounds(first, key)
    room = max(runs.plan_size.rounds - len(own_rounds), 0)
    cost = plan_cost(
        runs, room, question.most_points, run_limit(runs, question, own_rounds, key), question.missing
    )
    if cost.seconds >= WORTH_TELLING:
        study.options.announce(cost.cost_text)
    phases, phase = cost.phases, 0
    while True:
        ready = training_runs.replace_scenes_by_emulator(runs, phase_progress(progress, phases, phase))
        inference = question.answer(ready, phase_progress(progress, phases, phase + 1))
        phase += 2
        while (about := points_of_next_round(runs, question, inference, own_rounds, earlier)) == []:
            own_rounds.append([])  # a round about nothing new changes no answer
        if about is not None:
            runs = training_runs.add_refinement_round(runs, about, f"{key}|{len(own_rounds)}")
            own_rounds.append(about)
            write_rounds(study, {**earlier_points(study), key: own_rounds})
            continue
        write_rounds(study, {**earlier_points(study), key: own_rounds})
        if (wider := add_mechanism_runs(runs, ready, question, inference)) is None:
            steps = phase_progress(progress, phases, len(phases) - 1)
            return check_answer_by_runs(question, inference, ready, runs, key, steps)
        runs, cost = wider, plan_cost(wider, 1, 2 * MOST_POINTS, run_limit(wider, question, own_rounds, key))
        study.options.announce(f"No listed effect suffices. {cost.cost_text}")
        phases = [*phases[:phase], *cost.phases, *phases[phase:]]


def add_mechanism_runs(
    runs: TrainingRuns, ready: Study, question: Question, inference: StudyInference
) -> TrainingRuns | None:
    """The runs with those of mechanisms where the listed effects leave something open and there is room."""
    can_be_tried = question.missing and not runs.mechanisms and not blocks_verdict(ready.faults)
    if not (can_be_tried and has_unexplained_misfit(inference.posterior.race)):
        return None
    wider = training_runs.add_dose_runs(runs)
    return wider if wider.mechanisms and training_runs.runs_left_by_cap(wider) >= 0 else None


def run_limit(runs: TrainingRuns, question: Question, rounds: list[Points], key: str) -> int:
    """Most runs that end an answer; none where it was tested after the same rounds."""
    if question.query is not None:
        return question.query_sets * runs.plan_size.fresh
    count = read_rounds_file(runs.study)["fresh"].get(key)
    if not question.tested or (count is not None and count["rounds"] == len(rounds)):
        return 0
    return most_test_runs(runs, runs.plan_size.fresh) * (fresh_test.CLOSER if runs.mechanisms else 1)


def check_answer_by_runs(
    question: Question, inference: StudyInference, ready: Study, runs: TrainingRuns, key: str, steps: Progress
) -> tuple[StudyInference, Study]:
    """The answer with its test by fresh runs, or with runs at new rows, and the study with these counted.

    Where they contradict it, the next answer starts with a round about what was tested.
    """
    decision = inference.decision
    acting = decision.named or decision.group or decision.acting_mechanisms
    if question.query is None and not (question.tested and acting):
        return inference, ready
    study, stored, rounds = runs.study, read_rounds_file(runs.study)["fresh"], earlier_points(runs.study)
    mapping, race = ready.problem.model, inference.posterior.race
    assert isinstance(mapping, NameMapping)
    new_keys = frozenset(run for entry in stored.values() for run in entry["runs"])
    simulator = FreshSimulator(runs, mapping, new_keys, runs.plan_size.fresh)
    part, count = inference.fresh, len(rounds[key])
    if question.query is not None:
        rows, keys = fresh_test.simulate_untrained_rows(question.query(inference), simulator, steps)
        inference = replace(inference, query=rows, query_runs=len(keys))
    else:
        simulate = simulator.simulate_settings
        part, keys = fresh_test.run_fresh_test(inference.posterior, decision, simulate, steps)
        inference = replace(inference, decision=fresh_test.after_runs(decision, part))
    if part is not None and part.outcome == "contradicted":
        about = inference.points_at(*(kind.fits[0] for kind in fresh_test.answer_and_rivals(race, decision)))
        if training_runs.has_room_for_round(runs, about):
            rounds[key].append(about)
            part = replace(part, more_runs=runs.plan_size.round * len(about) * len(runs.scenes))
    inference = replace(inference, fresh=part)
    if not keys:
        return inference, ready
    entry = {"rounds": count, "runs": sorted(keys.union(stored[key]["runs"] if key in stored else ()))}
    write_rounds(study, rounds, {**stored, key: entry})
    return inference, replace(ready, simulations=(ready.simulations or 0) + len(keys))


def add_stored_rounds(runs: TrainingRuns, key: str) -> tuple[TrainingRuns, list[Points], set[frozenset[str]]]:
    """Runs with those of earlier rounds; rounds of one question, effects of others by the same plan."""
    study, rounds = runs.study, earlier_points(runs.study)
    budget = key.rpartition(" ")[2]
    start, is_fresh = study.fresh or FRESH, bool(study.fresh)  # of rounds whose seeds a study uses
    past = {n: each for n, each in rounds.items() if n != key and n.startswith(start) == is_fresh}
    own_rounds = list(rounds.get(key, []))
    for name, series in [*past.items(), (key, own_rounds)]:
        for number, about in enumerate(series):
            spent = name.rpartition(" ")[2]
            if not runs.mechanisms and has_doses(about):
                runs = training_runs.add_dose_runs(runs)
            runs = training_runs.add_refinement_round(runs, about, f"{name}|{number}", spent)
    tests = {run for entry in read_rounds_file(study)["fresh"].values() for run in entry["runs"]}
    runs = replace(runs, other_runs=runs.other_runs + len(tests))
    alike = [series for name, series in past.items() if name.endswith(budget)]
    return runs, own_rounds, {acting_at(point) for series in alike for about in series for point in about}


def points_of_next_round(
    runs: TrainingRuns,
    question: Question,
    inference: StudyInference,
    own_rounds: list[Points],
    earlier: set[frozenset[str]],
) -> Points | None:
    """Points of the next round, none where the cap has no room for it; None where the answer counts."""
    if len(own_rounds) < runs.plan_size.rounds:
        about = [point for point in question.points(inference) if acting_at(point) not in earlier]
        return about if training_runs.has_room_for_round(runs, about) else []
    signatures = earlier | {acting_at(point) for about in own_rounds for point in about}
    needed = points_before_unlisted_verdict(inference) if question.missing else []
    about = [point for point in needed if acting_at(point) not in signatures]
    alike = sum(has_doses(each) == has_doses(about) for each in own_rounds[runs.plan_size.rounds :])
    is_complete = alike >= MOST_REQUIRED
    return None if is_complete or not about or not training_runs.has_room_for_round(runs, about) else about


def has_doses(about: Points) -> bool:
    return any(point.doses for point in about)


def phase_progress(progress: Progress, phases: Sequence[float], phase: int) -> Progress:
    """Progress of one phase as part of the whole plan; 1 beyond it."""
    total = sum(phases) or 1.0
    before, weight = sum(phases[:phase]) / total, sum(phases[phase : phase + 1]) / total
    return lambda words, share: progress(words, before + weight * share)


def acting_at(point: Setting) -> frozenset[str]:
    """Effects and mechanisms that act at a point, these with the condition and the signs of their doses."""
    names = []
    for name, strength in point.effects.items():
        doses = [numbers[name] for _, numbers in point.doses if name in numbers]
        signs = {int(np.sign(dose)) for dose in doses if abs(dose) > LEAST_DOSE * abs(strength)}
        names += [f"{name}|{point.along}|{sorted(signs)}" if doses else name] * (strength != 0.0)
    return frozenset(names)


def read_rounds_file(study: Study) -> Mapping[str, Any]:
    """Rounds and fresh runs by question, as stored; none where the study or its table has changed since."""
    file, digest = rounds_file(study)
    document = files.read_document(file) or {}
    return {"rounds": {}, "fresh": {}} | (document if document.get("of") == digest else {})


def earlier_points(study: Study) -> Rounds:
    stored = read_rounds_file(study)["rounds"].items()
    return {name: [[Setting(**entry) for entry in about] for about in series] for name, series in stored}


def write_rounds(study: Study, rounds: Rounds, fresh: Mapping[str, Any] | None = None) -> None:
    """Store the points of all rounds, and the fresh runs by question; as stored where none are given."""
    plain = {key: [[asdict(point) for point in about] for about in each] for key, each in rounds.items()}
    tests = read_rounds_file(study)["fresh"] if fresh is None else dict(fresh)
    file, digest = rounds_file(study)
    files.write_document(file, {"of": digest, "rounds": plain, "fresh": tests})


def rounds_file(study: Study) -> tuple[Path, str]:
    """File of the rounds, and the digest of the study file and its measurements for which they count.

    A round serves an effect file that joins them too.
    """
    digest = f"{study.digest}|{read_text_of_file(study.path, str(study.path))}"
    file = files.answer_file(study.results, study.path.stem, files.ROUNDS)
    return file, sha256(digest.encode()).hexdigest()[:16]


def plans_to_try(study: Study) -> Sequence[BudgetName]:
    """Plan that was asked for, else that of the last discovery: its runs are there already."""
    if study.options.budget is not None:
        return (study.options.budget,)
    last = files.read_reply(study.results, study.path.stem, "discover")
    return ("full",) if last is not None and last.about["budget"] == "full" else ("quick",)
