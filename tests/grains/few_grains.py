"""Small worlds, each an experiment of its own, run as replicas of one ensemble: kernels compile once."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from grain_worlds import MASS, NONE, PLATE, RADIUS, RESTING, TIME_STEP, contacts, grains, mesh_floor, setup
from scipy.spatial.transform import Rotation

from taichi_erosion.core.setup import ClumpTable, Floats, Laws, Motion, Numerics, PrimitiveKind, Setup
from taichi_erosion.core.snapshot import Failure, Snapshot
from taichi_erosion.simulation import advance, assemble, failure_of, move_surface, remove_surface, snapshot
from tests.verification.small_scenes import primitive_table

INTERVAL = 0.002  # s between snapshots
INTERVALS = 20
REMOVAL = 10  # snapshot after which the plate of "removed" is taken away
BELT_SPEED = 0.1  # m s-1
TURN = 20.0  # rad s-1 of turntable and drum
ARM = 8e-3  # m, distance of the grain from the axis of the turntable
DRUM = 0.02  # m, radius
DRUM_WALL = primitive_table(PrimitiveKind.REVOLVED, (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, DRUM, -0.01, DRUM, 0.01))
PERIOD = 6e-3  # m
BOX = ((0.0, -1.0, -1.0), (PERIOD, 1.0, 1.0))
OBLIQUE = ((0.3, 0.05, 0.02), (-0.1, -0.02, 0.04))  # m s-1
RESTED = (0.0, 0.0, RADIUS - RESTING)
FREE: dict[str, Any] = {"gravity": (0.0, 0.0, 0.0)}
ARMS = np.array([[1.2, 0.0, 0.1], [-0.9, 0.7, 0.0], [-0.3, -0.7, -0.1]]) * RADIUS  # of a clump's spheres
INERTIA = np.array([0.6, 1.0, 1.5]) * MASS * (2.0 * RADIUS) ** 2  # kg m2, three different principal moments


def equal_clumps(centre: Floats, poses: Rotation) -> ClumpTable:
    """Clumps of three spheres at places [n, 3] in m and in poses."""
    count = len(centre)
    return ClumpTable(
        body=np.repeat(np.arange(count, dtype=np.int32), len(ARMS)),
        offset=np.tile(ARMS, (count, 1)),
        mass=np.full(count, 3.0 * MASS),
        inertia=np.tile(INERTIA, (count, 1)),
        position=centre,
        orientation=poses.as_quat(scalar_first=True),
    )


@dataclass(frozen=True)
class WorldRecord:
    """Snapshots of one world every INTERVAL, the first after one step, and how it ended."""

    frames: tuple[Snapshot, ...]
    failure: Failure | None
    setup: Setup


def worlds() -> dict[str, Setup]:
    pair = np.array([[-0.7, 0.1, 0.0], [0.5, 0.0, 0.05]]) * 2.0 * RADIUS
    rolling = grains(RESTED, (0.11, 0.037, 0.0))
    across = np.array([[5.8e-3, 0.0, 0.0], [0.9e-3, 0.0, 0.0]])
    towards = np.array([[0.0, 0.0, 0.0], [-0.1, 0.0, 0.0]])
    periodic = {"domain": BOX, "period": (PERIOD, 0.0, 0.0)} | FREE
    apart = across - [[3e-3, 0.0, 0.0], [-3e-3, 0.0, 0.0]]
    law = contacts(rolling=0.1)
    return {
        "plane": setup(rolling, PLATE, law),
        "mesh": setup(rolling, mesh_floor(1.3e-3, (-2e-3, -2e-3), (7, 5)), law),
        "pair": setup(grains(pair, OBLIQUE, [[5.0, -30.0, 9.0], [0.0, 12.0, 1.0]]), NONE, law, **FREE),
        "released": setup(grains(np.eye(3) * 0.01, release=[0.0, 0.011, 0.03]), NONE),
        "belt": setup(grains(RESTED)),
        "turntable": setup(grains((ARM, 0.0, RESTED[2]))),
        "drum": setup(grains((0.0, 0.0, -DRUM + RESTED[2])), DRUM_WALL),
        "removed": setup(grains([RESTED, (4.0 * RADIUS, 0.0, RESTED[2])])),
        "across the edge": setup(grains(across, towards), NONE, **periodic),
        "in the middle": setup(grains(apart, towards), NONE, **periodic),
        "runaway": setup(grains((0.0, 0.0, 0.01), (0.5, 0.0, 0.0)), domain=((-1.0,) * 3, (2e-3, 1.0, 1.0))),
        "inside each other": setup(grains([(0.0, 0.0, 0.01), (0.0, 0.0, 0.01 + 1.2 * RADIUS)])),
        "not a number": setup(grains((0.0, 0.0, 0.01), (np.nan, 0.0, 0.0))),
        "infinite": setup(grains((0.0, 0.0, 0.01), (np.inf, 0.0, 0.0))),
    }


IN_PARTITIONS = Numerics("cpu", 1, "f64")


def run_worlds(numerics: Numerics = IN_PARTITIONS) -> dict[str, WorldRecord]:
    """All worlds run side by side in double precision."""
    setups = worlds()
    index = {name: replica for replica, name in enumerate(setups)}
    sim = assemble(list(setups.values()), Laws(rolling="elastic_plastic"), numerics)
    move_surface(sim, index["belt"], "wall 0", Motion(velocity=(BELT_SPEED, 0.0, 0.0)))
    move_surface(sim, index["turntable"], "wall 0", Motion(spin=(0.0, 0.0, TURN)))
    move_surface(sim, index["drum"], "wall 0", Motion(spin=(0.0, TURN, 0.0)))
    frames: list[list[Snapshot]] = []
    for k in range(INTERVALS + 1):
        advance(sim, [max(k * INTERVAL, TIME_STEP)] * len(setups))
        frames.append([snapshot(sim, replica) for replica in range(len(setups))])
        if k == REMOVAL:
            remove_surface(sim, index["removed"], "wall 0")
    ends = [failure_of(sim, replica) for replica in range(len(setups))]
    tracks = {name: tuple(frame[r] for frame in frames) for name, r in index.items()}
    return {name: WorldRecord(tracks[name], ends[r], setups[name]) for name, r in index.items()}
