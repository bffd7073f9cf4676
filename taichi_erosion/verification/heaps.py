"""V34: angles of repose rise with friction, rolling friction and adhesion; a plate heap stands as Zhou's
formula says.

Heaps of a lifted tube, an ensemble of settings and seeds in one launch; the angle is measured on side
silhouettes. They are small (a few hundred grains), so the angles are those of this apparatus, good for
trends. The plate heap is the discharge apparatus of Zhou et al. (2002) in the limit of a thick container.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Laws, Motion, Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.repose import repose_angle
from taichi_erosion.simulation import advance, move_surface, remove_surface
from taichi_erosion.verification.bench_run import bench, states
from taichi_erosion.verification.bulk_scenes import (
    DIAMETER,
    MASS,
    column_scene,
    plate_scene,
    soft_touch,
)
from taichi_erosion.verification.claim import Outcome, Precision, holds
from taichi_erosion.verification.reference import bulk

Floats = NDArray[np.float64]

LAWS = Laws(normal="jkr", rolling="elastic_plastic")
COUNT, TUBE_RADIUS = 800, 6.0 * DIAMETER
SETTLE, LIFT_SPEED, LIFTED, REST = 0.12, 0.08, 0.24, 0.20  # s, m s-1, s, s
SEEDS = (1, 2, 3)
PLATE_COUNT, PLATE_HALF = 1500, 16.0 * DIAMETER
PLATE_FRICTION, PLATE_ROLLING = 0.4, 0.02
PLATE_SEEDS = (1, 2, 3)


@dataclass(frozen=True)
class Setting:
    """What the angle is asked to depend on."""

    friction: float = 0.5
    friction_rolling: float = 0.1
    bond: float = 0.0  # pull-off force 3 pi gamma R* over the weight of a grain [1]


BASE = Setting()
TRENDS: dict[str, Sequence[Setting]] = {
    "friction 0.15, 0.3, 0.6": [replace(BASE, friction=mu) for mu in (0.15, 0.3, 0.6)],
    "rolling friction 0.02, 0.1, 0.4": [replace(BASE, friction_rolling=mu) for mu in (0.02, 0.1, 0.4)],
    "Bond number 0, 2, 8": [replace(BASE, bond=bond) for bond in (0.0, 2.0, 8.0)],
}


def heap_scene(setting: Setting, seed: int) -> Setup:
    """A column in a tube that will be lifted."""
    energy = setting.bond * MASS * 9.81 / (3.0 * np.pi * DIAMETER / 4.0)
    touch = soft_touch(setting.friction, setting.friction_rolling, energy)
    return column_scene(touch, COUNT, TUBE_RADIUS, seed)


def heap_angles(runs: Sequence[tuple[Setting, int]], precision: Precision) -> Floats:
    """Angle of repose of each (setting, seed) [deg]."""
    sim = bench([heap_scene(setting, seed) for setting, seed in runs], precision, LAWS)
    count = len(runs)
    advance(sim, [SETTLE] * count)
    for replica in range(count):
        move_surface(sim, replica, "wall1", Motion(velocity=(0.0, 0.0, LIFT_SPEED)))
    advance(sim, [SETTLE + LIFTED] * count)
    for replica in range(count):
        remove_surface(sim, replica, "wall1")
    advance(sim, [SETTLE + LIFTED + REST] * count)
    return np.array([repose_angle(state).value for state in states(sim, count)])


def repose_trends() -> Iterator[Outcome]:
    """V34."""
    settings = list(dict.fromkeys(setting for group in TRENDS.values() for setting in group))
    runs = [(setting, seed) for setting in settings for seed in SEEDS]
    found = heap_angles(runs, "f32").reshape(len(settings), len(SEEDS))
    mean = dict(zip(settings, found.mean(axis=1), strict=True))
    sd = float(np.sqrt(np.mean(found.var(axis=1, ddof=1))))
    for name, group in TRENDS.items():
        angles = [mean[setting] for setting in group]
        listed = ", ".join(f"{angle:.1f}" for angle in angles)
        sentence = f"repose angle rises with {name}: {listed} deg, seed sd {sd:.1f} deg"
        yield holds(sentence, bool(np.all(np.diff(angles) > 0.0)), "f32")
    yield from plate_outcomes()


def plate_outcomes() -> Iterator[Outcome]:
    """Plate heap of 2 mm glass against Zhou's formula, 3 deg."""
    grain = soft_touch(PLATE_FRICTION, PLATE_ROLLING)
    setups = [plate_scene(grain, grain, PLATE_COUNT, PLATE_HALF, seed) for seed in PLATE_SEEDS]
    sim = bench(setups, "f32", Laws(rolling="elastic_plastic"))
    advance(sim, [SETTLE] * len(setups))
    for replica in range(len(setups)):
        remove_surface(sim, replica, "wall1")
        remove_surface(sim, replica, "wall2")
    advance(sim, [SETTLE + 0.9] * len(setups))
    angles = np.array([plate_angle(state) for state in states(sim, len(setups))])
    # the torque mu_r R* F is a length times F: R* is a quarter of the diameter between grains, half of it
    # at the plate
    lengths = PLATE_ROLLING * DIAMETER / 4.0, PLATE_ROLLING * DIAMETER / 2.0
    wanted = bulk.zhou_angle(PLATE_FRICTION, PLATE_FRICTION, *lengths, DIAMETER)
    name = f"plate heap of 2 mm glass against Zhou (2002) [deg], seed sd {angles.std(ddof=1):.1f} deg"
    yield Outcome(name, float(angles.mean()), wanted, 3.0, "f32")


def plate_angle(state: Snapshot) -> float:
    """Mean slope of the two flanks of the heap on the plate [deg].

    Height of the highest grain in bins of one diameter along x; a line through the bins from 20 % to 80 %
    of the way from the edge of the plate to the ridge.
    """
    on_plate = (np.abs(state.position[:, 0]) < PLATE_HALF) & (state.position[:, 2] > 0.0)
    x, top = state.position[on_plate, 0], state.position[on_plate, 2] + state.radius[on_plate]
    edges = np.arange(-PLATE_HALF, PLATE_HALF + 0.5 * DIAMETER, DIAMETER)
    bins = np.digitize(x, edges) - 1
    middle = 0.5 * (edges[1:] + edges[:-1])
    height = np.array([top[bins == k].max() if np.any(bins == k) else 0.0 for k in range(len(middle))])
    inner = (np.abs(middle) > 0.2 * PLATE_HALF) & (np.abs(middle) < 0.8 * PLATE_HALF)
    slopes = [
        np.polyfit(np.abs(middle[side]), height[side], 1)[0]
        for side in (inner & (middle < 0), inner & (middle > 0))
    ]
    return float(np.degrees(np.arctan(-np.mean(slopes))))
