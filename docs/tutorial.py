"""Fills the tutorial and the thresholds with what their commands print: `python docs/tutorial.py`.

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
PAGES = (DOCS / "discover.md", DOCS / "threshold.md")
READ = (
    "measured/*.csv",
    "impact_threshold*.toml",
    "hao2022*_reduced.toml",
    "wind/answers.py",
    "wind/saturated.csv",
)
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
        for file in (file for pattern in READ for file in (DOCS.parent / "doe").glob(pattern)):
            place = Path(folder) / file.relative_to(DOCS.parent)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, place)
        with chdir(folder):
            return STEP.sub(filled, page)


if __name__ == "__main__":
    os.environ["COLUMNS"] = "400"  # sentences stay on their lines
    for page in PAGES:
        page.write_text(fill(page.read_text(encoding="utf-8")), encoding="utf-8")
