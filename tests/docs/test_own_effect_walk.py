"""The walk of docs/write_an_effect.md: from an empty file to a falling error, with a laboratory of its own.

The laboratory is another process with another law of pores, time step and density. Everything after it is
what the page tells a reader to type and to write.
"""

import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from zipfile import ZipFile

import pytest
from hatchling.builders.wheel import WheelBuilder

from taichi_erosion.cli.main import main
from taichi_erosion.effect_library import load_library
from taichi_erosion.evidence.answers.files import read_reply

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "write_an_effect.md").read_text(encoding="utf-8")
FILE = r"<!-- file: (?P<file>\S+) -->\n```\w+\n(?P<text>.*?)```"
STEP = re.compile(rf"{FILE}|```sh\n(?P<commands>.*?)```", re.DOTALL)
NAME, STUDY = "pores", "doe/own_effect/pores.toml"
ONE_WORKER = ("--workers", "1")  # a second one would compile the same kernels again
pytestmark = pytest.mark.docs


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of what the page reads, whose table another process has just made."""
    folder = tmp_path_factory.mktemp("reader")
    own = folder / "doe" / "own_effect"
    shutil.copytree(ROOT / "doe" / "own_effect", own, ignore=shutil.ignore_patterns("*-results"))
    table = own / "pores.csv"
    table.unlink()
    words = [sys.executable, "-m", "doe.own_effect.laboratory", str(table)]
    subprocess.run(words, cwd=ROOT, check=True, timeout=600.0)
    return folder


def steps() -> list[tuple[str, str]]:
    """(file to write, its text), or ("", command line), in the order of the page."""
    found = []
    for step in STEP.finditer(PAGE):
        if step["file"]:
            found.append((step["file"], step["text"]))
        else:
            found += [("", line.removeprefix("./erosion ")) for line in step["commands"].splitlines()]
    return found


@pytest.mark.slow
def test_an_own_effect_goes_from_a_scaffold_to_a_falling_error(reader, monkeypatch):
    monkeypatch.chdir(reader)
    for file, text in steps():
        if file:
            Path(file).parent.mkdir(exist_ok=True)
            Path(file).write_text(text, encoding="utf-8")
        else:
            assert main([*shlex.split(text), *(ONE_WORKER if STUDY in text else ())]) == 0, text
    results = Path("doe/own_effect/pores-results")
    discovered, adopted = read_reply(results, "pores", "discover"), read_reply(results, "pores", "adopt")
    assert (discovered.record.verdict, discovered.record.named) == ("present", (NAME,))
    held = adopted.record.vault
    assert held.chi2_per_row_after < 0.1 * held.chi2_per_row_before
    assert held.chi2_per_row_wrong_effect > 2.0 * held.chi2_per_row_after
    for section, file in (("scene", "fall_pores"), ("study", "pores")):
        written = tomllib.loads(Path(f"doe/own_effect/{file}_with_{NAME}.toml").read_text(encoding="utf-8"))
        assert written[section]["effect_files"] == ["../../pores.py"]


def test_the_package_that_the_page_shows_offers_its_effect(tmp_path, monkeypatch):
    package = tmp_path / "package"
    package.mkdir()
    for file, text in (step for step in steps() if step[0]):
        (package / Path(file).name).write_text(text, encoding="utf-8")
    (wheel,) = WheelBuilder(str(package)).build(directory=str(tmp_path))
    with ZipFile(wheel) as packed:
        packed.extractall(tmp_path / "installed")
    assert NAME not in load_library()
    monkeypatch.syspath_prepend(tmp_path / "installed")
    assert load_library()[NAME].reads == ("pore_volume",)
