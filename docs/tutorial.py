"""Runs the commands of the pages, and writes what they print into the pages: `python docs/make.py`.

The commands of a page run one after another in a copy of what they read. A block after the mark
`<!-- output: N -->` shows the first N lines that the last command above it prints; the block after
`<!-- file: NAME -->` is written to that file. A command that needs a window, a graphics processor, another
machine or minutes is parsed with its options and not run.
"""

import io
import os
import re
import shlex
import shutil
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path
from unittest.mock import patch

import typer

from taichi_erosion.cli.main import app
from taichi_erosion.cli.main import main as run_command
from taichi_erosion.evidence.words import NAME_SWITCH

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
PRINTED = {NAME_SWITCH: "./erosion", "COLUMNS": "400"}  # sentences stay on their lines
COMMAND = "./erosion "
STEP = re.compile(
    r"<!-- file: (?P<file>\S+) -->\n```\w+\n(?P<text>.*?)```"
    r"|(?P<block>```sh\n(?P<commands>.*?)```)"
    r"(?P<mark>\n\n<!-- output: (?P<lines>\d+) -->\n```text\n)?(?(mark).*?```)",
    re.DOTALL,
)
PARSED = {"doe", "view", "snapshot", "bench", "verify", "export"}
ELSEWHERE = {"--arch", "--web"}  # options that need what a test does not have
LAUNCHER = {"test"}  # what the launcher does by itself
SMALLER = (
    ("count = 1800", "count = 200"),
    ("radius_d = 9.0", "radius_d = 4.4"),
    ("radius_d = 8.4", "radius_d = 3.8"),
)


def copy_tree(folder: Path) -> Path:
    """A clone with what the pages' commands read; the scene of live sessions has fewer grains."""
    clone = folder / "clone"
    kept_out = shutil.ignore_patterns("*-results", "ledger.sqlite*", "trials", "__pycache__")
    for name in ("scenes", "doe", "recordings", "docs/pictures"):
        shutil.copytree(ROOT / name, clone / name, ignore=kept_out)
    scene = clone / "scenes" / "column_collapse.toml"
    text = scene.read_text(encoding="utf-8")
    for stated, smaller in SMALLER:
        text = text.replace(stated, smaller)
    scene.write_text(text, encoding="utf-8")
    return clone


def printed(line: str) -> list[str]:
    """Output lines of one command line, `TEXT | ./erosion ...` included. Raises SystemExit if it fails."""
    typed, _, rest = line.rpartition(COMMAND)
    words = shlex.split(rest, comments=True)
    if words[0] in LAUNCHER:
        return []
    if words[0] in PARSED or ELSEWHERE & set(words):
        parse(words)
        return []
    if words[0] == "run":
        words.append("--check")
    keys = " ".join(shlex.split(typed)[1:-1]).replace("\\n", "\n") + "\nquit\n"
    page = io.StringIO()
    with redirect_stdout(page), patch("sys.stdin", io.StringIO(keys)):
        code = run_command(words)
    if code != 0:
        raise SystemExit(f"{line}: exit code {code}")
    return page.getvalue().splitlines()


def parse(words: list[str]) -> None:
    """Refuse a command, option or file that is not there."""
    command = typer.main.get_command(app)
    while words and hasattr(command, "commands"):
        command, words = command.commands[words[0]], words[1:]  # pyright: ignore[reportAttributeAccessIssue]
    command.make_context(str(command.name), list(words))


def run_step(step: re.Match[str]) -> str:
    """One block of a page: a file that is written, or commands with the output of the last one."""
    if step["file"]:
        Path(step["file"]).parent.mkdir(exist_ok=True)
        Path(step["file"]).write_text(step["text"], encoding="utf-8")
        return step[0]
    shown: list[str] = []
    for line in step["commands"].splitlines():
        if COMMAND in line:
            shown = printed(line)
    if not step["mark"]:
        return step[0]
    return step["block"] + step["mark"] + "\n".join(shown[: int(step["lines"])]) + "\n```"


def fill(page: str) -> str:
    """Page with new output of its commands."""
    with tempfile.TemporaryDirectory() as folder:
        with chdir(copy_tree(Path(folder))), patch.dict(os.environ, PRINTED):
            return STEP.sub(run_step, page)
