"""Dotted paths of a scene: overrides, and the JSON schema that documents them."""

import json
from typing import Any

import pytest
from scene_tables import SCENES, complaint, good_table

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import parse_scene, resolve
from taichi_erosion.scene.paths import describe_entry_at_path, schema_text, unit_at_path
from taichi_erosion.scene.schema.scene import Stage

BAD_ORDERS = "grains.count|=3|grains..count=3|stages.9.name=x|stages.x=1|grains.count.a.b=3|grains.count=1 2"


@pytest.mark.parametrize(
    ("order", "path", "value"),
    [
        ("grains.count=77", ("grains", "count"), 77),
        ("contact.soil-steel.restitution = 0.3", ("contact", "steel-soil", "restitution"), 0.3),
        ("stages.1.duration_max=0.25", ("stages", 1, "duration_max"), 0.25),
        ("stages.lift.duration_max=0.25", ("stages", 1, "duration_max"), 0.25),
        ("laws.normal=jkr", ("laws", "normal"), "jkr"),
        ("geometry.plate.centre=[0, 0, 0.01]", ("geometry", "plate", "centre"), [0.0, 0.0, 0.01]),
        ("geometry.plate.radius_d=40", ("geometry", "plate", "radius"), 0.08),
        ("effects.lift.strength=0.5", ("effects", "lift", "strength"), 0.5),
    ],
)
def test_any_parameter_can_be_set_by_its_dotted_path(order: str, path: tuple[Any, ...], value: Any):
    place: Any = resolve(parse_scene(good_table(), overrides=[order]))
    for key in path:
        place = place[key]
    assert place == (pytest.approx(value) if isinstance(value, float) else value)


@pytest.mark.parametrize("order", [*BAD_ORDERS.split("|"), "=\n", "stages.x\n=1"])
def test_an_order_that_cannot_be_followed_is_told(order: str):
    assert "--set" in complaint(good_table(), overrides=[order])


def test_a_stage_has_its_name_as_a_place():
    assert unit_at_path("stages.shear.move.lid.force") == unit_at_path("stages.3.move.lid.force") == "N"
    with pytest.raises(BadInput, match="did you mean lift"):
        parse_scene(good_table(), overrides=["stages.lft.duration_max=1.0"])


def test_the_schema_beside_the_scenes_is_fresh_and_every_number_of_it_has_a_unit():
    # write_schema writes it
    assert (SCENES / "scene.schema.json").read_text(encoding="utf-8") == schema_text()

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


def test_the_entries_of_a_list_of_sections_are_told_with_their_meanings():
    first, *lines = describe_entry_at_path("stages").splitlines()
    assert first == f"stages: {(Stage.__doc__ or '').strip()}"
    told = dict(line.strip().split(": ", 1) for line in lines[1:])
    assert list(told) == list(Stage.model_fields)
    assert told["duration_min"] == "shortest duration [s] from 0 to 100000; default 0.0"
    assert told["until"].endswith("; default rest; one of rest, time, threshold")
