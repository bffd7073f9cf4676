"""Command `predict`: a study and a table of conditions in, a document out, stored with the results."""

from dataclasses import asdict
from pathlib import Path
from time import perf_counter

from taichi_erosion.evidence.answers import documents
from taichi_erosion.evidence.answers.commands import open_study, stored
from taichi_erosion.evidence.answers.documents import Document
from taichi_erosion.evidence.answers.rounds import (
    Points,
    Question,
    answered,
    last_budget,
    refinement_point,
    values,
)
from taichi_erosion.evidence.data.held_out_rows import COUNTER, read_counter, record_opening
from taichi_erosion.evidence.data.problem import Progress
from taichi_erosion.evidence.models.column_units import place_units
from taichi_erosion.evidence.models.load_study import LONGEST_CHAIN, NO_OPTIONS, Study, StudyOptions
from taichi_erosion.evidence.models.new_conditions import NewConditions, read_new_conditions
from taichi_erosion.evidence.prediction.predict import Prediction, predict


def predict_study(
    path: Path, at: Path, progress: Progress, options: StudyOptions = NO_OPTIONS, bare: bool = False
) -> Document:
    """What the calibrated model of a study says at the conditions of a table.

    Where effects have been adopted, the adopted model answers, unless `bare`. Rows of a vault that has been
    opened for it check the intervals; that is one opening more for each adopted model. Raises BadInput.
    """
    start = perf_counter()
    chosen = path if bare else adopted_study(path, options)
    with open_study(chosen, options) as study:
        outdated = () if bare else outdated_adoption(study)
        table = read_new_conditions(at, study.file, places_of(study), study.problem.measurements)
        opened, seed = bool(study.file.adopted) and len(study.problem.vault.rows) > 0, study.file.study.seed

        def answer(ready: Study, progress: Progress) -> Prediction:
            return predict(ready.problem, table, progress, seed, opened)

        question = Question("predict", answer, prediction_points, most=1)
        found, ready = answered(study, last_budget(study), question, progress)
        document = documents.record(found) | {"at": table.file, "vault_opened": opening(study, opened)}
        document |= {"faults": documents.plain([asdict(each) for each in ready.faults])}
        document |= {"sentences": [*sentences(found, study, table, path), *outdated]}
        return stored(ready, "predict", document | {"wall_s": perf_counter() - start}, start)


def places_of(study: Study) -> dict[str, str]:
    """Units of what the conditions of a study set."""
    return place_units(study.file, study.path, study.effect_files)


def adopted_study(path: Path, options: StudyOptions = NO_OPTIONS) -> Path:
    """The study that the last of several adoptions wrote; the study itself where there is none."""
    for _ in range(LONGEST_CHAIN):
        with open_study(path, options) as study:
            last = documents.read_answer(study.results, path.stem, "adopt")
        if last is None or last.get("digest") != study.digest[:12]:
            return path
        written = path.with_name(Path(last["written"]).name)
        if written == path or not written.is_file():
            return path
        path = written
    return path


def outdated_adoption(study: Study) -> tuple[str, ...]:
    """That an adoption answers no longer, since the study or its table has changed."""
    last = documents.read_answer(study.results, study.path.stem, "adopt")
    if last is None or last.get("digest") == study.digest[:12]:
        return ()
    effects = " and ".join(last["added"]["effects"])
    return (
        f"Left out: {effects}, adopted before the table or the study changed; `adopt` again takes it in.",
    )


def prediction_points(found: Prediction) -> Points:
    """The calibrated model."""
    return [refinement_point(values(found.parameters), {})]


def opening(study: Study, opened: bool) -> int:
    """Openings of the vault, with that of this model where it is compared with."""
    name = f"predict {study.path.stem}"
    earlier = read_counter(study.results / COUNTER).get(study.drawn_from, [])
    if opened and name not in earlier:
        return record_opening(study.results, study.drawn_from, name)
    return len(earlier)


def sentences(found: Prediction, study: Study, table: NewConditions, asked: Path) -> list[str]:
    """Which model answers, what its intervals rest on, and what could not be checked."""
    adopted, hidden = list(study.file.adopted), len(study.problem.vault.rows)
    told = [f"Predicted by the calibrated model of {study.path.name}."]
    if study.path != asked:
        told = [f"Predicted by the adopted model, with {' and '.join(adopted)} ({study.path.name})."]
    told += found.sentences
    if hidden and not adopted:
        told.append(f"{hidden} held-out rows are neither used nor compared with: they stay for `adopt`.")
    return [*told, *table.notes]
