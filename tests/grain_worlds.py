"""Setups of few grains for the tests of grains, simulation and run: soft equal spheres over simple walls."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from taichi_erosion.core.setup import (
    ContactTable,
    Floats,
    GrainTable,
    PrimitiveKind,
    PrimitiveTable,
    Setup,
    Surface,
)
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.simulation import Simulation, advance, failure_of, snapshot
from tests.verification.small_scenes import FLOOR, joined, planes, primitive_table, spheres

RADIUS = 0.5e-3  # m
MASS = 1e-6  # kg
YOUNG = 5.5e6  # Pa, effective modulus of every pair
FRICTION = 0.5
TIME_STEP = 1e-5  # s, a twentieth of the shortest contact in these tests
GRAVITY = 9.81  # m s-2
# overlap at which the Hertz force (4/3) E* sqrt(R) d^1.5 of a grain on a wall carries its weight [m]
RESTING = (0.75 * MASS * GRAVITY / (YOUNG * np.sqrt(RADIUS))) ** (2.0 / 3.0)

NONE, PLATE = planes(), planes(FLOOR)


def contacts(friction: float = FRICTION, rolling: float = 0.0, restitution: float = 0.5) -> ContactTable:
    one = np.ones(3)
    laws = (YOUNG * one, 0.2 * YOUNG * one, restitution * one, friction * one, rolling * one, 0.3 * one)
    return ContactTable(*laws, surface_energy=0.0 * one, effects=one)


def grains(position: Any, velocity: Any = 0.0, spin: Any = 0.0, release: Any = 0.0) -> GrainTable:
    table = spheres(position, velocity, spin, RADIUS, MASS)
    return replace(table, release_time=np.array(np.broadcast_to(np.asarray(release, float), len(table.mass))))


def setup(
    table: GrainTable, walls: PrimitiveTable = PLATE, law: ContactTable | None = None, **rest: Any
) -> Setup:
    """Every primitive is of a surface of its own, unless its table says otherwise."""
    names = tuple(Surface(f"wall {k}", 1) for k in range(walls.surface.max(initial=-1) + 1))
    return Setup(table, ("soil", "steel"), law or contacts(), walls, names, **{"time_step": TIME_STEP} | rest)


def heap(count: int, seed: int, friction: float = FRICTION) -> Setup:
    """A jittered block of grains that collapses inside a short upright tube."""
    rng = np.random.default_rng(seed)
    side = round(count ** (1.0 / 3.0)) + 1
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:count]
    place = 2.05 * RADIUS * (grid[np.argsort(grid[:, 2], kind="stable")] + [0.0, 0.0, 0.6])
    place -= place.mean(axis=0) * [1.0, 1.0, 0.0]
    place += rng.uniform(-0.02, 0.02, place.shape) * RADIUS
    tube = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, side * 2.0 * RADIUS, 0.0, side * 2.0 * RADIUS, 0.1)
    walls = joined(PLATE, primitive_table(PrimitiveKind.REVOLVED, tube))
    return setup(grains(place, rng.normal(0.0, 0.05, place.shape)), walls, contacts(friction, 0.1))


def mesh_floor(side: float, low: Sequence[float], cells: tuple[int, int]) -> PrimitiveTable:
    """Squares on z = 0, each cut into two triangles along alternating diagonals."""
    rows = []
    for i, j in np.ndindex(*cells):
        x, y = low[0] + side * i, low[1] + side * j
        a, b, c, d = ((x, y, 0.0), (x + side, y, 0.0), (x + side, y + side, 0.0), (x, y + side, 0.0))
        rows += [(a, b, c), (a, c, d)] if (i + j) % 2 else [(a, b, d), (b, c, d)]
    return primitive_table(PrimitiveKind.TRIANGLE, np.reshape(rows, (-1, 9)))


def fingerprint(state: Snapshot) -> str:
    """Equal for equal bits of position, velocity and spin, and practically never otherwise."""
    columns: tuple[Floats, ...] = (state.position, state.velocity, state.spin)
    return hashlib.sha256(b"".join(np.ascontiguousarray(c).tobytes() for c in columns)).hexdigest()


def ends(sim: Simulation, until: float) -> list[str]:
    """Bits of all replicas at a time [s], none of which may have failed."""
    advance(sim, [until] * len(sim.setups))
    assert not any(failure_of(sim, r) for r in range(len(sim.setups)))
    return [fingerprint(snapshot(sim, r)) for r in range(len(sim.setups))]
