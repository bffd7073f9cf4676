"""The contact network holds the forces that the next step finds, and reading it changes nothing."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import GRAVITY, MASS, RADIUS, fingerprint, grains, heap, mesh_floor, setup

from taichi_erosion import simulation
from taichi_erosion.core.setup import Laws, Numerics, Setup

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
LAWS = Laws(rolling="elastic_plastic")
BEFORE = 0.012  # s; the heap has fallen, and still moves


def on_mesh() -> Setup:
    """A heap that rolls over a floor of triangles, so that contacts pass from one to the next."""
    one, floor = heap(60, 3), mesh_floor(1.3e-3, (-6e-3, -6e-3), (12, 10))
    table = replace(one.grains, velocity=one.grains.velocity + np.array([0.3, 0.1, 0.0]))
    return replace(one, grains=table, primitives=floor, surfaces=(one.surfaces[0],))


@pytest.mark.parametrize("decomposition", ["partitions", "grains"])
@pytest.mark.parametrize("start", [heap(120, 1), on_mesh()], ids=["tube", "mesh"])
def test_forces_of_the_network_are_those_of_the_next_step_and_no_bit_moves(start, decomposition):
    sim = simulation.assemble([start], LAWS, Numerics("cpu", 2, "f64", decomposition))
    state, dt = simulation.export_state(sim), start.time_step
    networks = []
    for time in np.linspace(0.5 * BEFORE, BEFORE, 9):
        simulation.advance(sim, [time])
        networks.append(simulation.contact_network(sim, 0))
    simulation.advance(sim, [BEFORE + dt])
    looked = simulation.snapshot(sim, 0)
    simulation.import_state(sim, state)
    simulation.advance(sim, [BEFORE + dt])
    assert fingerprint(simulation.snapshot(sim, 0)) == fingerprint(looked)
    found = networks[-1]
    assert (found.second < 0).sum() > 3
    assert (found.second >= 0).sum() > 2
    assert looked.force is not None
    wanted = looked.force - (looked.mass[:, None] * np.array([0.0, 0.0, -GRAVITY]))
    assert np.abs(wanted).max() > MASS * GRAVITY
    total, inside = np.zeros_like(wanted), found.second >= 0  # of the forces of all contacts on every grain
    np.add.at(total, found.first, found.force)
    np.add.at(total, found.second[inside], -found.force[inside])
    np.testing.assert_allclose(total, wanted, atol=1e-9 * np.abs(wanted).max())
    middle = found.point[inside] - looked.position[found.first[inside]]
    assert np.allclose(np.linalg.norm(middle, axis=1), RADIUS, rtol=0.05)
    np.testing.assert_allclose((found.tangential_force * found.normal).sum(axis=1), 0.0, atol=1e-12)


def test_a_grain_at_rest_on_a_plate_presses_with_its_weight():
    sim = simulation.assemble([setup(grains([[0.0, 0.0, RADIUS]]))], LAWS, Numerics("cpu", 1))
    simulation.advance(sim, [0.2])
    found = simulation.contact_network(sim, 0)
    assert (found.second.tolist(), found.walls) == ([-1], ("wall 0",))
    np.testing.assert_allclose(found.normal_force, MASS * GRAVITY, rtol=1e-4)
    np.testing.assert_allclose(found.point, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.branch, [[0.0, 0.0, RADIUS]], rtol=1e-3)
