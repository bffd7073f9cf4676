"""Scenes whose sections do not fit together are refused in one line."""

import pytest
from scene_tables import SCENES, TUNNEL, complaint, good_table

from taichi_erosion.core.errors import BadInput
from taichi_erosion.execution import check_scene
from taichi_erosion.measures.boundary_layer import AIR_OBSERVABLES
from taichi_erosion.scene.load import load_air_scene, parse_scene
from taichi_erosion.scene.schema.scene import effect_problems

GRID = "wind.columns=[8, 8]; wind.closure='smagorinsky'; wind.drive='gradient'"
GUSTS = "effects.turbulent_gusts.strength=1.0"
OUTSIDE = r"fill.radius = .*: grains would start outside the wall; geometry\."
APART = "grains.clump={spheres = [{offset = [0, 0, 0], radius = 0.5}, {offset = [5, 0, 0], radius = 0.5}]}"
MOVING = "stages.0.move={ground = { velocity = [1.0, 0.0, 0.0] }}"


def test_an_unknown_effect_or_observable_is_told_with_those_that_exist():
    scene = parse_scene(good_table())
    (line,) = effect_problems(scene, {"lift": ("strength",), "drag": ()})
    assert line.startswith("effects.plain_pull is unknown; an effect of your own needs --effect")
    assert line.endswith("known effects: drag, lift")
    (line,) = effect_problems(scene, {"plain_pul": ("strength",), "drag": ()})
    assert line == "effects.plain_pull is unknown; did you mean plain_pul?"
    (line,) = effect_problems(scene, {"plain_pull": ("force",)})
    assert line == "effects.plain_pull.strength is unknown; allowed: force"
    line = complaint(good_table(), observables=("pile_height",))
    assert line == "scenes/bad.toml: measure.repose_angle is unknown; known observables: pile_height"


def test_two_grains_in_one_place_are_refused():
    table = good_table()
    table["grains"]["count"] = 2
    table["fill"] = {"law": "positions", "grains": [{"position": [0.0, 0.0, z]} for z in (0.010, 0.011)]}
    assert "fill.grains.1 overlaps fill.grains.0 by 0.001 m" in complaint(table)


@pytest.mark.parametrize(
    ("order", "line"),
    [
        ("air.sides.x_high.kind=wall", "an inlet needs an outlet"),
        ("run.time_step=0.1", "CFL"),
        ("air.sides.z_high.kind=inlet", "may stand at x_low or z_low only"),
        ("air.sides.y_low.kind=periodic", "both are periodic or none"),
        ("air.sides.z_high.kind=stress", "air.friction_velocity = 0.0"),
        ("air.lowest=0.1", "are higher than the box"),
        ("air.sides.z_low.roughness_length=0.01", "exceeds half a cell"),
        ("air.cells=[100000, 1000, 40]", "at most"),
        ("measure.speed.place=1.0", "measure.speed is unknown"),
    ],
)
def test_a_bad_air_scene_gets_one_line(order: str, line: str):
    with pytest.raises(BadInput, match=line) as refusal:
        load_air_scene(TUNNEL, [order], AIR_OBSERVABLES)
    assert str(refusal.value).startswith(f"{TUNNEL}: ")
    assert "\n" not in str(refusal.value)


REFUSED = [
    ("column_collapse", "fill.radius_d=9.5", OUTSIDE),  # rain into a tube of 9 d
    ("rotating_drum", "fill.radius=0.031", OUTSIDE),  # a lattice in a drum of 0.03 m that lies on its side
    ("funnel_repose", "fill.radius=0.07", OUTSIDE),  # a pour into a funnel
    ("saltation", "wind.columns=[4, 4]", r"measure\.bed_stress reads a single column"),
    ("column_collapse", APART, "some touch no other"),
    ("packed_bed", "wind.columns=[4, 4]", "through_flow needs a single column"),
    ("saltation", "wind.surface=0.2", "the lid is inside the bed"),
    ("saltation", "measure.flux={}", r"measure\.flux\.every is missing"),
    ("wind_threshold", "wind.height=5e-4", "the lid lies inside the bed"),
    ("wind_threshold", "wind.height=3e-3", "the lid lies in the layer where grains hop"),
    ("wind_threshold", "wind.length=1e-3", "wind.length = 0.001 m holds"),
    ("wind_threshold", "wind.look_steps=5000", "wind.look_steps = 5000"),
    ("wind_threshold", "threshold.hold=1e-3", "threshold.hold = 0.001 s is shorter than two"),
    ("wind_threshold", "stages.1.until='time'", "needs a stage with until = 'threshold'"),
    ("wind_threshold", "stages.0.until='threshold'", "must be the last stage"),
    ("wind_threshold", "wind.sleep_after=1e-4", "grains that begin to fall seem to be at rest"),
    ("wind_threshold", MOVING, "may sleep where walls move"),
    ("wind_threshold", "wind.closure='smagorinsky'", "one column has no eddies"),
    ("wind_threshold", "wind.drive='gradient'", "one column is driven by its lid"),
    ("wind_threshold", "wind.columns=[4, 5]", r"wind\.columns\.1 = 5: an even number is needed, at least 4"),
    ("wind_threshold", "wind.columns=[4, 16]", "narrower than a grain"),
    ("wind_threshold", f"effects={{}}; {GRID}; wind.look_steps=100", "a gust of .* crosses .*; at most"),
    ("wind_threshold", f"{GRID}; wind.look_steps=5; {GUSTS}", "the grid has gusts of its own"),
]


@pytest.mark.parametrize(("name", "orders", "message"), REFUSED)
def test_a_fill_or_a_wind_that_does_not_fit_its_scene_is_refused(name: str, orders: str, message: str):
    with pytest.raises(BadInput, match=message):
        check_scene(SCENES / f"{name}.toml", tuple(orders.split("; ")))
