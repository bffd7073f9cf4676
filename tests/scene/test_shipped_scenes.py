"""The scenes that come with the program, their walls, and the schema beside them."""

import json
from math import atan, degrees
from pathlib import Path

import numpy as np
import pytest
from scene_tables import changed, good_table

from taichi_erosion.core.setup import PrimitiveKind
from taichi_erosion.scene import build_setup, explain, load_scene, parse_scene
from taichi_erosion.scene.diameters import parts_of, scaling_names
from taichi_erosion.scene.paths import schema_text
from taichi_erosion.scene.schema.fields import unit_of
from taichi_erosion.scene.schema.scene import Scene

SCENES = Path(__file__).parents[2] / "scenes"
NAMES = ("column_collapse", "funnel_repose", "incline", "lifting_cylinder", "rotating_drum")


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_scene_loads_builds_and_warns_of_nothing(name: str):
    scene = load_scene(SCENES / f"{name}.toml")
    setup = build_setup(scene, scene.run.seed)
    low, high = map(np.array, setup.domain)
    assert np.all((setup.grains.position > low) & (setup.grains.position < high))
    assert explain(scene)["warnings"] == []


def test_the_funnel_has_the_published_parameters_and_enough_grains():
    scene = load_scene(SCENES / "funnel_repose.toml")
    soil, steel = scene.contact["soil-soil"], scene.contact["soil-steel"]
    assert (soil.restitution, soil.friction_sliding, soil.friction_rolling) == (0.60, 0.61, 0.69)
    assert (steel.restitution, steel.friction_sliding, steel.friction_rolling) == (0.25, 0.34, 0.41)
    assert (scene.materials["soil"].density, scene.materials["steel"].shear_modulus) == (2130.0, 7e10)
    assert scene.grains.count >= 3000
    assert scene.run.replicas >= 3
    told = explain(scene)
    outlet = 2.0 * scene.geometry["funnel"].outlet_radius
    assert outlet > 6.0 * told["diameter"]["high"]
    # grain-steps of all replicas at 25 million a second stay below 90 s
    assert scene.grains.count * scene.run.replicas * told["steps_most"] < 90 * 25e6 * 1.01


@pytest.mark.parametrize(("diameter", "least"), [(1.5e-3, 6.1), (3e-3, 8.6)])
def test_the_column_is_the_apparatus_of_laboratory_c(diameter: float, least: float):
    scene = load_scene(SCENES / "column_collapse.toml", [f"grains.size.diameter={diameter}"])
    settle, collapse = scene.stages
    assert scene.geometry["tube"].radius == pytest.approx(9.0 * diameter)
    assert scene.run.time_step == pytest.approx(1e-2 * diameter)
    assert settle.duration_min == pytest.approx(least * np.sqrt(diameter / 9.81), rel=0.01)
    assert (settle.duration_max, collapse.duration_max) == pytest.approx((350.0 * diameter, 430.0 * diameter))
    assert (settle.rest_energy, collapse.rest_energy) == (1e-5, 1e-7)
    assert collapse.remove == ("tube",)
    assert (scene.grains.count, scene.contact["grain-grain"].friction_rolling) == (1800, 0.12)


def test_the_incline_lets_go_at_the_friction_angle_before_it_tips():
    scene = load_scene(SCENES / "incline.toml")
    friction = scene.contact["soil-steel"].friction_sliding
    assert scene.measured["sliding_angle"].value == pytest.approx(degrees(atan(friction)), abs=0.01)
    assert friction < 1.0 / np.sqrt(3.0)
    grains = build_setup(scene, 1).grains
    assert np.all((grains.position[:, 2] > grains.radius) & (grains.position[:, 2] < 1.02 * grains.radius))
    tilt = scene.stages[1]
    assert tilt.tilt_rate * tilt.duration_max > scene.measured["sliding_angle"].value


def test_the_schema_beside_the_scenes_is_fresh():
    assert (SCENES / "scene.schema.json").read_text(encoding="utf-8") == schema_text(), (
        "run write_schema again"
    )


