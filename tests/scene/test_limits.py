"""Every number of the schema at both ends of its range: refused in a sentence, or the scene can be set up."""

from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel
from scene_tables import good_table

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import parse_scene, resolve, step_report
from taichi_erosion.scene.preparation.setup import replica_setup

SLOW = ("grains.count",)  # five million grains
FILLS: dict[str, dict[str, Any]] = {
    "pour": {"centre": [0.0, 0.0, 0.09], "radius": 0.02, "speed": 2.0},
    "rain": {"pitch": 4e-3, "radius": 0.014, "first_height": 0.06},
    "lattice": {"pitch": 4e-3, "radius": 0.014, "length": 0.1, "centre": [0.0, 0.0, 0.1]},
    "positions": {"grains": [{"position": [0.0, 0.0, 0.06]}]},
}
WALLS: dict[str, dict[str, Any]] = {
    "floor": {"shape": "plane"},
    "tube": {"shape": "cylinder", "radius": 0.2, "length": 0.5},
    "cone": {"shape": "cone", "radius_low": 0.2, "radius_high": 0.3, "length": 0.1},
    "box": {"shape": "box", "low": [-1.0, -1.0, -1.0], "high": [1.0, 1.0, 1.0]},
}


def scene(law: str) -> dict[str, Any]:
    """A scene with one law of filling and every kind of wall but meshes."""
    table = good_table()
    table["fill"] = {"law": law} | deepcopy(FILLS[law])
    table["grains"]["count"] = 1 if law == "positions" else 30
    table["geometry"] |= {name: {"material": "steel"} | wall for name, wall in WALLS.items()}
    del table["effects"]
    return table


def limits(model: BaseModel, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], float, bool]]:
    """Path and value of every bound of the numbers of a scene, and whether it is that of a vector."""
    for name, field in type(model).model_fields.items():
        value, extra = getattr(model, name), field.json_schema_extra
        if isinstance(extra, dict):
            for bound in (extra.get("minimum"), extra.get("maximum")):
                if isinstance(bound, int | float):
                    yield (*path, name), bound, isinstance(value, tuple)
        for key, part in parts(value):
            yield from limits(part, (*path, name, *key))


def parts(value: Any) -> Iterator[tuple[tuple[Any, ...], BaseModel]]:
    """Sections in a value, with the key of each."""
    if isinstance(value, BaseModel):
        yield (), value
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, tuple) else ()
    yield from (((key,), part) for key, part in pairs if isinstance(part, BaseModel))


def at_limit(table: dict[str, Any], path: tuple[Any, ...], bound: float, is_vector: bool) -> dict[str, Any]:
    """The table with one number, or all of a vector, at a bound; whole where the schema wants whole ones."""
    changed = deepcopy(table)
    place: Any = changed
    for key in path[:-1]:
        place = place.setdefault(key, {}) if isinstance(place, dict) else place[key]
    place[path[-1]] = [float(bound)] * 3 if is_vector else bound
    return changed


@pytest.mark.parametrize("law", FILLS)
def test_a_number_at_the_end_of_its_range_is_refused_in_a_sentence_or_can_be_set_up(law: str):
    table, built = scene(law), 0
    found = [each for each in limits(parse_scene(table)) if ".".join(map(str, each[0])) not in SLOW]
    assert len(found) > 150
    for path, bound, is_vector in found:
        try:
            changed = parse_scene(at_limit(table, path, bound, is_vector))
            setup, told = replica_setup(changed, 1), step_report(changed)
        except BadInput:
            continue
        built += 1
        columns = (setup.grains.position, setup.grains.velocity, setup.grains.mass, setup.gravity)
        assert all(np.isfinite(numbers).all() for numbers in columns), path
        assert told["steps_most"] > 0, path
        assert parse_scene(resolve(changed)) == changed, path
    assert built > 80
