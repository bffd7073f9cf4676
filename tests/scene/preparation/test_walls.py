"""Walls of a scene become primitives, and the box that no grain may leave."""

from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from scene_tables import changed, good_table

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import PrimitiveKind
from taichi_erosion.scene import build_setup, parse_scene
from taichi_erosion.scene.preparation.walls import TRAY, distance_to_wall


def test_a_mesh_that_is_none_is_told_with_its_path(tmp_path: Path):
    (tmp_path / "wall.stl").write_bytes(b"solid nothing")
    told = {"wall.stl": "triangle", "no.stl": "no such file", "../x.stl": "beside", "a": "no such"}
    for file, word in told.items():
        table = changed("geometry.plate", {"shape": "mesh", "material": "steel", "file": file})
        with pytest.raises(BadInput, match=rf"geometry\.plate.*{word}"):
            parse_scene(table, "bad.toml", tmp_path)


def test_walls_become_the_primitives_that_they_describe():
    table, steel = good_table(), {"material": "steel"}
    table["geometry"] |= {
        "box": {"shape": "box", "material": "steel", "low": [-1.0, -1.0, -1.0], "high": [1.0, 1.0, 1.0]},
        "floor": {"shape": "plane", "material": "soil", "point": [0.0, 0.0, -0.5], "normal": [0.0, 0.0, 2.0]},
        "tube": {"shape": "cylinder", "radius": 0.03, "length": 0.2, "axis": [0.0, 3.0, 0.0]} | steel,
        "cone": {"shape": "cone", "radius_low": 0.01, "radius_high": 0.02, "length": 0.1} | steel,
    }
    table["geometry"]["funnel"]["stem_length"] = 0.01
    setup = build_setup(parse_scene(table), 1)
    assert [surface.name for surface in setup.surfaces] == ["box", "cone", "floor", "funnel", "plate", "tube"]
    walls = setup.primitives
    rows = {each.name: walls.shape[walls.surface == k] for k, each in enumerate(setup.surfaces)}
    kinds = dict(zip(walls.surface.tolist(), walls.kind.tolist(), strict=True))
    assert [kinds[k] for k in range(6)] == [PrimitiveKind.PLANE, 1, 0, PrimitiveKind.REVOLVED, 1, 1]
    assert len(rows["box"]) == 5
    assert rows["box"][3, :6].tolist() == [1.0, 1.0, 1.0, 0.0, -1.0, 0.0]
    assert rows["floor"][0, :6].tolist() == [0.0, 0.0, -0.5, 0.0, 0.0, 1.0]
    assert rows["tube"][0].tolist() == [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.03, 0.0, 0.03, 0.2]
    assert rows["plate"][0, 6:].tolist() == [0.0, 0.0, 0.1, 0.0]
    assert rows["cone"][0, 6:].tolist() == [0.01, 0.0, 0.02, 0.1]
    # stem and cone of a funnel share an edge
    assert rows["funnel"][0, 8:].tolist() == rows["funnel"][1, 6:8].tolist() == pytest.approx([0.01, 0.01])


def test_what_falls_off_the_disc_of_a_heap_lands_on_a_tray_that_nothing_else_touches():
    setup = build_setup(parse_scene(good_table()), 1)
    assert setup.surfaces[-1].name == TRAY
    rows = setup.primitives.shape[setup.primitives.surface == len(setup.surfaces) - 1]
    (floor,) = rows[rows[:, 5] == 1.0, 2]
    low, largest = np.array(setup.domain[0]), setup.grains.radius.max()
    assert (rows[:, 3:6] @ np.ones(3)).tolist() == [1.0, -1.0, 1.0, -1.0, 1.0]
    assert low[2] < floor < -largest * len(setup.grains.radius) ** (1.0 / 3.0)
    for other in ({"geometry.floor": {"shape": "plane", "material": "steel"}}, {"measure": {}}):
        ((path, entry),) = other.items()
        assert TRAY not in [each.name for each in build_setup(parse_scene(changed(path, entry)), 1).surfaces]


def test_a_plane_leaves_more_room_to_run_away_than_a_plate():
    bounded = build_setup(parse_scene(good_table()), 1).domain
    table = good_table()
    table["geometry"]["floor"] = {"shape": "plane", "material": "steel"}
    endless = build_setup(parse_scene(table), 1).domain
    assert endless[1][0] > 2.0 * bounded[1][0] > 0.2


def test_distances_from_a_plane_a_tube_and_a_funnel_are_those_to_their_nearest_points():
    table = good_table()
    table["geometry"] |= {
        "floor": {"shape": "plane", "material": "soil", "point": [0.0, 0.0, -0.5], "normal": [0.0, 0.0, 2.0]},
        "tube": {"shape": "cylinder", "material": "soil", "radius": 0.03, "length": 0.2},
    }
    scene, points = parse_scene(table), np.array([[0.01, 0.0, 0.1], [0.0, 0.07, 0.05], [0.0, 0.03, 0.24]])
    assert distance_to_wall(scene, "floor", points) == pytest.approx([0.6, 0.55, 0.74])
    assert distance_to_wall(scene, "tube", points) == pytest.approx([0.02, 0.04, 0.04])
    middle = [[0.0, 0.0, 0.07], [0.0, 0.0, 0.04]]  # outlet 0.01 at 0.05, rim 0.04 at 0.09: a slope of 4 in 3
    assert distance_to_wall(scene, "funnel", np.array(middle)) == pytest.approx(
        [0.025 * 0.8, 0.01 * sqrt(2.0)]
    )
