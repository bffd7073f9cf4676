"""Every script of a study can be imported from the repository root, and says how it is used."""

from importlib import import_module
from pathlib import Path

import pytest

from doe.common.command import run_step, words

ROOT = Path(__file__).parents[2]
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in sorted((ROOT / "doe").rglob("*.py"))
    if path.name != "my_lab.py"  # a model of a study, loaded by its path
]


@pytest.mark.parametrize("name", MODULES)
def test_a_module_is_imported_by_its_name(name: str):
    module = import_module(name)
    if '__name__ == "__main__"' in Path(str(module.__file__)).read_text(encoding="utf-8"):
        assert f"python -m {name}" in (module.__doc__ or "")


def test_help_prints_the_usage_and_runs_nothing(monkeypatch: pytest.MonkeyPatch, capsys):
    monkeypatch.setattr("sys.argv", ["run", "--help"])
    with pytest.raises(SystemExit) as ended:
        words("python -m doe.a.run")
    assert (ended.value.code, capsys.readouterr().out) == (0, "python -m doe.a.run\n")


@pytest.mark.parametrize("asked", [[], ["bake"], ["make", "solve"]])
def test_a_step_that_is_unknown_prints_the_usage(asked, monkeypatch: pytest.MonkeyPatch, capsys):
    monkeypatch.setattr("sys.argv", ["run", *asked])
    with pytest.raises(SystemExit) as ended:
        run_step("usage", {"make": list, "solve": list})
    assert (ended.value.code, capsys.readouterr().err) == (2, "usage\n")


def test_a_step_that_is_known_runs(monkeypatch: pytest.MonkeyPatch):
    done = []
    monkeypatch.setattr("sys.argv", ["run", "make"])
    run_step("usage", {"make": lambda: done.append("made")})
    assert done == ["made"]
