"""Every key that a command prints stands on docs/json.md, and every key of that page is printed."""

import json
import re
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.evidence.data import findings, fresh_findings, mechanism_findings, repeats
from taichi_erosion.evidence.prediction.predict import PredictedRow, PredictiveCheck
from taichi_erosion.scene.schema.units import Scale
from taichi_erosion.verification.claims import Outcome
from tests.evidence.small_study import MODEL, STUDY, write_study
from tests.verification import ladder

PAGE = (Path(__file__).parents[2] / "docs" / "json.md").read_text("utf-8")
SECTION = re.compile(r"^#{2,3} (?P<name>.+)$", re.MULTILINE)
KEY = re.compile(r"`(?P<name>\w+)(?P<ends>(?:\.\*|\[\])*)`")
RECORD = re.compile(r"^\*(?P<name>[^*]+)\*")
ENDS = re.compile(r"; (?P<kind>null|left out)\b")
COMMON = "Every document of a study"
RECORDS = {
    "fault": findings.SetUpFault,
    "observable misfit": findings.ObservableMisfit,
    "place": findings.MisfitPlace,
    "stretch": findings.Stretch,
    "noise": findings.Noise,
    "noise of an observable": findings.ObservableNoise,
    "lack of fit": repeats.LackOfFit,
    "estimate": findings.Estimate,
    "correlation": findings.Correlation,
    "level": findings.LevelShift,
    "row misfit": findings.RowMisfit,
    "row off": findings.RowOff,
    "unstated error": findings.ErrorFinding,
    "variants": findings.Variants,
    "effect": findings.EffectFinding,
    "strength trend": mechanism_findings.StrengthTrend,
    "member": findings.MemberFinding,
    "fresh test": fresh_findings.FreshCheck,
    "tested explanation": fresh_findings.FreshSetting,
    "gap": fresh_findings.EmulatorGap,
    "action": findings.EffectAction,
    "opposed sign": findings.OpposedSign,
    "explanation": findings.PlausibleHypothesis,
    "nearest explanation": findings.NearestHypothesis,
    "trend": findings.ResidualTrend,
    "law": findings.Law,
    "varying number": findings.VaryingNumber,
    "experiment": findings.Experiment,
    "vault": findings.VaultErrors,
    "adopted fit": findings.HypothesisFit,
    "predicted row": PredictedRow,
    "check": PredictiveCheck,
    "mechanisms": mechanism_findings.BeyondList,
    "mechanism": mechanism_findings.MechanismFinding,
    "dose": mechanism_findings.DoseEstimate,
    "law of doses": mechanism_findings.DoseLaw,
    "scale": Scale,
}
TUPLES = ("points", "table", "curve")  # lists whose entries are lists
NOT_PRINTED = {"rows", "vault_rows"}  # of fits: figures are drawn from them


@dataclass(frozen=True)
class Entry:
    """What the page says of a key."""

    ends: tuple[str, ...]  # ".*" and "[]", from outside in
    record: str  # of what it holds; empty for a number or a word
    null: str  # "never", "null" or "left out"

    @property
    def optional(self) -> bool:
        return self.null == "left out"


def sections() -> dict[str, dict[str, Entry]]:
    """Keys by section of the page."""
    heads = list(SECTION.finditer(PAGE))
    ends = [*(head.start() for head in heads[1:]), len(PAGE)]
    found = {}
    for head, end in zip(heads, ends, strict=True):
        rows = [
            [cell.strip() for cell in line.strip("| ").split("|")]
            for line in PAGE[head.end() : end].splitlines()
            if line.startswith("| `")
        ]
        keys: dict[str, Entry] = {}
        for cells in rows:
            assert len(cells) == 2, cells
            key, record, ends = KEY.search(cells[0]), RECORD.match(cells[1]), ENDS.search(cells[1])
            assert key is not None, cells
            marks = tuple(re.findall(r"\.\*|\[\]", key["ends"]))
            keys[key["name"]] = Entry(
                marks, record["name"] if record else "", ends["kind"] if ends else "never"
            )
        found[head["name"]] = keys
    return found


TABLES = sections()


def check_record(found: dict[str, Any], keys: dict[str, Entry], where: str) -> None:
    """A record has the keys of the page, and these hold what the page says."""
    assert found.keys() <= keys.keys(), f"{where}: not on the page: {sorted(found.keys() - keys.keys())}"
    lost = {key for key, entry in keys.items() if not entry.optional} - found.keys()
    assert not lost, f"{where}: on the page alone: {sorted(lost)}"
    for key, value in found.items():
        check_value(value, keys[key], keys[key].ends, f"{where}.{key}")


