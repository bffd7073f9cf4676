"""Time-step limits and adhesion numbers, against figures worked out by hand and by quadrature."""

from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from scene_tables import changed, good_table
from scipy.integrate import quad

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import parse_scene, step_report
from taichi_erosion.scene.load import SOURCE, load_scene
from taichi_erosion.scene.preparation import limits

POISSON, DENSITY, GAMMA = 0.3, 2650.0, 3.3  # surface energy of the study, quartz


@pytest.mark.parametrize(
    ("radius", "shear", "time"), [(0.05e-3, 2e7, 1.95e-6), (0.5e-3, 2e10, 6.2e-7), (1e-3, 2e13, 3.9e-8)]
)
def test_rayleigh_times_of_the_published_parameters(radius: float, shear: float, time: float):
    assert limits.rayleigh_time(radius, DENSITY, shear, POISSON) == pytest.approx(time, rel=0.02)


@pytest.mark.parametrize(
    ("radius", "shear", "tear", "speed"), [(0.05e-3, 2e7, 1.8e-6, 1.9), (1e-3, 2e10, 48e-9, 0.016)]
)
def test_tear_off_distance_and_sticking_speed_of_the_published_parameters(radius, shear, tear, speed):
    reduced, young = 0.5 * radius, shear * (1.0 + POISSON) / (1.0 - POISSON**2)
    mass = 0.5 * DENSITY * 4.0 / 3.0 * pi * radius**3
    assert limits.jkr_tear_off_distance(GAMMA, reduced, young) == pytest.approx(tear, rel=0.03)
    assert limits.jkr_sticking_speed(GAMMA, reduced, young, mass) == pytest.approx(speed, rel=0.03)


def test_the_work_of_separation_is_the_area_under_the_jkr_curve():
    # in s = sqrt(a / L): F = (4/3) s^3 (s^3 - 3) pi gamma R*, delta = (s^4 - 2 s) L^2 / R*;
    # from first touch, s^3 = 2, to tear-off, s^3 = 1/2
    def pull(s: float) -> float:
        return 4.0 / 3.0 * s**3 * (s**3 - 3.0) * (4.0 * s**3 - 2.0)

    area = quad(pull, 0.5 ** (1.0 / 3.0), 2.0 ** (1.0 / 3.0))[0]
    assert area == pytest.approx(-limits.WORK_OF_SEPARATION, rel=1e-5)


def test_duration_and_depth_of_an_impact_solve_its_equation_of_motion():
    mass, radius, young, speed = 2e-6, 1e-3, 2e7, 0.7
    stiffness = 4.0 / 3.0 * young * sqrt(radius)
    depth = limits.impact_overlap(mass, radius, young, speed)
    assert 0.4 * stiffness * depth**2.5 == pytest.approx(0.5 * mass * speed**2)
    # t_c = 2 int d(delta) / v(delta), with delta = depth sin^(4/5) to take the root out of the end
    duration = 2.0 * quad(lambda x: depth / (speed * sqrt(1.0 - x**2.5)), 0.0, 1.0)[0]
    assert limits.impact_duration(mass, radius, young, speed) == pytest.approx(duration, rel=1e-4)


def seed_study(**changes: Any) -> dict[str, Any]:
    table = good_table()
    table["laws"]["normal"] = "jkr"
    table["contact"]["soil-soil"]["surface_energy"] = GAMMA
    table["materials"]["soil"] |= {"density": DENSITY, "poisson_ratio": POISSON, "shear_modulus": 2e7}
    table["grains"] |= {"count": 3000, "size": {"law": "monodisperse", "diameter": 2e-3}}
    table["run"] = changes
    return step_report(parse_scene(table))


def test_the_published_surface_energy_is_reported_and_warned_of():
    told = seed_study()
    assert told["adhesion"]["bond_number"] == pytest.approx(143.0, rel=0.01)
    assert told["adhesion"]["tensile_strength"] == pytest.approx(2.7 * GAMMA / 2e-3)
    assert sum("Bond number" in line or "cohesion" in line for line in told["warnings"]) == 2
    assert any("range of adhesion" in line for line in told["warnings"])
    resolved = seed_study(time_step=1e-7)
    assert resolved["limits"]["jkr_neck"] > 1e-7
    assert not any("range of adhesion" in line for line in resolved["warnings"])


def test_dry_grains_have_a_step_a_speed_and_no_adhesion_numbers():
    told = step_report(parse_scene(good_table()))
    assert (told["adhesion"], told["limits"]["jkr_neck"], told["warnings"]) == (None, None, [])
    assert told["limits"]["rayleigh_time"] == pytest.approx(limits.rayleigh_time(0.5e-3, 2130.0, 1e7, 0.29))
    assert told["time_step"] == pytest.approx(0.2 * told["limits"]["rayleigh_time"])
    # the largest grain's top starts at 0.09 + 0.0015 m above the plate
    assert told["expected_speed"] == pytest.approx(np.sqrt(2.0**2 + 2.0 * 9.81 * 0.0915))


def test_five_rayleigh_times_are_refused_unless_forced():
    table = changed("run", {"time_step_fraction": 5.0})
    with pytest.raises(BadInput, match=r"5 Rayleigh times .* unless run\.force_time_step = true"):
        parse_scene(table)
    parse_scene(table, overrides=["run.force_time_step=true"])


def test_softening_is_told_with_its_rule_and_its_factor():
    table = changed("materials.soil.softening", {"rule": "bond_number", "true_modulus": 2e10})
    (line,) = step_report(parse_scene(table))["softening"]
    assert line == "soil: stiffness divided by 2e+03, bond number kept (rule 'bond_number')"


@pytest.mark.parametrize(
    ("scene", "change", "words"),
    [
        ("funnel_repose", "laws.rolling=none", "friction_rolling changes nothing"),
        ("funnel_repose", "geometry.funnel.outlet=[0.0, 0.0, -0.05]", "behind the plane 'plate'"),
        ("wind_threshold", "wind.friction_velocity=0.3", "settles in a wind of u"),
        ("saltation", "grains.size={law='monodisperse', diameter=1e-5}", "dust"),
    ],
)
def test_an_entry_that_changes_nothing_or_is_hardly_meant_is_warned_of(scene: str, change: str, words: str):
    before, after = (step_report(load_scene(SOURCE / f"{scene}.toml", each)) for each in ((), (change,)))
    assert [words in "".join(each["warnings"]) for each in (before, after)] == [False, True]


@pytest.mark.parametrize(("width", "warned"), [(5.1, False), (4.9, True)])
def test_a_funnel_in_which_grains_may_arch_is_warned_of(width: float, warned: bool):
    grain = step_report(load_scene(SOURCE / "funnel_repose.toml"))["diameter"]["high"]
    scene = load_scene(SOURCE / "funnel_repose.toml", [f"geometry.funnel.outlet_radius={width * grain / 2}"])
    assert any("geometry.funnel" in line for line in step_report(scene)["warnings"]) == warned
