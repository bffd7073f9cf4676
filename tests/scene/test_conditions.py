"""Conditions that a user declares: their value, unit and name are checked like all others."""

import pytest
from scene_tables import complaint, good_table

from taichi_erosion.scene import parse_scene, resolve, scene_hash

EXTRA = {"root_density": {"unit": "g/cm3", "value": 0.004}, "room": {"unit": "degC", "value": 20.0}}


def scene_with(extra, overrides=(), **stated):
    table = good_table()
    table["conditions"] = {"moisture": 0.01, "extra": extra} | stated
    return parse_scene(table, overrides=overrides)


def test_effects_read_declared_conditions_in_si_units():
    found = scene_with(EXTRA).conditions.values_in_si()
    assert found == pytest.approx({"moisture": 0.01, "root_density": 4.0, "room": 293.15})


def test_a_value_may_be_set_beside_the_declaration_and_on_the_command_line():
    declared = {"root_density": {"unit": "g/cm3"}}
    assert "root_density" not in scene_with(declared).conditions.values_in_si()
    values = scene_with(declared, root_density=0.5).conditions.values_in_si()
    assert values["root_density"] == pytest.approx(500.0)
    set_later = scene_with(declared, ["conditions.root_density=0.25"])
    assert set_later.conditions.values_in_si()["root_density"] == pytest.approx(250.0)
    assert scene_with(declared, ["conditions.extra.root_density.value=0.25"]) == set_later


def test_a_scene_without_own_conditions_is_what_it_was():
    plain = parse_scene(good_table())
    assert "extra" not in resolve(plain)["conditions"]
    assert scene_hash(plain) != scene_hash(scene_with(EXTRA))
    assert parse_scene(resolve(scene_with(EXTRA))) == scene_with(EXTRA)


@pytest.mark.parametrize(
    ("conditions", "line"),
    [
        ({"moistur": 0.1}, "conditions.moistur is unknown; did you mean 'moisture'?"),
        ({"root_densty": 0.1, "extra": EXTRA}, "root_densty is unknown; did you mean 'root_density'?"),
        ({"xyz": 0.1}, "a condition of your own: [conditions.extra] NAME = { unit = "),
        ({"extra": {"roots": {"unit": "kgs"}}}, "conditions.extra.roots.unit: 'kgs' is not a known unit"),
        ({"extra": {"moisture": {"unit": "1"}}}, "moisture is among [conditions] already, in kg kg-1"),
        ({"extra": {"bed_height": {"unit": "m"}}}, "bed_height is a number that effects get from the scene"),
        ({"extra": {"root density": {"unit": "1"}}}, "conditions.extra.root density"),
    ],
)
def test_a_wrong_condition_gets_one_line(conditions, line):
    table = good_table()
    table["conditions"] = conditions
    assert line in complaint(table)
