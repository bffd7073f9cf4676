"""Studies made of tables, and commands of the evidence loop, without a shell."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from taichi_erosion.evidence.answers import commands
from taichi_erosion.evidence.answers.files import Command, Reply
from taichi_erosion.evidence.answers.new_study import NewStudyOptions, write_new_study
from taichi_erosion.evidence.models.load_study import NO_OPTIONS, Study, StudyOptions, load_study

SILENT = ("none_detected", "not_testable")  # verdicts that name nothing
Rows = (
    str | bytes | Sequence[str | Sequence[object]]
)  # a table as a text, its content, its lines or its cells


def closed_form_study(folder: Path, rows: Rows, name: str = "t.csv", **wishes) -> tuple[Study, list[str]]:
    """The study of a table by the closed form, where nobody answers, and what was assumed."""
    if not isinstance(rows, str | bytes):
        rows = "".join((row if isinstance(row, str) else ";".join(map(str, row))) + "\n" for row in rows)
    folder.mkdir(exist_ok=True)
    (folder / name).write_bytes(rows if isinstance(rows, bytes) else rows.encode())
    asked: dict[str, Any] = {"closed_form": True, "anew": True} | wishes
    document = write_new_study(folder / name, NewStudyOptions(**asked), lambda _, guess: guess)
    return load_study(Path(document["study"])), document["assumed"]


def no_progress(_: str, __: float) -> None:
    """Progress that nobody wants to see."""


def ask(command: Command, path: Path, *effects: str, options: StudyOptions = NO_OPTIONS) -> Reply:
    if command == "adopt":
        return commands.adopt_study(path, effects, no_progress, options)
    asked = {"compare": commands.compare_study, "discover": commands.discover_study}
    return (asked | {"next": commands.next_study})[command](path, no_progress, options)
