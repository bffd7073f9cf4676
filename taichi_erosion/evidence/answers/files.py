"""Answers in the results folder: what an answer is about, its record, and the ladder of adoptions.

A file `STUDY.COMMAND.json` holds the keys of docs/json_and_python.md, and under `record` all that pages are
drawn from.
"""

import json
import platform
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from math import isfinite, nan
from pathlib import Path
from typing import Any, Literal

from pydantic import TypeAdapter, ValidationError

from taichi_erosion import __version__
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file, write_atomic
from taichi_erosion.effects import effect_titles
from taichi_erosion.evidence.data.table_units import KEY, TableUnits
from taichi_erosion.evidence.models.adopted_files import adopted_study
from taichi_erosion.evidence.models.load_study import Study
from taichi_erosion.evidence.race.posterior import Posterior
from taichi_erosion.evidence.race.record import DecisionPart, EffectPart, HeldOutPart, Interval, Record
from taichi_erosion.evidence.words import answer_lines as lines
from taichi_erosion.evidence.words import shell_command
from taichi_erosion.evidence.words.vocabulary import Vocabulary
from taichi_erosion.measures.result import without_nan
from taichi_erosion.mechanisms.library import dose_meaning, mechanism_rows

Command = Literal["compare", "discover", "adopt", "next", "predict", "rounds"]
Document = dict[str, Any]
FORMAT = 4  # of documents: their keys are those of docs/json_and_python.md
LADDER = "ladder.json"  # errors after each adoption, shared by the studies that follow one another
ROUNDS: Command = "rounds"  # no command: what the rounds of simulations were about
STORED = ("record", "rows")  # of a document: what figures are drawn from is not printed
LIBRARIES = ("numpy", "scipy")
RECORD = TypeAdapter(Record)


@dataclass(frozen=True)
class Reply:
    """An answer of a command: its record, and what it is about."""

    command: Command
    about: Document  # study, table, versions, faults of the set-up, files written
    record: Record
    posterior: Posterior | None = field(default=None, compare=False)  # of a new answer; it is not stored

    @property
    def document(self) -> Document:
        """What `--json` prints."""
        return self.about | document(self.record)

    def vocabulary(self, *options: str, call: Callable[..., str] = shell_command) -> Vocabulary:
        """Names and units of the study, and its commands as the user gives them, with further options.

        A study that `adopt` wrote states its effect files itself.
        """
        about, rows, held = self.about, mechanism_rows(), self.record.held_out
        written = str(adopted_study(Path(about["study"]), held.adopted)) if held else ""

        def command(*words: str) -> str:
            alone = words[0] == "effects" or written in words
            return call(*words, *(() if alone else options))

        return Vocabulary(
            about["study"],
            command,
            TableUnits.of(about),
            {n: row["title"] for n, row in rows.items()} | effect_titles(map(Path, about["effect_files"])),
            {name: dose_meaning(name) for name in rows},
            str(document_file(Path(about["results"]), Path(about["study"]).stem, "discover")),
            written,
        )

    def answer(self, *options: str, call: Callable[..., str] = shell_command) -> lines.Answer:
        """Sentences and table."""
        return lines.ANSWERS[self.command](self.record, self.vocabulary(*options, call=call))


def study_document(study: Study) -> Document:
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
        KEY: table.table_units.record(),
        "notes": list(study.notes),
        "rows_visible": table.size - len(study.problem.vault.rows),
        "rows_hidden": len(study.problem.vault.rows),
        "versions": versions | {name: version(name) for name in LIBRARIES},
    }


def printed_document(found: Mapping[str, Any]) -> Document:
    """A document as printed: what figures are drawn from stays in the results folder."""
    return {key: value for key, value in found.items() if key not in STORED}


def after_adoption(record: Record, adopted: Record) -> Record:
    """A discovery that knows what `adopt` has found of what it names: a name that is refuted is not given."""
    named, held = record.decided.named, adopted.held_out
    if held is None or set(held.adopted) != set(named):
        return record
    told = replace(record, held_out=held, fit=adopted.fit)
    none = replace(record.decided, verdict="none_detected", named=(), group=(), refuted=named)
    return told if told.improves else replace(told, decided=none, law=None, sensitivity={})


def document_file(folder: Path, stem: str, command: Command) -> Path:
    """File of the last answer of a command; studies that follow one another share a folder."""
    return folder / f"{stem}.{command}.json"


def write_reply(folder: Path, stem: str, reply: Reply) -> Reply:
    """Store an answer in place of an earlier one."""
    whole = reply.document | {"record": storable(RECORD.dump_python(reply.record, mode="json"))}
    write_document(document_file(folder, stem, reply.command), whole)
    return reply


def storable(value: Any) -> Any:
    """Nested tables with "nan" and "inf" for numbers that JSON does not have."""
    if isinstance(value, dict):
        return {key: storable(each) for key, each in value.items()}
    if isinstance(value, list):
        return [storable(each) for each in value]
    return str(value) if isinstance(value, float) and not isfinite(value) else value


def write_document(file: Path, found: Document) -> Path:
    """Write a document in place of an earlier one."""
    return write_atomic(file, (json.dumps(found, indent=1, allow_nan=False) + "\n").encode())


