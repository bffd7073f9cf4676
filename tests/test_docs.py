"""What README and docs tell a reader to type exists and works."""

import re
import shlex
from pathlib import Path

import pytest
import typer

from taichi_erosion.cli.commands import app
from taichi_erosion.cli.main import main

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"```sh\n(.*?)```", re.DOTALL)
INLINE = re.compile(r"`\./erosion ([^`]+)`")
LAUNCHER_WORDS = {"test"}  # what the launcher does by itself
PLACEHOLDER = re.compile(r"^[A-Z][A-Z=]*$")


def fenced_commands() -> list[tuple[str, str]]:
    """(page, command line) of every launcher call in a shell block."""
    return [
        (page.name, line.removeprefix("./erosion "))
        for page in PAGES
        for block in FENCE.findall(page.read_text(encoding="utf-8"))
        for line in block.splitlines()
        if line.startswith("./erosion ")
    ]


def named_commands() -> list[tuple[str, str]]:
    """(page, words) of every launcher call named in running text."""
    return [
        (page.name, words) for page in PAGES for words in INLINE.findall(page.read_text(encoding="utf-8"))
    ]


@pytest.mark.parametrize(("page", "line"), fenced_commands())
def test_a_scene_that_a_page_runs_is_valid(page: str, line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    words = shlex.split(line)
    monkeypatch.chdir(ROOT)
    if words[0] == "run" and not any(PLACEHOLDER.match(word) for word in words):
        assert main([*words, "--check"]) == 0, f"{page}: {line}"
    else:
        assert words[0] in LAUNCHER_WORDS | command_names(), f"{page}: {line}"


@pytest.mark.parametrize(("page", "words"), named_commands())
def test_a_command_that_a_page_names_exists(page: str, words: str) -> None:
    assert words.split()[0] in LAUNCHER_WORDS | command_names(), f"{page}: {words}"


def command_names() -> set[str]:
    """Commands of the program."""
    return set(typer.main.get_command(app).commands)  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_picture_and_page_that_is_linked_is_there(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not missing
