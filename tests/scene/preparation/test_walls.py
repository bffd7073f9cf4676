"""Walls of a scene become primitives, and the box that no grain may leave."""

from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from scene_tables import changed, good_table

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import PrimitiveKind
from taichi_erosion.scene import parse_scene, replica_setup
from taichi_erosion.scene.preparation.walls import distance_to_wall

STEEL = {"material": "steel"}
PLANE = {"shape": "plane", **STEEL}
LOW = PLANE | {"material": "soil", "point": [0.0, 0.0, -0.5], "normal": [0.0, 0.0, 2.0]}
SIDES = {"shape": "box", "low": [-1.0, -1.0, 0.0], "high": [1.0, 1.0, 1.0], **STEEL}
TUBE = {"shape": "cylinder", "radius": 0.03, "length": 0.2, **STEEL}


def test_a_mesh_that_is_none_is_told_with_its_path(tmp_path: Path):
    (tmp_path / "wall.stl").write_bytes(b"solid nothing")
    told = {"wall.stl": "triangle", "no.stl": "no such file", "../x.stl": "beside", "a": "no such"}
    for file, word in told.items():
        table = changed("geometry.plate", {"shape": "mesh", "material": "steel", "file": file})
        with pytest.raises(BadInput, match=rf"geometry\.plate.*{word}"):
            parse_scene(table, "bad.toml", tmp_path)


def test_walls_become_the_primitives_that_they_describe():
    table = good_table()
    table["geometry"] |= {
        "box": SIDES | {"low": [-1.0, -1.0, -1.0]},
        "floor": LOW,
        "tube": TUBE | {"axis": [0.0, 3.0, 0.0]},
        "cone": {"shape": "cone", "radius_low": 0.01, "radius_high": 0.02, "length": 0.1} | STEEL,
    }
    table["geometry"]["funnel"]["stem_length"] = 0.01
    setup = replica_setup(parse_scene(table), 1)
    assert [surface.name for surface in setup.surfaces] == ["box", "cone", "floor", "funnel", "plate", "tube"]
    walls = setup.primitives
    rows = {each.name: walls.shape[walls.surface == k] for k, each in enumerate(setup.surfaces)}
    kinds = dict(zip(walls.surface.tolist(), walls.kind.tolist(), strict=True))
    assert [kinds[k] for k in range(6)] == [PrimitiveKind.PLANE, 1, 0, PrimitiveKind.REVOLVED, 1, 1]
    assert (len(rows["box"]), rows["box"][3, :6].tolist()) == (5, [1.0, 1.0, 1.0, 0.0, -1.0, 0.0])
    assert rows["floor"][0, :6].tolist() == [0.0, 0.0, -0.5, 0.0, 0.0, 1.0]
    assert rows["tube"][0].tolist() == [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.03, 0.0, 0.03, 0.2]
    assert rows["plate"][0, 6:].tolist() == [0.0, 0.0, 0.1, 0.0]
    assert rows["cone"][0, 6:].tolist() == [0.01, 0.0, 0.02, 0.1]
    # stem and cone of a funnel share an edge
    assert rows["funnel"][0, 8:].tolist() == rows["funnel"][1, 6:8].tolist() == pytest.approx([0.01, 0.01])


@pytest.mark.parametrize(
    ("path", "entry", "removes"),
    [
        ("geometry.floor", PLANE, False),
        ("geometry.floor", PLANE | {"normal": [1.0, 0.0, 0.0]}, True),
        ("geometry.floor", SIDES, False),
        ("geometry.floor", SIDES | {"faces": ["x_low", "z_high"]}, True),
        ("measure", {}, True),
        ("domain", {"outside": "stop"}, False),
    ],
)
def test_grains_that_leave_are_taken_out_unless_a_half_space_holds_all_up(path, entry, removes):
    assert replica_setup(parse_scene(changed(path, entry)), 1).removes_outside is removes


