"""A bed of spheres that roll to rest one by one, and the ways in which each of its grains can tip.

Every sphere starts at a random place over those that lie and rolls down their envelope to its next lowest
point, where three of them hold it (Visscher & Bolsterli 1972, Nature 239, 504). Nothing of the simulator is
used. Lengths are in mean diameters; the patch is periodic.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_erosion.core.setup import Floats

LAYERS, SPREAD, CUT = 4.0, 0.1, (0.8, 1.25)  # of the bed; sd of ln diameter; diameters that are left
PACKED = 1.1  # spheres in the volume of a diameter cubed
START, LEAST, WAYS = 0.2, 2e-4, 8  # way of the first step; the last; directions tried
SHRINK, GROWTH = 0.7, 1.6  # of a way that leads nowhere down, of one that does
NEAR, MOVED = 3.0, 0.6  # reach of the spheres that count, and the way after which they are counted anew
GAP = 0.02  # over the sum of radii, up to which spheres touch
ABOVE = 0.5  # height over the distance from which a neighbour lies on a grain
DEEPEST = 0.6  # below the surface, centre of the deepest grains that can tip
APPROACH = 1e-4  # of a rotation, at which a contact counts as not closing


@dataclass(frozen=True)
class Tilt:
    """One rotation of a grain about the line through two of its contacts, at one radian in unit time."""

    forward: float  # way of the centre along the wind
    upward: float
    spin: float  # along the vorticity of the wind
    opening: float  # of its other contacts, added up
    carried: float  # normal forces of both contacts over their resultant


@dataclass(frozen=True)
class Loose:
    """A grain that nothing lies on."""

    height: float  # of the centre over the surface of the bed
    radius: float
    tilts: tuple[Tilt, ...]


def dropped(side: float, seed: int) -> tuple[Floats, Floats]:
    """Centres [n, 3] and radii of a bed on a square patch."""
    rng = np.random.default_rng(seed)
    count = int(side * side * LAYERS * PACKED)
    radii = 0.5 * np.clip(np.exp(SPREAD * rng.normal(size=count)), *CUT)
    centres = np.zeros((count, 3))
    for k in range(count):
        place, height = rolled(centres[:k], radii[:k], radii[k], side, rng)
        centres[k] = (*place % side, height)
    return centres, radii


def rolled(
    lying: Floats, radii: Floats, radius: float, side: float, rng: np.random.Generator
) -> tuple[Floats, float]:
    """Place and height at which a sphere comes to rest."""
    place, step = side * rng.random(2), START
    turn = 2.0 * np.pi * np.arange(WAYS) / WAYS
    counted, near = place, close_to(lying, place, side)
    height = envelope(lying[near], radii[near], radius, place[np.newaxis], side)[0]
    while step > LEAST and height > radius:
        if np.abs(place - counted).max() > MOVED:
            counted, near = place, close_to(lying, place, side)
        tried = place + step * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        heights = envelope(lying[near], radii[near], radius, tried, side)
        best = int(np.argmin(heights))
        if heights[best] < height:
            place, height, step = tried[best], heights[best], min(GROWTH * step, START)
        else:
            step, turn = SHRINK * step, turn + 2.0 * np.pi / WAYS * rng.random()
    return place, float(height)


def close_to(lying: Floats, place: Floats, side: float) -> Any:
    """Which spheres can touch one near a place."""
    apart = lying[:, :2] - place
    apart -= side * np.round(apart / side)
    return np.hypot(apart[:, 0], apart[:, 1]) < NEAR


def envelope(lying: Floats, radii: Floats, radius: float, places: Floats, side: float) -> Floats:
    """Heights at which a sphere touches the first of those that lie, or the ground."""
    apart = lying[:, :2] - places[:, np.newaxis]
    apart -= side * np.round(apart / side)
    over = (radii + radius) ** 2 - (apart**2).sum(axis=2)
    touch = np.where(over > 0.0, lying[:, 2] + np.sqrt(np.maximum(over, 0.0)), 0.0)
    return np.maximum(touch.max(axis=1, initial=0.0), radius)


def surface_of(centres: Floats, radii: Floats, side: float) -> float:
    """Height at which half of the solid share of the bed is left.

    Over regular layers that is 0.1 diameters below their tops, where resolved flow has the zero of the wind
    (`doe/bed_wind/`).
    """
    heights = np.linspace(0.0, centres[:, 2].max() + 1.0, 400)
    cut = np.pi * np.maximum(radii[:, np.newaxis] ** 2 - (heights - centres[:, 2:]) ** 2, 0.0).sum(axis=0)
    top = float(np.percentile(centres[:, 2], 98))
    inside = (heights > 0.35 * top) & (heights < 0.65 * top)
    return float(heights[np.flatnonzero(cut > 0.5 * np.median(cut[inside]))[-1]])


def loose_grains(centres: Floats, radii: Floats, side: float, deepest: float = DEEPEST) -> dict[int, Loose]:
    """Grains near the surface that nothing lies on and that their weight holds, by number in the bed."""
    surface = surface_of(centres, radii, side)
    found = {}
    for k in np.flatnonzero(centres[:, 2] > surface - deepest):
        tilts = tilts_of(normals(centres, radii, side, int(k)), float(radii[k]))
        if tilts and min(tilt.upward for tilt in tilts) > 0.0:
            found[int(k)] = Loose(float(centres[k, 2] - surface), float(radii[k]), tilts)
    return found


def normals(centres: Floats, radii: Floats, side: float, k: int) -> Floats:
    """Unit vectors from a grain to those that touch it [n, 3]."""
    apart = centres - centres[k]
    apart[:, :2] -= side * np.round(apart[:, :2] / side)
    far = np.sqrt((apart**2).sum(axis=1))
    touch = far < (radii + radii[k]) * (1.0 + GAP)
    touch[k] = False
    return apart[touch] / far[touch][:, np.newaxis]


def tilts_of(unit: Floats, radius: float) -> tuple[Tilt, ...]:
    """Rotations about two contacts that close no other; none where a neighbour lies on the grain."""
    if len(unit) < 2 or (unit[:, 2] > ABOVE).any():
        return ()
    found = []
    for a in range(len(unit)):
        for b in range(len(unit)):
            axis = unit[b] - unit[a]
            size = float(np.linalg.norm(axis))
            if a == b or size == 0.0:
                continue
            axis /= size
            closing = radius * (np.cross(axis, unit - unit[a]) * unit).sum(axis=1)
            closing[[a, b]] = 0.0
            if closing.max() > APPROACH:
                continue
            way = np.cross(axis, -radius * unit[a])
            carried = 2.0 / max(float(np.linalg.norm(unit[a] + unit[b])), 1e-9)
            opening = float(-closing.sum())
            found.append(Tilt(float(way[0]), float(way[2]), float(axis[1]), opening, carried))
    return tuple(found)
