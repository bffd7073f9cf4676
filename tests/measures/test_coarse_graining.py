"""Coarse-grained fields against sums in closed form, and their balance of mass and momentum."""

import numpy as np
import pytest
from scipy.special import erf

from taichi_erosion.core.snapshot import ContactNetwork, Snapshot
from taichi_erosion.measures.coarse_graining import Kernel, coarse_grain, lateral_stress_ratio, solid_fraction
from tests.measures.heaps import snapshot_of

WIDTH, OPEN = 0.7, (0.0, 0.0, 0.0)


def snapshot(position, velocity, mass) -> Snapshot:
    return snapshot_of(position, 1.0, velocity=velocity, mass=mass)


def network(first, second, centre, branch, force) -> ContactNetwork:
    normal = branch / np.linalg.norm(branch, axis=1)[:, None]
    one, two = np.asarray(first, np.int32), np.asarray(second, np.int32)
    return ContactNetwork(0.0, one, two, centre, centre - 0.5 * branch, branch, normal, force, ("floor",))


@pytest.fixture(scope="module")
def world() -> tuple[Snapshot, ContactNetwork]:
    """Twelve grains that move, of unlike masses; any two push each other, and a wall some."""
    rng = np.random.default_rng(1)
    place, speed = rng.uniform(-1.0, 1.0, (12, 3)), rng.normal(size=(12, 3))
    pairs = [(i, j) for i in range(12) for j in range(i + 1, 12)]
    first = np.array([i for i, _ in pairs] + [0, 1, 2])
    second = np.array([j for _, j in pairs] + [-1, -1, -1])
    branch = np.where((second < 0)[:, None], [0.1, 0.2, 0.9], place[first] - place[second])
    force = rng.normal(size=branch.shape)
    return snapshot(place, speed, rng.uniform(1, 2, 12)), network(first, second, place[first], branch, force)


def gaussian(away):
    return np.exp(-0.5 * (away / WIDTH) ** 2).prod(axis=-1) / (np.sqrt(2.0 * np.pi) * WIDTH) ** away.shape[-1]


def line_integral(away, branch):
    """Integral over s in (0, 1) of the Gaussian of away + s b, in closed form."""
    long = np.linalg.norm(branch)
    along = away @ branch / long
    across = np.sqrt(max(away @ away - along**2, 0.0))
    norm = (np.sqrt(2.0 * np.pi) * WIDTH) ** len(away)
    ends = erf((along + long) / (np.sqrt(2.0) * WIDTH)) - erf(along / (np.sqrt(2.0) * WIDTH))
    return np.exp(-0.5 * (across / WIDTH) ** 2) / norm * np.sqrt(0.5 * np.pi) * WIDTH * ends / long


def test_fields_on_a_grid_are_the_sums_of_the_definition(world):
    state, contacts = world
    at = {"x": np.array([-0.5, 0.2]), "y": np.array([0.1]), "z": np.array([-1.0, 0.0, 0.4])}
    found = coarse_grain(state, contacts, Kernel(at, WIDTH, {}))
    for a, b, c in np.ndindex(2, 1, 3):
        r = np.array([at["x"][a], at["y"][b], at["z"][c]])
        psi = gaussian(r - state.position)
        density = (state.mass * psi).sum()
        velocity = (state.mass * psi) @ state.velocity / density
        fluctuation = state.velocity - velocity
        kinetic = np.einsum("n,na,nb->ab", state.mass * psi, fluctuation, fluctuation)
        touches = zip(contacts.force, contacts.branch, contacts.centre, strict=True)
        stress = sum(np.outer(f, b) * line_integral(r - centre, b) for f, b, centre in touches)
        assert found.density[a, b, c] == pytest.approx(density)
        assert found.solid_fraction[a, b, c] == pytest.approx(np.pi / 6.0 * psi.sum())
        np.testing.assert_allclose(found.velocity[a, b, c], velocity)
        np.testing.assert_allclose(found.kinetic_stress[a, b, c], kinetic, atol=1e-12)
        np.testing.assert_allclose(found.contact_stress[a, b, c], stress, atol=1e-9)


@pytest.mark.parametrize("axes", ["z", "xz", "xyz"])
def test_mass_and_momentum_integrate_to_those_of_the_grains(world, axes):
    state, contacts = world
    at, extent = dict.fromkeys(axes, np.arange(-6.0, 6.0, 0.25)), {"x": 3.0, "y": 5.0}
    found = coarse_grain(state, contacts, Kernel(at, WIDTH, extent))
    cell = 0.25 ** len(axes) * np.prod([extent[axis] for axis in "xyz" if axis not in axes])
    assert found.density.sum() * cell == pytest.approx(state.mass.sum(), rel=1e-9)
    total = (np.nan_to_num(found.velocity) * found.density[..., None]).reshape(-1, 3).sum(axis=0) * cell
    np.testing.assert_allclose(total, state.mass @ state.velocity, rtol=1e-4)
    force = contacts.force[contacts.second < 0].sum(axis=0)
    assert found.wall_force.reshape(-1, 3).sum(axis=0) * cell == pytest.approx(force)


