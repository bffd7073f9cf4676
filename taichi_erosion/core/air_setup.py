"""Air of one replica before its first step: grid, sides, closure, flow, initial turbulence; plain NumPy.

`scene/` makes these records from a scene file, `air/` puts them on the device. x runs downwind, z upwards;
cells are equal along x and y and may be stretched along z. Nothing here knows Taichi.
"""

from dataclasses import dataclass, field
from itertools import product
from math import inf
from typing import Any, Literal

import numpy as np
import scipy

from taichi_erosion.core.setup import Floats, Triple

SIDES = ("x_low", "x_high", "y_low", "y_high", "z_low", "z_high")
EVEN = 1e-9  # widening of a cell over its neighbour that still counts as even [1]

SideKind = Literal["periodic", "wall", "rough", "symmetry", "inlet", "outlet", "stress"]
Closure = Literal["none", "mixing_length", "smagorinsky"]
Advection = Literal["none", "central", "limited"]


@dataclass(frozen=True)
class AirSide:
    """One side of the box of air.

    periodic: what leaves here enters opposite; both sides of an axis are periodic or none
    wall:     the air has the velocity of the wall
    rough:    a wall whose stress follows from the log law in the nearest cell (z0 = 0: smooth)
    symmetry: no flow through, no stress
    inlet:    the air enters with `velocity`, along x times AirSetup.inlet_shape
    outlet:   pressure zero, velocity unchanged along the normal
    stress:   a lid without flow through, under the stress rho u*^2 along x
    """

    kind: SideKind = "periodic"
    velocity: Triple = (0.0, 0.0, 0.0)  # m s-1, of a wall or of entering air
    roughness: float = 0.0  # m, roughness length z0 of a rough wall


@dataclass(frozen=True)
class AirModel:
    """Choices compiled in, one for an ensemble."""

    closure: Closure = "none"
    advection: Advection = "central"
    scheme: Literal["runge_kutta", "euler"] = "runge_kutta"  # of explicit terms; euler serves columns
    exchange: bool = False  # whether grains take part: void fraction and momentum exchange


@dataclass(frozen=True)
class ClosureConstants:
    """Numbers of the turbulence closures."""

    karman: float = 0.40  # kappa [1]
    sublayer: float = 7.0  # R_c of the mixing length, thickness of the viscous sublayer [1]
    van_driest: float = 26.0  # A+ of the damping near a wall, for smagorinsky [1]
    smagorinsky: float = 0.10  # C_s [1]
    length_most: float = inf  # largest mixing length [m]
    length_share: float = 0.0  # largest mixing length over the thickness of the layer; 0: no limit [1]


@dataclass(frozen=True)
class InletTurbulence:
    """Statistics of fluctuations at the inlet: a sum of random waves that drift with the mean wind."""

    deviation: Triple  # m s-1, standard deviations of u, v, w
    length: float  # m, integral length scale
    seed: int = 0
    waves: int = 64  # waves that are summed


@dataclass(frozen=True)
class InitialTurbulence:
    """Fluctuations from which eddies grow over a bed: waves of random phases on the mean wind."""

    deviation: float  # standard deviation of each velocity over u* [1]
    turnovers: float  # time of growth without grains, times u* over the height above the bed [1]
    roughness: float  # m, roughness length of the initial mean wind
    seed: int


@dataclass(frozen=True)
class AirSetup:
    """The air of one replica before its first step."""

    cells: tuple[int, int, int]
    low: Triple  # m, corner of the box
    high: Triple  # m, opposite corner
    faces_z: Floats  # [nz + 1] m, from low[2] to high[2]
    sides: dict[str, AirSide]  # by the names of SIDES
    density: float  # kg m-3
    viscosity: float  # m2 s-1, kinematic
    time_step: float  # s
    model: AirModel = AirModel()
    constants: ClosureConstants = ClosureConstants()
    friction_velocity: float = 0.0  # m s-1, u* of a side under stress
    driving_gradient: Triple = (0.0, 0.0, 0.0)  # Pa m-1, mean pressure gradient; negative drives forwards
    ground: float = 0.0  # m, height of a bed of grains, from which a closure over it counts distances
    implicitness: float = 1.0  # of diffusion along z: 1/2 second order in time, 1 damps any step [1]
    inlet_shape: Floats | None = None  # [nz] speed at an inlet along x over that of the side; None: 1
    turbulence: InletTurbulence | None = None
    initial_turbulence: InitialTurbulence | None = None  # of a grid over grains
    start: Floats | None = field(default=None)  # m s-1: [nz] along x, or [3, nx, ny, nz]; None: at rest


def equal_cell_faces(low: float, high: float, count: int) -> Floats:
    """Faces of equal cells [m]."""
    return np.linspace(low, high, count + 1)


