"""Answers of the evidence commands in a terminal: at most eight lines and a table, more where asked."""

import json
import re
from dataclasses import asdict
from pathlib import Path

import pytest
from small_study import write_study
from ten_records import ADOPTIONS, DISCOVERIES, UNITS

from taichi_erosion.cli.main import main
from taichi_erosion.cli.output import MOST_LINES, print_answer
from taichi_erosion.evidence.answers.files import Command, Reply
from taichi_erosion.evidence.data.table_units import KEY
from taichi_erosion.evidence.record import Record
from taichi_erosion.evidence.words import NAME_SWITCH

ABOUT = {
    "study": "my lab/a.toml",
    "results": "my lab/a-results",
    "effect_files": [],
    "units": {"repose_angle": "deg", "radius_90": "m", "threshold_u_star": "m/s"},
    KEY: asdict(UNITS),
    "set_up": [],
    "notes": ["7 rows are held out."],
    "warnings": ["the scatter is unknown"],
    "versions": {"taichi_erosion": "1.0"},
}
REPLIES = [
    *(("discover", record) for record in DISCOVERIES.values()),
    *(("compare", record) for record in DISCOVERIES.values()),
    *(("next", record) for record in DISCOVERIES.values()),
    *(("adopt", record) for record in ADOPTIONS.values()),
]


@pytest.fixture(autouse=True)
def launched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(NAME_SWITCH, "erosion")


def reply(command: Command, record: Record, *set_up: str) -> Reply:
    return Reply(command, ABOUT | {"set_up": set_up}, record)


@pytest.fixture
def tables(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Titles of the tables that are printed, which then are not among the lines."""
    titles: list[str] = []
    monkeypatch.setattr("taichi_erosion.cli.output.print_table", lambda title, *_: titles.append(title))
    return titles


@pytest.mark.parametrize(("command", "record"), REPLIES)
@pytest.mark.parametrize("faults", [0, 1, 9])
def test_an_answer_has_at_most_eight_lines_and_a_table(command, record, faults, capsys, tables):
    print_answer(reply(command, record, *(f"error: {k}" for k in range(faults))), (), verbose=False)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) <= MOST_LINES
    assert len(tables) <= 1
    assert lines[0].startswith("error: ") == bool(faults)


def test_more_is_told_where_it_is_asked_for(capsys, tables):
    many = [f"error: {k}" for k in range(9)]
    print_answer(reply("discover", DISCOVERIES["single"], *many), (), verbose=True)
    lines = capsys.readouterr().out.splitlines()
    assert len(tables) == 3
    for words in (*many, "note: 7 rows", "note: the scatter", "412 settings", "seed 7", "taichi_erosion 1.0"):
        assert any(words in line for line in lines), words


def test_the_next_command_names_the_effect_files_again_but_for_a_study_that_states_them(capsys):
    options = ("--effect", "my pull.py")
    print_answer(reply("discover", DISCOVERIES["single"]), options, verbose=False)
    assert "`./erosion adopt 'my lab/a.toml' liquid_bridge --effect 'my pull.py'`" in capsys.readouterr().out
    print_answer(reply("adopt", ADOPTIONS["adopted"]), options, verbose=False)
    assert "`./erosion compare 'my lab/a_with_liquid_bridge.toml'`" in capsys.readouterr().out
    print_answer(reply("discover", DISCOVERIES["mechanism"]), options, verbose=True)
    result = "'my lab/a-results/a.discover.json'"
    told = capsys.readouterr().out
    assert f"`./erosion effects new NAME --from-discovery {result}`" in told
    assert re.search("side_walls +no limit +no limit +99%", told)


def test_a_study_is_answered_as_one_document(tmp_path: Path, capsys):
    study = str(write_study(tmp_path, {"liquid_bridge": 1.0}, 3))
    for words in (["compare"], ["discover"], ["adopt", "liquid_bridge"], ["next"]):
        assert main([words[0], study, *words[1:], "--json"]) == 0
        document = json.loads(capsys.readouterr().out)
        assert "record" not in document
        assert "rows" not in document
        assert document["set_up"] == []
