"""Ranges of numbers of a scene: those of its schema, and none of conditions of its own."""

from taichi_erosion.scene.physical_ranges import likely_units, place_range


def test_a_place_has_the_range_of_its_schema_and_a_condition_of_the_own_scene_none():
    found = place_range("grains.size.diameter")
    assert found.unit == "m"
    assert found.is_usual(2.5e-4)
    assert not found.is_usual(0.25)
    assert "mm" in likely_units([0.25, 0.5], None, found)
    assert place_range("conditions.extra.spread.value") is None
    assert place_range("grains.nothing") is None
