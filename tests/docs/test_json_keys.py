"""Every key that a command prints stands in docs/json_and_python.md, and every key there is printed."""

import json
import re
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.evidence import record
from taichi_erosion.evidence.answers.files import Reply
from taichi_erosion.evidence.data.problem import SetUpFault
from taichi_erosion.scene.schema.units import Scale
from taichi_erosion.verification.claims import Outcome
from tests.evidence.asking import ask
from tests.verification import ladder

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "json_and_python.md").read_text("utf-8")
SECTION = re.compile(r"^#{3,4} (?P<name>.+)$", re.MULTILINE)
LINE = re.compile(r"^- (?P<keys>`\w+[^:]*?`): (?P<told>.*)$", re.MULTILINE)
KEY = re.compile(r"`(?P<name>\w+)(?P<ends>(?:\.\*|\[\])*)`")
COMMON, ANSWER = "Every document of a study", "compare, discover, adopt, next"
RECORDS = {"fault": SetUpFault, "parameter": record.ParameterPart, "level": record.LevelPart}
RECORDS |= {"unstated error": record.ErrorPart, "repeats": record.RepeatPart, "scatter": record.ScatterPart}
RECORDS |= {"law": record.LawPart, "dose": record.DosePart, "mechanism": record.MechanismPart}
RECORDS |= {"curve": record.CurvePart, "point": record.PointPart, "answer": record.DecisionPart}
RECORDS |= {"effect": record.EffectPart, "place": record.PlacePart, "interval": record.Interval}
RECORDS |= {"experiment": record.ExperimentPart, "fresh test": record.FreshPart, "gap": record.GapPart}
RECORDS |= {"scale": Scale}
pytestmark = pytest.mark.docs
_, *PARTS = SECTION.split(PAGE)


@dataclass(frozen=True)
class Entry:
    ends: tuple[str, ...]  # ".*" and "[]", from outside in
    record: str  # of what it holds; empty for a number or a word
    nullable: bool


def entries(text: str) -> dict[str, Entry]:
    found = {}
    for line in LINE.finditer(text):
        named = re.match(r"\*(?P<name>[^*]+)\*", line["told"])
        for key in KEY.finditer(line["keys"]):
            ends = tuple(re.findall(r"\.\*|\[\]", key["ends"]))
            found[key["name"]] = Entry(ends, named["name"] if named else "", "; null: " in line["told"])
    return found


TABLES = {name: entries(text) for name, text in zip(PARTS[::2], PARTS[1::2], strict=True)}


def check_record(found: Mapping[str, Any], keys: dict[str, Entry], where: str) -> None:
    """A record has the keys of the page, and these hold what the page says."""
    assert found.keys() == keys.keys(), where
    for key, value in found.items():
        check_value(value, keys[key], keys[key].ends, f"{where}.{key}")


def check_value(value: Any, entry: Entry, ends: tuple[str, ...], where: str) -> None:
    if value is None:
        assert entry.nullable, f"{where} is null"
    elif ends:
        assert isinstance(value, dict if ends[0] == ".*" else list), where
        for each in value.values() if isinstance(value, dict) else value:
            check_value(each, entry, ends[1:], where)
    elif entry.record:
        check_record(value, TABLES[entry.record], where)
    else:
        assert not isinstance(value, dict | list), f"{where} is no single value"


def checked(reply: Reply) -> dict[str, Any]:
    """The document of an answer, against the page."""
    found = json.loads(json.dumps(reply.document, allow_nan=False))
    check_record(found, TABLES[COMMON] | TABLES[ANSWER] | TABLES.get(reply.command, {}), reply.command)
    for end in ("before", "after"):
        assert found[f"chi2_{end}"] == pytest.approx(found["n"] * found[f"chi2_per_row_{end}"])
    assert sum(found["probabilities"].values()) == pytest.approx(1.0)
    return found


@pytest.fixture
def studies(tmp_path: Path) -> Path:
    ignore = shutil.ignore_patterns("*-results", "__pycache__")
    return shutil.copytree(ROOT / "doe", tmp_path / "doe", ignore=ignore)


def test_every_command_prints_the_keys_of_the_page(studies, capsys):
    study = studies / "my_lab.toml"
    checked(ask("compare", study))
    assert checked(ask("discover", study))["named"] == ["cohesion"]
    adopted = checked(ask("adopt", study, "cohesion"))
    assert adopted["vault"]["adopted"] == ["cohesion"]
    assert checked(ask("discover", study))["vault"] == adopted["vault"]
    (study.parent / "at.csv").write_text("observable,diameter [mm]\nrepose_angle,0.3\n")
    assert main(["predict", str(study), "--at", str(study.parent / "at.csv"), "--json"]) == 0
    check_record(json.loads(capsys.readouterr().out), TABLES[COMMON] | TABLES["predict"], "predict")


def test_proposed_experiments_have_the_keys_of_the_page(studies):
    assert checked(ask("next", studies / "impact_threshold.toml"))["next_experiments"]


def test_an_answer_beyond_the_list_prints_the_keys_of_the_page(studies):
    found = checked(ask("discover", studies / "beyond/rolling_wet.toml"))
    assert found["mechanisms"]["rolling_friction"]["law"] is not None


def test_verify_prints_the_keys_of_the_page(monkeypatch, capsys):
    monkeypatch.setitem(ladder.CHECKS, "V01", lambda: iter([Outcome("holds", 1.0, 1.0, 0.0, "f64")]))
    assert main(["verify", "V01", "--json"]) == 0
    check_record(json.loads(capsys.readouterr().out), TABLES["verify"], "verify")


def test_every_record_that_the_page_names_is_on_it_with_its_keys():
    for name, record_type in RECORDS.items():
        assert TABLES[name].keys() == {each.name for each in fields(record_type)}, name
    used = {entry.record for keys in TABLES.values() for entry in keys.values()} - {""}
    assert used <= TABLES.keys()
    assert RECORDS.keys() <= used
