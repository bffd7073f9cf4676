"""Effect files: each that cannot be used is told in one line with its place and its remedy."""

from pathlib import Path

import pytest

from taichi_erosion.cli.effects import effect_file_text
from taichi_erosion.cli.main import main
from taichi_erosion.core.effect_file import effect_in, read_effect_file, read_effect_files
from taichi_erosion.core.errors import BadInput
from taichi_erosion.effect_library import load_library

PULL = effect_file_text("pair_effect").replace("NAME", "constant_pull")
BROKEN = {  # change of a good file -> what is told of it
    ("EFFECT = ", "OTHER = "): "holds no EFFECT = Effect(...)",
    ("act=pull", "force=pull"): "got an unexpected keyword argument 'force'",
    ("core.effect import", "core.quantity import"): "line 14): ModuleNotFoundError: No module named",
    ("@ti.func\n", ""): "act must be a ti.func for place 'pair'",
    ('place="pair"', 'place="wall"'): "place = 'wall' is not one of pair, first_contact",
    ("    constants=constants,\n", ""): "needs constants(params, strength, conditions)",
    ("params=Params", "params=dict"): "params is not a dataclass",
    ("@dataclass(frozen=True)", "raise SystemExit(0)"): "SystemExit: 0",
    ("EFFECT = Effect(", "EFFECT = Effect("[:-1]): "IndentationError: unexpected indent",
}
SCENE = str(Path(__file__).parents[2] / "scenes" / "column_collapse.toml")
RUN = ("run", SCENE, "--set", "effects.constant_pull.strength=1")


@pytest.fixture
def told_of(tmp_path, monkeypatch, capsys):
    """Function that gives what a command that is refused says of a changed effect file."""

    def refusal(old: str, new: str, *words: str) -> str:
        assert old in PULL
        monkeypatch.chdir(tmp_path)
        Path("glue.py").write_text(PULL.replace(old, new), encoding="utf-8")
        assert main([*words, "--effect", "glue.py"]) == 2
        first, told = capsys.readouterr().err.splitlines()
        assert first == "executes glue.py (named by --effect)"
        return told

    return refusal


@pytest.mark.parametrize(("old", "new"), BROKEN)
def test_a_file_of_another_interface_gets_one_line(old, new, told_of):
    assert BROKEN[old, new] in told_of(old, new, "effects")


@pytest.mark.parametrize("name", ["glue.toml", "nothing.py", "folder.py"])
def test_what_is_no_python_file_is_refused(name, tmp_path):
    (tmp_path / "folder.py").mkdir()
    (tmp_path / "glue.toml").write_text("a = 1", encoding="utf-8")
    with pytest.raises(BadInput, match=name):
        read_effect_file(tmp_path / name)


def test_no_two_files_nor_a_file_and_the_library_share_a_name_but_one_may_be_named_twice(tmp_path, capsys):
    one, other, listed = (tmp_path / f"{name}.py" for name in ("one", "other", "listed"))
    listed.write_text(PULL.replace('"constant_pull"', '"dry_adhesion"'), encoding="utf-8")
    with pytest.raises(BadInput, match=r"effect 'dry_adhesion' exists already in the library; give it"):
        load_library([listed])
    one.write_text(PULL, encoding="utf-8")
    other.write_text(f"{PULL}\n", encoding="utf-8")
    assert "constant_pull" in load_library(read_effect_files([one, tmp_path / "." / "one.py"]))
    told = capsys.readouterr().err.splitlines()
    assert told == [f"executes {file} (named by --effect)" for file in (listed, one)]
    with pytest.raises(BadInput, match="exists already in another file"):
        load_library([one, other])


def test_an_edited_file_is_another_effect_in_the_same_process(tmp_path):
    file = tmp_path / "glue.py"
    file.write_text(PULL, encoding="utf-8")
    before = read_effect_file(file)
    file.write_text(PULL.replace("1e-7", "3e-7"), encoding="utf-8")
    after = read_effect_file(file)
    assert before.digest != after.digest
    assert [effect_in(each).params().pull_off for each in (before, after)] == [1e-7, 3e-7]


def test_annotations_may_be_postponed_in_a_file_of_the_host(tmp_path):
    shipped = Path(__file__).parents[2] / "taichi_erosion" / "effect_library" / "repose_method.py"
    text = f"from __future__ import annotations\n{shipped.read_text('utf-8')}"
    file = tmp_path / "my_method.py"
    file.write_text(text, encoding="utf-8")
    assert effect_in(read_effect_file(file)).name == "my_method"


UNUSABLE = {  # change of a good file -> what is told of it by `run --check`, in one line with its place
    ("pair.gap <=", "pair.gapp <="): "glue.py: line 31, in pull: cannot be compiled: AttributeError",
    ("def pull(constants, pair)", "def pull(pair)"): "is not that of its place in core/effect.py",
    ("constants.pull, 0.0)", "constants.pull, 0.0) * pair.normal"): "what an effect takes or gives is not",
    ("strength * params", "strength * float('nan') * params"): "a dict of finite numbers by name",
    ('{"pull": strength * params.pull_off}', "strength"): "constants must give a dict of finite numbers",
    ("strength * params", "strength / 0.0 * params"): "its constants failed (glue.py, line ",
}


@pytest.mark.parametrize(("old", "new"), UNUSABLE)
def test_an_effect_that_cannot_act_is_refused_before_a_run(old, new, told_of):
    told = told_of(old, new, *RUN, "--check")
    assert told.startswith("glue.py: effect 'constant_pull' cannot act: ")
    assert UNUSABLE[old, new] in told
    assert "Traceback" not in told


def test_a_run_tells_of_a_result_of_the_wrong_shape(told_of):
    few = ("--no-record", "--set", "grains.count=20", "--replicas", "1")
    told = told_of("constants.pull, 0.0)", "constants.pull, 0.0) * pair.normal", *RUN, *few)
    assert "what an effect takes or gives is not that of its place" in told


def test_a_check_says_that_a_file_keeps_or_breaks_the_contract(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for unit, told in (('"N"', "compiles and keeps the contract"), ('"uN"', "declared in uN")):
        Path("glue.py").write_text(PULL.replace('"N"', unit), encoding="utf-8")
        assert main(["run", SCENE, "--check", "--effect", "glue.py"]) == 0
        out = capsys.readouterr().out
        assert told in out
        assert "effect 'constant_pull' does not act: the scene does not name it" in out
