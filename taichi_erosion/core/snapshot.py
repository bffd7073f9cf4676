"""State of one replica as plain NumPy, for measures and recordings: grains, sums over them, and air."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Floats


class Status(IntEnum):
    """Reason why a replica runs or has stopped."""

    RUNNING = 0
    OVERLAP = 1  # two bodies overlap beyond the limit
    LOST = 2  # a grain left a domain that it should not leave
    NOT_FINITE = 3  # a coordinate is NaN or infinite
    ENERGY = 4  # mechanical energy appeared
    OVERFLOW = 5  # a list was too short; the host enlarges it and continues
    COUNT = 7  # grains or mass are missing
    AIR = 9  # the pressure solve did not converge


@dataclass(frozen=True)
class Snapshot:
    """Released spheres of one replica at one moment, in the order of its GrainTable."""

    time: float  # s
    step: int
    position: NDArray[np.float64]  # [n, 3] m
    velocity: NDArray[np.float64]  # [n, 3] m s-1
    spin: NDArray[np.float64]  # [n, 3] rad s-1
    radius: NDArray[np.float64]  # [n] m
    mass: NDArray[np.float64]  # [n] kg
    contacts: NDArray[np.int32]  # [n] touching partners, walls included
    ident: NDArray[np.int32]  # [n] row of the GrainTable
    waiting: int  # spheres not released yet
    # by `effect.number`: [n] state variables that effects keep of every sphere, in their own units
    effect_state: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    # [n, 3] N, resultant of contacts, air, effects and gravity at the last step; None where it is not known
    force: NDArray[np.float64] | None = None
    removed: int = 0  # spheres taken out, since they left the domain
    kind: NDArray[np.int32] | None = None  # [n] place of the material among `kinds`; None where all are alike
    kinds: tuple[str, ...] = ()  # materials of the grains in alphabetical order, where there are several


@dataclass(frozen=True)
class ContactNetwork:
    """Contacts of one replica at one moment, with forces of pair effects, some of them across a gap."""

    time: float  # s
    first: NDArray[np.int32]  # [m] row of the GrainTable
    second: NDArray[np.int32]  # [m] a greater row of the GrainTable, or -1 - k for wall k
    centre: Floats  # [m, 3] m, of the first
    point: Floats  # [m, 3] m, where it acts
    branch: Floats  # [m, 3] m, to the centre of the first, from that of the second or the point on the wall
    normal: Floats  # [m, 3] 1, towards the first
    force: Floats  # [m, 3] N, on the first
    walls: tuple[str, ...]  # names

    @property
    def normal_force(self) -> Floats:
        """Force along the normal, [m] N, positive where it pushes apart."""
        return (self.force * self.normal).sum(axis=1)

    @property
    def tangential_force(self) -> Floats:
        """Force on the first across the normal, [m, 3] N."""
        return self.force - self.normal_force[:, np.newaxis] * self.normal


@dataclass(frozen=True)
class GrainFields:
    """Coarse-grained fields at coordinates by axis; vectors and tensors have their components last."""

    time: float  # s
    at: Mapping[str, Floats]  # m, in order of x, y, z; a field is an average along an axis that is not there
    width: float  # m
    solid_fraction: Floats  # 1
    density: Floats  # kg m-3, of the grains in the whole volume
    velocity: Floats  # m s-1, NaN where there are no grains
    kinetic_stress: Floats  # Pa
    contact_stress: Floats  # Pa
    wall_force: Floats  # N m-3, of walls on grains


FIELD_UNITS = {"solid_fraction": "1", "density": "kg m-3", "velocity": "m s-1"}
FIELD_UNITS |= {"kinetic_stress": "Pa", "contact_stress": "Pa", "wall_force": "N m-3"}


@dataclass(frozen=True)
class Totals:
    """Sums over one replica at one moment."""

    time: float  # s
    step: int
    kinetic_translation: float  # J
    kinetic_rotation: float  # J
    potential: float  # J, gravity, zero at the origin
    elastic: float  # J, stored in normal and tangential springs
    contacts: int  # touching pairs, grain-grain and grain-wall
    overlap_largest: float  # over the smaller radius [1]
    speed_largest: float  # m s-1
    released: int
    rebuilds: int


@dataclass(frozen=True)
class WallPose:
    """A wall as it stands: a point p of it at the start is now at  R p + t."""

    present: bool  # False once removed
    rotation: Floats  # R [3, 3]
    translation: Floats  # t [3] m

    @property
    def has_moved(self) -> bool:
        """Whether it stands elsewhere than at the start."""
        return bool(np.any(self.translation) or np.any(self.rotation != np.eye(3)))


@dataclass(frozen=True)
class AirProfile:
    """The air over a patch, layer by layer from the floor upwards; of a grid, means over its columns."""

    face: NDArray[np.float64]  # [n + 1] m, heights of the faces between layers
    velocity: NDArray[np.float64]  # [n, 2] m s-1, along x and y
    void_fraction: NDArray[np.float64]  # [n] 1
    eddy_viscosity: NDArray[np.float64]  # [n] m2 s-1, on the lower face of each layer
    drag: NDArray[np.float64]  # [n, 2] N m-3, by the grains on the air at the last exchange
    lift: NDArray[np.float64]  # [n] Pa m-1, upward pressure gradient where air rises through a bed


@dataclass(frozen=True)
class Failure:
    """Why a replica stopped, in numbers."""

    status: Status
    time: float  # s
    grain: int  # row of the GrainTable
    partner: int  # row of the GrainTable, or -1 - primitive for a wall
    value: float  # overlap over radius, coordinate or energy ratio, by status


@dataclass(frozen=True)
class AirSnapshot:
    """Air of one replica at one moment; arrays run over cells along x, y and z unless stated otherwise."""

    time: float  # s
    x: Floats  # [nx] m, centres of cells
    y: Floats  # [ny] m
    z: Floats  # [nz] m
    faces_z: Floats  # [nz + 1] m
    velocity: Floats  # [nx, ny, nz, 3] m s-1, at centres
    pressure: Floats  # [nx, ny, nz] Pa
    eddy_viscosity: Floats  # [nx, ny, nz + 1] m2 s-1, on the lower faces of cells and the lid
    friction_velocity: Floats  # [nx, ny] m s-1, of the floor
    density: float  # kg m-3
    viscosity: float  # m2 s-1
