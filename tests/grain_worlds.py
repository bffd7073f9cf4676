"""Setups of few grains for the tests of grains, simulation and run: soft equal spheres over simple walls."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
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

RADIUS = 0.5e-3  # m
MASS = 1e-6  # kg
YOUNG = 5.5e6  # Pa, effective modulus of every pair
FRICTION = 0.5
TIME_STEP = 1e-5  # s, a twentieth of the shortest contact in these tests
GRAVITY = 9.81  # m s-2
# overlap at which the Hertz force (4/3) E* sqrt(R) d^1.5 of a grain on a wall carries its weight [m]
RESTING = (0.75 * MASS * GRAVITY / (YOUNG * np.sqrt(RADIUS))) ** (2.0 / 3.0)

FLOOR = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Walls:
    """Primitives, one surface each unless stated otherwise."""

    kind: tuple[int, ...] = ()
    shape: Any = ()
    surface: tuple[int, ...] = ()


NONE = Walls()
PLATE = Walls((PrimitiveKind.PLANE,), (FLOOR,), (0,))


def contacts(friction: float = FRICTION, rolling: float = 0.0, restitution: float = 0.5) -> ContactTable:
    one = np.ones(3)
    laws = (YOUNG * one, 0.2 * YOUNG * one, restitution * one, friction * one, rolling * one, 0.3 * one)
    return ContactTable(*laws, surface_energy=0.0 * one, effects=one)


def grains(position: Any, velocity: Any = 0.0, spin: Any = 0.0, release: Any = 0.0) -> GrainTable:
    place = np.asarray(position, np.float64).reshape(-1, 3)
    count = len(place)
    return GrainTable(
        position=place,
        velocity=np.broadcast_to(np.asarray(velocity, np.float64), (count, 3)).copy(),
        spin=np.broadcast_to(np.asarray(spin, np.float64), (count, 3)).copy(),
        radius=np.full(count, RADIUS),
        mass=np.full(count, MASS),
        material=np.zeros(count, np.int32),
        release_time=np.broadcast_to(np.asarray(release, np.float64), count).copy(),
    )


def setup(table: GrainTable, walls: Walls = PLATE, law: ContactTable | None = None, **rest: Any) -> Setup:
    names = tuple(Surface(f"wall {k}", 1) for k in range(max(walls.surface, default=-1) + 1))
    shape = np.asarray(walls.shape, np.float64).reshape(-1, 10)
    primitives = PrimitiveTable(np.array(walls.kind, np.int32), np.array(walls.surface, np.int32), shape)
    words = {"time_step": TIME_STEP} | rest
    return Setup(table, ("soil", "steel"), law or contacts(), primitives, names, **words)


def heap(count: int, seed: int, friction: float = FRICTION) -> Setup:
    """A jittered block of grains that collapses inside a short upright tube."""
    rng = np.random.default_rng(seed)
    side = round(count ** (1.0 / 3.0)) + 1
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:count]
    place = 2.05 * RADIUS * (grid[np.argsort(grid[:, 2], kind="stable")] + [0.0, 0.0, 0.6])
    place -= place.mean(axis=0) * [1.0, 1.0, 0.0]
    place += rng.uniform(-0.02, 0.02, place.shape) * RADIUS
    tube = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0, side * 2.0 * RADIUS, 0.0, side * 2.0 * RADIUS, 0.1)
    walls = Walls((PrimitiveKind.PLANE, PrimitiveKind.REVOLVED), (FLOOR, tube), (0, 1))
    return setup(grains(place, rng.normal(0.0, 0.05, place.shape)), walls, contacts(friction, 0.1))


def mesh_floor(side: float, low: Sequence[float], cells: tuple[int, int]) -> Walls:
    """Squares on z = 0, each cut into two triangles along alternating diagonals."""
    rows = []
    for i, j in np.ndindex(*cells):
        x, y = low[0] + side * i, low[1] + side * j
        a, b, c, d = ((x, y, 0.0), (x + side, y, 0.0), (x + side, y + side, 0.0), (x, y + side, 0.0))
        rows += [(a, b, c), (a, c, d)] if (i + j) % 2 else [(a, b, d), (b, c, d)]
    shape = np.zeros((len(rows), 10))
    shape[:, :9] = np.reshape(rows, (-1, 9))
    return Walls((PrimitiveKind.TRIANGLE,) * len(rows), shape, (0,) * len(rows))


def fingerprint(state: Snapshot) -> str:
    """Equal for equal bits of position, velocity and spin, and practically never otherwise."""
    columns: tuple[Floats, ...] = (state.position, state.velocity, state.spin)
    return hashlib.sha256(b"".join(np.ascontiguousarray(c).tobytes() for c in columns)).hexdigest()
