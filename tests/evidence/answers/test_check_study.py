"""A study is validated without a run."""

from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers import check_study as module
from taichi_erosion.evidence.answers.check_study import check_study

ROOT = Path(__file__).parents[3]
TABLE = "observable,value,sd,n,unit,group,slope [deg],moisture [%],source\nflux,1,0.1,5,g/(m s),a,5,1,me\n"
COSTED = ("impact_threshold_reduced", "my_lab", "first_calibration")  # of others, plans take long
STUDY = f"""
[study]
measurements = "t.csv"
[observables.flux]
scene = "{ROOT / "scenes" / "saltation.toml"}"
[conditions]
slope = "conditions.slope"
moisture = "conditions.moisture"
[candidates]
effects = ["bed_slope"]
"""


@pytest.mark.parametrize("study", sorted((ROOT / "doe").glob("*.toml")), ids=lambda path: path.stem)
def test_a_shipped_study_is_valid(study, capsys, monkeypatch):
    if study.stem not in COSTED:
        monkeypatch.setattr(module, "discovery_cost", lambda *_: {})
    assert main(["study", "check", str(study)]) == 0
    assert "valid; nothing was run" in capsys.readouterr().out


STEEP = ["slope = 95 deg, outside [-90, 90]", "moisture = 680 % is 6.8 kg kg-1, outside [0, 5]"]
COARSE = TABLE.replace("slope [deg]", "diameter [mm]").replace(",5,1,me", ",25,1,me")
OF_SIZE = STUDY.replace('slope = "conditions.slope"', 'diameter = "grains.size.diameter"')
FAULTY = [
    (TABLE.replace(",5,1,me", ",95,680,me"), STUDY, [f"row 2, {fault}" for fault in STEEP]),
    (TABLE, STUDY.replace('"bed_slope"', '"moonlight"'), ["candidates.moonlight is not in the library"]),
    (COARSE, OF_SIZE, ["diameter = 25 mm is 0.025 m, which is unusual"]),
]


@pytest.mark.parametrize(("table", "study", "told"), FAULTY)
def test_faults_of_a_study_are_told_with_their_place(tmp_path, table, study, told):
    (tmp_path / "t.csv").write_text(table, encoding="utf-8")
    (tmp_path / "t.toml").write_text(study, encoding="utf-8")
    with pytest.raises(BadInput) as caught:
        check_study(tmp_path / "t.toml")
    assert len(caught.value.faults) == len(told)
    assert all(each in words for each, words in zip(told, caught.value.faults, strict=True))


def test_a_laboratorys_own_table_works_in_a_study_directly(tmp_path):
    table = "Hang (°);w in %;Sandfluss [g/(m s)];SD;n\n5,5;1;1,2;0,1;5\n7;2;1,1;0,1;5\n"
    study = STUDY + '[columns]\n"Hang (°)" = "slope"\n"w in %" = "moisture"\n'
    (tmp_path / "t.toml").write_text(study, encoding="utf-8")
    (tmp_path / "t.csv").write_bytes(table.encode("cp1252"))
    document = check_study(tmp_path / "t.toml")
    assert document["observables"] == {"flux": 2}
    assert document["conditions"] == {"slope": "5.5 to 7 °", "moisture": "1 to 2 %"}