def stretched_faces(low: float, high: float, count: int, finest: float) -> Floats:
    """Faces of cells that widen upwards by a constant factor, the lowest `finest` thick [m].

    finest (q^n - 1) / (q - 1) = high - low   gives the factor q [1].
    """
    span = high - low
    if finest * count >= span * (1.0 - EVEN):
        return equal_cell_faces(low, high, count)
    growth: Any = scipy.optimize.brentq(
        lambda q: count * np.log(q) - np.log1p(span * (q - 1.0) / finest), 1.0 + EVEN, 1.0 + span / finest
    )
    widths = finest * growth ** np.arange(count)
    return low + span * np.concatenate([[0.0], np.cumsum(widths)]) / widths.sum()


def bed_faces(low: float, surface: float, high: float, finest: float, growth: float = 1.1) -> Floats:
    """Faces of equal cells up to `surface`, not wider than `finest`, that then widen by `growth` [m].

    Above the surface the fewest cells are taken whose last one does not exceed the growth.
    """
    below = equal_cell_faces(low, surface, max(1, int(np.ceil((surface - low) / finest * (1.0 - EVEN)))))
    count = int(np.ceil(np.log1p((high - surface) / finest * (growth - 1.0)) / np.log(growth)))
    return np.concatenate([below, stretched_faces(surface, high, max(count, 1), finest)[1:]])


def faces_fine_at_both_ends(low: float, high: float, count: int, finest: float) -> Floats:
    """Faces that widen from both ends towards the middle, for a channel of `count` (even) cells [m]."""
    half = stretched_faces(0.0, 0.5 * (high - low), count // 2, finest)
    return np.concatenate([low + half, (high - half[::-1])[1:]])


def log_profile(height: Floats, friction_velocity: float, roughness: float, karman: float) -> Floats:
    """Mean wind over a rough floor [m s-1], height above it in m.

    u = (u* / kappa) ln((z + z0) / z0)

    Reference: Richards & Hoxey (1993), J. Wind Eng. Ind. Aerodyn. 46-47, 145-153, eq. (5).
    """
    return friction_velocity / karman * np.log1p(np.maximum(height, 0.0) / roughness)


def stress_gradient(setup: AirSetup, friction_velocity: float) -> float:
    """Mean pressure gradient [Pa m-1] that puts the stress rho u*^2 on a bed, 0 where the lid does.

    dp/dx = -rho u*^2 / (H - h),   H the height of the lid, h that of the bed [m]
    """
    if setup.sides["z_high"].kind == "stress":
        return 0.0
    return -setup.density * friction_velocity**2 / (setup.high[2] - setup.ground)


WAVES_X, WAVES_Y, HALF_WAVES = 2, 3, 3  # largest numbers of waves along x and y, and of half waves up


def initial_wind(setup: AirSetup, friction_velocity: float) -> Floats:
    """Wind that sets in over a bed [m s-1], [3, nx, ny, nz]: a logarithmic mean, and random waves.

    u = (u*/kappa) ln(1 + z / z0),    u'_i = A_i sum_n cos(k_n . x + p_in) sin(pi m_n z / H)

    over the waves that are periodic in the patch, m half waves high, of equal amplitudes, with z counted from
    the bed [m]. Each u'_i has the standard deviation s u* over the air above the bed; the first projection
    removes its divergence. In the bed the air is at rest. Eddies grow from the waves.

    Reference: Moin & Kim (1982), J. Fluid Mech. 118, 341 (turbulence grown from random fluctuations).
    """
    assert setup.initial_turbulence is not None
    centre = 0.5 * (setup.faces_z[1:] + setup.faces_z[:-1]) - setup.ground
    wind = np.zeros((3, *setup.cells))
    roughness = setup.initial_turbulence.roughness
    wind[0] = log_profile(centre, friction_velocity, roughness, setup.constants.karman)
    height = np.maximum(centre, 0.0) / (setup.high[2] - setup.ground)
    random = np.random.Generator(np.random.Philox(setup.initial_turbulence.seed))
    x, y = (2.0 * np.pi * np.arange(n) / n for n in setup.cells[:2])
    waves = np.zeros((3, *setup.cells))
    for a, b, m in product(range(WAVES_X + 1), range(-WAVES_Y, WAVES_Y + 1), range(1, HALF_WAVES + 1)):
        phase = random.uniform(0.0, 2.0 * np.pi, 3)
        level = np.cos(a * x[None, :, None] + b * y[None, None, :] + phase[:, None, None])
        waves += level[..., None] * np.sin(np.pi * m * height)
    above = height > 0.0
    deviation = np.sqrt((waves[..., above] ** 2).mean(axis=(1, 2, 3), keepdims=True))
    waves /= np.maximum(deviation, np.finfo(float).tiny)
    return wind + setup.initial_turbulence.deviation * friction_velocity * waves
