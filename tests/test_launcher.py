"""The launcher, in a tree of its own whose path holds a space; a stand-in for `uv` makes the environment.

The stand-in writes down what it was asked for. The program it "installs" prints its words and its folder.
"""

import ast
import fcntl
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from taichi_erosion.core.engine import ENGINES

ROOT = Path(__file__).parent.parent
LAUNCHER = ROOT / "erosion"
UV = """#!/bin/sh
echo "$@" >> "$ASKED"
echo "chatter of the installer"
case "$1" in
venv)
    mkdir -p .venv/bin
    ln -sf "$PYTHON" .venv/bin/python
    ;;
pip)
    [ -z "$BROKEN_NETWORK" ] || exit 7
    for name in taichi-erosion ruff basedpyright lint-imports pytest; do
        cp "$PROGRAM" ".venv/bin/$name"
    done
    ;;
esac
"""
PROGRAM = """#!/bin/sh
echo "$(basename "$0")" "$@"
echo "in $PWD" >&2
echo "bytecode of modules: ${PYTHONDONTWRITEBYTECODE-kept}" >&2
case "$FAILING" in *"$(basename "$0")"*) exit 4 ;; esac
"""


class Tree:
    """A source tree and the record of what its installer was asked for."""

    def __init__(self, folder: Path):
        self.root = folder / "a source tree"
        self.asked = folder / "asked"
        tools = folder / "tools"
        for path in (self.root, tools):
            path.mkdir()
        shutil.copy(LAUNCHER, self.root / "erosion")
        (self.root / "pyproject.toml").write_text("[project]\n")
        (self.root / "constraints.txt").write_text("numpy==2.4.6\n")
        for path, text in ((tools / "uv", UV), (tools / "program", PROGRAM)):
            path.write_text(text)
            path.chmod(0o755)
        self.environment = {"PATH": f"{tools}:/usr/bin:/bin", "ASKED": str(self.asked)}
        self.environment |= {"PROGRAM": str(tools / "program"), "PYTHON": sys.executable}

    def call(self, *words: str, cwd: Path | None = None, **environment: str):
        command, folder = [sys.executable, str(self.root / "erosion"), *words], cwd or self.root
        quiet = {"capture_output": True, "text": True, "timeout": 600, "check": False}
        return subprocess.run(command, cwd=folder, env=self.environment | environment, **quiet)

    def installations(self) -> list[str]:
        """What the installer was asked for by its first words, since the last question."""
        lines = self.asked.read_text().splitlines() if self.asked.exists() else []
        self.asked.unlink(missing_ok=True)
        return [line.split()[0] for line in lines]


@pytest.fixture
def tree(tmp_path):
    return Tree(tmp_path)


@pytest.fixture
def used(tree):
    tree.call("run")
    assert tree.installations() == ["venv", "pip"]
    return tree


def test_the_first_use_makes_the_environment_and_later_ones_do_not(tree):
    first = tree.call("run", "a scene.toml", "--json")
    assert (first.returncode, first.stdout) == (0, "taichi-erosion run a scene.toml --json\n")
    assert "chatter of the installer" in first.stderr
    assert "erosion: making .venv" in first.stderr
    (installation,) = [line for line in tree.asked.read_text().splitlines() if line.startswith("pip")]
    assert installation.endswith("--editable .[test] --constraint constraints.txt")
    assert tree.installations() == ["venv", "pip"]
    assert (tree.call("run", "a scene.toml", "--json").stdout, tree.installations()) == (first.stdout, [])


def test_an_environment_that_is_a_link_is_used_as_it_is(used, tmp_path):
    (used.root / ".venv").symlink_to((used.root / ".venv").rename(tmp_path / "environment"))
    (used.root / "constraints.txt").write_text("numpy==2.4.7\n")
    assert (used.call("run").stdout, used.installations()) == ("taichi-erosion run\n", [])


@pytest.mark.parametrize("name", ["pyproject.toml", "constraints.txt"])
def test_a_change_of_requirements_completes_the_environment_in_place_also_after_a_failure(used, name):
    kept = used.root / ".venv" / "kept"
    kept.touch()
    with (used.root / name).open("a") as file:
        file.write("# changed\n")
    assert used.call("run", BROKEN_NETWORK="1").returncode == 1
    assert used.call("run").returncode == 0
    assert used.installations() == ["pip", "pip"]
    assert kept.exists()


def test_an_environment_made_by_hand_is_adopted(tree):
    programs = tree.root / ".venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "python").symlink_to(sys.executable)
    assert (tree.call("run").returncode, tree.installations()) == (0, ["pip"])


def test_an_interrupted_set_up_is_begun_again(tree):
    failed = tree.call("run", BROKEN_NETWORK="1")
    assert (failed.returncode, failed.stdout) == (1, "")
    assert "set-up failed with exit code 7" in failed.stderr
    tree.installations()
    remains = tree.root / ".venv" / "remains"
    remains.touch()
    assert (tree.call("run").returncode, tree.installations()) == (0, ["venv", "pip"])
    assert not remains.exists()


def test_an_environment_whose_python_is_gone_or_whose_tree_was_moved_is_made_again(used):
    python = used.root / ".venv" / "bin" / "python"
    python.unlink()
    python.symlink_to("/nowhere/python")
    assert (used.call("run").returncode, used.installations()) == (0, ["venv", "pip"])
    used.root = used.root.rename(used.root.with_name("moved tree"))
    assert "made for another folder" in used.call("run").stderr
    assert used.installations() == ["venv", "pip"]


