"""Control of a running simulation: walls, gravity, contact parameters, effects."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taichi_erosion.core.effect import ReplicaEffect, longest_effect_reaches
from taichi_erosion.core.effect_device import write_effect_constants
from taichi_erosion.core.setup import ContactTable, Floats, Motion, PrimitiveKind, Setup
from taichi_erosion.core.transfer import download, upload
from taichi_erosion.grains.materials import upload_materials
from taichi_erosion.grains.walls import FORCE, NO_SERVO, TORQUE
from taichi_erosion.simulation.assemble import Simulation, device_effects_by_place

AXIS_TOLERANCE = 1e-9  # of the extent: a surface of revolution turning about its own axis keeps its shape [1]


def place_of_named_surface(sim: Simulation, replica: int, name: str) -> int:
    """Place of a named surface among those of all replicas. Raises KeyError where there is none."""
    names = [surface.name for surface in sim.setups[replica].surfaces]
    if name not in names:
        raise KeyError(f"no surface '{name}'; there are {', '.join(names)}")
    return replica * sim.capacities.surfaces + names.index(name)


def remove_surface(sim: Simulation, replica: int, name: str) -> None:
    upload([(sim.world.walls.present, [0.0])], place_of_named_surface(sim, replica, name))
    request_rebuild_and_wake(sim, replica)


def move_surface(sim: Simulation, replica: int, name: str, motion: Motion) -> None:
    """Set the rigid motion of a wall; it replaces the one before and starts from where the wall is."""
    walls = sim.world.walls
    place = place_of_named_surface(sim, replica, name)
    moves = any((*motion.velocity, *motion.spin, *motion.table)) or motion.servo is not None
    has_moved = moves or download([walls.has_moved], place, 1)[0][0] > 0.0
    setup, surface = sim.setups[replica], place % sim.capacities.surfaces
    steady = [replace(motion, velocity=row[1:4], spin=row[4:7]) for row in motion.table] or [motion]
    sweep = max(wall_speed_bound(setup, surface, each) for each in steady)
    vectors = [(getattr(walls, name), [getattr(motion, name)]) for name in ("velocity", "spin", "centre")]
    words = [(walls.moving, [float(moves)]), (walls.has_moved, [float(has_moved)]), (walls.sweep, [sweep])]
    upload([*words, *vectors, *wall_drive_fields(sim, replica, surface, motion)], place)
    request_rebuild_and_wake(sim, replica)


def wall_drive_fields(
    sim: Simulation, replica: int, surface: int, motion: Motion
) -> list[tuple[Any, list[Any]]]:
    """Fields of a surface that say by which table and servo it moves, with their values."""
    walls, setup, servo = sim.world.walls, sim.setups[replica], motion.servo
    lengths, in_use = [len(table) for table in setup.tables], motion.table in setup.tables
    first = sum(lengths[: setup.tables.index(motion.table)]) if in_use else 0
    now = download([sim.world.replicas.step], replica, 1)[0][0]
    columns = [(walls.row, [replica * walls.rows + first]), (walls.row_count, [in_use * len(motion.table)])]
    columns += [(walls.start_step, [now]), (walls.servo_speed, [0.0])]
    if servo is None:
        return [*columns, (walls.servo, [NO_SERVO])]
    turning = replace(motion, velocity=(0.0, 0.0, 0.0), spin=servo.axis)
    reach = wall_speed_bound(setup, surface, turning) if servo.is_torque else 1.0
    numbers = {"target": servo.target, "axis": servo.axis, "fastest": servo.fastest, "servo_reach": reach}
    columns += [(getattr(walls, name), [value]) for name, value in numbers.items()]
    return [*columns, (walls.servo, [TORQUE if servo.is_torque else FORCE])]


def wall_speed_bound(setup: Setup, surface: int, motion: Motion) -> float:
    """Bound on the speed at which the shape of a surface moves through space [m s-1]."""
    spin = np.linalg.norm(motion.spin)
    table = setup.primitives
    rows = zip(table.kind[table.surface == surface], table.shape[table.surface == surface], strict=True)
    extent = max((0.0 if spin == 0.0 else spin_axis_distance(k, row, motion) for k, row in rows), default=0.0)
    return float(np.linalg.norm(motion.velocity) + spin * extent)


def spin_axis_distance(kind: int, row: Floats, motion: Motion) -> float:
    """Largest distance of a turning primitive from the spin axis [m]; 0 where turning leaves its shape."""
    axis = np.asarray(motion.spin) / np.linalg.norm(motion.spin)
    centre = np.asarray(motion.centre)
    if kind == PrimitiveKind.TRIANGLE:
        return float(np.linalg.norm(np.cross(row[:9].reshape(3, 3) - centre, axis), axis=1).max())
    if kind == PrimitiveKind.PLANE:
        return 0.0 if np.linalg.norm(np.cross(row[3:6], axis)) < AXIS_TOLERANCE else float("inf")
    size = float(np.hypot(max(row[6], row[8]), max(abs(row[7]), abs(row[9]))))
    is_coaxial = np.linalg.norm(np.cross(row[3:6], axis)) < AXIS_TOLERANCE
    aside = float(np.linalg.norm(np.cross(row[:3] - centre, axis)))
    return 0.0 if is_coaxial and aside < AXIS_TOLERANCE * size else aside + size


def set_replica_gravity(sim: Simulation, replica: int, gravity: tuple[float, float, float]) -> None:
    """Change the gravity of one replica [m s-2]."""
    upload([(sim.world.replicas.gravity, [gravity])], replica)
    wake_all_grains(sim, replica)


def set_contacts(sim: Simulation, replica: int, table: ContactTable) -> None:
    """Change the contact parameters of one replica; lists are renewed before the next step."""
    sim.setups[replica] = replace(sim.setups[replica], contacts=table)
    upload_materials(sim.world.materials, [table], replica)
    request_rebuild_and_wake(sim, replica)


def set_replica_effects(sim: Simulation, replica: int, effects: Sequence[ReplicaEffect]) -> bool:
    """Change the effects of one replica; False, and nothing changed, where that needs a new assembly.

    Effects that the run was assembled with change at once; others, and longer reaches, change the kernels or
    the cells.
    """
    before = sim.setups[replica].effects
    if np.any(np.greater(longest_effect_reaches(effects), longest_effect_reaches(before))):
        return False
    bounds = device_effects_by_place(sim.world)
    if any(e.effect.name not in bounds[e.effect.place].names for e in effects):
        return False
    for place, of_place in bounds.items():
        write_effect_constants(of_place, [[e for e in effects if e.effect.place == place]], replica)
    sim.setups[replica] = replace(sim.setups[replica], effects=tuple(effects))
    return True


def request_rebuild_and_wake(sim: Simulation, replica: int) -> None:
    """Request a rebuild before the next step, and wake all grains: their support may have changed."""
    upload([(sim.world.replicas.stale, [1.0])], replica)
    wake_all_grains(sim, replica)


def wake_all_grains(sim: Simulation, replica: int) -> None:
    """Wake all grains of one replica; their time at rest restarts."""
    if sim.world.sleeps:
        sleep, rows = sim.world.sleep, 2 * sim.capacities.grains
        upload([(field, np.zeros(rows)) for field in (sleep.state, sleep.rest_count)], replica * rows)
