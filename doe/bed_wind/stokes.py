"""Creeping shear over a layer of spheres, with the flow around every sphere resolved: where the wind begins.

A lattice Boltzmann method (D3Q19, two relaxation times, walls half way between nodes) on the periodic cell
of a layer of touching spheres on a plane; a lid moves a diameter above them. The horizontal mean of the flow
is straight above the spheres, since no force acts there, and meets zero at a depth below their tops that
depends on the arrangement. It uses nothing of the simulator and no law of drag.

Reference: Ginzburg, Verhaeghe & d'Humieres (2008), Commun. Comput. Phys. 3, 427 (two relaxation times).
"""

from itertools import product
from math import sqrt

import numpy as np

from taichi_erosion.core.setup import Floats

MAGIC = 3.0 / 16.0  # of both relaxation times: walls lie half way between nodes at any viscosity [1]
EVEN = 1.5  # relaxation time of the even moments; viscosity 1/3 [1]
LID, SPEED = 2.0, 1e-3  # height of the lid over the diameter; its speed in lattice units
SETTLED = 1e-7  # relative change of the flow in CHECK steps, at which it is steady
CHECK, LONGEST = 200, 40000  # steps
CORNERS = np.array([c for c in product((-1, 0, 1), repeat=3) if sum(map(abs, c)) <= 2])
SHARES = np.array([{0: 1 / 3, 1: 1 / 18, 2: 1 / 36}[int(np.abs(c).sum())] for c in CORNERS])
OPPOSITE = np.array([int(np.flatnonzero((CORNERS == -c).all(axis=1))[0]) for c in CORNERS])


def spheres_of(arrangement: str) -> tuple[list[tuple[float, float]], tuple[float, float]]:
    """Places of the spheres in a periodic cell, and its sides, over the diameter."""
    if arrangement == "quadratic":
        return [(0.5, 0.5)], (1.0, 1.0)
    return [(0.25 * sqrt(3.0), 0.5), (0.75 * sqrt(3.0), 0.0)], (sqrt(3.0), 1.0)


def solid_nodes(arrangement: str, cells: int) -> np.ndarray:
    """Which nodes lie in spheres, with `cells` nodes on a diameter."""
    places, sides = spheres_of(arrangement)
    counts = [round(side * cells) for side in sides]
    x, y, z = np.meshgrid(
        *((np.arange(n) + 0.5) / n * side for n, side in zip(counts, sides, strict=True)),
        (np.arange(round(LID * cells)) + 0.5) / cells,
        indexing="ij",
    )
    inside = np.zeros(x.shape, dtype=bool)
    for px, py in places:
        dx, dy = (d - side * np.round(d / side) for d, side in zip((x - px, y - py), sides, strict=True))
        inside |= dx**2 + dy**2 + (z - 0.5) ** 2 < 0.25
    return inside


def collided(f: Floats) -> tuple[Floats, Floats]:
    """Distributions after their collision, and the velocity [3, ...]; creeping flow, so no products of it."""
    odd_time = 0.5 + MAGIC / (EVEN - 0.5)
    density = f.sum(axis=0)
    velocity = np.tensordot(CORNERS.T.astype(float), f, axes=1)
    weights = SHARES[:, None, None, None]
    even_rest = weights * density
    odd_rest = 3.0 * weights * np.tensordot(CORNERS.astype(float), velocity, axes=1)
    opposite = f[OPPOSITE]
    even, odd = 0.5 * (f + opposite), 0.5 * (f - opposite)
    return f - (even - even_rest) / EVEN - (odd - odd_rest) / odd_time, velocity


def streamed(after: Floats, solid: np.ndarray) -> Floats:
    """Distributions after their flight; those that meet a sphere, the plane or the lid come back."""
    new = np.empty_like(after)
    for q, c in enumerate(CORNERS):
        moved = np.roll(after[q], tuple(c), axis=(0, 1, 2))
        blocked = np.roll(solid, tuple(c), axis=(0, 1, 2))
        back = after[OPPOSITE[q]].copy()
        if c[2] > 0:
            blocked[:, :, 0] = True
        if c[2] < 0:
            blocked[:, :, -1] = True
            # the lid moves along x
            back[:, :, -1] += 6.0 * SHARES[q] * c[0] * SPEED
        new[q] = np.where(blocked, back, moved)
    new[:, solid] = SHARES[:, None]
    return new


def steady(solid: np.ndarray) -> Floats:
    """Distributions of the steady flow around what is solid."""
    f = np.broadcast_to(SHARES[:, None, None, None], (len(SHARES), *solid.shape)).copy()
    before = np.zeros(solid.shape)
    for step in range(LONGEST):
        after, velocity = collided(f)
        f = streamed(after, solid)
        if step % CHECK == 0:
            along = np.where(solid, 0.0, velocity[0])
            if np.abs(along - before).max() < SETTLED * SPEED * CHECK and step:
                break
            before = along
    return f


def zero_depth(arrangement: str, cells: int) -> float:
    """Depth below the tops of the spheres at which the profile above them meets zero, over the diameter."""
    solid = solid_nodes(arrangement, cells)
    _, velocity = collided(steady(solid))
    along = np.where(solid, 0.0, velocity[0])
    height = (np.arange(solid.shape[2]) + 0.5) / cells
    above = height > 1.0
    slope, start = np.polyfit(height[above], along.mean(axis=(0, 1))[above], 1)
    return 1.0 + start / slope
