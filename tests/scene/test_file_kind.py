"""A file of another kind than a command wants is told with the command that takes it."""

from pathlib import Path

import pytest

from taichi_erosion.cli.main import main

ROOT = Path(__file__).parents[2]
STUDY, SCENE = str(ROOT / "doe" / "my_lab.toml"), str(ROOT / "scenes" / "saltation.toml")
MISTAKEN = {
    "a table for a study": (("compare", "t.csv"), "./erosion study new t.csv"),
    "a scene for a study": (("discover", SCENE), f"./erosion run {SCENE}"),
    "a folder for a study": (("adopt", str(ROOT / "doe"), "gusts"), "is a folder; name a study"),
    "a study for a scene": (("run", STUDY), f"./erosion compare {STUDY}"),
    "a table for a scene": (("run", "t.csv"), "./erosion study new t.csv"),
    "a study for a table": (("study", "new", STUDY), f"./erosion study check {STUDY}"),
    "a folder for a table": (("study", "new", "."), "is a folder; name a table"),
    "a scene to validate as a study": (("study", "check", SCENE), f"./erosion run {SCENE}"),
    "a table to report on": (("report", "t.csv"), "./erosion study new t.csv"),
    "a table to view": (("view", "t.csv"), "./erosion study new t.csv"),
    "an effect file for a study": (("compare", "pull.py"), "--effect pull.py"),
    "a recording for a study": (("next", "run.rrd"), "./erosion view run.rrd"),
}


@pytest.mark.parametrize("name", MISTAKEN)
def test_a_file_of_another_kind_is_told_with_its_own_command(tmp_path, monkeypatch, capsys, name):
    words, remedy = MISTAKEN[name]
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_bytes("Korngröße [µm];u*t (cm/s)\n90;13,8\n".encode("cp1252"))
    Path("pull.py").write_text("", encoding="utf-8")
    Path("run.rrd").write_bytes(b"RRF2")
    assert main(list(words)) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert remedy in line
    assert " is " in line