def read_reply(folder: Path, stem: str, command: Command) -> Reply | None:
    """The last answer of a command; None if it has not been given in this format."""
    document = read_document(document_file(folder, stem, command))
    if document is None or document.get("format") != FORMAT:
        return None
    try:
        record = RECORD.validate_python(document["record"])
    except (ValidationError, KeyError):
        raise BadInput(f"{document_file(folder, stem, command)}: holds no result; ask again") from None
    about = {key: value for key, value in document.items() if key not in STORED}
    return Reply(command, about, record)


def read_document(file: Path) -> Document | None:
    """A stored document, None if there is none; raises BadInput for a damaged one."""
    if not file.exists():
        return None
    try:
        return dict(json.loads(read_text_file(file)))
    except (ValueError, TypeError, OSError) as error:
        raise BadInput(f"{file}: cannot be read ({error}); remove it and ask again") from None


def extended_ladder(study: Study, record: Record) -> list[Document]:
    """Errors per row on a table before the first adoption and after each, with this one where they fall."""
    fit, held, before, of = record.fit, record.held_out, list(study.file.adopted), study.digest[:12]
    ladder = read_document(study.results / LADDER) or {"rungs": []}

    def rung(effects: list[str], fitted: float, unseen: float | None) -> Document:
        errors = {"chi2_per_row_fitted": fitted / fit.n, "chi2_per_row_held_out": unseen}
        return {"of": of, "effects": effects} | errors

    rungs = [each for each in ladder["rungs"] if each["of"] == of]
    rungs = rungs or [rung(before, fit.chi2_before, held and held.before)]
    if record.improves:
        acting = [*before, *record.decided.named]
        kept = [each for each in rungs if len(each["effects"]) < len(acting)]
        rungs = [*kept, rung(acting, fit.chi2_after, held and held.after)]
    write_document(study.results / LADDER, {"rungs": rungs})
    return rungs


def document(record: Record) -> Document:
    """Keys of the contract; `chi2` is a total, and per row where the name says so."""
    decided, fit, cost, parts = record.decided, record.fit, record.cost, asdict(record)
    columns = parts["rows"] | {
        key: parts["rows"][key].tolist() for key in ("measured", "low", "high", "sd", "before", "after")
    }
    columns["conditions"] = {name: column.tolist() for name, column in record.rows.conditions.items()}
    comparison = {"where": parts["where"], "repeats": parts["repeats"], "rows": columns}
    comparison |= answer(decided)
    told = ("n", "chi2_before", "chi2_after", "p_lack_of_fit", "p_lack_of_fit_after")
    comparison |= {key: parts["fit"][key] for key in told}
    comparison |= {
        "p": decided.familywise,
        "effects": {name: effect(part) for name, part in record.effects.items()},
        "parameters": {path: each | each.pop("now") for path, each in parts["numbers"].items()},
        "levels": [each | each.pop("size") for each in parts["levels"]],
        "errors": [each | each.pop("size") for each in parts["errors"]],
        "chi2_per_row_before": fit.chi2_before / max(fit.n, 1),
        "chi2_per_row_after": fit.chi2_after / max(fit.n, 1),
        "p_misfit": fit.p_before,
        "p_misfit_after": fit.p_after,
        "curves": [c | {"points": [{"at": x, **y} for x, y in c["points"]]} for c in parts["curves"]],
        "vault": None if record.held_out is None else vault(record.held_out),
        "next_experiments": parts["experiments"],
        "mechanisms": mechanisms(record),
        "fresh_runs": parts["fresh"],
        "sensitivity": {prior: list(map(answer, own)) for prior, own in record.sensitivity.items()},
        "wall_s": cost.seconds,
    }
    comparison |= {key: parts["cost"][key] for key in ("runs", "settings", "stopped", "seed")}
    return without_nan(comparison)


def answer(decided: DecisionPart) -> Document:
    """What is said."""
    return {key: getattr(decided, key) for key in ("verdict", "named", "group", "together", "probabilities")}


def effect(part: EffectPart) -> Document:
    """One candidate; an excluded one lies between 0 and what 99 % lie below."""
    told = Interval(nan, 0.0, part.limit) if part.status == "excluded" else part.strength
    return asdict(part) | {"strength": told.value, "strength_low": told.low, "strength_high": told.high}


def vault(held: HeldOutPart) -> Document:
    """Errors of the held-out rows: totals, and per row."""
    found = {key: getattr(held, key) for key in ("opened", "n", "p_after", "adopted", "wrong_effect")}
    for key, value in (("before", held.before), ("after", held.after), ("wrong_effect", held.wrong)):
        found |= {f"chi2_{key}": held.n * value, f"chi2_per_row_{key}": value}
    return found


def mechanisms(record: Record) -> Document:
    """Mechanisms, and what has a law, by name: probability, doses, law."""
    names = (*record.decided.mechanisms, *([record.law.mechanism] if record.law else []))
    shares = record.decided.probabilities
    documents: Document = {n: {"probability": shares.get(n, 0.0), "doses": [], "law": None} for n in names}
    if record.law is not None:
        law, powers = asdict(record.law), record.law.exponents.items()
        doses = [{"conditions": at, "dose": dose["value"], **dose} for at, dose in law.pop("doses")]
        ends = {"exponents": "value", "low": "low", "high": "high"}
        law |= {key: {name: getattr(power, end) for name, power in powers} for key, end in ends.items()}
        documents[record.law.mechanism] |= {"doses": doses, "law": law}
    return documents
