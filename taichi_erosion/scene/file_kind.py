"""What a file is, where a command is given one of another kind: a table for a study, a scene for a table.

Only what its name or its sections make certain is told; any other file is left to its own reader.
"""

import shlex
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name, read_text_file

Wanted = Literal["table", "study", "scene"]
ENDINGS: Mapping[str, str] = {
    **dict.fromkeys((".csv", ".tsv", ".xlsx", ".xlsm", ".xls", ".ods"), "table"),
    **dict.fromkeys((".rrd",), "recording"),
    **dict.fromkeys((".json", ".html", ".htm"), "result"),
    **dict.fromkeys((".py",), "effect"),
    **dict.fromkeys((".png", ".jpg", ".jpeg", ".pdf", ".npz", ".docx"), "other"),
}
REMEDIES: Mapping[str, str] = {
    "table": "is a table of measurements; make a study of it: ./erosion study new {path}",
    "study": "is a study; the commands on it are: ./erosion study check {path}, ./erosion compare {path}",
    "scene": "is a scene; simulate it: ./erosion run {path}",
    "recording": "is the recording of a run; look at it: ./erosion view {path}",
    "result": "is a result of this program, not its input",
    "effect": "is a Python file; an effect file is named beside a study or a scene: --effect {path}",
    "other": "is no text of this program",
}
NAMED = 3  # files of a folder that a message names


def refuse_other_kind(path: Path, wanted: Wanted) -> None:
    """Refuse a file that is certainly of another kind than wanted; raises BadInput with the right command."""
    refuse_other_name(path, wanted)
    refuse_kind(path, file_kind(path), wanted)


def refuse_other_name(path: Path, wanted: Wanted) -> None:
    """The same for a folder, and by the ending of the name; the file is not read."""
    if path.is_dir():
        raise BadInput(f"{one_line_name(path)}: is a folder; {folder_remedy(path, wanted)}")
    refuse_kind(path, ENDINGS.get(path.suffix.lower()), wanted)


def refuse_other_sections(path: Path, table: Mapping[str, Any], wanted: Wanted) -> None:
    """The same for a TOML file that has been read, by its sections."""
    if path.suffix.lower() == ".toml":
        refuse_kind(path, toml_kind(table), wanted)


def refuse_kind(path: Path, found: str | None, wanted: Wanted) -> None:
    """Refuse a file whose kind is known and not the wanted one."""
    if found is not None and found != wanted and path.is_file():
        name = one_line_name(path)
        raise BadInput(f"{name}: {REMEDIES[found].format(path=shlex.quote(name))}; a {wanted} is wanted here")


def refuse_neither(path: Path) -> None:
    """Refuse what is certainly neither a study nor a run, for commands that take both; raises BadInput."""
    if path.is_dir() or file_kind(path) in ("table", "effect", "scene"):
        refuse_other_kind(path, "study")


def file_kind(path: Path) -> str | None:
    """Kind of a file; None where its name does not tell, or its content cannot be read."""
    if path.suffix.lower() != ".toml":
        return ENDINGS.get(path.suffix.lower())
    try:
        return toml_kind(tomllib.loads(read_text_file(path)))
    except (OSError, ValueError, RecursionError):
        return None


def toml_kind(table: Mapping[str, Any]) -> str | None:
    """Kind of a TOML file by its sections; None for one that has neither those of a study nor of a scene."""
    if "study" in table or "observables" in table:
        return "study"
    return "scene" if "scene" in table or "grains" in table else None


def folder_remedy(folder: Path, wanted: Wanted) -> str:
    """What to name in place of a folder."""
    try:
        there = sorted(path.name for path in folder.iterdir() if file_kind(path) == wanted)
    except OSError:
        there = []
    if not there:
        return f"name a {wanted}"
    more = ", ..." if len(there) > NAMED else ""
    return f"name a {wanted} in it: {', '.join(there[:NAMED])}{more}"
