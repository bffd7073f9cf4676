"""Upload of the setups of an ensemble to the device."""

from typing import Any

import numpy as np
import scipy

from taichi_erosion.core.setup import ClumpTable, Floats, GrainTable, Integers, PrimitiveKind, Setup, pair_row
from taichi_erosion.core.transfer import upload
from taichi_erosion.grains import World
from taichi_erosion.grains.cells import cell_grid
from taichi_erosion.grains.materials import Materials, upload_materials
from taichi_erosion.grains.walls import Walls
from taichi_erosion.simulation.capacities import cells_for_grains, verlet_skin_limits

NOWHERE = np.inf  # m, position of the padding primitives of a replica with fewer walls than another


def join_padded(columns: list[Any], rows: int, filling: float = 0.0) -> Any:
    """Arrays of all replicas, joined, each padded to `rows`; a replica may have none."""
    inner = np.asarray(max(columns, key=len)).shape[1:]
    stacked = np.full((len(columns), rows, *inner), filling)
    for block, column in zip(stacked, columns, strict=True):
        if len(column):
            block[: len(column)] = column
    return stacked.reshape(-1, *inner)


def upload_world(world: World, setups: list[Setup], reaches: Floats, partitions: list[int]) -> None:
    """Everything that the setups state; `reaches` [n, 2] as `zero_force_gap` gives them."""
    upload_grain_tables(world, setups)
    upload_replicas(world, setups, reaches, partitions)
    upload_cell_grids(world, setups, reaches)
    upload_wall_primitives(world.walls, setups)
    upload_materials(world.materials, [s.contacts for s in setups])
    if world.sleeps:
        orders = [(s.coupling.sleep_exchanges, s.coupling.sleep_share) for s in setups]
        rest_least, share = zip(*orders, strict=True)
        upload([(world.sleep.rest_least, rest_least), (world.sleep.share, share)])
    if world.has_clumps:
        upload_clump_bodies(world, setups)


def material_row_of_all_pairs(setups: list[Setup], materials: Materials) -> list[int]:
    """Row of Materials of all pairs of grains, by replica; -1 where grains differ in material."""
    kinds = [np.unique(setup.grains.material) for setup in setups]
    return [
        r * materials.rows + pair_row(int(material[0]), int(material[0]), materials.count)
        if len(material) == 1
        else -1
        for r, material in enumerate(kinds)
    ]


def upload_grain_tables(world: World, setups: list[Setup]) -> None:
    source, rows = world.source, world.grains.capacity
    grains = [s.grains for s in setups]
    bodies = [np.arange(len(s.grains.radius)) if s.clumps is None else s.clumps.body for s in setups]
    names = ("position", "velocity", "spin", "radius", "material")
    columns = [(getattr(source, n), join_padded([getattr(g, n) for g in grains], rows)) for n in names]
    columns.append((source.mass_inverse, join_padded([1.0 / g.mass for g in grains], rows)))
    steps = [np.ceil(s.grains.release_time / s.time_step - 1e-9).clip(0) for s in setups]
    columns.append((source.release_step, join_padded(steps, rows)))
    columns.append((source.body, join_padded(bodies, rows)))
    upload(columns)


def upload_replicas(world: World, setups: list[Setup], reaches: Floats, partitions: list[int]) -> None:
    """Clocks, boxes and skins; nothing is released yet, the first step rebuilds."""
    replicas, is_full = world.replicas, world.pairs.stride > 1
    allowed = [verlet_skin_limits(s, is_full) for s in setups]
    # where cells hold the widest grain, none is wide, whatever rounding gives
    holds = [s.air is None or is_full for s in setups]
    cell_reach = [np.inf if all_in else m.cell_reach for all_in, m in zip(holds, allowed, strict=True)]
    upload(
        [
            (replicas.total, [len(s.grains.radius) for s in setups]),
            (replicas.stale, np.ones(len(setups))),
            (replicas.partitions, partitions),
            (replicas.pair_row, material_row_of_all_pairs(setups, world.materials)),
            (replicas.time_step, [s.time_step for s in setups]),
            (replicas.gravity, [s.gravity for s in setups]),
            (replicas.removes, [s.removes_outside for s in setups]),
            (replicas.low, [s.domain[0] for s in setups]),
            (replicas.high, [s.domain[1] for s in setups]),
            (replicas.period, [s.period for s in setups]),
            (replicas.reach, reaches[:, 0]),
            (replicas.met_reach, reaches[:, 1]),
            (replicas.overlap_limit, [s.overlap_limit for s in setups]),
            (replicas.skin_least, [m.least for m in allowed]),
            (replicas.skin_most, [m.most for m in allowed]),
            (replicas.skin_time, [m.time for m in allowed]),
            (replicas.cell_reach, cell_reach),
            (replicas.extent_most, [m.extent_most for m in allowed]),
        ]
    )


