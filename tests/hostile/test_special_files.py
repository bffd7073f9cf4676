"""Places that are no plain files, and logs that cannot grow: one line each, and nothing is waited for."""

import os
from pathlib import Path
from typing import Any

import pytest
from audit_hook import watched
from damaged_files import ROOT, SCENES

from taichi_erosion.cli.main import ExitCode, main

SCENE = "scenes/incline.toml"
READERS = (
    *("run FILE.toml --check", "audit FILE.csv", "measure repose FILE.png", "export FILE.rrd --vtk out"),
    *("report FILE.json", "report FILE.toml", "compare FILE.toml", "discover FILE.toml"),
    *("doe design FILE.toml", f"run {ROOT / SCENE} --resume FILE.npz"),
    "effects new law --from-discovery FILE.json",
)
BEYOND = (
    *("--replicas 999999999999", f"--seed {10**30}", "--threads 99999999999", "--effect scene.toml"),
    *("--every nan --checkpoint kept.npz", "--every -1 --checkpoint kept.npz", "--record="),
    *("--record \udcff.rrd", "--record scene.toml", "--no-record --force --checkpoint scene.toml"),
)


def make(kind: str, place: Path) -> None:
    """Something that is no plain file, or none that can be read."""
    if kind == "pipe":
        os.mkfifo(place)
    elif kind == "folder":
        place.mkdir()
    elif kind == "empty":
        place.touch()
    else:
        place.symlink_to({"loop": place.name, "dangling": "nowhere", "device": "/dev/zero"}[kind])


@pytest.mark.parametrize("kind", ["pipe", "folder", "empty", "loop", "dangling", "device"])
@pytest.mark.parametrize("command", READERS)
def test_what_is_no_file_is_refused_in_one_line_for_each_fault(tmp_path, monkeypatch, capsys, command, kind):
    monkeypatch.chdir(tmp_path)
    (name,) = (word for word in command.split() if word.startswith("FILE"))
    make(kind, tmp_path / name.replace("FILE", kind))
    with watched(tmp_path) as watch:
        code = main(command.replace("FILE", kind).split())
    said = capsys.readouterr().err
    assert (code, watch.trespasses) == (ExitCode.BAD_INPUT, []), said
    # one line for each fault; an empty file lacks sections
    assert 1 <= len(said.splitlines()) <= (11 if kind == "empty" else 1)
    assert all(kind in line for line in said.splitlines())


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where commands work, with a scene in it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_bytes(SCENES[SCENE])
    return tmp_path


@pytest.mark.usefixtures("folder")
def test_a_log_that_the_disk_refuses_ends_in_one_line_and_the_command_goes_on(capsys: Any):
    assert main(["--log", "/dev/full", "run", "scene.toml", "--check"]) == ExitCode.SUCCESS
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "/dev/full: cannot be written" in said


@pytest.mark.parametrize("kind", ["pipe", "folder"])
@pytest.mark.parametrize("option", ["--record FILE", "--no-record --checkpoint FILE"])
def test_an_output_never_replaces_what_is_no_file(folder: Path, capsys: Any, option: str, kind: str):
    place = folder / "kept"
    make(kind, place)
    before = place.stat()
    assert main(["run", "scene.toml", *option.replace("FILE", "kept").split()]) == ExitCode.BAD_INPUT
    assert os.path.samestat(before, place.stat())
    assert capsys.readouterr().err == "kept: is not the name of a file\n"


@pytest.mark.parametrize("words", BEYOND)
def test_impossible_words_are_refused_before_anything_is_made(folder: Path, capsys: Any, words: str):
    assert main(["run", "scene.toml", *words.split()]) == ExitCode.BAD_INPUT
    assert capsys.readouterr().err.count("\n") == 1
    assert os.listdir(folder) == ["scene.toml"]
    assert (folder / "scene.toml").read_bytes() == SCENES[SCENE]