def test_every_number_of_the_schema_has_a_unit():
    def numbers(part: object, name: str = ""):
        if isinstance(part, dict):
            kinds = {part.get("type")} | {option.get("type") for option in part.get("anyOf", ())}
            if kinds & {"number", "integer"} and "unit" not in part:
                yield name
            for key, entry in part.items():
                # the parts of a vector or of an option carry the unit of the whole
                if key not in ("anyOf", "prefixItems", "items", "additionalProperties"):
                    yield from numbers(entry, f"{name}.{key}")

    assert list(numbers(json.loads(schema_text())["$defs"])) == []


def test_a_name_that_may_be_given_in_diameters_has_one_kind_of_unit():
    scaled = scaling_names()
    units = {
        (name, unit_of(field))
        for part in parts_of(Scene)
        for name, field in part.model_fields.items()
        if name in scaled and part.__name__ != "ClumpSphere"  # [grains] is never expanded
    }
    assert sorted(name for name, _ in units) == sorted(scaled)


def test_walls_become_the_primitives_that_they_describe():
    table = good_table()
    table["geometry"] |= {
        "box": {"shape": "box", "material": "steel", "low": [-1.0, -1.0, -1.0], "high": [1.0, 1.0, 1.0]},
        "floor": {"shape": "plane", "material": "soil", "point": [0.0, 0.0, -0.5], "normal": [0.0, 0.0, 2.0]},
        "tube": {
            "shape": "cylinder",
            "material": "steel",
            "radius": 0.03,
            "length": 0.2,
            "axis": [0.0, 3.0, 0.0],
        },
        "cone": {
            "shape": "cone",
            "material": "steel",
            "radius_low": 0.01,
            "radius_high": 0.02,
            "length": 0.1,
        },
    }
    table["geometry"]["funnel"]["stem_length"] = 0.01
    setup = build_setup(parse_scene(table), 1)
    assert [surface.name for surface in setup.surfaces] == ["box", "cone", "floor", "funnel", "plate", "tube"]
    rows = {
        surface.name: setup.primitives.shape[setup.primitives.surface == k]
        for k, surface in enumerate(setup.surfaces)
    }
    kinds = dict(zip(setup.primitives.surface.tolist(), setup.primitives.kind.tolist(), strict=True))
    assert [kinds[k] for k in range(6)] == [PrimitiveKind.PLANE, 1, 0, PrimitiveKind.REVOLVED, 1, 1]
    assert len(rows["box"]) == 5
    assert rows["box"][3, :6].tolist() == [1.0, 1.0, 1.0, 0.0, -1.0, 0.0]
    assert rows["floor"][0, :6].tolist() == [0.0, 0.0, -0.5, 0.0, 0.0, 1.0]
    assert rows["tube"][0].tolist() == [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.03, 0.0, 0.03, 0.2]
    assert rows["plate"][0, 6:].tolist() == [0.0, 0.0, 0.1, 0.0]
    assert rows["cone"][0, 6:].tolist() == [0.01, 0.0, 0.02, 0.1]
    # stem and cone of a funnel share an edge
    assert rows["funnel"][0, 8:].tolist() == rows["funnel"][1, 6:8].tolist() == pytest.approx([0.01, 0.01])


def test_gravity_starts_along_its_direction():
    table = changed("gravity", {"magnitude": 1.62, "direction": [0.0, 3.0, -4.0]})
    assert build_setup(parse_scene(table), 1).gravity == pytest.approx((0.0, 0.6 * 1.62, -0.8 * 1.62))


def test_a_plane_leaves_more_room_to_run_away_than_a_plate():
    bounded = build_setup(parse_scene(good_table()), 1).domain
    table = good_table()
    table["geometry"]["floor"] = {"shape": "plane", "material": "steel"}
    endless = build_setup(parse_scene(table), 1).domain
    assert endless[1][0] > 2.0 * bounded[1][0] > 0.2
