"""Messages reach a caller in Python in words of Python."""

import re
from pathlib import Path

import pytest

import taichi_erosion as te
from taichi_erosion.api.wording import python_words
from taichi_erosion.core.files import REMEDY

SCENE = Path(__file__).parents[2] / "scenes" / "terminal_velocity.toml"
OPTION = re.compile(r"--\w")


@pytest.mark.parametrize(
    ("command_line", "python"),
    [
        (REMEDY, "move it away, or replace it with force=True"),
        ("does not act; --set effects.glue.strength=1", 'does not act; changes={"effects.glue.strength": 1}'),
        ("needs --effect FILE, or effect_files", "needs effect_files=[FILE], or effect_files"),
        ("Raise budget.runs, or ask for --budget quick", 'Raise budget.runs, or ask for budget="quick"'),
        ("`compare` says where the model fails.", "study.compare() says where the model fails."),
        ("run ./erosion compare doe/a.toml first", "run study.compare() first"),
        ("`./erosion adopt doe/a.toml glue`", 'study.adopt("glue")'),
        ("`taichi-erosion adopt 'my lab/a.toml' glue mud` tests", 'study.adopt("glue", "mud") tests'),
        ("`taichi-erosion discover a.toml` asks", "study.discover() asks"),
        ("so far; a larger --budget may change it", "so far; a larger budget may change it"),
        (
            "Go on with b.toml: `./erosion compare b.toml` shows it",
            'Go on with study = te.study("b.toml"): study.compare() shows it',
        ),
        (
            "simulate it: ./erosion run 'my lab/a.toml'; a study is",
            'simulate it: te.run("my lab/a.toml"); a study is',
        ),
        ("simulate it: ./erosion run a.toml; a study is", 'simulate it: te.run("a.toml"); a study is'),
        ("run ./erosion compare 'my lab/a.toml' first", "run study.compare() first"),
        ("use at least --replicas 6", "use at least replicas=6"),
        ("another folder with --out", "another folder with out=FOLDER"),
    ],
)
def test_options_and_commands_become_keywords_and_calls(command_line, python):
    assert python_words(command_line) == python


def test_plain_sentences_stay_as_they_are():
    told = "The heap is 4.8 deg flatter than measured; compare it with report.toml's next row -- far outside."
    assert python_words(told) == told


@pytest.mark.parametrize(
    "changes", [{"effects.glue.strength": 1.0}, {"grains.cout": 3}, {"gravity.magnitude.x": 1.0}]
)
def test_a_refused_run_names_no_option_of_the_command_line(changes):
    with pytest.raises(te.BadInput) as told:
        te.run(SCENE, changes=changes, record=False)
    assert not OPTION.search(str(told.value))
