"""Values and conditions as told: in the units of the table."""

import pytest

from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.scene.schema.units import Scale

UNITS = TableUnits(
    {"threshold": Scale("cm/s", 0.01)},
    {"diameter": Scale("um", 1e-6), "temperature": Scale("°C", 1.0, 273.15), "roughness": Scale("1")},
)


def test_values_and_conditions_have_the_numbers_and_units_of_the_table():
    assert UNITS.value_text("threshold", 0.253) == "25.3 cm/s"
    assert UNITS.value("threshold", 0.02) == pytest.approx(2.0)
    assert UNITS.value("threshold", None) is None
    assert UNITS.setting_text({"diameter": 2.3e-4, "temperature": 303.15, "roughness": 0.1}) == (
        "diameter = 230 um, temperature = 30 °C, roughness = 0.1"
    )
    assert UNITS.setting_text({"diameter": float("nan")}) == ""


def test_a_stored_document_keeps_its_units_and_one_without_them_tells_those_of_the_model():
    assert TableUnits.of({"table_units": UNITS.record()}) == UNITS
    assert TableUnits.of({"units": {"threshold": "m/s"}}).value_text("threshold", 0.253) == "0.253 m/s"
