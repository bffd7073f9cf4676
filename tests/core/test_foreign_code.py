"""A Python file of the user's is named before it runs: once, with what names it, on stderr."""

from taichi_erosion.core.foreign_code import read_effect_files, tell_execution


def test_a_file_is_named_once_with_the_file_that_names_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "glue.py").write_text("", encoding="utf-8")
    read_effect_files(["glue.py", "./glue.py"], tmp_path, "scenes/heap.toml")
    tell_execution(tmp_path / "glue.py", "study.toml")
    told = capsys.readouterr()
    assert (told.out, told.err) == ("", "executes glue.py (named by scenes/heap.toml)\n")
