"""Sums of contact forces on walls, and what is read from their series."""

from math import atan, degrees

import numpy as np
import pytest

from taichi_erosion.core.snapshot import ContactNetwork
from taichi_erosion.measures import wall_loads

UP = np.array([0.0, 0.0, 1.0])


def test_the_load_of_a_wall_is_the_sum_of_its_contacts_with_opposite_sign():
    # one contact of two grains, two on wall 1, one on wall 0
    first, second = np.array([[0, 1, 2, 3], [1, -2, -2, -1]], dtype=np.int32)
    point = np.array([[9.0, 9.0, 9.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]])
    force = np.array([[7.0, 7.0, 7.0], [0.0, 0.0, 2.0], [3.0, 0.0, 1.0], [0.0, 5.0, 0.0]])
    zero = np.zeros((4, 3))
    network = ContactNetwork(0.0, first, second, zero, point, zero, zero, force, ("a", "b"))
    loads = wall_loads.forces_and_torques_on_walls(network)
    assert loads[0].tolist() == [0.0, -5.0, 0.0, 5.0, 0.0, 0.0]  # z x -5 y = 5 x
    assert loads[1].tolist() == [-3.0, 0.0, -3.0, -2.0, 2.0, 6.0]


def test_forces_and_torques_are_means_with_the_scatter_of_blocks():
    rng = np.random.default_rng(1)
    loads = [np.array([0.0, 0.0, 2.0 + x, 0.0, 1.0, 0.5, 9.0, 9.0, 9.0]) for x in rng.normal(0.0, 0.1, 64)]
    force = wall_loads.mean_force_along_axis(loads, UP)
    assert (force.value, force.unit) == (pytest.approx(2.0, abs=0.05), "N")
    assert force.sd == pytest.approx(0.1 / 8.0, rel=0.5)
    about = wall_loads.mean_torque_about(loads, np.array([0.0, 1.0, 0.0]), np.array([3.0, 0.0, 0.0]))
    assert about.value == pytest.approx(1.0 + 3.0 * force.value)  # -(3 x) x (F z) = 3 F y
    assert wall_loads.mean_force_along_axis(loads[:1], UP).value == loads[0][2]
    assert np.isnan(wall_loads.mean_force_along_axis(loads[:3], UP).value)


def test_a_friction_angle_is_that_of_the_largest_mean_ratio():
    ratio = np.concatenate([np.linspace(0.0, 0.7, 40), np.full(24, 0.5)])
    loads = [np.array([each * 3.0, each * 4.0, -10.0, 0.0, 0.0, 0.0]) for each in ratio]  # T = 5 ratio
    found = wall_loads.peak_friction_angle(loads, UP)
    assert found.value == pytest.approx(degrees(atan(0.5 * ratio[36:40].mean())))
    assert found.details["normal_force"] == pytest.approx(10.0)
    rest = wall_loads.residual_friction_angle(loads, UP)
    assert (rest.value, rest.sd) == (pytest.approx(degrees(atan(0.25))), pytest.approx(0.0, abs=1e-12))
    assert np.isnan(wall_loads.peak_friction_angle(loads[:8], UP).value)
    assert np.isnan(wall_loads.peak_friction_angle([np.zeros(6)] * 20, UP).value)


def test_stresses_and_the_displacement_are_those_of_the_peak():
    places = np.linspace(0.0, 63e-3, 64)  # m, along x and, of the lid, up
    loads = [np.array([0, 8.0 if k < 32 else 2.0, -10, 0, 0, 0, x, 0, x]) for k, x in enumerate(places)]
    assert wall_loads.value_at_peak("shear_stress", loads, UP, 0.5).value == pytest.approx(16.0)
    assert wall_loads.value_at_peak("normal_stress", loads, UP, 0.5).value == pytest.approx(20.0)
    displacement = wall_loads.value_at_peak("peak_displacement", loads, UP, 0.5)
    assert displacement.value == pytest.approx(places[:4].mean())
