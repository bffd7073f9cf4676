"""Help that can be typed as it stands, a log of what was done, and completion for shells."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from taichi_erosion.cli import progress
from taichi_erosion.cli.commands import app
from taichi_erosion.cli.help import COMMANDS as HELP
from taichi_erosion.cli.main import main

ROOT = Path(__file__).resolve().parent.parent
PLACEHOLDERS = {"STUDY", "TABLE", "IMAGE", "SCRIPT", "FILE"}


def leaves(command, path: str = "") -> Iterator[tuple[str, object]]:
    """Every command by the words that call it."""
    for name, below in getattr(command, "commands", {"": command}).items():
        if name:
            yield from leaves(below, f"{path} {name}".strip())
        else:
            yield path, command


COMMANDS = dict(leaves(typer.main.get_command(app)))


def test_every_command_has_examples() -> None:
    assert set(HELP) == set(COMMANDS)
    assert all(page.examples for page in HELP.values())


@pytest.mark.parametrize("command", HELP)
def test_help_shows_the_examples_and_hides_no_word_in_brackets(command: str, capsys) -> None:
    assert main([*command.split(), "--help"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    for example in HELP[command].examples:
        assert f"./erosion {example}" in printed
    for option in COMMANDS[command].params:
        # the formatter takes what stands in square brackets for markup and drops it
        assert "[" not in (getattr(option, "help", None) or "")


@pytest.mark.parametrize("example", sorted({example for page in HELP.values() for example in page.examples}))
def test_an_example_names_options_and_files_that_are_there(example: str) -> None:
    words = example.split()
    name = next(name for name in COMMANDS if words[: len(name.split())] == name.split())
    known = {word for option in COMMANDS[name].params for word in option.opts} | {"--help"}
    assert {word for word in words if word.startswith("-")} <= known
    for word in words:
        inside = word.startswith(("scenes/", "doe/", "recordings/")) and not word.endswith("FILE.rrd")
        assert not inside or (ROOT / word).exists(), word


def test_the_log_tells_order_warnings_and_end_with_their_times(tmp_path: Path, capsys) -> None:
    log = tmp_path / "erosion.log"
    scene = str(ROOT / "scenes" / "incline.toml")
    assert main(["--log", str(log), "run", scene, "--check"]) == 0
    assert main(["--log", str(log), "run", scene, "--check", "--set", "grains.count=-1"]) == 2
    capsys.readouterr()
    lines = log.read_text(encoding="utf-8").splitlines()
    assert all(re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} (INFO|ERROR) ", line) for line in lines)
    told = [line.split(" ", 3)[3] for line in lines]
    assert told[0].endswith(f"run {scene} --check")
    assert told[1] == "exit code 0"
    assert "grains.count" in told[3]
    assert told[4] == "exit code 2"
    assert len(told) == 5


def test_a_log_that_cannot_be_written_is_refused_in_one_line(tmp_path: Path, capsys) -> None:
    assert main(["--log", str(tmp_path / "no" / "log"), "effects"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert "--log" in printed.err


@pytest.mark.parametrize(
    ("share", "elapsed", "said"),
    [
        (0.25, 10.0, ", about 30 s left"),
        (0.5, 600.0, ", about 10 min left"),
        (0.001, 60.0, ""),  # too little is done to tell
        (0.5, 1.0, ""),
    ],
)
def test_the_time_that_is_left_is_told_once_the_pace_is_known(share: float, elapsed: float, said: str):
    assert progress.time_left(share, elapsed) == said


def test_shells_can_complete_commands_under_the_name_they_were_called_by() -> None:
    named = {"TAICHI_EROSION_NAME": "erosion", "_EROSION_COMPLETE": "complete_bash"}
    typed = {"COMP_WORDS": "erosion me", "COMP_CWORD": "1"}
    answer = subprocess.run(
        [sys.executable, "-m", "taichi_erosion"],
        env={**os.environ, **named, **typed},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "measure" in answer.stdout
    assert "verify" not in answer.stdout
