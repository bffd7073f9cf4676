"""Fills the tutorial with what its commands print: `python docs/tutorial.py`.

A block behind the mark `<!-- output: N -->` shows the first N lines of the command above it.
"""

import io
import os
import re
import shutil
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path

from taichi_erosion.cli.main import main as command

DOCS = Path(__file__).resolve().parent
PAGE = DOCS / "discover.md"
ORDER = r"```sh\n\./erosion (?P<words>[^\n]+)\n```\n\n<!-- output: (?P<lines>\d+) -->\n```text\n"
STEP = re.compile(rf"(?P<order>{ORDER}).*?```", re.DOTALL)


def printed(words: str) -> list[str]:
    """Lines that a command prints."""
    page = io.StringIO()
    with redirect_stdout(page):
        code = command(words.split())
    if code != 0:
        raise SystemExit(f"{words}: exit code {code}")
    return page.getvalue().splitlines()


def filled(step: re.Match[str]) -> str:
    """One step of the tutorial with its output."""
    shown = printed(step["words"])[: int(step["lines"])]
    return step["order"] + "\n".join(shown) + "\n```"


def fill(page: str) -> str:
    """The page with every output made afresh, in a copy of doe/ so that no results are left behind."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(DOCS.parent / "doe" / "measured", Path(folder) / "doe" / "measured")
        for study in (DOCS.parent / "doe").glob("*_reduced.toml"):
            shutil.copy(study, Path(folder) / "doe")
        with chdir(folder):
            return STEP.sub(filled, page)


if __name__ == "__main__":
    os.environ["COLUMNS"] = "400"  # sentences stay on their lines
    PAGE.write_text(fill(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
