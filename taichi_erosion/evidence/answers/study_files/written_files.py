"""Files of a new study: tidy table, scenes, study. They are written together, or not at all.

Where the study is there already, its tidy table is written anew; the study and its scenes stay as the user
has changed them. Rows keep what they became when rows were drawn for the vault (`held_out_rows.py`).
"""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
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
from taichi_erosion.evidence.data.tables.rows import PLACE, Faults, Table, tidy_fields, tidy_text
from taichi_erosion.evidence.models.load_study import Study, load_study
from taichi_erosion.scene.load import file_text

Document = dict[str, Any]
TIDY = "_tidy.csv"  # end of the name of a tidy table, which so is another one than that of the laboratory's
KNOWN_AGAIN = 0.5  # share of the earlier rows that a correction of the same table has again
UNTOLD = (
    "scene.",
    "vault.",
    "candidates.",
    "study.notes",
    "study.title",
    "study.made_from",
)  # of differences


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
    earlier_of = earlier_places(earlier.rows, files.rows)
    rows, again = len(earlier.rows.rows), sum(place is not None for place in earlier_of)
    if again < KNOWN_AGAIN * rows:
        raise BadInput(
            f"{files.study}: is a study of another table: {rows - again} of its {rows} rows are not "
            f"in {files.rows.file}; name another folder with --out"
        )
    inactive: dict[str, str] = {}
    was, now = map(plain_rows, (earlier.rows, files.rows))
    lines = [
        row.line
        for row, cells, place in zip(files.rows.rows, now, earlier_of, strict=True)
        if place is None or was[place] != cells
    ]
    same = not lines and again == rows
    written = files.paths if anew else [files.study] if same else [files.table, files.study]
    with all_or_none(written):
        if anew:
            text, inactive = with_candidates(files)
            new = study_text(replace(text, drawn_from=earlier.study.drawn_from))
        else:
            new = with_entry(earlier.text, ("study", "made_from"), files.text.made_from)
            new = with_entry(new, ("study", "made_from_digest"), files.text.made_from_digest, READ)
            if not same:
                new = with_entry(new, ("vault", "drawn_from"), earlier.study.drawn_from)
        if anew or not same:
            before = drawn_rows(earlier.study, earlier.rows)
            write_table(files, ["" if place is None else before[place] for place in earlier_of])
        write_atomic(files.study, new.encode())
        found = fitting(files, [] if new == earlier.text and same else written)
    kept = [] if anew else list(differences(files))
    changes = {"lines": list(dict.fromkeys(lines)), "removed": rows - again}
    return {**found, "inactive": inactive, "changes": changes, "kept": kept}


def plain_rows(table: Table) -> list[dict[str, str]]:
    """Cells of every row, but for what the vault makes of it and its place in the file."""
    return [
        {name: text for name, text in row.items() if name != "vault" and text and not PLACE.fullmatch(text)}
        for row in tidy_fields(table)
    ]


def earlier_places(before: Table, after: Table) -> list[int | None]:
    """Of every new row its place in the earlier version; None for a row that was added.

    A row is known by its cells, else by its place in a table of equal length, else by its conditions.
    """
    was, now = plain_rows(before), plain_rows(after)
    at = [[(row.observable, row.conditions) for row in table.rows] for table in (before, after)]
    found: list[int | None] = [None] * len(now)
    places = [range(len(was)), range(len(now))]
    alike: list[tuple[Sequence[Any], Sequence[Any]]] = [(was, now), (at[0], at[1])]
    if len(was) == len(now):
        alike.insert(1, (places[0], places[1]))
    for old, new in alike:
        free = [place for place in places[0] if place not in found]
        for k in places[1]:
            if found[k] is None and (place := next((i for i in free if old[i] == new[k]), None)) is not None:
                found[k] = place
                free.remove(place)
    return found


def fitting(files: StudyFiles, written: Sequence[Path]) -> Document:
    """What was written; raises BadInput where the study that is there does not fit the corrected table."""
    try:
        return {"written": list(map(str, written)), **check_study(files.study)}
    except BadInput as error:
        remedy = "the study that is there does not fit the corrected table; correct it, or write it anew "
        raise BadInput(*error.faults, f"{files.study}: {remedy}with --anew") from None


def differences(files: StudyFiles) -> Iterator[str]:
    """Entries of the study and its scenes that a new one would have otherwise."""
    fresh = {files.study: study_text(replace(files.text, measurements=files.table.name))}
    fresh |= {files.scene(name): text for name, text in files.scenes.items()}
    for path, text in fresh.items():
        there = tomllib.loads(file_text(path, str(path))) if path.exists() else {}
        now, other = (dict(flat(each)) for each in (there, tomllib.loads(text)))
        names = (name for name in {**now, **other} if not name.startswith(UNTOLD))
        yield from (name for name in names if now.get(name) != other.get(name))


def flat(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Entries of nested tables by dotted path."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value
