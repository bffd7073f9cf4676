"""Values and conditions as told: in the units of the table."""

from math import nan

import pytest

from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.scene.schema.units import Scale


def test_values_and_conditions_are_told_in_the_units_of_the_table_also_from_a_stored_document():
    at = {"diameter": Scale("um", 1e-6), "temperature": Scale("°C", 1.0, 273.15), "roughness": Scale("1")}
    units = TableUnits({"threshold": Scale("cm/s", 0.01)}, at)
    assert units.value_text("threshold", 0.253) == "25.3 cm/s"
    assert units.value("threshold", 0.02) == pytest.approx(2.0)
    told = units.setting_text({"diameter": 2.3e-4, "temperature": 303.15, "roughness": 0.1, "slope": nan})
    assert told == "diameter = 230 um, temperature = 30 °C, roughness = 0.1"
    assert TableUnits.of({"table_units": units.record()}) == units
    assert TableUnits.of({"units": {"threshold": "m/s"}}).value_text("threshold", 0.253) == "0.253 m/s"
