"""What README and docs tell a reader to type exists and works."""

import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
import typer

from taichi_erosion.cli.commands import app
from taichi_erosion.cli.main import main

ROOT = Path(__file__).resolve().parents[2]
TOP = [path for path in sorted(ROOT.glob("*.md")) if path.name != "CHANGELOG.md"]
PAGES = [*TOP, ROOT / "recordings" / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
FENCE = re.compile(r"```sh\n(.*?)```", re.DOTALL)
INLINE = re.compile(r"`\./erosion ([^`]+)`")
pytestmark = pytest.mark.docs
LAUNCHER_WORDS = {"test"}  # what the launcher does by itself
PLACEHOLDER = re.compile(r"^[A-Z][A-Z=]*$")
EXECUTED = {
    "study",
    "audit",
    "compare",
    "discover",
    "adopt",
    "next",
    "predict",
    "report",
    "effects",
    "measure",
    "schema",
}
SMALLER = (
    ("count = 1800", "count = 200"),
    ("radius_d = 9.0", "radius_d = 4.4"),
    ("radius_d = 8.4", "radius_d = 3.8"),
)
OF_A_RUN = "FILE."  # a file that the reader's own run has left
ADOPTED = "_with_"  # in the name of a file that `adopt` has written
WALKED = ("docs/write_an_effect.md", "docs/beyond_the_list.md")  # commands with a test of their own


def name_of(page: Path) -> str:
    """Where a page lies; there is more than one README."""
    return str(page.relative_to(ROOT))


def fenced_commands() -> list[tuple[str, str]]:
    """(page, command line) of every launcher call in a shell block."""
    return [
        (name_of(page), line.removeprefix("./erosion "))
        for page in PAGES
        for block in FENCE.findall(page.read_text(encoding="utf-8"))
        for line in block.splitlines()
        if line.startswith("./erosion ")
    ]


def named_commands() -> list[tuple[str, str]]:
    """(page, words) of every launcher call named in running text."""
    return [
        (name_of(page), words) for page in PAGES for words in INLINE.findall(page.read_text(encoding="utf-8"))
    ]


@pytest.mark.parametrize(("page", "line"), fenced_commands())
def test_a_scene_that_a_page_runs_is_valid(page: str, line: str, monkeypatch: pytest.MonkeyPatch) -> None:
    words = shlex.split(line)
    monkeypatch.chdir(ROOT)
    if words[0] == "run" and not any(PLACEHOLDER.match(word) or ADOPTED in word for word in words):
        assert main([*words, "--check"]) == 0, f"{page}: {line}"
    else:
        assert words[0] in LAUNCHER_WORDS | command_names(), f"{page}: {line}"


def draw_heap(path: Path) -> None:
    """A dark heap of 30 degrees on a light ground."""
    across, down = np.meshgrid(np.arange(600), np.arange(300))
    inside = down > 40 + np.tan(np.radians(30.0)) * np.abs(across - 300)
    iio.imwrite(path, np.where(inside | (down > 190), 40, 220).astype(np.uint8))


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what the pages' commands read, in which they may write."""
    folder = tmp_path_factory.mktemp("copy")
    for name in ("scenes", "doe", "docs", "recordings"):
        kept_out = shutil.ignore_patterns("*-results", "ledger.sqlite*")
        shutil.copytree(ROOT / name, folder / name, ignore=kept_out)
    draw_heap(folder / "IMAGE.png")
    return folder


@pytest.mark.parametrize("page", [page for page in PAGES if name_of(page) not in WALKED], ids=name_of)
def test_the_commands_of_a_page_run_one_after_another(
    page: Path, copy: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = [line for name, line in fenced_commands() if name == name_of(page) and OF_A_RUN not in line]
    if page.read_text(encoding="utf-8").count("<!-- output:") == len(lines) > 0:
        pytest.skip("test_printed_output.py runs every command of this page")
    monkeypatch.chdir(copy)
    for line in lines:
        words = ["IMAGE.png" if word == "IMAGE" else word for word in shlex.split(line, comments=True)]
        if words[0] in EXECUTED:
            assert main(words) == 0, line


def test_the_python_session_of_the_live_page_measures_a_heap(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (ROOT / "docs" / "live.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    scene = (ROOT / "scenes" / "column_collapse.toml").read_text(encoding="utf-8")
    for stated, smaller in SMALLER:
        assert stated in scene
        scene = scene.replace(stated, smaller)
    (tmp_path / "scenes").mkdir()
    (tmp_path / "scenes" / "column_collapse.toml").write_text(scene, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(compile(block, "docs/live.md", "exec"), names)
    session = names["session"]
    assert session.table.loc["angle_of_repose", "unit"] == "deg"
    assert list(session.diff("at rest").index) == ["contact.grain-grain.friction_rolling"]
    assert len(session.plot("pile_height").axes[0].lines[0].get_xdata()) > 2


@pytest.mark.parametrize(("page", "words"), named_commands())
def test_a_command_that_a_page_names_exists(page: str, words: str) -> None:
    first = words.split()[0]
    assert first in LAUNCHER_WORDS | command_names() | program_options(), f"{page}: {words}"


def command_names() -> set[str]:
    """Commands of the program."""
    return set(typer.main.get_command(app).commands)  # pyright: ignore[reportAttributeAccessIssue]


def program_options() -> set[str]:
    """Options that stand before the command."""
    return {option for parameter in typer.main.get_command(app).params for option in parameter.opts}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: name_of(page))
def test_every_picture_and_page_that_is_linked_is_there(page: Path) -> None:
    links = re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if "://" not in link and not (page.parent / link).exists()]
    assert not missing


FILE_PATH = re.compile(
    r"`((?:[\w.-]+/)+[\w.*-]+\.(?:py|md|toml|csv|txt|png|rrd|json|npz|html|yml))(?:::?\w+)?`"
)
CREATED = re.compile(r"^(?:recordings|campaigns|my_scenes)/(?!README|sample)|results?/|^out/|peers/cases/")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: name_of(page))
def test_every_file_that_a_page_names_exists(page: Path) -> None:
    bases = (ROOT, ROOT / "taichi_erosion", ROOT / "doe", page.parent)
    named = {
        found for found in FILE_PATH.findall(page.read_text(encoding="utf-8")) if not CREATED.search(found)
    }
    missing = [path for path in sorted(named) if not any(any(base.glob(path)) for base in bases)]
    assert missing == []


@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.md")), ids=lambda page: page.name)
def test_every_page_links_to_the_glossary(page: Path) -> None:
    assert "](../GLOSSARY.md)" in page.read_text(encoding="utf-8")
