"""Tables of new conditions: units, headings, what is missing."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.models.load_study import load_study
from taichi_erosion.evidence.models.table_columns import place_units, read_new_conditions
from tests.evidence.small_study import write_study


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return load_study(write_study(tmp_path_factory.mktemp("study"), {}))


@pytest.fixture
def read(study, tmp_path):
    """Function that reads a table of new conditions of the study."""

    def found(text, measurements=study.problem.measurements):
        (tmp_path / "at.csv").write_text(text, encoding="utf-8")
        places = place_units(study.file, study.path)
        return read_new_conditions(tmp_path / "at.csv", study.file, places, measurements, tmp_path)

    return found


def test_numbers_are_read_in_the_units_of_their_headings_else_in_those_of_the_study(read):
    found = read("Moisture [%];diameter [um]\n1,5;250\n2;300\n")
    assert found.conditions["moisture"] == pytest.approx([0.015, 0.015, 0.02, 0.02])
    assert found.conditions["diameter"] == pytest.approx([2.5e-4, 2.5e-4, 3e-4, 3e-4])
    assert found.observable == ("repose_angle", "threshold_u_star") * 2
    plain = read("moisture,diameter\n0.015,0.25\n")
    assert plain.conditions["diameter"] == pytest.approx([2.5e-4] * 2)  # the study's table has millimetres
    assert plain.scales["diameter"].unit == "mm"


def test_a_column_of_observables_says_what_is_wanted(read):
    found = read("observable,moisture,diameter [mm]\nrepose_angle,0.01,0.2\n,0.02,0.2\n")
    assert found.observable == ("repose_angle", "repose_angle", "threshold_u_star")


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("observable,moisture,diameter [mm]\nflux,0.01,0.2\n", ["row 2, observable = 'flux'; the study has"]),
        ("diameter [mm]\n0.2\n", ["no column sets moisture, which the study varies from 0 to 0.04"]),
        ("moisture,diameter [mm]\n,0.2\n0.01,fine\n0.02,\n", ["row 2", "row 3", "row 4"]),
        ("moisture,diameter [mm]\n", ["holds no conditions"]),
        ("moisture [%],diameter [mm]\n600,0.2\n", ["row 2, moisture = 600 % is 6 kg kg-1, outside [0, 5]"]),
        (
            "moisture [%],diameter [mm],grain density [g/cm3]\n1,0.2,4\n",
            ["density is no condition of the study, which has moisture, diameter"],
        ),
    ],
)
def test_conditions_that_cannot_be_asked_are_refused_all_at_once(read, text, faults):
    with pytest.raises(BadInput) as told:
        read(text)
    assert len(told.value.faults) == len(faults)
    assert all(words in fault for words, fault in zip(faults, told.value.faults, strict=True))


def test_one_column_of_decimal_commas_is_one_column(study, read):
    table = study.problem.measurements
    constant = replace(table, conditions=table.conditions | {"diameter": np.full(table.size, 2e-4)})
    found = read("moisture [%]\n1,5\n2,25\n", constant)
    assert found.conditions["moisture"] == pytest.approx([0.015, 0.015, 0.0225, 0.0225])
