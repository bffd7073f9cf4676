"""A few hundred to a few thousand soft glass grains: loose filling, cylinder, orifice, slot, plate.

Grains are 2 mm glass with the shear modulus lowered to 5 MPa, so that 15 us is a fifth of the Rayleigh
time; in beds of a few centimetres the overlap stays below 0.3 % of the radius, where flow and angle do not
depend on stiffness.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import GrainTable, PrimitiveKind, PrimitiveTable, Setup
from taichi_erosion.verification.bench_setup import (
    FLOOR,
    Touch,
    contact_table,
    joined,
    planes,
    primitive_table,
    sphere_setup,
    spheres,
    touch_of,
)
from taichi_erosion.verification.reference.hertz import Solid, sphere_mass

Floats = NDArray[np.float64]

DIAMETER = 2e-3  # m
SOFT_GLASS = Solid(1.25e7, 0.25, 2500.0)
MASS = sphere_mass(DIAMETER / 2.0, SOFT_GLASS.density)
TIME_STEP = 1.5e-5  # s
GRAVITY = (0.0, 0.0, -9.81)  # m s-2
LATTICE = 1.1  # grain diameters between the centres of a loose filling [1]
SLOT_LENGTH = 5.6 * DIAMETER  # m, five rows of a loose filling; the period along a slot
TRAY = (0.0, 0.0, -30.0 * DIAMETER, 0.0, 0.0, 1.0)  # plane far below a silo
PLUG = "wall2"  # of a silo's opening


def soft_touch(friction: float, friction_rolling: float, surface_energy: float = 0.0) -> Touch:
    """Contact of two soft glass grains; walls are given the same."""
    return replace(
        touch_of(SOFT_GLASS, SOFT_GLASS, restitution=0.5, friction=friction),
        friction_rolling=friction_rolling,
        rolling_damping=0.3,
        surface_energy=surface_energy,
    )


def loose_grains(count: int, half_width: tuple[float, float], round_base: bool, seed: int) -> GrainTable:
    """`count` grains on a shaken lattice above z = 0, within a circle or a rectangle about the origin [m]."""
    rng = np.random.default_rng(seed)
    spacing = LATTICE * DIAMETER
    room = np.array(half_width) - 0.55 * DIAMETER
    numbers = np.floor(room / spacing).astype(int)
    x, y = (spacing * np.arange(-n, n + 1) for n in numbers)
    layer = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    if round_base:
        layer = layer[np.hypot(layer[:, 0], layer[:, 1]) <= room[0]]
    layers = -(-count // len(layer))
    height = spacing * (np.arange(layers) + 0.55)
    place = np.concatenate([np.column_stack([layer, np.full(len(layer), z)]) for z in height])[:count]
    place += rng.uniform(-0.04, 0.04, place.shape) * DIAMETER
    return spheres(place, rng.normal(0.0, 0.05, place.shape), 0.0, DIAMETER / 2.0, MASS)


def tube(radius: float, low: float, high: float) -> PrimitiveTable:
    """Upright cylinder about the z axis, open at both ends."""
    return revolved_segment((radius, low), (radius, high))


def revolved_segment(first: tuple[float, float], second: tuple[float, float]) -> PrimitiveTable:
    """Segment between two points (radius, height) [m], turned about the z axis."""
    return primitive_table(PrimitiveKind.REVOLVED, [(0.0, 0.0, 0.0, 0.0, 0.0, 1.0, *first, *second)])


def column_scene(touch: Touch, count: int, radius: float, seed: int) -> Setup:
    """Grains in a tube on a floor: surface wall0 is the floor, wall1 the tube."""
    grains = loose_grains(count, (radius, radius), True, seed)
    walls = joined(planes(FLOOR), tube(radius, 0.0, 60.0 * DIAMETER))
    return sphere_setup(grains, contact_table(touch, touch), TIME_STEP, walls, GRAVITY)


def silo_scene(touch: Touch, count: int, width: float, hole: float, seed: int) -> Setup:
    """A flat-bottomed round silo with a round hole [m].

    wall0 tube, wall1 bottom, wall2 plug, wall3 tray below.
    """
    radius, reach = width / 2.0, hole / 2.0
    grains = loose_grains(count, (radius, radius), True, seed)
    walls = joined(
        tube(radius, 0.0, 80.0 * DIAMETER),
        revolved_segment((reach, 0.0), (radius, 0.0)),
        revolved_segment((0.0, 0.0), (reach, 0.0)),
        planes(TRAY),
    )
    return sphere_setup(grains, contact_table(touch, touch), TIME_STEP, walls, GRAVITY)


def slot_scene(touch: Touch, count: int, width: float, slot: float, seed: int) -> Setup:
    """A flat-bottomed silo with a slot [m], periodic along it.

    wall0 and wall1 sides, wall2 plug, wall3 bottom, wall4 tray below.
    """
    half, reach = width / 2.0, slot / 2.0
    walls = joined(
        planes((-half, 0.0, 0.0, 1.0, 0.0, 0.0), (half, 0.0, 0.0, -1.0, 0.0, 0.0)),
        primitive_table(PrimitiveKind.TRIANGLE, strip(-reach, reach)),
        primitive_table(PrimitiveKind.TRIANGLE, strip(-half, -reach) + strip(reach, half)),
        planes(TRAY),
    )
    grains = loose_grains(count, (half, SLOT_LENGTH / 2.0), False, seed)
    setup = sphere_setup(grains, contact_table(touch, touch), TIME_STEP, walls, GRAVITY)
    return replace(setup, domain=endless(SLOT_LENGTH), period=(0.0, SLOT_LENGTH, 0.0))


def strip(left: float, right: float) -> list[list[float]]:
    """Two triangles at z = 0 between two x [m], along y much longer than any period."""
    y = 100.0 * DIAMETER
    corners = [[left, -y, 0.0], [right, -y, 0.0], [right, y, 0.0], [left, y, 0.0]]
    return [corners[0] + corners[1] + corners[2], corners[0] + corners[2] + corners[3]]


def endless(width: float) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Corners of a domain that is periodic along y and open elsewhere [m]."""
    inf = float("inf")
    return (-inf, -width / 2.0, -inf), (inf, width / 2.0, inf)


def plate_scene(grain: Touch, plate: Touch, count: int, half_length: float, seed: int) -> Setup:
    """Grains on a plate between dams, periodic along y; wall0 plate, wall1 and wall2 dams, wall3 floor.

    The front and back walls of the apparatus are left out: its formula is for containers so thick that they
    do not matter.
    """
    width = 5.0 * DIAMETER
    x = half_length
    walls = joined(
        primitive_table(PrimitiveKind.TRIANGLE, strip(-x, x)),
        planes(
            (-x, 0.0, 0.0, 1.0, 0.0, 0.0),
            (x, 0.0, 0.0, -1.0, 0.0, 0.0),
            (0.0, 0.0, -12.0 * DIAMETER, 0.0, 0.0, 1.0),
        ),
    )
    grains = loose_grains(count, (x, width / 2.0), False, seed)
    setup = sphere_setup(grains, contact_table(grain, plate), TIME_STEP, walls, GRAVITY)
    return replace(setup, domain=endless(width), period=(0.0, width, 0.0))
