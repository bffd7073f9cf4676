"""A study is validated without a run, and all that is wrong with it is told at once."""

from pathlib import Path

import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.answers.study_files.check_study import check_study
from taichi_erosion.evidence.models.load_study import load_study

ROOT = Path(__file__).parents[4]
TABLE = "observable,value,sd,n,unit,group,slope [deg],moisture [%],source\nflux,1,0.1,5,g/(m s),a,5,1,me\n"
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


def written(folder: Path, study: str = STUDY, table: str = TABLE) -> Path:
    (folder / "t.csv").write_text(table, encoding="utf-8")
    (folder / "t.toml").write_text(study, encoding="utf-8")
    return folder / "t.toml"


@pytest.mark.parametrize("study", ["impact_threshold_reduced.toml", "my_lab.toml", "first_calibration.toml"])
def test_a_shipped_study_is_valid(study, capsys):
    assert main(["study", "check", str(ROOT / "doe" / study)]) == 0
    assert "valid; nothing was run" in capsys.readouterr().out


def test_all_faults_of_a_study_are_told_at_once(tmp_path):
    table = TABLE.replace(",5,1,me", ",95,680,me")
    study = STUDY.replace('"bed_slope"', '"moonlight"')
    with pytest.raises(BadInput) as caught:
        check_study(written(tmp_path, study, table))
    told = caught.value.faults
    assert len(told) == 3
    assert "row 2, slope = 95 deg, outside [-90, 90]" in told[0]
    assert "row 2, moisture = 680 % is 6.8 kg kg-1, outside [0, 5]" in told[1]
    assert "candidates.moonlight is not in the library" in told[2]


def test_a_scene_that_does_not_measure_it_is_told_beside_a_unit_that_does_not_fit(tmp_path):
    study = STUDY.replace("saltation", "wind_threshold")
    with pytest.raises(BadInput) as caught:
        check_study(written(tmp_path, study, TABLE.replace("[deg]", "[%]")))
    told = " | ".join(caught.value.faults)
    assert "heading 'slope [%]': it sets a number in deg" in told
    assert "measures rolling_onset, threshold_u_star, threshold_wind_speed, not flux" in told


def test_a_laboratorys_own_table_works_in_a_study_directly(tmp_path):
    table = "Hang (°);w in %;Sandfluss [g/(m s)];SD;n\n5,5;1;1,2;0,1;5\n7;2;1,1;0,1;5\n"
    study = STUDY + '[columns]\n"Hang (°)" = "slope"\n"w in %" = "moisture"\n'
    (tmp_path / "t.toml").write_text(study, encoding="utf-8")
    (tmp_path / "t.csv").write_bytes(table.encode("cp1252"))
    document = check_study(tmp_path / "t.toml")
    assert document["observables"] == {"flux": 2}
    assert document["conditions"] == {"slope": "5.5 to 7 °", "moisture": "1 to 2 %"}


def test_a_table_far_from_its_own_scene_is_suspected_of_a_unit(tmp_path):
    table = TABLE.replace("slope [deg]", "diameter [mm]").replace(",5,1,me", ",25,1,me")
    study = STUDY.replace('slope = "conditions.slope"', 'diameter = "grains.size.diameter"')
    with pytest.raises(BadInput) as caught:
        check_study(written(tmp_path, study, table))
    assert "diameter = 25 mm is 0.025 m, which is unusual" in caught.value.faults[0]
    assert "did you mean [um]?" in caught.value.faults[0]


@pytest.mark.parametrize("read", [check_study, load_study])
def test_faults_of_a_study_and_of_its_table_are_told_at_once(tmp_path, read):
    faulty = STUDY.replace("[candidates]", "[candidates]\nefects = 1")
    path = written(tmp_path, faulty, TABLE.replace(",g/(m s),", ",gg/(m s),"))
    with pytest.raises(BadInput) as caught:
        read(path)
    assert any("candidates.efects" in fault for fault in caught.value.faults), caught.value.faults
    assert any("row 2, unit = 'gg/(m s)'" in fault for fault in caught.value.faults), caught.value.faults
