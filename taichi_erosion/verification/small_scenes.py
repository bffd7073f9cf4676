"""Small scenes made by hand: a few spheres, two materials (grain 0, wall 1), planes.

Running small scenes and sampling them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_erosion.core.setup import (
    SHAPE_NUMBERS,
    ContactTable,
    GrainTable,
    Laws,
    Numerics,
    PrimitiveKind,
    PrimitiveTable,
    Setup,
    Surface,
)
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.run.ensemble_loop import EnsembleRun, run_ensemble
from taichi_erosion.run.stages import ReplicaState
from taichi_erosion.scene import Scene, build_setup
from taichi_erosion.scene import laws as laws_of
from taichi_erosion.simulation import Simulation, advance, assemble, failure, snapshot
from taichi_erosion.verification.claim import Precision
from taichi_erosion.verification.reference.contact import (
    HeadOn,
    Solid,
    series,
    shear_effective,
    sphere_mass,
    young_effective,
)

Floats = NDArray[np.float64]

GRAIN, WALL = 0, 1
NO_GRAVITY = (0.0, 0.0, 0.0)
FLOOR = (0.0, 0.0, 0.0, 0.0, 0.0, 1.0)  # plane through the origin, free side up
OVERLAP_LIMIT = 0.5  # of the radius; the references have no limit, soft test grains dip far [1]


@dataclass(frozen=True)
class Touch:
    """Contact parameters of one pair of materials, as in ContactTable."""

    young: float  # E*, Pa
    shear: float  # G*, Pa
    restitution: float = 1.0
    friction: float = 0.0
    friction_rolling: float = 0.0
    rolling_damping: float = 0.0
    surface_energy: float = 0.0  # J m-2
    effects: float = 1.0


def touch_of(first: Solid, second: Solid | None, restitution: float = 1.0, friction: float = 0.0) -> Touch:
    """Contact of two solids; without a second the partner is rigid."""
    return Touch(young_effective(first, second), shear_effective(first, second), restitution, friction)


def contact_table(grain_grain: Touch, grain_wall: Touch) -> ContactTable:
    """Rows grain-grain, grain-wall, wall-wall; walls never meet, their row repeats the second."""
    rows = (grain_grain, grain_wall, grain_wall)

    def column(name: str) -> Floats:
        return np.array([getattr(row, name) for row in rows], dtype=float)

    return ContactTable(
        young_effective=column("young"),
        shear_effective=column("shear"),
        restitution=column("restitution"),
        friction_sliding=column("friction"),
        friction_rolling=column("friction_rolling"),
        rolling_damping=column("rolling_damping"),
        surface_energy=column("surface_energy"),
        effects=column("effects"),
    )


def spheres(
    position: ArrayLike, velocity: ArrayLike, spin: ArrayLike, radius: ArrayLike, mass: ArrayLike
) -> GrainTable:
    """Grains present from the start; vectors [n, 3], radius and mass one number or [n]."""
    place = np.atleast_2d(np.asarray(position, dtype=float))
    count = len(place)
    return GrainTable(
        position=place,
        velocity=np.array(np.broadcast_to(np.asarray(velocity, dtype=float), (count, 3))),
        spin=np.array(np.broadcast_to(np.asarray(spin, dtype=float), (count, 3))),
        radius=np.array(np.broadcast_to(np.asarray(radius, dtype=float), count)),
        mass=np.array(np.broadcast_to(np.asarray(mass, dtype=float), count)),
        material=np.zeros(count, dtype=np.int32),
        release_time=np.zeros(count),
    )


def primitive_table(kind: PrimitiveKind, shapes: ArrayLike, surface: ArrayLike = 0) -> PrimitiveTable:
    """Primitives of one kind, their numbers as PrimitiveKind says, without padding."""
    numbers = np.atleast_2d(np.asarray(shapes, dtype=float))
    padded = np.zeros((len(numbers), SHAPE_NUMBERS))
    if numbers.size:
        padded[:, : numbers.shape[1]] = numbers
    return PrimitiveTable(
        kind=np.full(len(numbers), int(kind), dtype=np.int32),
        surface=np.array(np.broadcast_to(np.asarray(surface, dtype=np.int32), len(numbers))),
        shape=padded,
    )


def planes(*shapes: Sequence[float]) -> PrimitiveTable:
    """Each (point, unit normal into the free side) is a surface of its own."""
    numbers = np.array(shapes, dtype=float).reshape(-1, 6)
    return primitive_table(PrimitiveKind.PLANE, numbers, np.arange(len(numbers)))


def joined(*tables: PrimitiveTable) -> PrimitiveTable:
    """Tables one after the other, the surfaces of each counted on from the last."""
    surfaces, first = [], 0
    for table in tables:
        surfaces.append(table.surface + first)
        first += int(table.surface.max()) + 1
    return PrimitiveTable(
        kind=np.concatenate([table.kind for table in tables]),
        surface=np.concatenate(surfaces).astype(np.int32),
        shape=np.concatenate([table.shape for table in tables]),
    )


def sphere_setup(
    grains: GrainTable,
    contacts: ContactTable,
    time_step: float,
    walls: PrimitiveTable | None = None,
    gravity: tuple[float, float, float] = NO_GRAVITY,
) -> Setup:
    """One replica; surfaces are named wall0, wall1, ... in the order of the table."""
    table = planes() if walls is None else walls
    count = int(table.surface.max()) + 1 if len(table.surface) else 0
    return Setup(
        grains=grains,
        materials=("grain", "wall"),
        contacts=contacts,
        primitives=table,
        surfaces=tuple(Surface(f"wall{k}", WALL) for k in range(count)),
        time_step=time_step,
        gravity=gravity,
        overlap_limit=OVERLAP_LIMIT,
    )


def on_plane(touch: Touch, grain: GrainTable, time_step: float, **changes: object) -> Setup:
    """Grains above the floor z = 0."""
    setup = sphere_setup(grain, contact_table(touch, touch), time_step, planes(FLOOR))
    return replace(setup, **changes)  # pyright: ignore[reportArgumentType]


def wall_impact(touch: Touch, radius: float, density: float, speed: float) -> HeadOn:
    """A sphere that meets a rigid plane head-on."""
    return HeadOn(touch.young, radius, sphere_mass(radius, density), speed)


def pair_impact(touch: Touch, radii: tuple[float, float], density: float, speed: float) -> HeadOn:
    """Two spheres that meet head-on with relative speed `speed`."""
    masses = [sphere_mass(radius, density) for radius in radii]
    return HeadOn(touch.young, series(*radii), series(masses[0], masses[1]), speed)


def resting_overlap(touch: Touch, radius: float, weight: float) -> float:
    """Overlap at which the Hertz spring carries `weight` [m]."""
    return (weight / (4.0 / 3.0 * touch.young * np.sqrt(radius))) ** (2.0 / 3.0)


HERTZ = Laws()  # Hertz, Mindlin, no rolling resistance


class Stopped(Exception):
    """A replica that should have run to its end did not."""


@dataclass(frozen=True)
class Trace:
    """Samples of an ensemble; replicas with fewer grains than others are filled up with NaN."""

    time: Floats  # [samples, replicas] s
    position: Floats  # [samples, replicas, grains, 3] m
    velocity: Floats  # [samples, replicas, grains, 3] m s-1
    spin: Floats  # [samples, replicas, grains, 3] rad s-1


def bench(setups: Sequence[Setup], precision: Precision, laws: Laws = HERTZ, threads: int = 0) -> Simulation:
    """The scenes on the CPU."""
    return assemble(setups, laws, Numerics(threads=threads, precision=precision))


def played_out(scenes: Sequence[Scene], seed: int) -> EnsembleRun:
    """Scenes of one law, each a replica of the seed, played to their ends on the CPU in single precision."""
    sim = assemble([build_setup(scene, seed) for scene in scenes], laws_of(scenes[0]), Numerics())
    whole = EnsembleRun(list(scenes), sim, [ReplicaState(seed) for _ in scenes])
    run_ensemble(whole, [])
    return whole


def states(sim: Simulation, replicas: int) -> list[Snapshot]:
    """Snapshots of all replicas; raises Stopped where one has failed."""
    for replica in range(replicas):
        if fault := failure(sim, replica):
            raise Stopped(f"replica {replica} stopped: {fault}")
    return [snapshot(sim, replica) for replica in range(replicas)]


def final_states(
    setups: Sequence[Setup], durations: ArrayLike, precision: Precision, laws: Laws = HERTZ
) -> list[Snapshot]:
    """Snapshots after `durations` [s], one number or one per replica."""
    sim = bench(setups, precision, laws)
    ends = np.broadcast_to(np.asarray(durations, dtype=float), len(setups))
    advance(sim, [float(end) for end in ends])
    return states(sim, len(setups))


def sample(sim: Simulation, times: Floats) -> Trace:
    """Samples at `times` [samples, replicas] in s."""
    rows = []
    for row in times:
        advance(sim, [float(time) for time in row])
        rows.append(states(sim, times.shape[1]))
    return Trace(
        time=np.array([[state.time for state in row] for row in rows]),
        position=stacked(rows, "position"),
        velocity=stacked(rows, "velocity"),
        spin=stacked(rows, "spin"),
    )


def stacked(rows: list[list[Snapshot]], name: str) -> Floats:
    """One vector of the state [samples, replicas, most grains, 3]."""
    most = max(len(state.radius) for state in rows[0])
    whole = np.full((len(rows), len(rows[0]), most, 3), np.nan)
    for moment, row in zip(whole, rows, strict=True):
        for place, state in zip(moment, row, strict=True):
            place[: len(state.radius)] = getattr(state, name)
    return whole


def every_step(setups: Sequence[Setup], steps: int) -> Floats:
    """Times of the first steps [steps, replicas] in s."""
    counts = np.arange(1.0, steps + 1.0)
    return counts[:, None] * np.array([setup.time_step for setup in setups])[None, :]


def crossing(time: Floats, value: Floats, level: float = 0.0) -> float:
    """First time at which a sampled value falls through `level`, interpolated; NaN if it never does."""
    falls = np.flatnonzero((value[:-1] > level) & (value[1:] <= level))
    if falls.size == 0:
        return float("nan")
    k = int(falls[0])
    share = (value[k] - level) / (value[k] - value[k + 1])
    return float(time[k] + share * (time[k + 1] - time[k]))


def acceleration(trace: Trace) -> Floats:
    """Central second difference of the positions [samples - 2, replicas, grains, 3] in m s-2.

    With samples one step apart a leapfrog step makes this exactly force over mass at the middle sample.
    """
    step = np.diff(trace.time, axis=0)[:-1, :, None, None]
    second = trace.position[2:] - 2.0 * trace.position[1:-1] + trace.position[:-2]
    return second / step**2
