"""Starts of the comparison of physics, the same for every code: two grains, small beds, columns.

Lengths are in m. The soil is that of the speed cases, on a floor as rough as the grains.
"""

from dataclasses import dataclass, replace
from math import pi

import numpy as np

from benchmarks.peers.cases import (
    LATTICE_BOTTOM,
    LATTICE_JITTER,
    LATTICE_LAYER_HEIGHT,
    LATTICE_SPEED,
    MILLIMETRE,
    SOIL,
    Floats,
    Soil,
)

ROUGH = replace(SOIL, friction_wall=SOIL.friction)
MASS = SOIL.density * pi / 6.0 * SOIL.diameter**3  # kg, of a grain
WEIGHT = MASS * SOIL.gravity  # N, of a grain
YOUNG_EFFECTIVE = SOIL.young / (2.0 * (1.0 - SOIL.poisson**2))  # Pa, E* of two grains, and of grain and wall
SHEAR_EFFECTIVE = SOIL.young / (4.0 * (2.0 - SOIL.poisson) * (1.0 + SOIL.poisson))  # Pa, G*, likewise
ROLLING_DAMPING = 0.3  # share of the critical value [1]

BED_SIDE = 8 * MILLIMETRE
BED_COUNT = 600
BED_ROW = 7  # grains per side of a lattice layer
BED_STEPS = 30_000  # 0.15 s: the fall takes 0.05 s
RELAX_STEPS = 10_000  # of a bed that already lies

TUBE_RADIUS = 4 * MILLIMETRE
TUBE_SPACING = 1.1 * MILLIMETRE
TUBE_CLEARANCE = 0.56 * MILLIMETRE  # of centres from the tube: jitter and radius
PILE_COUNT = 500
SETTLE_STEPS, SPREAD_STEPS = 20_000, 40_000  # 0.1 s in the tube, 0.2 s without

BOND = 2.0  # pull-off force 3 pi gamma R* of sticky grains over their weight [1]


@dataclass(frozen=True)
class Start:
    """Grains before the first step."""

    position: Floats  # [n, 3] m
    velocity: Floats  # [n, 3] m s-1


def shaken(position: Floats, seed: int) -> Start:
    """A lattice with its jitter and random velocities."""
    draw = np.random.default_rng(seed)
    moved = position + draw.uniform(-LATTICE_JITTER, LATTICE_JITTER, position.shape)
    return Start(moved, draw.normal(0.0, LATTICE_SPEED, position.shape))


def falling_bed(seed: int) -> Start:
    """Loose square layers in a periodic box, which fall into a bed."""
    index = np.arange(BED_COUNT, dtype=np.float64)
    column, row, layer = index % BED_ROW, index // BED_ROW % BED_ROW, index // BED_ROW**2
    spacing = BED_SIDE / BED_ROW
    height = LATTICE_BOTTOM + LATTICE_LAYER_HEIGHT * layer
    return shaken(np.stack([(column + 0.5) * spacing, (row + 0.5) * spacing, height], axis=1), seed)


def lying(position: Floats) -> Start:
    """Grains of a bed let go at rest, without memory of their contacts."""
    return Start(position, np.zeros_like(position))


def falling_column(seed: int) -> Start:
    """Loose square layers in a tube about the z axis."""
    reach = int(TUBE_RADIUS / TUBE_SPACING)
    grid = np.arange(-reach, reach + 1, dtype=np.float64) * TUBE_SPACING
    square = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    disc = square[np.hypot(square[:, 0], square[:, 1]) < TUBE_RADIUS - TUBE_CLEARANCE]
    layers = -(-PILE_COUNT // len(disc))
    heights = LATTICE_BOTTOM + LATTICE_LAYER_HEIGHT * np.arange(layers)
    column = np.concatenate([np.insert(disc, 2, height, axis=1) for height in heights])
    return shaken(column[:PILE_COUNT], seed)


def two_grains() -> Start:
    """One grain on the floor and one right above it."""
    middle = 0.5 * BED_SIDE
    place = np.array([[middle, middle, (0.5 + k) * SOIL.diameter] for k in range(2)])
    return Start(place, np.zeros_like(place))


def sticky_energy(soil: Soil = SOIL) -> float:
    """Gamma [J m-2] at which a grain hangs on by `BOND` times its weight, R* a quarter of the diameter."""
    return BOND * WEIGHT / (3.0 * pi * 0.25 * soil.diameter)
