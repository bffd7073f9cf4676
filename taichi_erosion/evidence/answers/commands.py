"""Commands of the evidence loop: a study file in, a reply out, which is stored in the results folder.

All of them condition the same race: `race_record` makes its record, each command adds what it was asked for.
"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from time import perf_counter
from typing import Any

from threadpoolctl import threadpool_limits

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers import files, rounds, set_up
from taichi_erosion.evidence.answers.files import Command, Reply
from taichi_erosion.evidence.answers.rounds import Question, StudyInference, discovery_question, plans_to_try
from taichi_erosion.evidence.answers.summary import mechanism_parts, race_record
from taichi_erosion.evidence.data.held_out_rows import count_opening, vault_openings
from taichi_erosion.evidence.data.problem import Laboratory, Progress
from taichi_erosion.evidence.data.transforms import EFFECTS, STRENGTH, is_strength_path
from taichi_erosion.evidence.models.adopted_files import Adoption, refuse_foreign_files, write_adopted_files
from taichi_erosion.evidence.models.load_study import NO_OPTIONS, PLANS, Study, StudyOptions, load_study
from taichi_erosion.evidence.race.decision import decide_cause, sensitivity
from taichi_erosion.evidence.race.dose_laws import dose_law_of_decision
from taichi_erosion.evidence.race.fit import Hypothesis
from taichi_erosion.evidence.race.outlook import held_out_part
from taichi_erosion.evidence.race.posterior import Posterior, condition_on_effects, infer, restrict_hypotheses
from taichi_erosion.evidence.race.priors import SURE
from taichi_erosion.evidence.race.proposals import proposals
from taichi_erosion.evidence.record import DecisionPart, Interval, Record
from taichi_erosion.evidence.words import shell_command
from taichi_erosion.evidence.words.vocabulary import join_words
from taichi_erosion.mechanisms.library import mechanism_rows

LEFT_OUT = ("they are not used", "they are left out")  # ends of warnings on rows that no answer has


@contextmanager
def open_study(path: Path, options: StudyOptions = NO_OPTIONS) -> Iterator[Study]:
    """A study whose runs are safe in its store when the block is left, however it is left.

    Matrices are multiplied on one thread: on several their last bits would depend on how many there are, and
    with them the choice of the next runs.
    """
    with threadpool_limits(1, user_api="blas"):
        study = load_study(path, options)
        set_up.refuse_unknown_scatter(study)
        faults = (*study.faults, *set_up.stale_faults(path, study.file), *set_up.table_faults(study.problem))
        study = replace(study, faults=faults)
        try:
            yield study
        finally:
            study.store.commit_runs()


def compare_study(path: Path, progress: Progress, options: StudyOptions = NO_OPTIONS) -> Reply:
    """Where the model fails if nothing is missing. Raises BadInput."""
    start = perf_counter()
    with open_study(path, options) as study:
        question = Question("compare", bare, lambda inference: [inference.bare_point], most_points=1)
        bare_inference, ready = answer_with_unit_faults(study, question, progress)
        record = race_record(restrict_hypotheses(bare_inference.posterior.race, lambda h: not h.acting))
        record = replace(record, **vars(bare_inference.decision.decision_record))
        return store_reply(ready, "compare", bare_inference, record, start)


def discover_study(path: Path, progress: Progress, options: StudyOptions = NO_OPTIONS) -> Reply:
    """Which effect is missing. Raises BadInput."""
    start = perf_counter()
    with open_study(path, options) as study:
        question = discovery_question(study, bare if set_up.blocks_verdict(study.faults) else infer_all)
        inference, ready = answer_with_unit_faults(study, question, progress)
        record = discover_record(inference)
        adopted = files.read_reply(study.results, study.path.stem, "adopt")
        blocked = set_up.blocks_verdict(ready.faults)
        if adopted is not None and adopted.about["digest"] == study.digest[:12] and not blocked:
            record = files.with_adoption(record, adopted.record)
        return store_reply(ready, "discover", inference, record, start, budget=ready.options.budget)


def adopt_study(
    path: Path, effects: Sequence[str], progress: Progress, options: StudyOptions = NO_OPTIONS
) -> Reply:
    """The error before and after effects are added, on data that no fit has seen; writes the new study.

    With `options.force` it replaces files that this study did not write. Raises BadInput.
    """
    start = perf_counter()
    with open_study(path, options) as study:
        names = study.problem.candidate_names
        effects = order_effects_to_adopt(effects, names, path)
        refuse_foreign_files(study, effects, options.force)

        def both_points(inference: StudyInference) -> list[Any]:
            posterior = inference.posterior
            return inference.points_at(posterior.race.bare, condition_on_effects(posterior, effects).best_fit)

        question = Question(f"adopt {' '.join(effects)}", infer_all, both_points, names, most_points=2)
        adopted_inference, ready = answer_with_unit_faults(study, question, progress)
        record = adoption_record(adopted_inference.posterior, effects, study.file.study.seed)
        opened = vault_openings(study.results, study.vault_digest)
        if len(study.problem.vault.rows):
            opened = count_opening(study.results, study.vault_digest, "+".join(effects))
        record = replace(record, vault=record.vault and replace(record.vault, opened=opened))
        names, numbers = record.named, dict[str, Interval](record.parameters)
        earlier = {path[len(EFFECTS) : -len(STRENGTH)]: path for path in numbers if is_strength_path(path)}
        strengths = {name: numbers.pop(path) for name, path in earlier.items()}
        strengths |= {name: record.effects[name].strength_range for name in names}
        paths = write_adopted_files(study, Adoption(names, strengths, numbers), options.force)
        details = {"written": str(paths[0]), "files": [str(file) for file in paths]}
        details |= {"ladder": files.append_adoption_errors(study, record)}
        conditioned = condition_on_effects(adopted_inference.posterior, effects)
        adopted_inference = replace(adopted_inference, posterior=conditioned)
        return store_reply(ready, "adopt", adopted_inference, record, start, **details)


def next_study(path: Path, progress: Progress, options: StudyOptions = NO_OPTIONS) -> Reply:
    """The measurements that would move the posterior. Raises BadInput."""
    start = perf_counter()
    with open_study(path, options) as study:
        question = discovery_question(study, infer_all, tested=False)
        inference, ready = answer_with_unit_faults(study, question, progress)
        laboratory = Laboratory(**study.file.laboratory.model_dump())
        kinds = {fault.kind for fault in ready.faults if fault.blocks}
        experiments = proposals(inference.posterior, laboratory) if kinds <= {"too_few_rows"} else ()
        record = replace(race_record(inference.posterior), next_experiments=experiments)
        return store_reply(ready, "next", inference, record, start)


def infer_all(ready: Study, progress: Progress, bare: bool = False) -> StudyInference:
    posterior = infer(ready.problem, ready.file.study.seed, progress=progress, bare=bare)
    return StudyInference(posterior, decide_cause(posterior))


bare = partial(infer_all, bare=True)  # without anything that could be missing


def answer_with_unit_faults(
    study: Study, question: Question, progress: Progress
) -> tuple[StudyInference, Study]:
    """The answer of a study, and the study with all that its model was asked and the faults that it shows.

    A discovery goes on with the next plan where one does not decide.
    """
    plans = PLANS if question.tested and study.options.budget is None else plans_to_try(study)
    inference, ready = rounds.answer_question(study, plans, question, progress)
    return inference, replace(ready, faults=(*ready.faults, *set_up.unit_faults(inference.posterior.race)))


def discover_record(inference: StudyInference) -> Record:
    """Which effect is missing, with the law of a mechanism.

    A name that fresh runs contradict, or to which they leave less than SURE, is not stable.
    """
    posterior, answer = inference.posterior, inference.decision
    other = defaultdict[str, list[DecisionPart]](list)
    for prior, _, decision in sensitivity(posterior, answer):
        other[prior].append(decision.decision_record)
    record = replace(race_record(posterior, answer), fresh_runs=inference.fresh, sensitivity=dict(other))
    record = replace(record, mechanisms=mechanism_parts(record, dose_law_of_decision(posterior, answer)))
    doubted, fresh = (*record.named, *record.group), inference.fresh
    if doubted and fresh is not None and (fresh.outcome == "contradicted" or fresh.simulated < SURE):
        return replace(record, verdict="unstable", named=(), group=doubted, sensitivity={})
    return record


def adoption_record(posterior: Posterior, effects: Sequence[str], seed: int) -> Record:
    """The error of fitted and held-out rows with these effects, numbers and strengths as they then are."""
    conditioned = condition_on_effects(posterior, effects)
    acting = {"verdict": "present", "named": tuple(effects), "group": ()}
    record = race_record(conditioned, replace(decide_cause(conditioned), acting_mechanisms=(), **acting))
    before = vars(decide_cause(posterior).decision_record) | acting | {"acting_mechanisms": ()}
    return replace(record, **before, vault=held_out_part(conditioned, effects, seed))


def order_effects_to_adopt(effects: Sequence[str], names: Sequence[str], path: Path) -> tuple[str, ...]:
    """Effects to adopt in the order of the candidates, each once; raises BadInput for one that is none."""
    if missing := [effect for effect in effects if effect not in names]:
        remedy = "one of your own: --effect FILE, or effect_files under [study]"
        if missing[0] in mechanism_rows():
            command = shell_command("effects", "new", "NAME", "--from-discovery", path)
            remedy = f"{command} makes an effect of it"
        listed = ", ".join(names) or "none"
        raise BadInput(f"{path}: {missing[0]} is no candidate; there are: {listed}; {remedy}")
    return tuple(name for name in names if name in effects)


def store_reply(
    study: Study, command: Command, inference: StudyInference, record: Record, start: float, **details: Any
) -> Reply:
    """The stored reply of a command, with its cost. A set-up that is not settled names nothing by itself."""
    if command != "adopt" and set_up.blocks_verdict(study.faults):
        waits = {"named": (), "group": (), "acting_mechanisms": (), "mechanisms": {}, "sensitivity": {}}
        record = replace(record, verdict="not_testable", **waits)
    runs = record.runs if study.simulations is None else study.simulations
    record = replace(record, runs=runs, wall_s=perf_counter() - start, seed=study.file.study.seed)
    reply = Reply(command, common_answer_fields(study, inference) | details, record, inference.posterior)
    return files.write_reply(study.results, study.path.stem, reply)


def common_answer_fields(study: Study, inference: StudyInference) -> files.Document:
    """What every answer says of its study and of the set-up."""
    about = files.study_fields(study) | {"faults": [asdict(each) for each in study.faults]}
    race, warnings = inference.posterior.race, list(inference.posterior.race.prepared.warnings)
    # repeats that differ first, for they may be typing errors
    order = sorted(study.faults, key=lambda fault: (fault.kind != "repeats", not fault.blocks))
    lines = dict.fromkeys(f"{'error' if each.blocks else 'warning'}: {each.sentence}" for each in order)
    lines |= dict.fromkeys(f"warning: {each}" for each in warnings if each.endswith(LEFT_OUT))
    if idle := [name for name in race.model.candidates if Hypothesis((name,)) not in race.fits]:
        lines[f"warning: {join_words(idle)} changes nothing here: has the model another name for it?"] = None
    return about | {"set_up": list(lines), "warnings": warnings}