def test_two_set_ups_do_not_run_at_once(tree):
    with (tree.root / ".venv.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        words = [sys.executable, str(tree.root / "erosion"), "run"]
        waiting = subprocess.Popen(
            words, env=tree.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert waiting.stderr.readline() == "erosion: waiting for another set-up of .venv to finish\n"
        assert tree.installations() == []
    out, _ = waiting.communicate(timeout=600)
    assert out == "taichi-erosion run\n"


def test_a_user_who_cannot_lock_the_environment_is_told_what_to_do(tree):
    (tree.root / ".venv.lock").mkdir()  # refuses to be opened for everybody, root too
    refused = tree.call("run")
    assert (refused.returncode, refused.stdout, refused.stderr.count("\n")) == (1, "", 1)
    assert ".venv.lock cannot be written" in refused.stderr
    assert "clone of your own" in refused.stderr
    tree.root.joinpath(".venv.lock").rmdir()
    tree.call("run")
    (tree.root / ".venv.lock").unlink()
    (tree.root / ".venv.lock").mkdir()
    assert tree.call("run").returncode == 0, "a complete environment needs no lock"


def test_every_gate_runs_and_the_first_failure_is_the_exit_code(tree):
    answer = tree.call("test", FAILING="ruff lint-imports")
    assert answer.returncode == 4
    quick = ["ruff check", "ruff format --check", "basedpyright", "lint-imports"]
    whole = "pytest -m not slow and not gpu -n logical --dist worksteal"
    assert answer.stdout.splitlines() == [*quick, whole, "pytest -m engine --engine quadrants"]
    ends = re.findall(r"(passed|FAILED)  (\S+)", answer.stderr)
    assert [gate for end, gate in ends if end == "FAILED"] == ["ruff", "ruff", "lint-imports"]
    assert [gate for end, gate in ends if end == "passed"] == ["basedpyright", "pytest", "pytest"]
    assert tree.call("test").returncode == 0
    # on the other engine when it is named
    answer = tree.call("test", "--engine", "quadrants")
    assert answer.stdout == "pytest -m not slow and not gpu -n logical --dist worksteal --engine quadrants\n"


def test_words_after_test_go_to_pytest_alone_from_the_root_and_bytecode_is_kept_for_it(tree, tmp_path):
    answer = tree.call("test", "-k", "two words", cwd=tmp_path, FAILING="pytest", PYTHONDONTWRITEBYTECODE="1")
    assert (answer.returncode, answer.stdout) == (4, "pytest -k two words\n")
    assert f"in {tree.root}\n" in answer.stderr
    assert "bytecode of modules: kept\n" in answer.stderr
    # any other command runs where it was typed
    other = tree.call("run", cwd=tmp_path, PYTHONDONTWRITEBYTECODE="1")
    assert f"in {tmp_path}\n" in other.stderr
    assert "bytecode of modules: 1\n" in other.stderr


def test_an_unsuitable_python_says_which_ones_serve(tree, tmp_path):
    launcher = str(tree.root / "erosion")
    source = "import runpy, sys; sys.executable = '/nowhere'; "
    words = [sys.executable, "-c", f"{source}runpy.run_path({launcher!r}, run_name='__main__')"]
    environment = tree.environment | {"PATH": str(tmp_path)}
    answer = subprocess.run(words, env=environment, capture_output=True, text=True, check=False)
    assert answer.returncode == 1
    assert answer.stderr.startswith("erosion: needs Python 3.11 to 3.14 on PATH")
    assert answer.stderr.count("\n") == 1
    assert not (tree.root / ".venv").exists()


def test_the_launcher_is_read_by_an_old_python_and_continuous_integration_runs_what_the_readme_says():
    assert os.access(LAUNCHER, os.X_OK)
    ast.parse(LAUNCHER.read_text(encoding="utf-8"), feature_version=(3, 8))
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert os.access(ROOT / ".ci" / "run", os.X_OK)
    assert script.splitlines()[-1] == "exec ./erosion test"
    assert not re.search(r"secret|token|password|sudo", script, re.IGNORECASE)
    assert "\n./erosion test\n" in (ROOT / "README.md").read_text(encoding="utf-8")
    workflows = {path.stem: path.read_text("utf-8") for path in ROOT.glob(".github/workflows/*.yml")}
    assert workflows.keys() == {"release", "tests", "weekly"}
    assert all("run: bash .ci/run" in workflows[name] for name in ("release", "tests"))


def test_every_requirement_is_pinned_within_its_bounds_and_every_python_gets_one_engine():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = [line for line in lines if line and not line.startswith("#")]
    version = r"[A-Za-z0-9_.-]+==[0-9][A-Za-z0-9.]*"
    assert all(re.fullmatch(version + r"(; python_version (<|>=) \"3\.\d+\")?", line) for line in pinned)
    pins = [Requirement(line) for line in pinned]
    # a package of two versions has each for other Pythons
    assert len({(canonicalize_name(pin.name), str(pin.marker)) for pin in pins}) == len(pins)
    for text in [*project["dependencies"], *project["optional-dependencies"]["test"]]:
        wanted = Requirement(text)
        found = [pin for pin in pins if canonicalize_name(pin.name) == canonicalize_name(wanted.name)]
        assert found, text
        for pin in found:
            (version,) = (specifier.version for specifier in pin.specifier)
            # a pin of older Pythons may lie below a bound for newer ones
            assert version in wanted.specifier or (wanted.marker and pin.marker), text
    engines = [one for one in map(Requirement, project["dependencies"]) if one.name in ENGINES and one.marker]
    for python, engine in (("3.11", "taichi"), ("3.13", "taichi"), ("3.14", "quadrants")):
        taken = [one.name for one in engines if one.marker.evaluate({"python_version": python})]
        assert taken == [engine], python
