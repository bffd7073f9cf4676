"""Answers in the results folder: what an answer is about, its record, and the ladder of adoptions.

A file `STUDY.COMMAND.json` holds the keys of docs/json_and_python.md, and under `rows` what figures are drawn
from.
"""

import json
import platform
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, fields, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from taichi_erosion import __version__
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file, write_atomic
from taichi_erosion.effect_library import effect_titles
from taichi_erosion.evidence.data.table_units import KEY, TableUnits
from taichi_erosion.evidence.models.adopted_files import adopted_study_path
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.record import FitPart, PredictionPart, Record
from taichi_erosion.evidence.words import answer_lines as lines
from taichi_erosion.evidence.words import shell_command
from taichi_erosion.evidence.words.part_words import naming_lowers_misfit
from taichi_erosion.evidence.words.vocabulary import Vocabulary
from taichi_erosion.mechanisms.library import DOSE, mechanism_rows

Command = Literal["compare", "discover", "adopt", "next", "predict", "rounds"]
Document = dict[str, Any]
FORMAT = 5  # of documents: their keys are those of docs/json_and_python.md
LADDER = "ladder.json"  # errors after each adoption, shared by the studies that follow one another
ROUNDS: Command = "rounds"  # no command: what the rounds of simulations were about
STORED = {"rows"}  # of a race: what figures are drawn from is not printed
RECORD, PREDICTION = TypeAdapter(Record), TypeAdapter(PredictionPart)


@dataclass(frozen=True)
class Reply:
    """An answer of a command: its record, and what it is about."""

    command: Command
    about: Document  # study, table, versions, faults of the set-up, files written
    record: Any  # PredictionPart of `predict`, Record of the others
    posterior: Posterior | None = field(default=None, compare=False)  # of a new answer; it is not stored

    @property
    def document(self) -> Document:
        hidden = set() if self.command == "predict" else STORED
        return self.about | record_type(self.command).dump_python(self.record, mode="json", exclude=hidden)

    @property
    def units(self) -> TableUnits:
        return TableUnits.of(self.about)

    def vocabulary(self, *options: str, call: Callable[..., str] = shell_command) -> Vocabulary:
        """Names and units of the study, and its commands as the user gives them, with further options.

        A study that `adopt` wrote states its effect files itself.
        """
        about, rows, vault = self.about, mechanism_rows(), self.record.vault
        adopted_path = str(adopted_study_path(Path(about["study"]), vault.adopted)) if vault else ""

        def command_with_options(*words: str) -> str:
            alone = words[0] == "effects" or adopted_path in words
            return call(*words, *(() if alone else options))

        titles = {name: row["title"] for name, row in rows.items()}
        titles |= effect_titles(map(Path, about["effect_files"]))
        words = titles, {name: row[DOSE][-1] for name, row in rows.items()}
        results = str(answer_file(Path(about["results"]), Path(about["study"]).stem, "discover"))
        return Vocabulary(about["study"], command_with_options, self.units, *words, results, adopted_path)

    def answer(self, *options: str, call: Callable[..., str] = shell_command) -> lines.Answer:
        if self.command == "predict":
            return lines.prediction_answer(self.record, self.about, self.units)
        return lines.ANSWERS[self.command](self.record, self.vocabulary(*options, call=call))


def record_type(command: Command) -> TypeAdapter[Any]:
    return PREDICTION if command == "predict" else RECORD


def study_fields(study: Study) -> Document:
    """The part of every document that describes its study."""
    table = study.problem.measurements
    versions = {"taichi_erosion": __version__, "python": platform.python_version()}
    return {
        "format": FORMAT,
        "study": str(study.path),
        "title": study.file.study.title,
        "model": study.model,
        "measurements": study.file.study.measurements,
        "results": str(study.results),
        "digest": study.digest[:12],
        "adopted": list(study.file.adopted),
        "candidates": study.problem.candidate_names,
        "effect_files": [str(file.path) for file in study.effect_files],
        "units": dict(zip(table.observable, table.unit, strict=True)),
        KEY: asdict(table.table_units),
        "notes": list(study.notes),
        "rows_visible": table.size - len(study.problem.vault.rows),
        "rows_hidden": len(study.problem.vault.rows),
        "versions": versions | {name: version(name) for name in ("numpy", "scipy")},
    }


def with_adoption(record: Record, adopted: Record) -> Record:
    """A discovery that knows what `adopt` has found of what it names: a name that is refuted is not given."""
    effects, unseen = record.named, adopted.vault
    if unseen is None or set(unseen.adopted) != set(effects):
        return record
    fit = {each.name: getattr(adopted, each.name) for each in fields(FitPart)}
    fitted = replace(record, vault=unseen, **fit)
    none = {"named": (), "group": (), "refuted": effects, "mechanisms": {}, "sensitivity": {}}
    return fitted if naming_lowers_misfit(fitted) else replace(fitted, verdict="none_detected", **none)


def answer_file(folder: Path, stem: str, command: Command) -> Path:
    """File of the last answer of a command; studies that follow one another share a folder."""
    return folder / f"{stem}.{command}.json"


def write_reply(folder: Path, stem: str, reply: Reply) -> Reply:
    """Store an answer in place of an earlier one."""
    whole = reply.about | record_type(reply.command).dump_python(reply.record, mode="json")
    write_document(answer_file(folder, stem, reply.command), whole)
    return reply


def write_document(file: Path, content: Document) -> Path:
    return write_atomic(file, (json.dumps(content, indent=1, allow_nan=False) + "\n").encode())


def read_reply(folder: Path, stem: str, command: Command) -> Reply | None:
    """The last answer of a command; None if it has not been given in this format."""
    document = read_document(answer_file(folder, stem, command))
    if document is None or document.get("format") != FORMAT:
        return None
    try:
        record = record_type(command).validate_python(document)
    except ValidationError:
        raise BadInput(f"{answer_file(folder, stem, command)}: holds no result; ask again") from None
    about = {key: value for key, value in document.items() if not hasattr(record, key)}
    return Reply(command, about, record)


def read_document(file: Path) -> Document | None:
    """A stored document, None if there is none; raises BadInput for a damaged one."""
    if not file.exists():
        return None
    try:
        return dict(json.loads(read_text_file(file)))
    except (ValueError, TypeError, OSError) as error:
        raise BadInput(f"{file}: cannot be read ({error}); remove it and ask again") from None


def append_adoption_errors(study: Study, record: Record) -> list[Document]:
    """Errors per row on a table before the first adoption and after each, with this one where they fall."""
    vault, before, of = record.vault, list(study.file.adopted), study.digest[:12]
    ladder = read_document(study.results / LADDER) or {"rungs": []}

    def rung(effects: list[str], fitted: float, unseen: float | None) -> Document:
        return dict(of=of, effects=effects, chi2_per_row_fitted=fitted, chi2_per_row_held_out=unseen)

    rungs = [each for each in ladder["rungs"] if each["of"] == of]
    rungs = rungs or [rung(before, record.chi2_per_row_before, vault and vault.chi2_per_row_before)]
    if naming_lowers_misfit(record):
        acting = [*before, *record.named]
        earlier_rungs = [each for each in rungs if len(each["effects"]) < len(acting)]
        rungs = [*earlier_rungs, rung(acting, record.chi2_per_row_after, vault and vault.chi2_per_row_after)]
    write_document(study.results / LADDER, {"rungs": rungs})
    return rungs
