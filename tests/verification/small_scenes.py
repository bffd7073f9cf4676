"""Scenes of the claims: spheres, planes and boxes of air made by hand, run on the CPU and sampled.

Materials are grain (0) and wall (1); surfaces are named wall0, wall1, ... in the order of their table.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from taichi_erosion.air.grid import Air, allocate_air
from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup, AirSide, equal_cell_faces
from taichi_erosion.core.device import start_device
from taichi_erosion.core.setup import (
    SHAPE_NUMBERS,
    ContactTable,
    Coupling,
    Floats,
    GrainTable,
    Laws,
    Numerics,
    PrimitiveKind,
    PrimitiveTable,
    Setup,
    Surface,
    Triple,
)
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.effect_library import load_library
from taichi_erosion.execution.ensemble_loop import EnsembleRun, run_ensemble
from taichi_erosion.execution.stages import ReplicaState
from taichi_erosion.scene import Scene
from taichi_erosion.scene import laws as laws_of
from taichi_erosion.simulation import Simulation, advance, assemble, failure_of, prepare, snapshot
from taichi_erosion.verification.claims import Precision
from taichi_erosion.verification.closed_forms import HERTZ, hertz_impact, sample_states, sphere_mass
from tests.verification.reference.contact import Solid, effective_moduli, series

WALL = 1  # material
NO_GRAVITY, GRAVITY = (0.0, 0.0, 0.0), (0.0, 0.0, -9.81)  # m s-2
FLOOR = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)  # plane through the origin, free side up
OVERLAP_LIMIT = 0.5  # of the radius; the references have no limit, soft test grains dip far [1]
LINEAR = AirModel(advection="none", scheme="euler")  # nothing is carried: parallel flow, any step


@dataclass(frozen=True)
class Touch:
    """Contact parameters of one pair of materials, named as in ContactTable."""

    young_effective: float  # E*, Pa
    shear_effective: float  # G*, Pa
    restitution: float = 1.0
    friction_sliding: float = 0.0
    friction_rolling: float = 0.0
    rolling_damping: float = 0.0
    surface_energy: float = 0.0  # J m-2
    effects: float = 1.0


def touch_of(first: Solid, second: Solid | None, restitution: float = 1.0, friction: float = 0.0) -> Touch:
    """Contact of two solids; without a second the partner is rigid."""
    return Touch(*effective_moduli(first, *([second] if second else [])), restitution, friction)


def spheres(
    position: ArrayLike, velocity: ArrayLike, spin: ArrayLike, radius: ArrayLike, mass: ArrayLike
) -> GrainTable:
    """Grains present from the start; vectors [n, 3], radius and mass one number or [n]."""
    place = np.atleast_2d(np.asarray(position, dtype=float))
    count = len(place)
    return GrainTable(
        position=place,
        velocity=np.broadcast_to(velocity, (count, 3)).astype(float),
        spin=np.broadcast_to(spin, (count, 3)).astype(float),
        radius=np.broadcast_to(radius, count).astype(float),
        mass=np.broadcast_to(mass, count).astype(float),
        material=np.zeros(count, dtype=np.int32),
        release_time=np.zeros(count),
    )


def primitive_table(kind: PrimitiveKind, shapes: ArrayLike, surface: ArrayLike = 0) -> PrimitiveTable:
    """Primitives of one kind, their numbers in the order of PrimitiveKind, without padding."""
    numbers = np.atleast_2d(np.asarray(shapes, dtype=float))
    return PrimitiveTable(
        kind=np.full(len(numbers), int(kind), dtype=np.int32),
        surface=np.broadcast_to(surface, len(numbers)).astype(np.int32),
        shape=np.pad(numbers, ((0, 0), (0, SHAPE_NUMBERS - numbers.shape[1]))),
    )


def planes(*shapes: Sequence[float]) -> PrimitiveTable:
    """Each (point, unit normal into the free side) is a surface of its own."""
    numbers = np.array(shapes, dtype=float).reshape(-1, 6)
    return primitive_table(PrimitiveKind.PLANE, numbers, np.arange(len(numbers)))


NONE, FLAT = planes(), planes(FLOOR)


def joined(*tables: PrimitiveTable) -> PrimitiveTable:
    """Tables one after the other, the surfaces of each counted on from the last."""
    surfaces, first = [], 0
    for table in tables:
        surfaces.append(table.surface + first)
        first += int(table.surface.max()) + 1
    kind, shape = (np.concatenate([getattr(table, name) for table in tables]) for name in ("kind", "shape"))
    return PrimitiveTable(kind=kind, surface=np.concatenate(surfaces).astype(np.int32), shape=shape)


def sphere_setup(
    grains: GrainTable,
    touch: Touch,
    time_step: float,
    walls: PrimitiveTable = NONE,
    gravity: Triple = NO_GRAVITY,
) -> Setup:
    """One replica in which grains meet each other and walls with the same contact parameters."""
    return Setup(
        grains=grains,
        materials=("grain", "wall"),
        contacts=ContactTable(**{name: np.full(3, float(value)) for name, value in vars(touch).items()}),
        primitives=walls,
        surfaces=tuple(Surface(f"wall{k}", WALL) for k in range(walls.surface.max(initial=-1) + 1)),
        time_step=time_step,
        gravity=gravity,
        overlap_limit=OVERLAP_LIMIT,
    )


class HeadOn(NamedTuple):
    """An elastic head-on impact with the closed form of Hertz."""

    mass: float  # m*, kg
    speed: float  # of approach, m s-1
    closed: tuple[float, float, float]  # K [N m^-1.5], deepest overlap [m], contact time [s]
    duration: float  # s


def head_on(touch: Touch, density: float, speed: float, *radii: float) -> HeadOn:
    """A sphere that meets a rigid plane, or two spheres that meet, with relative speed `speed` [m s-1]."""
    masses = [sphere_mass(radius, density) for radius in radii]
    radius, mass = (each[0] if len(radii) == 1 else series(*each) for each in (radii, masses))
    closed = hertz_impact(touch.young_effective, radius, mass, speed)
    return HeadOn(mass, speed, closed, closed[2])


def in_air(setup: Setup, air: AirSetup, coupling: Coupling, headroom: float) -> Setup:
    """The same grains in a periodic patch; they may rise `headroom` [m] above the lid."""
    low = (0.0, 0.0, air.faces_z[0] - headroom)
    high = (air.high[0], air.high[1], air.high[2] + headroom)
    period = (air.high[0], air.high[1], 0.0)
    return replace(setup, air=air, coupling=coupling, domain=(low, high), period=period)


def lattice_edge(diameter: float, void: float) -> float:
    """Edge of a cell of four spheres that leaves `void` of its volume free [m]."""
    return (4.0 * np.pi / 6.0 / (1.0 - void)) ** (1.0 / 3.0) * diameter


def regular_bed(diameter: float, density: float, void: float, cells: tuple[int, int, int]) -> GrainTable:
    """A face-centred cubic lattice of spheres from the origin that leaves `void` of its volume free."""
    edge = lattice_edge(diameter, void)
    base = edge * np.array([(0.25, 0.25, 0.25), (0.75, 0.75, 0.25), (0.25, 0.75, 0.75), (0.75, 0.25, 0.75)])
    corner = edge * np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1).reshape(-1, 1, 3)
    place = (corner + base).reshape(-1, 3)
    return spheres(place, 0.0, 0.0, diameter / 2.0, density * np.pi / 6.0 * diameter**3)


def sides(**given: AirSide) -> dict[str, AirSide]:
    """The named sides, symmetry along z, and periods elsewhere."""
    flat = {name: AirSide("symmetry") for name in ("z_low", "z_high")}
    return {name: AirSide() for name in SIDES} | flat | given


def box(cells: tuple[int, int, int], size: Triple, **words: Any) -> AirSetup:
    """A box of air from the origin, of density 1 and equal cells unless stated otherwise."""
    usual: dict[str, Any] = dict.fromkeys(("density", "viscosity", "time_step"), 1.0)
    usual |= {"faces_z": equal_cell_faces(0.0, size[2], cells[2]), "sides": sides(), "implicitness": 0.5}
    return AirSetup(cells=cells, low=(0.0, 0.0, 0.0), high=size, **usual | words)


def still_air(faces: Floats, patch: tuple[float, float], density: float, viscosity: float) -> AirSetup:
    """A column of air at rest over a patch [m], without stress at floor and lid; viscosity in Pa s."""
    return box(
        (1, 1, len(faces) - 1),
        (*patch, float(faces[-1])),
        faces_z=faces,
        sides=sides(z_high=AirSide("stress")),
        density=density,
        viscosity=viscosity / density,
        model=replace(LINEAR, exchange=True),
        implicitness=1.0,
    )


def air_of(setups: Sequence[AirSetup], threads: int = 0) -> Air:
    start_device(Numerics(threads=threads))
    return allocate_air(setups)


def centres(faces: Floats) -> Floats:
    return 0.5 * (faces[1:] + faces[:-1])


def simulation_of(setups: Sequence[Setup], precision: Precision, laws: Laws = HERTZ) -> Simulation:
    return assemble(setups, laws, Numerics(precision=precision))


def run_to_end(scenes: Sequence[Scene], seeds: Sequence[int]) -> EnsembleRun:
    """Scenes of one law, each with its effects and seed, run to their ends on the CPU in single precision."""
    library = load_library()
    setups = [prepare(scene, seed, library) for scene, seed in zip(scenes, seeds, strict=True)]
    sim = assemble(setups, laws_of(scenes[0]), Numerics())
    whole = EnsembleRun(list(scenes), sim, list(map(ReplicaState, seeds)))
    run_ensemble(whole, [])
    return whole


def states(sim: Simulation) -> list[Snapshot]:
    """Snapshots of all replicas; raises RuntimeError where one has failed."""
    for replica in range(len(sim.setups)):
        if fault := failure_of(sim, replica):
            raise RuntimeError(f"replica {replica} stopped: {fault}")
    return [snapshot(sim, replica) for replica in range(len(sim.setups))]


def advance_all(sim: Simulation, time: float) -> None:
    advance(sim, [float(time)] * len(sim.setups))


def final_states(
    setups: Sequence[Setup], durations: ArrayLike, precision: Precision, laws: Laws = HERTZ
) -> list[Snapshot]:
    """Snapshots after `durations` [s], one number or one per replica."""
    ends = np.broadcast_to(np.asarray(durations, dtype=float), (1, len(setups)))
    return [end for (end,) in sample_states(setups, ends, precision, laws)]


@dataclass(frozen=True)
class Trace:
    """Samples of an ensemble whose replicas have equal numbers of grains."""

    time: Floats  # [samples, replicas] s
    position: Floats  # [samples, replicas, grains, 3] m
    velocity: Floats  # [samples, replicas, grains, 3] m s-1
    spin: Floats  # [samples, replicas, grains, 3] rad s-1


def trace(setups: Sequence[Setup], times: Floats, precision: Precision, laws: Laws = HERTZ) -> Trace:
    """Samples at `times` [samples, replicas] in s, or [samples] for all replicas alike."""
    rows = np.broadcast_to(times if times.ndim == 2 else times[:, None], (len(times), len(setups)))
    paths = sample_states(setups, rows, precision, laws)
    names = ("time", "position", "velocity", "spin")
    return Trace(*(np.array([[getattr(s, n) for s in path] for path in paths]).swapaxes(0, 1) for n in names))


def order(errors: Sequence[float]) -> float:
    """Observed order of convergence from the last two of a series of errors, each grid twice as fine [1]."""
    return float(np.log(errors[-2] / errors[-1]) / np.log(2.0))
