"""Tables of new conditions: units, headings, what is missing."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.models.column_units import place_units
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.evidence.models.new_conditions import read_new_conditions
from tests.evidence.small_study import write_study


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return load_study(write_study(tmp_path_factory.mktemp("study"), {}))


def read(study, folder, text):
    table = folder / "at.csv"
    table.write_text(text, encoding="utf-8")
    places = place_units(study.file, study.path)
    return read_new_conditions(table, study.file, places, study.problem.measurements, study.path.parent)


def test_numbers_are_read_in_the_units_of_their_headings_else_in_those_of_the_study(study, tmp_path):
    found = read(study, tmp_path, "Moisture [%];diameter [um]\n1,5;250\n2;300\n")
    assert found.conditions["moisture"] == pytest.approx([0.015, 0.015, 0.02, 0.02])
    assert found.conditions["diameter"] == pytest.approx([2.5e-4, 2.5e-4, 3e-4, 3e-4])
    assert found.observable == ("repose_angle", "threshold_u_star") * 2
    plain = read(study, tmp_path, "moisture,diameter\n0.015,0.25\n")
    assert plain.conditions["diameter"] == pytest.approx([2.5e-4] * 2)  # the study's table has millimetres
    assert plain.scales["diameter"].unit == "mm"


def test_a_column_of_observables_says_what_is_wanted(study, tmp_path):
    text = "observable,moisture,diameter [mm]\nrepose_angle,0.01,0.2\n,0.02,0.2\n"
    assert read(study, tmp_path, text).observable == ("repose_angle", "repose_angle", "threshold_u_star")
    with pytest.raises(BadInput, match="row 2, observable = 'flux'; the study has"):
        read(study, tmp_path, "observable,moisture,diameter [mm]\nflux,0.01,0.2\n")


def test_a_missing_condition_is_refused_where_the_study_varies_it(study, tmp_path):
    with pytest.raises(BadInput, match=r"no column sets moisture, which the study varies from 0 to 0\.04"):
        read(study, tmp_path, "diameter [mm]\n0.2\n")


def test_every_bad_cell_is_told(study, tmp_path):
    with pytest.raises(BadInput) as told:
        read(study, tmp_path, "moisture,diameter [mm]\n,0.2\n0.01,fine\n0.02,\n")
    assert len(told.value.faults) == 3
    with pytest.raises(BadInput, match="holds no conditions"):
        read(study, tmp_path, "moisture,diameter [mm]\n")


def test_impossible_conditions_are_refused_with_the_ranges_of_a_new_study(study, tmp_path):
    with pytest.raises(BadInput, match=r"row 2, moisture = 600 % is 6 kg kg-1, outside \[0, 5\]"):
        read(study, tmp_path, "moisture [%],diameter [mm]\n600,0.2\n")


def test_one_column_of_decimal_commas_is_one_column(study, tmp_path):
    constant = replace(study.problem.measurements, conditions={**study.problem.measurements.conditions})
    constant.conditions["diameter"] = np.full(constant.size, 2e-4)
    (tmp_path / "at.csv").write_text("moisture [%]\n1,5\n2,25\n", encoding="utf-8")
    places = place_units(study.file, study.path)
    found = read_new_conditions(tmp_path / "at.csv", study.file, places, constant, tmp_path)
    assert found.conditions["moisture"] == pytest.approx([0.015, 0.015, 0.0225, 0.0225])


def test_a_condition_that_the_study_does_not_have_is_refused(study, tmp_path):
    with pytest.raises(BadInput, match="density is no condition of the study, which has moisture, diameter"):
        read(study, tmp_path, "moisture [%],diameter [mm],grain density [g/cm3]\n1,0.2,4\n")
