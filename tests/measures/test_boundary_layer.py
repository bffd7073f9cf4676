"""Thicknesses and friction velocities of profiles known in closed form."""

import numpy as np
import pytest

from taichi_erosion.core.snapshot import AirSnapshot
from taichi_erosion.measures import boundary_layer

Z = np.linspace(5e-4, 0.5, 1000)


def test_a_seventh_power_layer_has_an_eighth_and_seven_seventysecondths():
    layer = boundary_layer.Profile(Z, 6.0 * np.minimum(Z / 0.1, 1.0) ** (1.0 / 7.0), 0.2, 1.5e-5)
    assert boundary_layer.boundary_layer_thickness(layer) == pytest.approx(0.1 * 0.99**7, rel=0.01)
    # the steep first layers are joined by straight lines: 1 %
    assert boundary_layer.displacement_thickness(layer) == pytest.approx(0.1 / 8.0, rel=0.02)
    assert boundary_layer.momentum_thickness(layer) == pytest.approx(0.1 * 7.0 / 72.0, rel=0.02)


def test_a_log_layer_gives_its_friction_velocity_and_roughness():
    speed = np.minimum(0.3 / 0.4 * np.log(Z / 1e-5), 0.3 / 0.4 * np.log(0.3 / 1e-5))
    fit = boundary_layer.fit_log_profile(boundary_layer.Profile(Z, speed, 0.3, 1.5e-5), 0.4)
    assert fit.friction_velocity == pytest.approx(0.3, rel=1e-6)
    assert fit.roughness_length == pytest.approx(1e-5, rel=1e-5)


def test_a_profile_between_cells_is_interpolated_along_the_wind():
    """Two columns of air, the second one half as fast."""
    z, velocity = np.array([0.1, 0.2, 0.3]), np.zeros((2, 1, 3, 3))
    velocity[:, 0, :, 0] = [[1.0, 2.0, 3.0], [0.5, 1.0, 1.5]]
    faces, nothing, eddies = np.append(0.0, z + 0.05), np.zeros((2, 1, 3)), np.zeros((2, 1, 4))
    fields = (velocity, nothing, eddies, np.array([[0.2], [0.1]]))
    state = AirSnapshot(0.0, np.array([1.0, 2.0]), np.zeros(1), z, faces, *fields, 1.2, 1e-5)
    middle = boundary_layer.wind_profile_at(state, 1.5)
    assert middle.speed == pytest.approx([0.75, 1.5, 2.25])
    assert middle.friction_velocity == pytest.approx(0.15)
    assert boundary_layer.wind_profile_at(state, None).speed == pytest.approx([0.75, 1.5, 2.25])
