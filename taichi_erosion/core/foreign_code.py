"""The line that names a Python file of the user's before it runs."""

import sys
from pathlib import Path

from taichi_erosion.core.files import one_line_name

told: set[Path] = set()  # files that this process has named


def tell_execution(path: Path, named_by: str) -> None:
    """Print `executes FILE (named by SCENE-OR-STUDY)` on stderr, once a file."""
    file = path.resolve()
    if file in told:
        return
    told.add(file)
    here = Path.cwd()
    shown = file.relative_to(here) if file.is_relative_to(here) else file
    sys.stderr.write(f"executes {one_line_name(shown)} (named by {named_by})\n")