def test_the_divergence_of_stress_is_the_force_that_walls_and_contacts_leave_on_the_grains(world):
    state, contacts = world
    h, r = 1e-3, np.array([0.2, -0.1, 0.3])
    divergence = np.zeros(3)
    for k, axis in enumerate("xyz"):
        at = {name: r[n : n + 1] for n, name in enumerate("xyz")} | {axis: r[k] + np.array([-h, h])}
        stress = coarse_grain(state, contacts, Kernel(at, WIDTH, {})).contact_stress.reshape(2, 3, 3)
        divergence += (stress[1] - stress[0])[:, k] / (2.0 * h)
    net = np.zeros((12, 3))
    np.add.at(net, contacts.first, contacts.force)
    pairs = contacts.second >= 0
    np.add.at(net, contacts.second[pairs], -contacts.force[pairs])
    at = {name: r[n : n + 1] for n, name in enumerate("xyz")}
    wall = coarse_grain(state, contacts, Kernel(at, WIDTH, {})).wall_force.reshape(3)
    np.testing.assert_allclose(divergence, wall - gaussian(r - state.position) @ net, rtol=1e-5, atol=1e-7)


def test_grains_that_touch_nothing_have_no_contact_stress(world):
    none = ContactNetwork(0.0, *2 * [np.zeros(0, np.int32)], *5 * [np.zeros((0, 3))], ())
    found = coarse_grain(world[0], none, Kernel({"z": np.zeros(2)}, WIDTH, {"x": 1.0, "y": 1.0}))
    assert found.contact_stress.shape == (2, 3, 3)
    assert not found.contact_stress.any()
    assert found.density[0] > 0.0


def test_a_period_makes_the_field_of_its_images(world):
    state, contacts = world
    at, period = {"x": np.array([-0.9, 0.3]), "z": np.array([0.0])}, 2.5
    found = coarse_grain(state, contacts, Kernel(at, WIDTH, {"y": 1.0}, (period, 0.0, 0.0))).density
    shifts = np.arange(-5, 6)[:, None, None] * [period, 0.0, 0.0]
    images = [snapshot(state.position + shift, state.velocity, state.mass) for shift in shifts]
    kernel = Kernel(at, WIDTH, {"y": 1.0})
    total = sum(coarse_grain(image, contacts, kernel).density for image in images)
    np.testing.assert_allclose(found, total, rtol=1e-9)


def test_a_column_of_grains_at_rest_carries_its_weight_and_fills_the_known_share():
    """Spheres of diameter 1 in columns over a square of edge 2, layer on layer: density 4 m / (4 d)."""
    layers, m, g = 40, 2.0, 10.0
    place = np.array([[x, y, 0.5 + k] for k in range(layers) for x in (0.5, 1.5) for y in (0.5, 1.5)])
    above = np.repeat(np.arange(layers, 0, -1), 4) * m * g  # below each grain
    below = np.arange(len(place)) - 4
    branch = np.tile([0.0, 0.0, 1.0], (len(place), 1))
    branch[:4, 2] = 0.5
    force = np.column_stack([0.1 * above, 0.0 * above, above])
    state = snapshot(place, np.zeros_like(place), np.full(len(place), m))
    contacts = network(np.arange(len(place)), np.maximum(below, -1), place, branch, force)
    z = np.arange(-4.0, 45.0, 0.02)
    found = coarse_grain(state, contacts, Kernel({"z": z}, WIDTH, {"x": 2.0, "y": 2.0}))
    slope = np.gradient(found.contact_stress[:, 2, 2], z)
    force = found.wall_force[:, 2]
    np.testing.assert_allclose(slope, force - g * found.density, atol=1e-3 * force.max())
    deep = np.searchsorted(z, 10.0)
    assert found.contact_stress[deep, 2, 2] == pytest.approx(m * g * (layers - 10.0), rel=0.01)
    assert found.contact_stress[deep, 0, 2] == pytest.approx(0.1 * found.contact_stress[deep, 2, 2])
    assert solid_fraction(state, found).value == pytest.approx(np.pi / 6.0, rel=1e-3)
    assert lateral_stress_ratio(state, found).value == pytest.approx(0.0, abs=1e-9)
