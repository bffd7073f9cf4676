"""Heaps whose angle is known because they were built, not poured."""

from dataclasses import replace
from functools import cache
from math import radians, tan

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.snapshot import Snapshot

DIAMETER = 2e-3  # m
PITCH = 0.8  # diameters between lattice sites: neighbours touch in spite of the jitter
JITTER = 0.15  # diameters, uniform either way


def snapshot_of(position, diameter=DIAMETER, time: float = 0.0, **columns) -> Snapshot:
    """Grains at the given centres, at rest and all touching unless columns say otherwise."""
    count = len(position)
    place, still = np.asarray(position, dtype=float).reshape(count, 3), np.zeros((count, 3))
    radius = np.broadcast_to(0.5 * np.asarray(diameter), count).astype(float)
    mass = 2500.0 * 4.0 / 3.0 * np.pi * radius**3
    contacts, ident = np.full(count, 4, dtype=np.int32), np.arange(count, dtype=np.int32)
    return replace(Snapshot(time, 0, place, still, still, radius, mass, contacts, ident, 0), **columns)


def packing(half_width: float, height: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """A jittered lattice turned at random, filling a box from z = d / 2 upwards; all in diameters."""
    reach = np.hypot(half_width * 2.0**0.5, height) + 1.0
    sites = np.arange(-reach, reach, PITCH)
    lattice = np.stack(np.meshgrid(sites, sites, sites, indexing="ij"), axis=-1).reshape(-1, 3)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    centres = lattice @ turn + rng.uniform(-JITTER, JITTER, lattice.shape)
    inside = (np.abs(centres[:, :2]) <= half_width).all(axis=1)
    return centres[inside & (centres[:, 2] >= 0.5) & (centres[:, 2] <= height)]


@cache
def cone(angle: float, radius: float = 22.0, top: float = np.inf, seed: int = 1) -> NDArray[np.float64]:
    """Centres [m] of a cone of the given angle [deg], base radius and height of a flat top in diameters."""
    rng = np.random.default_rng(seed)
    fall = tan(radians(angle))
    centres = packing(radius, min(radius * fall, top) + 0.5, rng)
    inside = centres[:, 2] - 0.5 <= fall * (radius - np.hypot(centres[:, 0], centres[:, 1]))
    return centres[inside & (centres[:, 2] - 0.5 <= top)] * DIAMETER


@cache
def skirt(inner: float, outer: float, seed: int = 2) -> NDArray[np.float64]:
    """Centres [m] of a monolayer of touching grains between two radii in diameters."""
    rng = np.random.default_rng(seed)
    sites = np.arange(-outer, outer, 0.95)
    layer = np.stack(np.meshgrid(sites, sites, indexing="ij"), axis=-1).reshape(-1, 2)
    layer = layer + rng.uniform(-0.02, 0.02, layer.shape)
    distance = np.hypot(*layer.T)
    layer = layer[(distance > inner) & (distance < outer)]
    return np.column_stack([layer, np.full(len(layer), 0.5)]) * DIAMETER
