"""Setup of one replica."""

import pytest
from scene_tables import changed, softened

from taichi_erosion.scene import build_setup, laws, parse_scene


def test_gravity_starts_along_its_direction_and_laws_are_those_of_the_scene():
    table = changed("gravity", {"magnitude": 1.62, "direction": [0.0, 3.0, -4.0]})
    assert build_setup(parse_scene(table), 1).gravity == pytest.approx((0.0, 0.6 * 1.62, -0.8 * 1.62))
    chosen = laws(parse_scene(softened("bond_number", 0.02)))
    assert (chosen.normal, chosen.rolling, chosen.friction_cap) == ("jkr", "elastic_plastic", "thornton")
