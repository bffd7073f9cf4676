"""Files of a new study: tidy table, scenes, study. They are written together, or not at all.

A study whose table was corrected after `study new`.

The tidy table is written anew. The study and its scenes stay as they are, with what the user has changed in
them; what a new study would say otherwise is told. Rows keep what they became when rows were drawn for the
vault, and its openings go on being counted (`held_out_rows.py`).
"""

import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.study_file import read_evidence_study, with_entry
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.study_files.check_study import acting_candidates, check_study
from taichi_erosion.evidence.answers.study_files.study_text import READ, StudyText, study_text
from taichi_erosion.evidence.data.held_out_rows import stated_rows
from taichi_erosion.evidence.data.measured import read_table
from taichi_erosion.evidence.data.problem import Drawn
from taichi_erosion.evidence.data.tables.rows import Faults, Table, tidy_text
from taichi_erosion.evidence.data.tables.table_changes import TableChanges, table_changes
from taichi_erosion.evidence.models.load_study import Study, load_study
from taichi_erosion.scene.load import file_text

Document = dict[str, Any]
TIDY = "_tidy.csv"  # end of the name of a tidy table, which so is another one than that of the laboratory's
KNOWN_AGAIN = 0.5  # share of the earlier rows that a correction of the same table has again
UNTOLD = ("study.notes", "study.title", "scene.title", "scene.notes", "study.made_from")  # of differences
UNTOLD += ("study.made_from_digest", "vault.drawn_from", "candidates.effects")
LONGEST = 60  # characters of an entry that is told


@dataclass(frozen=True)
class StudyFiles:
    """A study before it is written."""

    folder: Path
    stem: str  # name of the laboratory's table, without its ending
    text: StudyText
    rows: Table
    scenes: Mapping[str, str]  # name -> text

    @property
    def study(self) -> Path:
        return self.folder / f"{self.stem}.toml"

    @property
    def table(self) -> Path:
        return self.folder / f"{self.stem}{TIDY}"

    def scene(self, name: str) -> Path:
        """File of a scene."""
        return self.folder / f"{name}.toml"

    @property
    def paths(self) -> list[Path]:
        """All files, the study first."""
        return [self.study, self.table, *map(self.scene, self.scenes)]


def written_files(files: StudyFiles) -> Document:
    """Write a new study; the document says what it holds. Raises BadInput where a file is there already."""
    for path in files.paths:
        if path.exists():
            raise BadInput(f"{path}: exists; remove it, or name another folder with --out")
    with all_or_none(files.paths):
        text, inactive = with_candidates(files)
        study = load_study(files.study)
        write_table(files, drawn_rows(study, files.rows))
        write_atomic(files.study, study_text(replace(text, drawn_from=study.digest)).encode())
        return {"written": list(map(str, files.paths)), **check_study(files.study), "inactive": inactive}


def with_candidates(files: StudyFiles) -> tuple[StudyText, dict[str, str]]:
    """Write a study whose candidates can act; its text, and why the others cannot."""
    text, inactive = replace(files.text, measurements=files.table.name), {}
    write_table(files, [row.drawn for row in files.rows.rows])
    for name, content in files.scenes.items():
        write_atomic(files.scene(name), content.encode())
    write_atomic(files.study, study_text(text).encode())
    if not text.model:
        acting, inactive = acting_candidates(load_study(files.study))
        text = replace(text, candidates=tuple(acting))
        write_atomic(files.study, study_text(text).encode())
    return text, inactive


def write_table(files: StudyFiles, drawn: Sequence[Drawn]) -> None:
    """Write the tidy table, with what became of every row when rows were drawn for the vault."""
    rows = [replace(row, drawn=was) for row, was in zip(files.rows.rows, drawn, strict=True)]
    write_atomic(files.table, tidy_text(replace(files.rows, rows=tuple(rows))).encode())


def drawn_rows(study: Study, table: Table) -> list[Drawn]:
    """What became of every row of a study's tidy table when rows were drawn for the vault.

    Nothing is told of rows that the study does not use, and of those that a stated range or source holds out.
    """
    used = [k for k, row in enumerate(table.rows) if row.observable in study.file.observables]
    hidden = set(study.problem.vault.rows.tolist())
    vault = study.file.vault
    inside = stated_rows(study.problem.measurements, vault.ranges, vault.sources)
    found: list[Drawn] = [""] * len(table.rows)
    for k, row in enumerate(used):
        found[row] = "" if inside[k] else "held out" if k in hidden else "fitted"
    return found


@contextmanager
def all_or_none(paths: Sequence[Path]) -> Iterator[None]:
    """Files that are as before where the block refuses what it is given (BadInput)."""
    before = {path: path.read_bytes() if path.is_file() else None for path in paths}
    folder = next((path.parent for path in paths if not path.parent.exists()), None)
    try:
        yield
    except BadInput:
        for path, content in before.items():
            if content is None:
                path.unlink(missing_ok=True)
            else:
                write_atomic(path, content)
        if folder is not None and folder.is_dir() and not any(folder.iterdir()):
            folder.rmdir()
        raise