def test_a_plane_leaves_more_room_to_run_away_than_a_plate():
    bounded = replica_setup(parse_scene(good_table()), 1).domain
    open_plane = replica_setup(parse_scene(changed("geometry.floor", PLANE)), 1).domain
    assert open_plane[1][0] > 2.0 * bounded[1][0] > 0.2


def test_distances_from_a_plane_a_tube_and_a_funnel_are_those_to_their_nearest_points():
    table = good_table()
    table["geometry"] |= {"floor": LOW, "tube": TUBE}
    scene, points = parse_scene(table), np.array([[0.01, 0.0, 0.1], [0.0, 0.07, 0.05], [0.0, 0.03, 0.24]])
    assert distance_to_wall(scene, "floor", points) == pytest.approx([0.6, 0.55, 0.74])
    assert distance_to_wall(scene, "tube", points) == pytest.approx([0.02, 0.04, 0.04])
    middle = [[0.0, 0.0, 0.07], [0.0, 0.0, 0.04]]  # outlet 0.01 at 0.05, rim 0.04 at 0.09: a slope of 4 in 3
    assert distance_to_wall(scene, "funnel", np.array(middle)) == pytest.approx([0.025 * 0.8, 0.01 * sqrt(2)])


ROWS = [[0.0] * 7, [1.0, 0.2, 0.0, 0.0, 0.0, 0.0, 3.0], [3.0, 0.0, 0.0, -0.1, 0.0, 0.0, 0.0]]


def test_a_wall_that_follows_a_table_or_a_servo_has_both_in_its_setup_and_its_way_in_the_domain():
    moved = replica_setup(parse_scene(changed("stages.1", stage_of({"table": ROWS}))), 1)
    assert moved.tables == (tuple(map(tuple, ROWS)),)
    assert not moved.has_servos
    still = replica_setup(parse_scene(changed("stages.1", stage_of({}))), 1)
    # 0.1 + 0.2 m along x, 0.1 m down until 3 s and 0.2 m more until 5 s; a margin grows with the extent
    assert moved.domain[1][0] - still.domain[1][0] == pytest.approx(0.3 * 1.5)
    assert still.domain[0][2] - moved.domain[0][2] > 0.3
    servo = replica_setup(parse_scene(changed("stages.1", stage_of({"force": -2.0}))), 1)
    assert servo.has_servos
    assert servo.tables == ()


@pytest.mark.parametrize(
    ("order", "told"),
    [
        ({"force": 1.0, "torque": 1.0}, "one of them"),
        ({"table": ROWS, "velocity": [0.0, 0.0, 1.0]}, "leave these out"),
        ({"table": ROWS[:1]}, "two rows"),
        ({"table": [ROWS[1], ROWS[0]]}, "rise"),
    ],
)
def test_orders_that_contradict_each_other_are_refused(order, told):
    with pytest.raises(BadInput, match=told):
        parse_scene(changed("stages.1", stage_of(order)))


def stage_of(order: dict) -> dict:
    """A stage of five seconds that moves the plate."""
    return {"name": "lift", "duration_max": 5.0, "move": {"plate": order}}


def test_a_box_may_be_periodic_without_wind_and_own_apparatus_needs_no_kind():
    table = good_table()
    del table["scene"]["kind"]
    table["fill"] = {"law": "layers", "pitch": 4e-3, "first_height": 4e-3}
    table["geometry"] = {"floor": PLANE}
    table |= {"domain": {"period": [0.03, 0.04]}, "measure": {}, "stages": table["stages"][:1]}
    setup = replica_setup(parse_scene(table), 1)
    assert (setup.period, setup.domain[0][:2]) == ((0.03, 0.04, 0.0), (0.0, 0.0))
    assert (setup.grains.position[:, :2] < (0.034, 0.044)).all()
    table["domain"]["period"] = [0.02, 0.04]
    with pytest.raises(BadInput, match=r"period\.0 = 0\.02 m holds 5 grains"):
        parse_scene(table)
    table["fill"] = {"law": "rain", "pitch": 4e-3, "radius": 0.02, "first_height": 4e-3}
    with pytest.raises(BadInput, match="filled by 'layers'"):
        parse_scene(table)
