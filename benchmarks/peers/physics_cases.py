"""Starts of the comparison of physics, the same for every code: two grains, small beds.

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
ROLLING_DAMPING = 0.3  # share of the critical value [1]

BED_SIDE = 8 * MILLIMETRE
BED_COUNT = 600
BED_ROW = 7  # grains per side of a lattice layer
BED_STEPS = 30_000  # 0.15 s: the fall takes 0.05 s
RELAX_STEPS = 10_000  # of a bed that already lies


class Failed(Exception):
    """A code did not run to its end."""


@dataclass(frozen=True)
class Start:
    """Grains before the first step."""

    position: Floats  # [n, 3] m
    velocity: Floats  # [n, 3] m s-1


def mass(soil: Soil) -> float:
    """Mass of a grain [kg]."""
    return soil.density * pi / 6.0 * soil.diameter**3


def weight(soil: Soil) -> float:
    """Weight of a grain [N]."""
    return mass(soil) * soil.gravity


def young_effective(soil: Soil) -> float:
    """E* of two grains, and of grain and wall [Pa]."""
    return soil.young / (2.0 * (1.0 - soil.poisson**2))


def shear_effective(soil: Soil) -> float:
    """G* of two grains, and of grain and wall [Pa]."""
    return soil.young / (4.0 * (2.0 - soil.poisson) * (1.0 + soil.poisson))


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


def two_grains() -> Start:
    """One grain on the floor and one right above it."""
    middle = 0.5 * BED_SIDE
    place = np.array([[middle, middle, (0.5 + k) * SOIL.diameter] for k in range(2)])
    return Start(place, np.zeros_like(place))