@dataclass(frozen=True)
class EarlierStudy:
    """A study of the same table that is there already."""

    study: Study
    text: str
    rows: Table


def earlier_study(folder: Path, stem: str) -> EarlierStudy | None:
    """The study of a table that is there, None where nothing is. Raises BadInput for another's."""
    path, table = folder / f"{stem}.toml", folder / f"{stem}{TIDY}"
    there = [each for each in (path, table) if each.exists()]
    if not there:
        return None
    if len(there) == 1 or read_evidence_study(path).study.measurements != table.name:
        raise BadInput(f"{there[0]}: exists; remove it, or name another folder with --out")
    faults = Faults()
    study = faults.of(load_study, path)
    rows = faults.of(read_table, table, table.name)
    if study is None or rows is None:
        raise BadInput(*faults, f"{path}: is there and cannot be used; correct it, or name another folder")
    return EarlierStudy(study, file_text(path, str(path)), rows)


def corrected_study(earlier: EarlierStudy, files: StudyFiles, anew: bool) -> Document:
    """Correct the table of a study; `anew`: write its scenes and the study too.

    Raises BadInput where it is another table, or where the study does not fit it; then nothing is written.
    """
    changes, rows = table_changes(earlier.rows, files.rows), len(earlier.rows.rows)
    if rows - len(changes.removed) < KNOWN_AGAIN * rows:
        raise BadInput(
            f"{files.study}: is a study of another table: {len(changes.removed)} of its {rows} rows are not "
            f"in {files.rows.file}; name another folder with --out"
        )
    inactive: dict[str, str] = {}
    written = files.paths if anew else [files.study] if changes.none else [files.table, files.study]
    with all_or_none(written):
        if anew:
            text, inactive = with_candidates(files)
            new = study_text(replace(text, drawn_from=earlier.study.drawn_from))
        else:
            new = with_entry(earlier.text, ("study", "made_from"), files.text.made_from)
            new = with_entry(new, ("study", "made_from_digest"), files.text.made_from_digest, READ)
            if not changes.none:
                new = with_entry(new, ("vault", "drawn_from"), earlier.study.drawn_from)
        if anew or not changes.none:
            before = drawn_rows(earlier.study, earlier.rows)
            write_table(files, ["" if place is None else before[place] for place in changes.earlier])
        write_atomic(files.study, new.encode())
        found = fitting(files, [] if new == earlier.text and changes.none else written)
    kept = [] if anew else list(differences(files))
    return {**found, "inactive": inactive, "changes": changes_document(earlier, changes), "kept": kept}


def fitting(files: StudyFiles, written: Sequence[Path]) -> Document:
    """What was written; raises BadInput where the study that is there does not fit the corrected table."""
    try:
        return {"written": list(map(str, written)), **check_study(files.study)}
    except BadInput as error:
        remedy = "the study that is there does not fit the corrected table; correct it, or write it anew "
        raise BadInput(*error.faults, f"{files.study}: {remedy}with --anew") from None


def changes_document(earlier: EarlierStudy, changes: TableChanges) -> Document:
    """Changes of a table as plain values."""
    gone = [earlier.rows.rows[place] for place in changes.removed]
    return {
        "cells": [asdict(change) for change in changes.cells],
        "units": [list(change) for change in changes.units],
        "added": list(changes.added),
        "removed": [row.source or f"row {row.line}" for row in gone],
    }


def differences(files: StudyFiles) -> Iterator[str]:
    """What a new study of the table would say otherwise than the one that is there, one line each."""
    fresh = {files.study: study_text(replace(files.text, measurements=files.table.name))}
    fresh |= {files.scene(name): text for name, text in files.scenes.items()}
    for path, text in fresh.items():
        if not path.exists():
            yield f"{path} is not there; a new study would have it"
            continue
        now, other = (flat(tomllib.loads(each)) for each in (file_text(path, str(path)), text))
        for name in dict.fromkeys((*now, *other)):
            if now.get(name) != other.get(name) and name not in UNTOLD:
                there = f"{name} = {now[name]} stays" if name in now else f"{name} is not there"
                yield f"{path}: {there}; a new study would have {other.get(name, 'no such entry')}"


def flat(table: Mapping[str, Any], above: str = "") -> dict[str, str]:
    """Entries of nested tables by dotted path, as short texts."""
    found: dict[str, str] = {}
    for key, value in table.items():
        path = f"{above}{key}"
        if isinstance(value, Mapping):
            found |= flat(value, f"{path}.")
        else:
            text = json.dumps(value, ensure_ascii=False, default=str)
            found[path] = text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."
    return found
