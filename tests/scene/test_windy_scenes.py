"""Scenes under wind: what is shipped loads, what does not fit together is refused in one line."""

from pathlib import Path

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.run import check_scene
from taichi_erosion.scene import build_setup, load_scene
from taichi_erosion.scene.build.air import surface_height
from taichi_erosion.scene.build.sizes import mean_cube, nominal_diameter

SCENES = Path(__file__).parents[2] / "scenes"
NAMES = ("gusty_patch", "impact_threshold", "packed_bed", "saltation", "terminal_velocity", "wind_threshold")

REFUSED = [
    ("wind_threshold", "wind.height=5e-4", "the lid lies inside the bed"),
    ("wind_threshold", "wind.height=3e-3", "the lid lies in the layer where grains hop"),
    ("wind_threshold", "wind.length=1e-3", "wind.length = 0.001 m holds"),
    ("wind_threshold", "wind.look_steps=5000", "wind.look_steps = 5000"),
    ("wind_threshold", "threshold.hold=1e-3", "threshold.hold = 0.001 s is shorter than two"),
    ("wind_threshold", "threshold.share=2.0", "threshold.share = 2.0 lies outside"),
    ("wind_threshold", "stages.1.until='time'", "needs a stage with until = 'threshold'"),
    ("wind_threshold", "stages.0.until='threshold'", "must be the last stage"),
    ("wind_threshold", "wind.sleep_share=0.0", "wind.sleep_share = 0.0 lies outside"),
    ("wind_threshold", "wind.sleep_after=0.0", "wind.sleep_after = 0.0 lies outside"),
    ("wind_threshold", "wind.sleep_after=1e-4", "grains that begin to fall seem to be at rest"),
    (
        "wind_threshold",
        "stages.0.move={ground = { velocity = [1.0, 0.0, 0.0] }}",
        "may sleep where walls move",
    ),
    ("wind_threshold", "wind.closure='smagorinsky'", "one column has no eddies"),
    ("wind_threshold", "wind.drive='gradient'", "one column is driven by its lid"),
    ("wind_threshold", "wind.columns=[4, 1]", r"wind\.columns\.1 = 1: an even number is needed, at least 4"),
    ("wind_threshold", "wind.columns=[5, 4]", r"wind\.columns\.0 = 5: an even number"),
    ("wind_threshold", "wind.columns=[4, 16]", "narrower than a grain"),
    ("saltation", "wind.columns=[4, 4]", r"measure\.bed_stress reads a single column"),
    ("packed_bed", "wind.columns=[4, 4]", "through_flow needs a single column"),
    ("saltation", "stages.3.friction_velocity=50.0", "lies outside"),
    ("saltation", "wind.surface=0.2", "the lid is inside the bed"),
]


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_scene_under_wind_loads_and_builds(name: str):
    told = check_scene(SCENES / f"{name}.toml")
    scene = load_scene(SCENES / f"{name}.toml")
    setup = build_setup(scene, scene.run.seed)
    assert setup.air is not None
    assert setup.coupling.surface < setup.air.high[2]
    assert told["limits"]["time_step"] == setup.time_step


@pytest.mark.parametrize(("name", "order", "message"), REFUSED)
def test_a_wind_that_does_not_fit_its_patch_is_refused(name: str, order: str, message: str):
    with pytest.raises(BadInput, match=message):
        check_scene(SCENES / f"{name}.toml", (order,))


def test_a_mean_over_a_stage_needs_its_interval(tmp_path: Path):
    text = (SCENES / "saltation.toml").read_text(encoding="utf-8")
    path = tmp_path / "scene.toml"
    path.write_text(text.replace("[measure.flux]\nevery = 5e-3", "[measure.flux]"), encoding="utf-8")
    with pytest.raises(BadInput, match=r"measure\.flux\.every is missing"):
        check_scene(path)


def test_air_may_rise_later_where_only_a_stage_says_so():
    scene = load_scene(SCENES / "packed_bed.toml", ["wind.through_flow=0.0"])
    assert build_setup(scene, 1).coupling.rising


def test_the_bed_is_as_high_as_its_grains_fill_whatever_their_sizes():
    scene = load_scene(SCENES / "wind_threshold.toml")
    wind, size = scene.wind, scene.grains.size
    assert wind is not None
    sampled = build_setup(scene, 1).grains.radius
    solid = (4.0 / 3.0 * 3.14159265 * sampled**3).sum()
    # of a sample of some hundred grains: the mean cube scatters by a few percent
    assert mean_cube(size) < nominal_diameter(size) ** 3
    assert surface_height(scene, wind) == pytest.approx(solid / (0.6 * wind.length * wind.width), rel=0.1)


GRID = ("wind.columns=[8, 8]", "wind.closure='smagorinsky'", "wind.drive='gradient'")


def test_a_grid_over_a_patch_is_built_with_what_stirs_it():
    scene = load_scene(SCENES / "wind_threshold.toml", [*GRID, "wind.look_steps=5"])
    air = build_setup(scene, 3).air
    assert air is not None
    assert air.stir is not None
    assert air.cells[:2] == (8, 8)
    assert air.sides["z_high"].kind == "symmetry"
    assert (air.model.closure, air.model.scheme, air.stir.seed) == ("smagorinsky", "runge_kutta", 3)


def test_a_gust_crosses_no_more_than_a_cell_between_two_looks():
    with pytest.raises(BadInput, match=r"a gust of .* crosses .* between two looks; at most"):
        check_scene(SCENES / "wind_threshold.toml", (*GRID, "wind.look_steps=100"))


def test_gusts_of_the_grid_and_of_the_effect_do_not_blow_at_once():
    orders = (*GRID, "wind.look_steps=5", "effects.turbulent_gusts.strength=1.0")
    with pytest.raises(BadInput, match="the grid has gusts of its own"):
        check_scene(SCENES / "wind_threshold.toml", orders)
