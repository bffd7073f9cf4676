"""Air of a scene: over a patch of grains, and alone."""

import numpy as np
import pytest
from scene_tables import SCENES

from taichi_erosion.scene import load_scene, replica_setup
from taichi_erosion.scene.preparation.air import bed_surface_height, inlet_wind
from taichi_erosion.scene.preparation.sizes import mean_cubed_diameter, nominal_diameter
from taichi_erosion.scene.schema.air import LogProfile, TableProfile

GRID = ("effects={}", "wind.columns=[8, 8]", "wind.closure='smagorinsky'", "wind.drive='gradient'")


def test_inlet_profiles_follow_their_laws():
    height = np.array([0.001, 0.01, 0.2])
    logarithmic = LogProfile(law="log", friction_velocity=0.3, roughness_length=1e-4)
    assert inlet_wind(logarithmic, height, 0.4) == pytest.approx(0.75 * np.log1p(height / 1e-4))
    listed = TableProfile(law="table", heights=(0.0, 0.02), speeds=(0.0, 4.0))
    assert inlet_wind(listed, height, 0.4) == pytest.approx([0.2, 2.0, 4.0])


def test_air_may_rise_later_where_only_a_stage_says_so():
    assert replica_setup(load_scene(SCENES / "packed_bed.toml", ["wind.through_flow=0.0"]), 1).coupling.rising


def test_the_bed_is_as_high_as_its_grains_fill_whatever_their_sizes():
    scene = load_scene(SCENES / "wind_threshold.toml")
    wind, size = scene.wind, scene.grains.size
    solid = (4.0 / 3.0 * 3.14159265 * replica_setup(scene, 1).grains.radius ** 3).sum()
    # of a sample of some hundred grains: the mean cube scatters by a few percent
    assert mean_cubed_diameter(size) < nominal_diameter(size) ** 3
    assert bed_surface_height(scene, wind) == pytest.approx(solid / (0.6 * wind.length * wind.width), rel=0.1)


def test_a_grid_over_a_patch_is_built_with_what_stirs_it():
    air = replica_setup(load_scene(SCENES / "wind_threshold.toml", [*GRID, "wind.look_steps=5"]), 3).air
    assert air.initial_turbulence is not None
    assert air.initial_turbulence.seed == 3
    assert (air.cells[:2], air.sides["z_high"].kind) == ((8, 8), "symmetry")
    assert (air.model.closure, air.model.scheme) == ("smagorinsky", "runge_kutta")
