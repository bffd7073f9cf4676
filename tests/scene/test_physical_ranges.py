"""Ranges of numbers of a scene: those of its schema, and none of conditions of its own."""

from taichi_erosion.scene.physical_ranges import plausible_units, range_at


def test_a_place_has_the_range_of_its_schema_and_a_condition_of_the_own_scene_none():
    found = range_at("grains.size.diameter")
    assert found.unit == "m"
    assert found.is_usual(2.5e-4)
    assert not found.is_usual(0.25)
    assert "mm" in plausible_units([0.25, 0.5], None, found)
    assert range_at("conditions.extra.spread.value") is None
    assert range_at("grains.nothing") is None
