"""Columns on errors of conditions: read from tidy tables and from those of laboratories, told, or refused."""

import re
from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.comparison_rows import comparison_rows
from taichi_erosion.evidence.data.measured import read_table
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.evidence.models.prepared_problem import condition_errors
from tests.evidence.small_study import study_text, table_text

TIDY = "observable,value,n,unit,group,moisture [%],sd of moisture [%],diameter,sd of set diameter\n"
ROWS = "repose_angle,33,3,deg,a,1.5,0.1,0.0002,0.00001\nrepose_angle,31,3,deg,b,0,,0.0002,\n"


def table(folder: Path, text: str):
    file = folder / "heap.csv"
    file.write_text(text, encoding="utf-8")
    return read_table(file, "heap.csv")


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        (
            "sd of moisture [%]",
            "sd of moistur [%]",
            "no column 'moistur'; conditions there: moisture, diameter",
        ),
        ("sd of moisture [%]", "sd of moisture [mm]", "is in [mm]; moisture is in [%]: give it so"),
        (",0.1,", ",-0.1,", "row 2, sd of moisture [%] = '-0.1' must be above 0"),
    ],
)
def test_an_sd_of_no_condition_of_another_unit_or_below_0_is_refused(tmp_path, old, new, told):
    with pytest.raises(BadInput, match=re.escape(told)):
        table(tmp_path, (TIDY + ROWS).replace(old, new))


def test_a_study_has_it_in_the_unit_of_the_model_and_tells_it(tmp_path):
    head, *lines = table_text({"liquid_bridge": 1.0}, 1).splitlines()
    head = head.replace("diameter [mm]", "diameter [mm],sd of set diameter")
    rows = [",".join([*line.split(",")[:7], "0.02", *line.split(",")[7:]]) for line in lines]
    (tmp_path / "heap.csv").write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    (tmp_path / "heap.toml").write_text(study_text(), encoding="utf-8")
    study = load_study(tmp_path / "heap.toml")
    assert study.problem.measurements.condition_sd["diameter"] == pytest.approx(np.full(len(lines), 2e-5))
    assert study.problem.measurements.condition_set == {"diameter"}
    assert any("rows state its sd, at most 0.02 mm; it enters their errors" in note for note in study.notes)
    errors = condition_errors(comparison_rows(study.problem, study.problem.visible()))
    assert errors.sd["diameter"] == pytest.approx(2e-5)
