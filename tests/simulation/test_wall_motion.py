"""Walls that follow a table, or push with a constant force or torque."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import GRAVITY, MASS, PLATE, RADIUS, ends, grains, heap, setup

from taichi_erosion import simulation
from taichi_erosion.core.setup import Floats, Laws, Motion, MotionRow, Numerics, PrimitiveKind, Servo, Setup
from taichi_erosion.measures.wall_loads import forces_and_torques_on_walls
from tests.verification.small_scenes import joined, primitive_table

pytestmark = pytest.mark.usefixtures("start_device")  # which stops what a test has started
LAWS = Laws(rolling="elastic_plastic")
FORCE = 20.0 * MASS * GRAVITY  # N
HALF, WHOLE = 0.08, 0.1  # s
UP = (0.0, 0.0, 1.0)
STILL = tuple((time, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0) for time in (0.0, 1.0))
TABLE = ((0.0,) * 7, (0.01, 0.2, 0.0, 0.0, 0.0, 0.0, 4.0), (0.03, 0.0, 0.0, -0.1, 0.0, 0.0, 0.0))


def press() -> Setup:
    """A heap in a tube under a disc, which is surface 2."""
    one = heap(60, 1)
    top = one.grains.position[:, 2].max() + 1.5 * RADIUS
    lid = (0.0, 0.0, top, 0.0, 0.0, 1.0, 0.0, 0.0, 0.99 * one.primitives.shape[1, 6], 0.0)
    walls = joined(one.primitives, primitive_table(PrimitiveKind.REVOLVED, lid))
    return replace(setup(one.grains, walls, one.contacts), has_servos=True, tables=(TABLE,))


def pressed(force: float, *table: MotionRow) -> simulation.Simulation:
    """The heap under the disc, which a servo has let fall from above onto the grains, also beside a table."""
    sim = simulation.assemble([replace(press(), tables=(table or TABLE,))], LAWS, Numerics("cpu", 1))
    simulation.move_surface(sim, 0, "wall 2", Motion(table=table, servo=Servo(False, -force, UP, 0.2)))
    ends(sim, HALF)
    return sim


def mean_loads(sim: simulation.Simulation, until: float) -> Floats:
    """Mean of twenty readings on the way to a time [s]."""
    loads = []
    for time in np.linspace(HALF, until, 21)[1:]:
        ends(sim, float(time))
        loads.append(forces_and_torques_on_walls(simulation.contact_network(sim, 0)))
    return np.mean(loads, axis=0)


@pytest.mark.parametrize("table", [(), STILL], ids=["alone", "beside a table"])
def test_a_servo_presses_with_its_force_and_a_run_resumes_under_it(table):
    sim = pressed(FORCE, *table)
    kept = simulation.export_state(sim)
    floor, tube, lid = mean_loads(sim, WHOLE)[:, 2]
    assert lid == pytest.approx(FORCE, rel=0.1)
    assert -floor - tube == pytest.approx(FORCE + 60 * MASS * GRAVITY, rel=0.1)
    whole = ends(sim, WHOLE)
    simulation.import_state(sim, kept)
    assert ends(sim, WHOLE) == whole


def test_a_servo_turns_a_wall_against_the_friction_of_grains_with_its_torque():
    sim, torque = pressed(10.0 * FORCE), 0.5 * FORCE * RADIUS
    simulation.move_surface(sim, 0, "wall 2", Motion(servo=Servo(True, torque, UP, 5.0)))
    before = forces_and_torques_on_walls(simulation.contact_network(sim, 0))[2, 5]
    ends(sim, WHOLE)
    after = forces_and_torques_on_walls(simulation.contact_network(sim, 0))[2, 5]
    assert simulation.wall_poses(sim, 0)["wall 2"].rotation[1, 0] != 0.0
    assert abs(after + torque) < 0.5 * abs(before + torque)  # grains that roll under it let it settle slowly


@pytest.mark.parametrize("way", ["partitions", "grains"])
def test_a_wall_follows_a_table(way):
    table = grains(np.array([[0.0, 0.0, 0.05]]))
    plate = primitive_table(PrimitiveKind.REVOLVED, (0.0, 0.0, -0.01, 0.0, 0.0, 1.0, 0.0, 0.0, 1e-3, 0.0))
    world = setup(table, joined(PLATE, plate), tables=(TABLE,))
    sim = simulation.assemble([world], LAWS, Numerics("cpu", 1, "f64", way))
    ends(sim, 0.01)
    simulation.move_surface(sim, 0, "wall 1", Motion(table=TABLE))
    ends(sim, 0.05)  # 0.04 s later: 1 mm + 2 mm along x, -1 mm - 1 mm along z
    pose = simulation.wall_poses(sim, 0)["wall 1"]
    assert pose.translation == pytest.approx([0.003, 0.0, -0.002], abs=1e-9)
    assert pose.rotation[1, 0] == pytest.approx(np.sin(0.5 * 4.0 * 0.01 + 0.5 * 4.0 * 0.02), rel=1e-6)
