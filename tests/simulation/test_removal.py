"""Grains that leave the domain are taken out and counted; the others go on as if nothing had been there."""

from dataclasses import replace

import numpy as np
import pytest
from few_grains import ARMS, equal_clumps
from grain_worlds import RADIUS, contacts, ends, fingerprint, grains, heap, setup
from scipy.spatial.transform import Rotation

from taichi_erosion import simulation
from taichi_erosion.core.setup import Laws, Numerics, PrimitiveKind, Setup
from taichi_erosion.core.snapshot import Status
from taichi_erosion.execution.ensemble_loop import failure_of_lost_grains
from taichi_erosion.simulation.assemble import reallocate_fields
from tests.verification.small_scenes import primitive_table

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
LAWS, HALF, WHOLE = Laws(rolling="elastic_plastic"), 0.02, 0.04  # s
LOW, HIGH = (-0.02, -0.02, -1e-3), (0.02, 0.02, 0.05)  # m, of the domain
DISC = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 2.5 * RADIUS, 0.0)


def on_disc(removes: bool = True) -> Setup:
    """A heap that is wider than the disc below it, and grains that fall beside it, some released later."""
    late = np.array([[9.0 * RADIUS * np.cos(k), 9.0 * RADIUS * np.sin(k), 0.5e-3] for k in range(20)])
    position = np.concatenate([late[:10], heap(60, 1).grains.position, late[10:]])
    release = np.concatenate([np.zeros(70), np.linspace(0.012, 0.03, 10)])
    walls = primitive_table(PrimitiveKind.REVOLVED, DISC)
    table = grains(position, release=release)
    return setup(table, walls, contacts(rolling=0.1), domain=(LOW, HIGH), removes_outside=removes)


def test_grains_that_fall_off_a_disc_are_counted_and_the_rest_is_whole_wherever_it_runs():
    sim = simulation.assemble([on_disc(), heap(60, 2)], LAWS, Numerics("cpu", 1))
    half = ends(sim, HALF)
    kept = simulation.export_state(sim)
    gone_half, now = simulation.removed_spheres(sim), simulation.snapshot(sim, 0)
    whole = ends(sim, WHOLE)
    end, gone = simulation.snapshot(sim, 0), simulation.removed_spheres(sim)
    assert 10 <= gone_half[0] < gone[0] < 80
    assert gone[1] == 0
    assert len(end.ident) + end.removed == 80
    assert now.waiting > 0 == end.waiting
    assert set(now.ident[now.ident < 70]) > set(end.ident[end.ident < 70])
    assert not set(end.ident) & set(range(10))  # they fell beside the disc
    assert (end.position > np.subtract(LOW, RADIUS)).all()  # until the next list a grain may be just outside
    assert end.mass.sum() == pytest.approx(1e-6 * len(end.ident))
    assert failure_of_lost_grains(sim, 0, WHOLE) is None
    simulation.import_state(sim, kept)
    assert ends(sim, WHOLE) == whole
    reallocate_fields(sim, replace(sim.capacities, pairs=80, wall_pairs=16))  # lists overflow at once
    simulation.import_state(sim, kept)
    assert [fingerprint(simulation.snapshot(sim, r)) for r in range(2)] == half
    assert ends(sim, WHOLE) == whole


def test_one_thread_a_grain_removes_the_same_grains():
    found = []
    for numerics in (Numerics("cpu", 2, "f64"), Numerics("cpu", 2, "f64", "grains")):
        sim = simulation.assemble([on_disc()], LAWS, numerics)
        ends(sim, HALF)
        found.append(simulation.snapshot(sim, 0))
    assert found[0].removed == found[1].removed > 10
    assert found[0].ident.tolist() == found[1].ident.tolist()
    assert np.allclose(found[0].position, found[1].position, atol=1e-3 * RADIUS)


@pytest.mark.parametrize("way", ["partitions", "grains"])
def test_a_clump_leaves_with_all_its_spheres(way):
    centre, size = np.array([[0.0, 0.0, 1e-3], [8e-3, 0.0, 2e-3]]), len(ARMS)
    clumps = equal_clumps(centre, Rotation.identity(2))
    table = replace(grains(np.repeat(centre, size, 0) + np.tile(ARMS, (2, 1))), mass=clumps.mass[clumps.body])
    walls = primitive_table(PrimitiveKind.REVOLVED, (8e-3, *DISC[1:]))
    world = setup(table, walls, clumps=clumps, domain=(LOW, HIGH), removes_outside=True)
    sim = simulation.assemble([world], Laws(), Numerics("cpu", 1, "f64", way))
    ends(sim, WHOLE)
    end = simulation.snapshot(sim, 0)
    assert (end.removed, end.ident.tolist()) == (size, [size + k for k in range(size)])


def test_a_domain_that_no_grain_should_leave_still_stops_the_run():
    sim = simulation.assemble([on_disc(removes=False)], LAWS, Numerics("cpu", 1))
    simulation.advance(sim, [WHOLE])
    assert simulation.failure_of(sim, 0).status == Status.LOST
