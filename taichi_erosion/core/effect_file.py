"""Python files with effects of the user's own: read once, known by their content.

A file is read when a command begins. All its runs, on workers of this machine or of a cluster, execute that
text, and its digest is part of what a run is known by.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name, read_text_file

SUFFIX = ".py"
DIGITS = 12  # hexadecimal, of a digest


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
        """The path as messages show it: relative where it lies below the working folder."""
        here = Path.cwd()
        return str(self.path.relative_to(here) if self.path.is_relative_to(here) else self.path)


def read_effect_file(path: Path) -> EffectFile:
    """The file at a path. Raises BadInput where there is no Python file."""
    name = one_line_name(path)
    try:
        if path.suffix != SUFFIX:
            raise BadInput(f"{name}: no such Python file; an effect is a file that ends in {SUFFIX}")
        return EffectFile(path.resolve(), read_text_file(path, "utf-8-sig"))
    except FileNotFoundError:
        raise BadInput(f"{name}: no such Python file") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{name}: cannot be read: {error}") from None


def read_effect_files(paths: Iterable[str | Path], folder: Path = Path()) -> tuple[EffectFile, ...]:
    """Files named relative to a folder; one that is named twice counts once. Raises BadInput."""
    return tuple(dict.fromkeys(read_effect_file(folder / path) for path in paths))
