"""Python files of the user's own that this program runs: effects, read once and known by their content.

A file is read when a command begins, and a line on stderr names it. All its runs, on workers of this machine
or of a cluster, execute that text, and its digest is part of what a run is known by.
"""

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name, read_text_file

SUFFIX = ".py"
DIGITS = 12  # hexadecimal, of a digest
OPTION = "--effect"  # what names a file that neither a scene nor a study names
NAMED: set[Path] = set()  # files that this process has named


@dataclass(frozen=True)
class EffectFile:
    """A Python file with an effect, as it was read."""

    path: Path  # absolute
    text: str

    @property
    def digest(self) -> str:
        """Name of the content."""
        return sha256(self.text.encode()).hexdigest()[:DIGITS]

    def __str__(self) -> str:
        """The path as messages show it."""
        return short_path(self.path)


def short_path(path: Path) -> str:
    """An absolute path, relative where it lies below the working folder."""
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def tell_execution(path: Path, named_by: str) -> None:
    """Write `executes FILE (named by SCENE-OR-STUDY)` on stderr, once a file, before it runs."""
    file = path.resolve()
    if file not in NAMED:
        NAMED.add(file)
        sys.stderr.write(f"executes {one_line_name(short_path(file))} (named by {one_line_name(named_by)})\n")


def read_effect_file(path: Path, named_by: str = OPTION) -> EffectFile:
    """The file at a path, which will be executed. Raises BadInput where there is no Python file."""
    name = one_line_name(path)
    try:
        if path.suffix != SUFFIX:
            raise BadInput(f"{name}: no such Python file; an effect is a file that ends in {SUFFIX}")
        file = EffectFile(path.resolve(), read_text_file(path, "utf-8-sig"))
    except FileNotFoundError:
        raise BadInput(f"{name}: no such Python file") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{name}: cannot be read: {error}") from None
    tell_execution(path, named_by)
    return file


def read_effect_files(
    paths: Iterable[str | Path], folder: Path = Path(), named_by: str = OPTION
) -> tuple[EffectFile, ...]:
    """Files named relative to a folder; one that is named twice counts once. Raises BadInput."""
    return tuple(dict.fromkeys(read_effect_file(folder / path, named_by) for path in paths))
