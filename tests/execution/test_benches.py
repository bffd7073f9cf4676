"""Shipped benches at reduced size: their numbers beside laws, stated loads and published angles."""

from math import atan, degrees, pi, sqrt

import pytest

from taichi_erosion.execution import RunOptions, run_scene
from taichi_erosion.scene.load import SCENES

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started


def measured(scene: str, *overrides: str) -> dict[str, float]:
    options = RunOptions(overrides, threads=1, replicas=1, no_record=True)
    measures = run_scene(SCENES / f"{scene}.toml", options)["measures"]
    return {name: found["value"] for name, found in measures.items()}


def test_a_hopper_empties_as_beverloo_says():
    flow = measured("hopper", "grains.count=900", "stages.1.duration_max=0.12", "stages.2.duration_max=0.01")
    diameter, outlet, density = 2e-3, 16e-3, 1500.0  # m, m, kg m-3 in bulk
    beverloo = 0.58 * density * sqrt(9.81) * (outlet - 1.4 * diameter) ** 2.5
    assert flow["mass_flow"] == pytest.approx(beverloo, rel=0.25)  # the law: 15 %, few grains: 10 %


def test_a_sheared_layer_carries_its_load_and_slides_at_the_friction_of_soils():
    found = measured("plane_shear", "grains.count=480", "stages.3.duration_max=0.12")
    assert found["wall_force"] == pytest.approx(13.0, rel=0.02)  # N, that of the servo
    assert 26.0 < found["friction_angle"] < 40.0  # deg; 36.1 is published, 30 to 33 as early as here


def test_a_small_shear_box_reads_the_load_of_its_lid_and_an_angle_near_that_of_glass_beads():
    radius = {"floor.radius": 0.013, "lower.radius": 0.013, "table.hole": 0.013, "upper.radius": 0.013}
    radius |= {"frame.hole": 0.013, "lid.radius": 0.0128}
    small = [f"geometry.{path}={value}" for path, value in radius.items()]
    small += ["grains.count=1250", "fill.radius=0.011", "stages.shear.move.lid.force=-5.31"]
    small += [f"measure.{name}.area=5.31e-4" for name in ("normal_stress", "shear_stress")]
    found = measured("shear_box", *small)
    assert 0.95e4 < found["normal_stress"] < 1.3e4  # Pa; friction of the walls adds to the load of 10 kPa
    ratio = found["shear_stress"] / found["normal_stress"]
    assert degrees(atan(ratio)) == pytest.approx(found["friction_angle"], abs=0.1)
    assert 18.0 < found["residual_friction_angle"] < found["friction_angle"] < 36.0  # deg; 20.9 without a box
    assert 0.5e-3 < found["peak_displacement"] < 6e-3


def test_a_bed_of_two_soils_is_as_dense_as_poured_mixtures():
    found = measured("two_soils")
    assert 0.56 < found["solid_fraction"] < 0.68  # of spheres in loose and dense packings, finer ones in gaps
    bulk = found["solid_fraction"] * 0.016**2 * found["bed_height"]
    sand, aggregate = 0.7 / 2650.0, 0.3 / 1600.0  # m3 of solid in a kilogram
    coarse = aggregate / (sand + aggregate) * bulk / (pi / 6.0 * 2e-3**3)
    assert coarse == pytest.approx(121, rel=0.25)  # grains of the kind, of 1500


def test_what_falls_off_a_disc_leaves_a_heap_of_the_angle_of_the_grains():
    small = "grains.count=900", "geometry.disc.radius=0.014", "fill.radius=0.008"
    found = measured("heap_on_disc", *small, "measure.repose_angle.azimuths=6")
    assert 18.0 < found["repose_angle"] < 36.0  # deg
    assert 0.25 < found["pile_height"] / 0.014 < 0.75  # of the disc's radius


@pytest.mark.slow
def test_a_press_needs_more_force_the_farther_it_goes():
    rows = "[[0.0, 0.0, 0.0, {v}, 0.0, 0.0, 0.0], [0.05, 0.0, 0.0, {v}, 0.0, 0.0, 0.0]]"
    ends = "stages.3.duration_max=0.05", "stages.4.duration_max=0.04", "stages.4.move={plate={}}"
    forces = [
        measured("uniaxial_press", f"stages.3.move.plate.table={rows.format(v=-speed)}", *ends)["wall_force"]
        for speed in (0.002, 0.02)  # m s-1: 0.1 and 1 mm
    ]
    assert 0.5 * 1.25 < forces[0] < 2.0 * 1.25  # N, near the load at which the plate touches
    assert forces[1] > 2.0 * forces[0]