def upload_cell_grids(world: World, setups: list[Setup], reaches: Floats) -> None:
    skins = [verlet_skin_limits(s, world.pairs.stride > 1) for s in setups]
    least = [2.0 * skin.cell_reach + reach for skin, reach in zip(skins, reaches[:, 0], strict=True)]
    most = [min(world.cells.capacity, cells_for_grains(len(s.grains.radius))) for s in setups]
    grids = [cell_grid(*one) for one in zip(setups, least, most, strict=True)]
    upload([(getattr(world.cells, name), [grid[name] for grid in grids]) for name in grids[0]])


def upload_wall_primitives(walls: Walls, setups: list[Setup]) -> None:
    tables = [s.primitives for s in setups]
    if not any(len(table.kind) for table in tables):
        return
    shapes = join_padded([t.shape for t in tables], walls.primitives)
    kinds = join_padded([t.kind for t in tables], walls.primitives)
    balls = [[bounding_ball(k, row) for k, row in zip(t.kind, t.shape, strict=True)] for t in tables]
    centres, radii = ([[ball[n] for ball in of_table] for of_table in balls] for n in range(2))
    upload(
        [
            (walls.kind, kinds),
            (walls.surface, join_padded([t.surface for t in tables], walls.primitives)),
            (walls.corner, shapes[..., 0:3]),
            (walls.second, shapes[..., 3:6]),
            (walls.third, np.where((kinds == PrimitiveKind.TRIANGLE)[..., None], shapes[..., 6:9], 0.0)),
            (walls.profile, shapes[..., 6:10]),
            (walls.ball_centre, join_padded(centres, walls.primitives, NOWHERE)),
            (walls.ball_radius, join_padded(radii, walls.primitives)),
        ]
    )
    if walls.rows:
        rows = [[row for table in s.tables for row in table] for s in setups]
        upload([(walls.table, join_padded([np.reshape(each, (-1, 7)) for each in rows], walls.rows))])
    present = join_padded([np.ones(len(s.surfaces)) for s in setups], walls.surfaces)
    upload(
        [
            (walls.material, join_padded([[f.material for f in s.surfaces] for s in setups], walls.surfaces)),
            (walls.present, present),
            (walls.turn, np.broadcast_to(np.eye(3), (*present.shape, 3, 3))),
        ]
    )


def bounding_ball(kind: int, row: Floats) -> tuple[Floats, float]:
    """Centre [m] and radius [m] of a ball around a primitive; infinite for a plane."""
    if kind == PrimitiveKind.TRIANGLE:
        corners = row[:9].reshape(3, 3)
        middle = corners.mean(axis=0)
        return middle, float(np.linalg.norm(corners - middle, axis=1).max())
    if kind == PrimitiveKind.REVOLVED:
        height = 0.5 * (row[7] + row[9])
        return row[:3] + height * row[3:6], float(np.hypot(max(row[6], row[8]), 0.5 * abs(row[9] - row[7])))
    return np.zeros(3), float("inf")


def upload_clump_bodies(world: World, setups: list[Setup]) -> None:
    """Bodies as placed, moving and turning as the first sphere of each does at release."""
    clumps, rows = world.clumps, world.grains.capacity
    tables = [s.clumps for s in setups if s.clumps is not None]
    bodies = clumps.capacity
    firsts = [np.searchsorted(t.body, np.arange(len(t.mass))).astype(np.int32) for t in tables]
    motions = [body_motion(s.grains, t, f) for s, t, f in zip(setups, tables, firsts, strict=True)]
    upload(
        [
            (clumps.first, join_padded(firsts, bodies)),
            (clumps.number, join_padded([np.bincount(t.body) for t in tables], bodies)),
            (clumps.position, join_padded([t.position for t in tables], bodies)),
            (clumps.orientation, join_padded([t.orientation for t in tables], bodies)),
            (clumps.mass_inverse, join_padded([1.0 / t.mass for t in tables], bodies)),
            (clumps.inertia_inverse, join_padded([1.0 / t.inertia for t in tables], bodies)),
            (clumps.velocity, join_padded([velocity for velocity, _ in motions], bodies)),
            (clumps.momentum, join_padded([momentum for _, momentum in motions], bodies)),
        ]
    )
    upload([(clumps.offset, join_padded([t.offset for t in tables], rows))])


def body_motion(grains: GrainTable, table: ClumpTable, firsts: Integers) -> tuple[Floats, Floats]:
    """Velocity of the centre [m s-1] and angular momentum [kg m2 s-1] of bodies that follow a sphere.

        v = v_1 - w x (A o_1),    L = A I A^T w

    with v_1 and w velocity and spin of the sphere, o_1 its offset in the body, A the rotation of the body.
    """
    spin = grains.spin[firsts]
    frame: Any = scipy.spatial.transform.Rotation.from_quat(table.orientation, scalar_first=True).as_matrix()
    arm = np.einsum("bij,bj->bi", frame, table.offset[firsts])
    turning: Any = np.cross(spin, arm)
    momentum = np.einsum("bij,bj,bkj,bk->bi", frame, table.inertia, frame, spin)
    return grains.velocity[firsts] - turning, momentum
