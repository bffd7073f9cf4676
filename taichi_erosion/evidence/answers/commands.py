"""Commands of the evidence loop: a study file in, a document out, which is stored in the results folder."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from time import perf_counter

from threadpoolctl import threadpool_limits

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers import documents
from taichi_erosion.evidence.answers.adopt import adopt, judged
from taichi_erosion.evidence.answers.compare import compare
from taichi_erosion.evidence.answers.discover import Answer, record_of
from taichi_erosion.evidence.answers.documents import Command, Document, discovery_sentences
from taichi_erosion.evidence.answers.finding_sentences import fresh_words
from taichi_erosion.evidence.answers.mechanism_experiments import mechanism_experiments
from taichi_erosion.evidence.answers.next_experiments import next_experiments
from taichi_erosion.evidence.answers.rounds import (
    FreshTest,
    Question,
    adoption_points,
    answered,
    asks_mechanisms,
    comparison_points,
    discovery_points,
    last_budget,
    refinement_point,
    required_points,
)
from taichi_erosion.evidence.answers.set_up import (
    WAITS,
    blocked,
    bound_faults,
    discovery,
    lacks_rows,
    missing_rows,
    sentences,
    set_up_faults,
    source_faults,
    table_faults,
)
from taichi_erosion.evidence.data.findings import (
    Adoption,
    Comparison,
    Discovery,
    HypothesisFit,
    PlausibleHypothesis,
    SetUpFault,
)
from taichi_erosion.evidence.data.held_out_rows import openings, record_opening
from taichi_erosion.evidence.data.problem import Laboratory, Progress
from taichi_erosion.evidence.data.transforms import split_setting
from taichi_erosion.evidence.emulator.design import RefinementPoint
from taichi_erosion.evidence.inference.pipeline import Analysis
from taichi_erosion.evidence.inference.robustness.fresh_check import (
    after_check,
    can_be_tested,
    contenders,
    fresh_check,
)
from taichi_erosion.evidence.models.adopted_files import refuse_foreign_files, write_adopted_files
from taichi_erosion.evidence.models.load_study import NO_OPTIONS, Study, StudyOptions, load_study

COST = ("runs", "wall_s")
CIRCUMSTANCES = ("vault", "notes", "warnings", "versions", "study")  # may change while the answer stays


@contextmanager
def open_study(path: Path, options: StudyOptions = NO_OPTIONS) -> Iterator[Study]:
    """A study whose runs are safe in its store when the block is left, however it is left.

    Matrices are multiplied on one thread: on several their last bits would depend on how many there are, and
    with them the choice of the next runs.
    """
    with threadpool_limits(1, user_api="blas"):
        study = load_study(path, options)
        study = replace(study, faults=(*study.faults, *source_faults(study), *table_faults(study.problem)))
        try:
            yield study
        finally:
            study.store.commit()


def compare_study(path: Path, progress: Progress, options: StudyOptions = NO_OPTIONS) -> Document:
    """Where the model fails."""
    start = perf_counter()
    with open_study(path, options) as study:
        seed = study.file.study.seed

        def answer(ready: Study, progress: Progress) -> Comparison:
            return compare(ready.problem, progress, seed)

        question = Question("compare", answer, comparison_points, most=1)
        found, ready = answered(study, last_budget(study), question, progress)
        faults = set_up_faults(ready, found.rows, found.parameters, found.warnings, found.levels)
        return stored(ready, "compare", documents.record(replace(found, faults=faults)), start)


def discover_study(path: Path, progress: Progress, options: StudyOptions = NO_OPTIONS) -> Document:
    """Which effect is missing."""
    start = perf_counter()
    with open_study(path, options) as study:
        seed, spent = study.file.study.seed, study.problem.budget.name

        def answer(ready: Study, progress: Progress) -> Answer:
            return discovery(ready, seed, progress)

        question = Question(
            "discover",
            answer,
            lambda found: discovery_points(found.record),
            study.problem.candidate_names,
            ahead=bool(study.file.laboratory.ranges),
            required=lambda found: required_points(found.record),
            beyond=lambda found: asks_mechanisms(found.record),
            tested=tested,
        )
        told, ready = answered(study, spent, question, progress)
        found = told.record
        document = documents.record(with_experiments(ready, found)) | {"budget": spent}
        return stored(ready, "discover", document | vault_of(study, found), start)


def vault_of(study: Study, found: Discovery) -> Document:
    """What the held-out rows said when the effects that a discovery names were adopted; else nothing."""
    adopted = documents.read_answer(study.results, study.path.stem, "adopt")
    if adopted is None or adopted["digest"] != study.digest[:12]:
        return {}
    vault = adopted["vault"]
    return {"vault": vault} if set(vault["effects"]) == set(found.named) else {}


def tested(found: Answer, fresh: FreshTest, progress: Progress) -> tuple[Answer, frozenset[str]]:
    """An answer that names effects with the outcome of fresh runs, unstable where these contradict it.

    Beside it the keys of these runs.
    """
    if found.analysis is None or not can_be_tested(found.analysis):
        return found, frozenset()
    check, keys = fresh_check(found.analysis, fresh.simulator.simulate, progress)
    analysis, record = after_check(found.analysis, check), found.record
    if check.outcome == "contradicted":
        record = replace(record_of(analysis, found.beyond, record.seed), faults=record.faults)
        check = replace(check, more_runs=fresh.schedule(points_of(found.analysis)))
    units = analysis.fitted.prepared.problem.measurements.table_units
    check = replace(check, sentence=fresh_words(check, units))
    record = replace(record, stability=analysis.stability, fresh_runs=check)
    record = replace(record, sentences=discovery_sentences(record))
    return replace(found, record=record, analysis=analysis), keys


def points_of(found: Analysis) -> list[RefinementPoint]:
    """The explanations that were tested."""
    points = []
    for item in (found.final, *(each for each, _ in contenders(found))):
        parameters, adopted = split_setting(found.fitted.prepared.axes, item.fit.x)
        points.append(refinement_point(parameters, {**adopted, **item.fit.acting()}))
    return points


def adopt_study(
    path: Path,
    effects: Sequence[str],
    progress: Progress,
    options: StudyOptions = NO_OPTIONS,
    force: bool = False,
) -> Document:
    """The error before and after effects are added, on data that no fit has seen; writes the new study.

    `force` replaces files that this study did not write.
    """
    start = perf_counter()
    with open_study(path, options) as study:
        names, seed = study.problem.candidate_names, study.file.study.seed
        effects = known_effects(effects, names, path)
        refuse_foreign_files(study, effects, force)
        others = named_beside(study, effects)

        def answer(ready: Study, progress: Progress) -> Adoption:
            return adopt(ready.problem, effects, seed, progress, others)

        question = Question(f"adopt {' '.join(effects)}", answer, adoption_points, names, most=5)
        found, ready = answered(study, last_budget(study), question, progress)
        found = with_one_base(study, found)
        count = openings(study.results, study.drawn_from)
        if len(study.problem.vault.rows):
            count = record_opening(study.results, study.drawn_from, "+".join(effects))
        written = write_adopted_files(study, found, force)
        document = documents.adopt_document(found, count, [str(file) for file in written])
        faults = (*ready.faults, *bound_faults(study, found.added.parameters))
        document |= {"faults": documents.plain([asdict(each) for each in faults])}
        if not documents.ladder(study.results, study.digest[:12]):
            documents.extend_ladder(study.results, rung(study, (), found.base))
        if not found.contradicted:
            documents.extend_ladder(study.results, rung(study, effects, found.added))
        document |= {"ladder": documents.ladder(study.results, study.digest[:12])}
        return stored(ready, "adopt", document, start)


def known_effects(effects: Sequence[str], names: Sequence[str], path: Path) -> tuple[str, ...]:
    """Effects to adopt in the order of the candidates, each once; raises BadInput for one that is none."""
    if missing := [effect for effect in effects if effect not in names]:
        own = "one of your own: --effect FILE, or effect_files under [study]"
        known = ", ".join(names) or "none"
        raise BadInput(f"{path}: {missing[0]} is no candidate; there are: {known}; {own}")
    return tuple(name for name in names if name in effects)


def named_beside(study: Study, effects: Sequence[str]) -> list[str]:
    """Effects that the last discovery named together with those to be adopted."""
    last = last_discovery(study)
    named = last["named"] if last is not None else []
    return [name for name in named if name not in effects] if set(effects) & set(named) else []


def next_study(path: Path, progress: Progress, options: StudyOptions = NO_OPTIONS) -> Document:
    """The experiments that would decide."""
    start = perf_counter()
    with open_study(path, options) as study:
        seed, budget, names = study.file.study.seed, last_budget(study), study.problem.candidate_names

        def answer(ready: Study, progress: Progress) -> Discovery:
            return with_experiments(ready, discovery(ready, seed, progress).record)

        question = Question("next", answer, discovery_points, names, ahead=True, beyond=asks_mechanisms)
        found, ready = answered(study, budget, question, progress)
        experiments = documents.plain([asdict(each) for each in found.next_experiments])
        words = asked_here(study, found) + runs_first(study) + found.next_sentence
        document = {"next_experiments": experiments, "sentence": words}
        document |= {"faults": documents.plain([asdict(each) for each in found.faults])}
        return stored(ready, "next", document, start)


def last_discovery(study: Study) -> Document | None:
    """The last answer of `discover` on these measurements; None before the first."""
    last = documents.read_answer(study.results, study.path.stem, "discover")
    return last if last is not None and last.get("digest") == study.digest[:12] else None


def asked_here(study: Study, found: Discovery) -> str:
    """That the question of `discover` was asked without it, and its answer; empty where it was given."""
    if last_discovery(study) is not None or not found.sentences:
        return ""
    told = found.sentences[0].rstrip(".")
    return f"`discover` has not answered yet; its question was asked here first: {told}. "


def contradicted(last: Document) -> bool:
    """Whether new simulations contradicted the names of a discovery."""
    return (last.get("fresh_runs") or {}).get("outcome") == "contradicted"


def runs_first(study: Study) -> str:
    """That runs come before measurements, where new simulations contradicted the last discovery."""
    last = last_discovery(study)
    if last is None or not contradicted(last):
        return ""
    return "New simulations contradicted the last answer of `discover`: more runs come before measurements. "


def stored(study: Study, command: Command, document: Document, start: float) -> Document:
    """A document in the results folder, with its study and what all of it has cost."""
    document = documents.study_document(study) | document
    document |= {"set_up": sentences([SetUpFault(**each) for each in document["faults"]])}
    if study.simulations is not None:
        document |= {"runs": study.simulations, "wall_s": perf_counter() - start}
    document |= first_cost(documents.read_answer(study.results, study.path.stem, command), document)
    documents.write_document(documents.document_file(study.results, study.path.stem, command), document)
    return document


def first_cost(earlier: Document | None, document: Document) -> Document:
    """Cost of an answer when it was first given; to read it again from stored runs costs next to nothing."""
    told = document.keys() - {*COST, *CIRCUMSTANCES}
    if earlier is None or any(earlier.get(key) != document[key] for key in told):
        return {}
    known = [key for key in COST if earlier.get(key) is not None and document.get(key) is not None]
    return {key: max(earlier[key], document[key]) for key in known}


def with_experiments(study: Study, found: Discovery) -> Discovery:
    """A discovery with the experiments that the laboratory could make.

    None while its verdict waits, unless it waits for more rows: then those that tell the candidates apart.
    """
    few = lacks_rows(found.faults)
    if blocked(found.faults) and not few:
        return replace(found, next_sentence=WAITS)
    stated = study.file.laboratory
    laboratory = Laboratory(ranges=dict(stated.ranges), costs=dict(stated.costs), repeats=stated.repeats)
    told = None if few else mechanism_experiments(study.problem, found, laboratory)
    told = told or next_experiments(study.problem, with_all_open(study, found) if few else found, laboratory)
    words = told.sentence
    if few:
        words = f"{more_rows(missing_rows(study.problem))} {words}"
    return replace(found, next_experiments=told.experiments, next_sentence=words)


def with_all_open(study: Study, found: Discovery) -> Discovery:
    """The discovery with the bare model and every candidate as explanations of equal probability."""
    share = 1.0 / (len(found.effects) + 1)
    numbers = {number.path: number.start for number in study.problem.parameters}
    numbers |= {path: number.value for path, number in found.parameters.items()}
    point = refinement_point(numbers, {})
    bare = PlausibleHypothesis((), share, point.parameters, point.effects)
    effects = {name: replace(effect, probability=share) for name, effect in found.effects.items()}
    return replace(found, survivors=(bare,), effects=effects)


def more_rows(count: int) -> str:
    """Sentence on rows that are lacking."""
    rows = (
        "one row more under other conditions is"
        if count == 1
        else f"{count} rows more under other conditions are"
    )
    return f"At least {rows} needed before an effect can be named."


def with_one_base(study: Study, found: Adoption) -> Adoption:
    """The adoption with the errors before it that were told when this vault was first opened for this model.

    Two adoptions calibrate the bare model with other runs or levels, and would tell two values for one model.
    """
    rungs, adopted = documents.ladder(study.results, study.digest[:12]), list(study.file.adopted)
    known = [each for each in rungs if each["effects"] == adopted]
    if not known or known[0]["chi2_per_row_held_out"] is None:
        return found
    fitted, held_out = known[0]["chi2_per_row_fitted"], known[0]["chi2_per_row_held_out"]
    return judged(replace(found, base=replace(found.base, chi2_per_row=fitted, vault_chi2_per_row=held_out)))


def rung(study: Study, effects: Sequence[str], fit: HypothesisFit) -> Document:
    """One rung of the error ladder: the errors per row with some more effects in the model."""
    effects = [*study.file.adopted, *effects]
    errors = {
        "chi2_per_row_fitted": fit.chi2_per_row,
        "chi2_per_row_held_out": fit.vault_chi2_per_row,
        "rmse_held_out": fit.vault_rmse,
    }
    return documents.plain({"of": study.digest[:12], "effects": effects} | errors)
