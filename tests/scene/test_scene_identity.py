"""One physical situation has one name; overrides change what they address."""

import copy
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_tables import changed, good_table

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import build_setup, load_scene, parse_scene, resolved, scene_hash

FUNNEL = Path(__file__).parents[2] / "scenes" / "funnel_repose.toml"


def hash_with(*orders: str) -> str:
    return scene_hash(parse_scene(good_table(), overrides=orders))


def test_the_order_of_sections_and_comments_leave_the_hash_and_every_bit(tmp_path: Path):
    sections = re.split(r"\n(?=\[)", FUNNEL.read_text(encoding="utf-8"))
    path = tmp_path / "scene.toml"
    path.write_text("# another comment\n" + "\n".join(reversed(sections)), encoding="utf-8")
    straight, turned = load_scene(FUNNEL), load_scene(path)
    assert list(turned.geometry) == list(reversed(straight.geometry))
    assert scene_hash(turned) == scene_hash(straight)
    first, other = build_setup(straight, 1), build_setup(turned, 1)
    assert first.materials == other.materials
    assert first.surfaces == other.surfaces
    assert np.array_equal(first.primitives.shape, other.primitives.shape)
    assert np.array_equal(first.grains.position, other.grains.position)


@pytest.mark.parametrize(
    "order",
    [
        "run.replicas=9",
        "run.seed=99",
        "record.every=0.5",
        "record.bed_every=3",
        "scene.title='other'",
        "scene.notes='why'",
        "measured.repose_angle.value=20.0",
        "gravity.magnitude=9.81",
        "run.skin=0.05",
        "stages.0.until=rest",
    ],
)
def test_what_is_not_physics_leaves_the_hash(order: str):
    assert hash_with(order) == hash_with()


@pytest.mark.parametrize(
    "order",
    [
        "grains.count=61",
        "contact.soil-soil.restitution=0.61",
        "conditions.moisture=0.02",
        "run.time_step_fraction=0.1",
        "run.precision=f64",
        "laws.friction_cap=edem",
        "effects.plain_pull.strength=0.0",
        "stages.2.duration_max=2.0",
        "geometry.plate.radius=0.11",
    ],
)
def test_what_changes_the_result_changes_the_hash(order: str):
    assert hash_with(order) != hash_with()


def test_a_pair_spelled_the_other_way_round_is_the_same_scene():
    table = good_table()
    table["contact"]["soil-steel"] = table["contact"].pop("steel-soil")
    assert scene_hash(parse_scene(table)) == hash_with()


def test_the_resolved_scene_is_complete_and_reads_back_as_itself():
    scene = parse_scene(good_table())
    table = resolved(scene)
    assert table["gravity"]["magnitude"] == 9.81
    assert table["laws"]["friction_cap"] == "thornton"
    assert table["stages"][0]["rest_energy"] == 1e-5
    assert resolved(parse_scene(table)) == table


@pytest.mark.parametrize(
    ("order", "path", "value"),
    [
        ("grains.count=77", ("grains", "count"), 77),
        ("contact.soil-steel.restitution = 0.3", ("contact", "steel-soil", "restitution"), 0.3),
        ("stages.1.duration_max=0.25", ("stages", 1, "duration_max"), 0.25),
        ("run.skin=0.1", ("run", "skin"), 0.1),
        ("laws.normal=jkr", ("laws", "normal"), "jkr"),
        ("conditions.diameter=2e-3", ("conditions", "diameter"), 2e-3),
        ("geometry.plate.centre=[0, 0, 0.01]", ("geometry", "plate", "centre"), [0.0, 0.0, 0.01]),
        ("geometry.plate.radius_d=40", ("geometry", "plate", "radius"), 0.08),
        ("effects.lift.strength=0.5", ("effects", "lift", "strength"), 0.5),
    ],
)
def test_any_parameter_can_be_set_by_its_dotted_path(order: str, path: tuple[Any, ...], value: Any):
    place: Any = resolved(parse_scene(good_table(), overrides=[order]))
    for key in path:
        place = place[key]
    assert place == (pytest.approx(value) if isinstance(value, float) else value)


@pytest.mark.parametrize(
    "order",
    [
        "grains.count",
        "=3",
        "grains..count=3",
        "stages.9.name=x",
        "stages.x=1",
        "grains.count.a.b=3",
        "grains.count=1 2",
    ],
)
def test_an_order_that_cannot_be_followed_is_told(order: str):
    with pytest.raises(BadInput, match="--set"):
        parse_scene(good_table(), overrides=[order])


def test_loading_leaves_the_given_table_alone():
    table = changed("geometry.plate", {"shape": "disc", "material": "steel", "radius_d": 40.0})
    kept = copy.deepcopy(table)
    parse_scene(table, overrides=["grains.count=5"])
    assert table == kept


def test_an_apparatus_in_diameters_grows_with_its_grains():
    table = changed("geometry.plate", {"shape": "disc", "material": "steel", "radius_d": 40.0})
    table["run"] |= {"time_step_d": 2e-3}
    sizes = [
        f"grains.size.{name}={value}" for name, value in (("low", 2e-3), ("median", 3e-3), ("high", 4e-3))
    ]
    scene = parse_scene(table, overrides=sizes)
    assert scene.geometry["plate"].radius == pytest.approx(0.12)
    assert scene.run.time_step == pytest.approx(6e-6)


def test_the_hash_of_a_mesh_follows_its_content(tmp_path: Path):
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex {x} 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    names = []
    for x in (1.0, 2.0):
        (tmp_path / "wall.stl").write_text(f"solid wall\n{facet.format(x=x)}endsolid wall\n")
        table = changed(
            "geometry.plate", {"shape": "mesh", "material": "steel", "file": "wall.stl", "scale": 0.1}
        )
        scene = parse_scene(table, "scene.toml", tmp_path)
        names.append(scene_hash(scene))
        shape = build_setup(scene, 1).primitives.shape
        assert shape[-1, :9] == pytest.approx([0.0, 0.0, 0.0, 0.1 * x, 0.0, 0.0, 0.0, 0.1, 0.0])
    assert names[0] != names[1]
