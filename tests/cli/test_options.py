"""Examples of the help can be typed as they stand; shells complete commands."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import typer

from taichi_erosion.cli.main import app, main
from taichi_erosion.cli.options import command_examples

ROOT = Path(__file__).resolve().parents[2]


def leaves(command, path: str = "") -> Iterator[tuple[str, object]]:
    """Every command by the words that call it."""
    for name, below in getattr(command, "commands", {"": command}).items():
        if name:
            yield from leaves(below, f"{path} {name}".strip())
        else:
            yield path, command


COMMANDS = dict(leaves(typer.main.get_command(app)))


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_the_examples_and_hides_no_word_in_brackets(command: str, capsys) -> None:
    assert main([*command.split(), "--help"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    for example in command_examples(command):
        assert f"./erosion {example}" in printed
    for option in COMMANDS[command].params:
        # the formatter takes what stands in square brackets for markup and drops it
        assert "[" not in (getattr(option, "help", None) or "")


def test_every_command_has_examples_that_name_options_and_files_that_are_there() -> None:
    for name in COMMANDS:
        assert command_examples(name), name
        known = {word for option in COMMANDS[name].params for word in option.opts} | {"--help"}
        for words in map(str.split, command_examples(name)):
            assert {word for word in words if word.startswith("-")} <= known
            for word in words:
                inside = word.startswith(("scenes/", "doe/", "recordings/")) and not word.endswith("FILE.rrd")
                assert not inside or (ROOT / word).exists(), word


def test_shells_can_complete_commands_under_the_name_they_were_called_by() -> None:
    named = {"TAICHI_EROSION_NAME": "erosion", "_EROSION_COMPLETE": "complete_bash"}
    typed = {"COMP_WORDS": "erosion me", "COMP_CWORD": "1"}
    command, places = [sys.executable, "-m", "taichi_erosion"], {**os.environ, **named, **typed}
    answer = subprocess.run(command, env=places, cwd=ROOT, capture_output=True, text=True, check=False)
    assert "measure" in answer.stdout
    assert "verify" not in answer.stdout
