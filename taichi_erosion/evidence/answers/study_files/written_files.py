"""Files of a new study: tidy table, scenes, study. They are written together, or not at all."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.evidence.answers.study_files.check_study import acting_candidates, check_study
from taichi_erosion.evidence.answers.study_files.study_text import StudyText, study_text, table_text
from taichi_erosion.evidence.data.held_out_rows import stated_rows
from taichi_erosion.evidence.data.problem import Drawn
from taichi_erosion.evidence.data.tables.spreadsheet import Cells
from taichi_erosion.evidence.models.load_study import Study, load_study

Document = dict[str, Any]
TIDY = "_tidy.csv"  # end of the name of a tidy table, which so is another one than that of the laboratory's
PLACE = 6  # of the column `vault` in a tidy table: behind `group`


@dataclass(frozen=True)
class StudyFiles:
    """A study before it is written."""

    folder: Path
    stem: str  # name of the laboratory's table, without its ending
    text: StudyText
    tidy: Cells
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
        text = replace(text, drawn_from=study.digest)
        write_table(files, drawn_rows(study, files.tidy))
        write_atomic(files.study, study_text(text).encode())
        return {
            "written": [str(path) for path in files.paths],
            **check_study(files.study),
            "inactive": inactive,
        }


def with_candidates(files: StudyFiles) -> tuple[StudyText, dict[str, str]]:
    """Write a study whose candidates can act; its text, and why the others cannot."""
    text, inactive = replace(files.text, measurements=files.table.name), {}
    write_table(files, ("",) * len(files.tidy.lines))
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
    write_atomic(files.table, table_text(with_drawn(files.tidy, drawn)).encode())


def with_drawn(tidy: Cells, drawn: Sequence[Drawn]) -> Cells:
    """A tidy table with its column `vault`."""
    first, heading = tidy.rows[0]
    here = heading.index("vault") if "vault" in heading else None
    rows = [(first, with_cell(heading, here, "vault"))]
    rows += [(line, with_cell(row, here, was)) for (line, row), was in zip(tidy.lines, drawn, strict=True)]
    return replace(tidy, rows=tuple(rows))


def with_cell(row: Sequence[str], here: int | None, text: str) -> tuple[str, ...]:
    """A row with a cell replaced, or put into the place of the column `vault`."""
    start, rest = (min(PLACE, len(row)),) * 2 if here is None else (here, here + 1)
    return (*row[:start], text, *row[rest:])


def drawn_rows(study: Study, tidy: Cells) -> list[Drawn]:
    """What became of every row of a study's tidy table when rows were drawn for the vault.

    Nothing is told of rows that the study does not use, and of those that a stated range or source holds out.
    """
    place = [cell.partition("[")[0].strip() for cell in tidy.heading].index("observable")
    used = [row for row, (_, cells) in enumerate(tidy.lines) if cells[place] in study.file.observables]
    hidden = set(study.problem.vault.rows.tolist())
    vault = study.file.vault
    inside = stated_rows(study.problem.measurements, vault.ranges, vault.sources)
    found: list[Drawn] = [""] * len(tidy.lines)
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
