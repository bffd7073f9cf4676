"""`predict` on a study: which model answers, what is printed, written and stored."""

import csv
import json

import pandas as pd
import pytest

import taichi_erosion as te
from taichi_erosion.cli.main import main
from tests.evidence.small_study import write_study


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return write_study(tmp_path_factory.mktemp("study"), {"liquid_bridge": 1.0})


@pytest.fixture(scope="module")
def table(study):
    path = study.with_name("at.csv")
    path.write_text("moisture [%],diameter [um]\n0,300\n2,300\n", encoding="utf-8")
    return path


def predicted(capsys, *words):
    capsys.readouterr()
    assert main(["predict", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_the_adopted_model_answers_after_an_adoption(study, table, capsys):
    bare = predicted(capsys, study, "--at", table)
    assert bare["adopted"] == []
    assert bare["held_out"] is None
    assert "they stay for `adopt`" in bare["sentences"][-1]
    assert main(["adopt", str(study), "liquid_bridge"]) == 0
    adopted = predicted(capsys, study, "--at", table)
    assert adopted["adopted"] == ["liquid_bridge"]
    assert adopted["held_out"]["n"] > 0
    assert adopted["vault_opened"] == 2
    assert predicted(capsys, study, "--at", table)["vault_opened"] == 2  # one opening for one model
    assert predicted(capsys, study, "--at", table, "--bare")["adopted"] == []
    wet = [row for row in adopted["rows"] if row["observable"] == "threshold_u_star"][1]
    assert wet["conditions"] == {"moisture": 2.0, "diameter": 300.0}
    assert wet["condition_units"] == {"moisture": "%", "diameter": "um"}
    assert wet["low"] < wet["value"] < wet["high"]
    assert (study.parent / "heap-results" / "heap_with_liquid_bridge.predict.json").is_file()


def test_the_table_is_written_as_csv(study, table, capsys):
    out = study.with_name("out.csv")
    assert main(["predict", str(study), "--at", str(table), "--out", str(out)]) == 0
    assert f"written: {out}" in capsys.readouterr().out
    rows = list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))
    assert [row["moisture [%]"] for row in rows] == ["0", "0", "2", "2"]
    before = table.read_text(encoding="utf-8")
    assert main(["predict", str(study), "--at", str(table), "--out", str(table)]) == 2
    assert table.read_text(encoding="utf-8") == before
    given = te.study(study).predict({"moisture [%]": [0.0, 2.0], "diameter [um]": [300.0, 300.0]})
    assert list(given.table["value"]) == [pytest.approx(float(row["value"]), rel=1e-5) for row in rows]
    for wrong in (3, [1.0], {"moisture": 1.0}):
        with pytest.raises(te.BadInput, match="table"):
            te.study(study).predict(wrong)
    assert main(["compare", str(study)]) == 0
    page = te.study(study).report().read_text(encoding="utf-8")
    assert 'id="predictions"' in page


def test_python_takes_a_data_frame(study):
    found = te.study(study).predict(pd.DataFrame({"moisture [%]": [1.0], "diameter [mm]": [0.3]}))
    assert list(found.table["observable"]) == ["repose_angle", "threshold_u_star"]
    assert (found.table["low"] < found.table["high"]).all()


def test_a_table_that_is_not_there_is_one_line(study, capsys):
    assert main(["predict", str(study), "--at", "none.csv"]) == 2
    assert "none.csv: no such file" in capsys.readouterr().err


def test_an_adoption_before_a_change_of_the_table_is_told_to_be_left_out(study, table, capsys):
    measured = study.with_name("heap.csv")
    lines = measured.read_text("utf-8").splitlines(keepends=True)
    measured.write_text("".join([*lines[:-1]]), encoding="utf-8")
    found = predicted(capsys, study, "--at", table)
    assert found["adopted"] == []
    assert found["sentences"][-1].startswith("Left out: liquid_bridge, adopted before the table")
