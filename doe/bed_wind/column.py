"""The horizontal mean of the wind over layers of spheres at rest, written a second time in NumPy.

    d/dz [eps (nu + l^2 |du/dz|) du/dz] = n F(u) / rho,    dl/dz = kappa (1 - exp(-sqrt(u l / (7 nu))))

with n spheres per volume and F the drag of one in the mean wind over it [N], by a law of drag; u and l are 0
on the plane below, the stress at the lid is rho u*^2. Nothing of the simulator but the laws' second form is
used.

Reference: Duran, Andreotti & Claudin (2012), Phys. Fluids 24, 103306.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, sqrt

import numpy as np
from scipy.linalg import solve_banded

from taichi_erosion.core.setup import Floats
from tests.verification.reference.flow import LAWS, Stream

VISCOSITY, AIR, KARMAN, SUBLAYER = 1.46e-5, 1.225, 0.4, 7.0  # m2 s-1, kg m-3, 1, 1
FINE, GROWTH, LID = 0.025, 1.05, 60.0  # cells in diameters: those of the layer, their growth above, the lid
ROUNDS, MIXED, CLOSE = 400, 0.4, 1e-6  # of the iteration, the share of the new flow, its last change over u*
SLOWEST = 1e-9  # slip of a law of drag [m s-1]


@dataclass(frozen=True)
class Layer:
    """Spheres at one height; lengths in diameters of the bed."""

    centre: float  # over the plane
    number: float  # on the square of a diameter
    size: float = 1.0  # diameter of these spheres


LAYERS = {"quadratic": (Layer(0.5, 1.0),), "triangular": (Layer(0.5, 1.0 / sqrt(0.75)),)}


@dataclass(frozen=True)
class Blow:
    """A wind over spheres."""

    friction: float  # m s-1
    diameter: float  # m
    law: str
    turbulent: bool = True
    viscosity: float = VISCOSITY


def faces_over(top: float) -> Floats:
    """Faces of cells [diameters]: fine up to a diameter above the spheres."""
    fine = np.arange(0.0, top + 1.0, FINE)
    above = fine[-1] + np.cumsum(FINE * GROWTH ** np.arange(1, 400))
    return np.append(fine, above[above < LID])


def volume_shares(layers: Sequence[Layer], faces: Floats) -> Floats:
    """Share of a sphere's volume in each cell [layer, cell]."""
    centres, sizes = np.array([[layer.centre] for layer in layers]), sizes_of(layers)[:, None]
    x = np.clip(2.0 * (faces - centres) / sizes, -1.0, 1.0)
    return np.diff(0.25 * (2.0 + 3.0 * x - x**3), axis=1)


def sizes_of(layers: Sequence[Layer]) -> Floats:
    """Diameters of the spheres of every layer over that of the bed [1]."""
    return np.array([layer.size for layer in layers])


def mixing_length(speed: Floats, faces: Floats, viscosity: float) -> Floats:
    """Mixing length on every face [m]."""
    length, root = np.zeros(len(faces)), 0.0

    def slope(root: float, rate: float) -> float:
        share = rate * root
        grown = rate * (1.0 - 0.5 * share) if share < 1e-3 else (1.0 - exp(-share)) / root
        return 0.5 * KARMAN * grown

    for k in range(1, len(faces)):
        rise, rate = faces[k] - faces[k - 1], sqrt(abs(speed[k - 1]) / (SUBLAYER * viscosity))
        root += rise * slope(root + 0.5 * rise * slope(root, rate), rate)
        length[k] = root**2
    return length


def cells_over(layers: Sequence[Layer]) -> tuple[Floats, Floats, Floats]:
    """Faces of cells [diameters], shares of the spheres in them, and void fractions [1]."""
    faces = faces_over(max(layer.centre + 0.5 * layer.size for layer in layers))
    shares = volume_shares(layers, faces)
    volumes = np.pi / 6.0 * np.array([layer.number for layer in layers]) * sizes_of(layers) ** 3
    return faces, shares, 1.0 - (volumes[:, None] * shares).sum(axis=0) / np.diff(faces)


def drags_of(layers: Sequence[Layer], blow: Blow) -> Floats:
    """Drag of the steady wind on one sphere of each layer over rho u*^2 d^2, d that of the bed [1]."""
    _, shares, void = cells_over(layers)
    _, speed = wind_over(layers, blow)
    slip = np.maximum(np.abs(shares @ speed), SLOWEST)
    diameters = blow.diameter * sizes_of(layers)
    stream = Stream(slip, diameters, AIR, AIR * blow.viscosity, shares @ void)  # pyright: ignore
    return np.asarray(LAWS[blow.law](stream)) / (AIR * (blow.friction * blow.diameter) ** 2)


def wind_over(layers: Sequence[Layer], blow: Blow) -> tuple[Floats, Floats]:
    """Heights of the middles of cells [diameters], and the steady wind there [m s-1]."""
    faces, shares, void = cells_over(layers)
    numbers = np.array([layer.number for layer in layers])
    places, metres = 0.5 * (faces[1:] + faces[:-1]), faces * blow.diameter
    diameters = blow.diameter * sizes_of(layers)
    speed = blow.friction * np.sqrt(places)
    for _ in range(ROUNDS):
        slip = np.maximum(np.abs(shares @ speed), SLOWEST)
        stream = Stream(slip, diameters, AIR, AIR * blow.viscosity, shares @ void)  # pyright: ignore
        rates = LAWS[blow.law](stream) / slip  # pyright: ignore
        drag = (numbers * rates) @ shares / (AIR * blow.diameter**2)
        after = stepped(speed, void, drag, metres, blow)
        change = np.abs(after - speed).max() / blow.friction
        speed = speed + MIXED * (after - speed)
        if change < CLOSE:
            break
    return places, speed


def stepped(speed: Floats, void: Floats, drag: Floats, metres: Floats, blow: Blow) -> Floats:
    """The wind [m s-1] that the present rates of drag and eddy viscosities make steady."""
    gaps = np.diff(0.5 * (metres[1:] + metres[:-1]))
    eddy = 0.0
    if blow.turbulent:
        length = mixing_length(speed, metres, blow.viscosity)[1:-1]
        eddy = length**2 * np.abs(np.diff(speed)) / gaps
    inner = 0.5 * (void[1:] + void[:-1]) * (blow.viscosity + eddy) / gaps
    below = np.append(2.0 * blow.viscosity / (metres[1] - metres[0]), inner)
    above = np.append(inner, 0.0)
    bands = np.zeros((3, len(speed)))
    bands[0, 1:], bands[1], bands[2, :-1] = -inner, below + above + drag, -inner
    stress = np.zeros(len(speed))
    stress[-1] = blow.friction**2
    return solve_banded((1, 1), bands, stress)


def zero_depth(layers: Sequence[Layer], blow: Blow) -> float:
    """Depth below the tops at which the wind would begin that has u*^2 / nu as its shear [diameters].

    For laminar air, whose profile above the spheres is straight.
    """
    heights, speed = wind_over(layers, blow)
    top = max(layer.centre for layer in layers) + 0.5
    slope, start = np.polyfit(heights[heights > top + 1.0], speed[heights > top + 1.0], 1)
    return float(top + start / slope)


def height_of(layers: Sequence[Layer], blow: Blow, place: float) -> float:
    """Height over which the shear u*^2 / nu gives the wind at a place [diameters], and its own."""
    heights, speed = wind_over(layers, blow)
    at = float(np.interp(place, heights, speed))
    return at * blow.viscosity / blow.friction**2 / blow.diameter