def check_value(value: Any, entry: Entry, ends: tuple[str, ...], where: str) -> None:
    if value is None:
        assert entry.null != "never", f"{where} is null"
    elif ends:
        assert isinstance(value, dict if ends[0] == ".*" else list), where
        for each in value.values() if isinstance(value, dict) else value:
            check_value(each, entry, ends[1:], where)
    elif entry.record:
        check_record(value, TABLES[entry.record], where)
    elif where.rpartition(".")[2] not in TUPLES:
        assert not isinstance(value, dict | list), f"{where} is no single value"


def documents(folder: Path, capsys, *steps: tuple[str, ...]) -> None:
    """Documents of some commands on the study of a folder, each against the page."""
    for words in steps:
        capsys.readouterr()
        assert main([words[0], str(folder / "heap.toml"), *words[1:], "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        check_record(found, TABLES[COMMON] | TABLES[words[0]], words[0])
        check_sums(found)


def check_sums(found: dict[str, Any]) -> None:
    """What is named per row is what is named in all over the number of rows."""
    for end in ("before", "after"):
        if found.get(f"chi2_{end}") is not None:
            assert found[f"chi2_{end}"] == pytest.approx(found["n"] * found[f"chi2_per_row_{end}"])
    for effect, each in found.get("effects", {}).items():
        assert each["probability_alone"] == found["probabilities"].get(effect, 0.0)
        assert each["probability_alone"] <= each["probability"] + 1e-9
    fits = [found[key] for key in ("base", "added") if key in found]
    if fits and fits[0]["vault_chi2_per_row"] is not None:
        rows = found["vault"]["chi2_before"] / found["vault"]["chi2_per_row_before"]
        assert rows == pytest.approx(found["held_out"], abs=1e-6)
        assert found["vault"]["chi2_per_row_after"] == fits[1]["vault_chi2_per_row"]
        assert found["vault"]["effects"] == fits[1]["effects"]


def test_every_command_prints_the_keys_of_the_page(tmp_path, capsys):
    write_study(tmp_path, {"liquid_bridge": 1.0})
    (tmp_path / "at.csv").write_text("observable,moisture,diameter\nrepose_angle,0.01,0.0003\n")
    quick = ("discover", "--budget", "quick")
    steps = (("compare",), quick, ("adopt", "gusts"), quick, ("next",))
    documents(tmp_path, capsys, *steps, ("predict", "--at", str(tmp_path / "at.csv")))


@pytest.mark.docs
def test_an_answer_beyond_the_list_prints_the_keys_of_the_page(tmp_path, capsys):
    study = STUDY.format(model=MODEL, candidates="[candidates.gusts]\n[candidates.side_walls]")
    write_study(tmp_path, {"liquid_bridge": 2.0}, study=study)
    documents(tmp_path, capsys, ("compare",), ("discover", "--budget", "quick"), ("next",))


@pytest.mark.docs
def test_held_out_rows_are_told_of_the_effects_that_were_named(tmp_path, capsys):
    write_study(tmp_path, {"liquid_bridge": 1.0})
    for effect, told in (("gusts", False), ("liquid_bridge", True)):
        assert main(["adopt", str(tmp_path / "heap.toml"), effect]) == 0
        capsys.readouterr()
        assert main(["discover", str(tmp_path / "heap.toml"), "--budget", "quick", "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        assert found["named"] == ["liquid_bridge"]
        assert (found["vault"]["chi2_after"] is not None) == told


def test_verify_prints_the_keys_of_the_page(monkeypatch, capsys):
    monkeypatch.setitem(ladder.CHECKS, "V01", lambda: iter([Outcome("holds", 1.0, 1.0, 0.0, "f64")]))
    assert main(["verify", "V01", "--json"]) == 0
    check_record(json.loads(capsys.readouterr().out), TABLES["verify"], "verify")


@pytest.mark.parametrize("name", RECORDS)
def test_the_page_has_every_key_of_a_record(name):
    assert TABLES[name].keys() == {each.name for each in fields(RECORDS[name])} - NOT_PRINTED


def test_every_record_that_the_page_names_is_on_it():
    used = {entry.record for keys in TABLES.values() for entry in keys.values()} - {""}
    assert used <= TABLES.keys()
    assert RECORDS.keys() <= used
