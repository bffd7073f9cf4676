"""The grain beds and funnels that every code in the comparison is given, made of plain NumPy.

A case holds the grain centres and the box; the soil is the same everywhere and is said once, in `Soil`.
Lengths are in m.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MILLIMETRE = 1e-3  # m


@dataclass(frozen=True)
class Soil:
    """Grains and walls of all cases: Hertz-Mindlin with history, and a rolling spring under a Coulomb cap."""

    diameter: float = 1e-3  # m
    density: float = 2130.0  # kg m-3
    young: float = 1e7  # Pa, Young's modulus of grains and walls
    poisson: float = 0.29  # 1
    restitution: float = 0.6  # 1
    friction: float = 0.61  # 1, grain on grain
    friction_wall: float = 0.34  # 1, grain on floor or funnel
    friction_rolling: float = 0.1  # 1
    gravity: float = 9.81  # m s-2
    time_step: float = 5e-6  # s


SOIL = Soil()

SURFACE_ENERGY = 0.05  # J m-2, of grains that stick: a pull-off force of eleven times their weight
FRICTIONS = (0.4, 0.8)  # of the runs of an ensemble, from the first to the last

BED_COUNT = 10_000
BED_TILES = (2, 5)  # copies of the bed along x and y that make the bed of 100,000
LATTICE_ROW = 18  # grains per side of a lattice layer
SMALL_COUNT, SMALL_ROW = 2000, 8  # of the bed of 2,000, as deep
LATTICE_SPACING = 20 * MILLIMETRE / 18
LATTICE_LAYER_HEIGHT = 1.1 * MILLIMETRE
LATTICE_BOTTOM = 0.65 * MILLIMETRE
LATTICE_JITTER = 0.045 * MILLIMETRE  # below half the free gap of 0.1 mm, so that no pair starts overlapping
LATTICE_SPEED = 0.1  # m s-1, sd of each velocity component; it forgets the lattice

FUNNEL_REFERENCE_COUNT = 2000  # funnels are similar: every length goes with the cube root of the grain count
FUNNEL_ORIFICE_RADIUS = 5 * MILLIMETRE
FUNNEL_BOTTOM = 15 * MILLIMETRE
FUNNEL_HEIGHT = 18 * MILLIMETRE
FUNNEL_HALF_WIDTH = 45 * MILLIMETRE
FUNNEL_SPACING = 1.08 * MILLIMETRE
FUNNEL_JITTER = 0.03 * MILLIMETRE
FUNNEL_CLEARANCE = (
    0.8 * MILLIMETRE
)  # of centres from the cone, measured horizontally: 0.57 mm along its normal
FUNNEL_FACETS = 48  # flat sides of the cone in the STL


@dataclass(frozen=True)
class Bed:
    """Grains in a box periodic along x and y, on a floor at z = 0."""

    position: Floats  # [n, 3] m
    period: tuple[float, float]  # m


@dataclass(frozen=True)
class Pile:
    """Grains at rest inside a cone funnel of 45 degrees above a floor at z = 0."""

    position: Floats  # [n, 3] m
    orifice_radius: float  # m
    funnel_bottom: float  # m, height of the orifice above the floor
    funnel_height: float  # m, of the cone itself; its upper radius is orifice_radius + funnel_height
    half_width: float  # m, half the side of the open box


def frictions(count: int) -> Floats:
    """Friction between grains in every run of an ensemble [1]."""
    return np.linspace(*FRICTIONS, count)


def loose_lattice(count: int = BED_COUNT, rows: int = LATTICE_ROW, seed: int = 1) -> tuple[Bed, Floats]:
    """Jittered square layers with random velocities [m s-1], which fall into the settled bed."""
    draw = np.random.default_rng(seed)
    index = np.arange(count, dtype=np.float64)
    side, spacing = rows * LATTICE_SPACING, LATTICE_SPACING
    column, row, layer = index % rows, index // rows % rows, index // rows**2
    height = LATTICE_BOTTOM + LATTICE_LAYER_HEIGHT * layer
    position = np.stack([(column + 0.5) * spacing, (row + 0.5) * spacing, height], axis=1)
    position += draw.uniform(-LATTICE_JITTER, LATTICE_JITTER, position.shape)
    return Bed(position, (side, side)), draw.normal(0.0, LATTICE_SPEED, position.shape)


def shuffled(bed: Bed, seed: int = 5) -> Bed:
    """The same grains in random order and wrapped into the box: every code must sort them itself."""
    position = np.random.default_rng(seed).permutation(bed.position)
    position[:, :2] %= bed.period
    return Bed(position, bed.period)


def tiled(bed: Bed, tiles: tuple[int, int] = BED_TILES) -> Bed:
    """Copies of a periodic bed side by side: the same packing in a wider box."""
    steps = [(x * bed.period[0], y * bed.period[1], 0.0) for x in range(tiles[0]) for y in range(tiles[1])]
    position = np.concatenate([bed.position + step for step in steps])
    return Bed(position, (tiles[0] * bed.period[0], tiles[1] * bed.period[1]))


def funnel_pile(count: int, seed: int = 3) -> Pile:
    """Jittered cubic lattice that fills a funnel from its orifice upwards.

    Lengths scale with s = (count / 2000)^(1/3), so that piles of any count have the same shape.
    """
    draw = np.random.default_rng(seed)
    scale = (count / FUNNEL_REFERENCE_COUNT) ** (1 / 3)
    orifice, bottom, height = scale * FUNNEL_ORIFICE_RADIUS, scale * FUNNEL_BOTTOM, scale * FUNNEL_HEIGHT
    reach = int((orifice + height) / FUNNEL_SPACING) + 1
    grid = np.arange(-reach, reach + 1, dtype=np.float64) * FUNNEL_SPACING
    square = np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    layers: list[Floats] = []
    level = bottom + 0.6 * MILLIMETRE
    while sum(map(len, layers)) < count:
        inside = np.hypot(square[:, 0], square[:, 1]) < orifice + level - bottom - FUNNEL_CLEARANCE
        layers.append(np.insert(square[inside], 2, level, axis=1))
        level += FUNNEL_SPACING
    position = np.concatenate(layers)[:count]
    position += draw.uniform(-FUNNEL_JITTER, FUNNEL_JITTER, position.shape)
    return Pile(draw.permutation(position), orifice, bottom, height, scale * FUNNEL_HALF_WIDTH)


def funnel_triangles(pile: Pile, facets: int = FUNNEL_FACETS) -> Floats:
    """Corners [t, 3, 3] m of the funnel as flat facets inscribed in the cone, normals outward."""
    angle = np.linspace(0.0, 2 * pi, facets + 1)
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    low = circle * pile.orifice_radius + (0.0, 0.0, pile.funnel_bottom)
    high = circle * (pile.orifice_radius + pile.funnel_height) + (
        0.0,
        0.0,
        pile.funnel_bottom + pile.funnel_height,
    )
    first = np.stack([low[:-1], low[1:], high[1:]], axis=1)
    second = np.stack([low[:-1], high[1:], high[:-1]], axis=1)
    return np.concatenate([first, second])
