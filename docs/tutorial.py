"""Inserts the output of commands into docs/discover.md and other pages: `python docs/tutorial.py`.

A block after the mark `<!-- output: N -->` shows the first N lines of output of the command above it.
"""

import io
import os
import re
import shutil
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path
from unittest.mock import patch

from taichi_erosion.cli.main import main as run_command
from taichi_erosion.evidence.words.shell import NAME_SWITCH

DOCS = Path(__file__).resolve().parent
PAGES = (DOCS / "discover.md", DOCS / "threshold.md", DOCS / "your_table.md", DOCS / "predict.md")
INPUTS = (
    "measured/*.csv",
    "impact_threshold*.toml",
    "hao2022*_reduced.toml",
    "wind/answers.py",
    "wind/saturated.csv",
    "windkanal.csv",
    "prediction/grains_to_come.csv",
)
PRINTED = {NAME_SWITCH: "./erosion", "COLUMNS": "400"}  # sentences stay on their lines
COMMAND = r"```sh\n\./erosion (?P<words>[^\n]+)\n```\n\n<!-- output: (?P<lines>\d+) -->\n```text\n"
STEP = re.compile(rf"(?P<command>{COMMAND}).*?```", re.DOTALL)


def printed(words: str) -> list[str]:
    """Output lines of a command."""
    page = io.StringIO()
    with redirect_stdout(page):
        code = run_command(words.split())
    if code != 0:
        raise SystemExit(f"{words}: exit code {code}")
    return page.getvalue().splitlines()


def with_output(step: re.Match[str]) -> str:
    """One command with its output."""
    shown = printed(step["words"])[: int(step["lines"])]
    return step["command"] + "\n".join(shown) + "\n```"


def fill(page: str) -> str:
    """Page with new output of every command, run in a temporary copy of doe/."""
    with tempfile.TemporaryDirectory() as folder:
        for file in (file for pattern in INPUTS for file in (DOCS.parent / "doe").glob(pattern)):
            place = Path(folder) / file.relative_to(DOCS.parent)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, place)
        with chdir(folder), patch.dict(os.environ, PRINTED):
            return STEP.sub(with_output, page)


if __name__ == "__main__":
    for page in PAGES:
        page.write_text(fill(page.read_text(encoding="utf-8")), encoding="utf-8")
