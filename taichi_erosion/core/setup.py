"""Setup of one replica: grains, clumps, contact table, walls and numerics, in plain NumPy.

`scene/` makes these records from a scene file, `simulation/` puts them on the device. Lengths are in m,
masses in kg, times in s, angles in rad. Nothing here knows Taichi.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from math import inf
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.errors import BadInput

if TYPE_CHECKING:
    from taichi_erosion.core.air_setup import AirSetup
    from taichi_erosion.core.effect import ReplicaEffect

Floats = NDArray[np.float64]
Integers = NDArray[np.int32]
Triple = tuple[float, float, float]

NormalLaw = Literal["hertz", "jkr"]
AdhesionBranch = Literal["touch", "edem"]  # edem: the neck also pulls on approach
FrictionCap = Literal["thornton", "edem"]
RollingLaw = Literal["none", "constant_torque", "elastic_plastic"]
DragLaw = Literal["schiller_naumann", "two_limits", "two_limits_hindered", "di_felice", "gidaspow"]
Precision = Literal["f32", "f64"]
Arch = Literal["cpu", "cuda"]
ArchChoice = Literal["auto", "cpu", "cuda"]  # auto: a graphics processor for much work
Decomposition = Literal["partitions", "grains"]  # what one thread advances

MotionRow = tuple[float, ...]  # time [s], velocity [m s-1] (3) and spin [rad s-1] (3)
EVERYWHERE: tuple[Triple, Triple] = ((-inf, -inf, -inf), (inf, inf, inf))  # m, a domain without an end


class PrimitiveKind(IntEnum):
    """Shapes that walls are made of; `PrimitiveTable.shape` says what the numbers of a row mean."""

    PLANE = 0  # half space: point (3), unit normal into the free side (3)
    REVOLVED = 1  # turned segment: point of the axis (3), unit axis (3), radius and height of both ends (4)
    TRIANGLE = 2  # corners a, b, c (9)


SHAPE_NUMBERS = 10  # longest row of PrimitiveTable.shape


@dataclass(frozen=True)
class GrainTable:
    """Contact spheres of one replica, one row each.

    A sphere is a grain of its own unless `ClumpTable` groups it. A sphere whose `release_time` lies in the
    future is not simulated yet: it enters at `position` with `velocity` once the clock reaches that time.
    """

    position: Floats  # [n, 3] m
    velocity: Floats  # [n, 3] m s-1
    spin: Floats  # [n, 3] rad s-1
    radius: Floats  # [n] m
    mass: Floats  # [n] kg, of the whole clump for clump members
    material: Integers  # [n] index into Setup.materials
    release_time: Floats  # [n] s, never decreasing along the table


@dataclass(frozen=True)
class ClumpTable:
    """Rigid bodies made of several spheres of the GrainTable."""

    body: Integers  # [n] body of each sphere, counted from 0, spheres of a body adjacent
    offset: Floats  # [n, 3] m, sphere centre in the body's principal frame
    mass: Floats  # [b] kg
    inertia: Floats  # [b, 3] kg m2, principal moments
    position: Floats  # [b, 3] m, centre of mass
    orientation: Floats  # [b, 4] unit quaternion (w, x, y, z), body frame to space


@dataclass(frozen=True)
class ContactTable:
    """Contact parameters of every pair of materials; row `pair_row(i, j, m)` serves materials i and j."""

    young_effective: Floats  # [pairs] Pa, 1/E* = (1-nu_i^2)/E_i + (1-nu_j^2)/E_j
    shear_effective: Floats  # [pairs] Pa, 1/G* = (2-nu_i)/G_i + (2-nu_j)/G_j
    restitution: Floats  # [pairs] 1
    friction_sliding: Floats  # [pairs] 1
    friction_rolling: Floats  # [pairs] 1
    rolling_damping: Floats  # [pairs] 1, share of the critical value
    surface_energy: Floats  # [pairs] J m-2, per surface: work of adhesion w = 2 gamma
    effects: Floats  # [pairs] 1 where pair effects act, 0 where none does


def pair_row(i: int, j: int, materials: int) -> int:
    """Row of ContactTable for materials i and j (upper triangle, row by row)."""
    low, high = min(i, j), max(i, j)
    return low * materials - low * (low - 1) // 2 + high - low


def material_pair_rows(first: int, materials: int) -> Integers:
    """Rows [first (first + 1) / 2] of pairs of the `first` materials, in a ContactTable of `materials`."""
    return np.array([pair_row(i, j, materials) for i in range(first) for j in range(i, first)])


@dataclass(frozen=True)
class PrimitiveTable:
    """Wall primitives; several of them form one surface, which has one material and moves as one body."""

    kind: Integers  # [p] PrimitiveKind
    surface: Integers  # [p] index into Setup.surfaces
    shape: Floats  # [p, SHAPE_NUMBERS] as PrimitiveKind says, zero padded


@dataclass(frozen=True)
class Surface:
    name: str
    material: int


@dataclass(frozen=True)
class Laws:
    """Law in every slot; one choice per ensemble, compiled in."""

    normal: NormalLaw = "hertz"
    adhesion_branch: AdhesionBranch = "touch"
    friction_cap: FrictionCap = "thornton"
    rolling: RollingLaw = "none"
    drag: DragLaw = "schiller_naumann"


@dataclass(frozen=True)
class Coupling:
    """Exchange between grains and the air above and between them."""

    look_steps: int = 10  # time steps of the grains between two exchanges with the air
    surface: float = 0.0  # m, height of the undisturbed bed
    through_flow: float = 0.0  # m s-1, superficial velocity of air that rises through the bed
    rising: bool = False  # whether air may rise through the bed later on
    seed: int = 0  # of random forces on grains
    partition: float = 1.0  # friction velocity that reaches the bed over the one that is set [1]
    sleep_exchanges: int = 0  # exchanges at rest before deep grains sleep until disturbed; 0: none ever does
    sleep_share: float = 0.2  # of the weight of a sleeping grain, that disturbs it [1]


@dataclass(frozen=True)
class Setup:
    """Everything that defines one replica before its first step."""

    grains: GrainTable
    materials: tuple[str, ...]
    contacts: ContactTable
    primitives: PrimitiveTable
    surfaces: tuple[Surface, ...]
    time_step: float  # s
    gravity: Triple = (0.0, 0.0, -9.81)  # m s-2
    clumps: ClumpTable | None = None
    domain: tuple[Triple, Triple] = EVERYWHERE  # m, low and high
    removes_outside: bool = False  # whether grains that leave the domain are taken out, or stop the run
    period: Triple = (0.0, 0.0, 0.0)  # m, 0 where the box is open; a period starts at domain low
    overlap_limit: float = 0.2  # overlap over the smaller radius that stops the run [1]
    skin: float = 0.05  # least list margin of a grain over its radius [1]
    tables: tuple[tuple[MotionRow, ...], ...] = ()  # motions that surfaces may follow
    has_servos: bool = False  # whether a surface may have a servo
    effects: "tuple[ReplicaEffect, ...]" = ()  # optional physics between and on grains
    air: "AirSetup | None" = None  # a column of cells with exchange, or none
    coupling: Coupling = Coupling()
    bed: Mapping[str, NDArray[Any]] | None = None  # of another run, with its contacts


@dataclass(frozen=True)
class Motion:
    """Rigid motion of a surface, from the moment it is set."""

    velocity: Triple = (0.0, 0.0, 0.0)  # m s-1
    spin: Triple = (0.0, 0.0, 0.0)  # rad s-1
    centre: Triple = (0.0, 0.0, 0.0)  # m, a point of the spin axis
    table: tuple[MotionRow, ...] = ()  # a motion that follows the time since it was set; one of Setup.tables
    servo: "Servo | None" = None  # motion along or about an axis beside that


@dataclass(frozen=True)
class Servo:
    """Motion by which a surface pushes the grains with a constant force or torque."""

    is_torque: bool
    target: float  # N along the axis, or N m about it
    axis: Triple  # unit vector; that of a torque goes through Motion.centre
    fastest: float  # m s-1 or rad s-1


def usable_cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Numerics:
    """How the device runs; on a CPU neither arch nor threads change a result."""

    arch: Arch = "cpu"
    threads: int = field(default=0)  # 0: all cores
    precision: Precision = "f32"
    decomposition: Decomposition | None = None  # None: partitions on a CPU, grains elsewhere

    def __post_init__(self) -> None:
        kinds = (("arch", self.arch, Arch), ("decomposition", self.decomposition, Decomposition))
        for name, value, kind in kinds:
            if value is not None and value not in get_args(kind):
                raise BadInput(f"{name} = '{value}': write one of {', '.join(get_args(kind))}")

    @property
    def by_grain(self) -> bool:
        """Whether one thread advances one grain, rather than a partition of a replica."""
        return (self.decomposition or ("partitions" if self.arch == "cpu" else "grains")) == "grains"
