"""Capacities of the fields of a run, and the division of its grains into cells and partitions.

Everything here that can affect a result (partitions, margins, cells) depends on one replica alone, so that a
replica gives the same bits whatever runs beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import prod

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Setup

PLACES_MOST = 2**31 - 1  # of a field: places are counted in 32 bits
GRIDS = "one thread per grain has no grids of air: one thread solves the pressure of a whole grid"
REMEDY = "use --arch cpu, or --decomposition partitions"
PARTITION_GRAINS = 4000  # grains per partition above which a barrier costs little
PAIR_GRAINS = 1000  # the same for two workers
PARTITIONS_MOST = 16
ENTRIES_PER_GRAIN = 8  # half-list entries of a dense bed with its skin
ENTRIES_MOST = 16  # of one grain among grains of similar size, where all have the same number of places
ENTRIES_LEAST = 256  # for partitions of few grains
WALL_ENTRIES_PER_GRAIN = 2
CELLS_PER_GRAIN = 8
CELLS_LEAST = 4096
SMALL_GRAINS = 128  # replicas of so few grains all have the same capacities, and so the same compiled kernels
SMALL_REPLICAS = 64
SMALL_WALLS = 4  # primitives and surfaces
SMALL_AIR = 2048  # cells of air
SKIN_MOST = 0.4  # largest skin over the largest radius [1]
SKIN_STEPS = 60  # time steps that a fast grain should last on one list
SKIN_FLIGHT = 10.0  # largest skin under wind over the median radius [1]
FLIGHT_STEPS = 100  # time steps that a fast grain should last on one list under wind
SKIN_IN_CELLS = 0.3  # skin over the radius that fits into cells under wind [1]
LARGE_MOST = 50  # largest grains that search beyond adjacent cells


@dataclass(frozen=True)
class Capacities:
    """Capacities of one run; growing them changes no result."""

    replicas: int  # some may stay empty
    partitions: int
    grains: int
    pairs: int  # entries a replica and side
    wall_pairs: int
    cells: int
    primitives: int
    surfaces: int
    materials: int
    bodies: int
    motion_rows: int = 0  # of the tables that surfaces may follow
    servos: int = 0  # partitions whose forces on walls are summed for servos; 0: none


def partitions_of_replica(setup: Setup) -> int:
    count = len(setup.grains.radius)
    partitions = max(count // PARTITION_GRAINS, min(count // PAIR_GRAINS, 2), 1)
    return min(partitions, PARTITIONS_MOST)


def cells_for_grains(grains: int) -> int:
    return max(round_up(grains * CELLS_PER_GRAIN), CELLS_LEAST)


def round_up(number: int) -> int:
    """Next of 2^k and 1.5 * 2^k: few different sizes, so that compiled kernels are found in the cache."""
    power = 1 << max(number - 1, 1).bit_length()
    return power * 3 // 4 if power * 3 // 4 >= number else power


def initial_capacities(setups: list[Setup], by_grain: bool = False) -> Capacities:
    """Capacities for a dense start; with one thread per grain there is one partition, and no idle replica."""
    grains = round_up(max(len(s.grains.radius) for s in setups))
    bodies = max(0 if s.clumps is None else len(s.clumps.mass) for s in setups)
    primitives = max(len(s.primitives.kind) for s in setups)
    surfaces = max(len(s.surfaces) for s in setups)
    replicas = len(setups)
    air = setups[0].air
    if grains <= SMALL_GRAINS and (air is None or prod(air.cells) <= SMALL_AIR):
        grains, replicas = SMALL_GRAINS, replicas if by_grain else max(round_up(replicas), SMALL_REPLICAS)
        primitives, surfaces = (max(round_up(walls), SMALL_WALLS) for walls in (primitives, surfaces))
    return Capacities(
        replicas=replicas,
        partitions=1 if by_grain else max(partitions_of_replica(s) for s in setups),
        grains=grains,
        pairs=grains * ENTRIES_MOST if by_grain else max(grains * ENTRIES_PER_GRAIN, ENTRIES_LEAST),
        wall_pairs=max(grains * WALL_ENTRIES_PER_GRAIN, ENTRIES_LEAST),
        cells=cells_for_grains(grains),
        primitives=primitives,
        surfaces=surfaces,
        materials=max(len(s.materials) for s in setups),
        bodies=max(bodies, 1),
        motion_rows=max(sum(map(len, s.tables)) for s in setups),
        servos=max(partitions_of_replica(s) for s in setups) if has_servo(setups) else 0,
    )


def pad_setups_with_copies(setups: list[Setup], capacities: Capacities) -> list[Setup]:
    """Setups, padded with copies of the first, which never run, up to the number of replicas."""
    return setups + setups[:1] * (capacities.replicas - len(setups))


def double_list_capacities(capacities: Capacities) -> Capacities:
    return replace(capacities, pairs=2 * capacities.pairs, wall_pairs=2 * capacities.wall_pairs)


@dataclass(frozen=True)
class VerletSkin:
    """How far grains may move before their lists are rebuilt."""

    least: float  # over the radius [1]
    most: float  # m
    extent_most: float  # m, of any grain: radius and skin
    time: float  # s, that a moving grain should stay within it
    cell_reach: float  # m, radius and skin up to which adjacent cells hold all partners


def verlet_skin_limits(setup: Setup, by_grain: bool = False) -> VerletSkin:
    """Skin of one replica.

    Under wind few grains move, and those far: their skin extends beyond adjacent cells and they are searched
    in a larger box, as are the few largest grains, so that cells may be as narrow as most grains need. With
    one thread per grain no grain may take so much longer than the others.
    """
    radius = np.sort(setup.grains.radius)
    if setup.air is None or by_grain:
        most = SKIN_MOST * float(radius[-1])
        extent = float(radius[-1]) + most
        return VerletSkin(setup.skin, most, extent, SKIN_STEPS * setup.time_step, extent)
    large = float(radius[-1 - min(LARGE_MOST, len(radius) - 1)])
    most = SKIN_FLIGHT * float(np.median(radius))
    extent, reach = float(radius[-1]) + most, (1.0 + SKIN_IN_CELLS) * large
    return VerletSkin(setup.skin, most, extent, FLIGHT_STEPS * setup.time_step, reach)


def has_grid(setups: Sequence[Setup]) -> bool:
    """Whether any replica has air in more than one column of cells."""
    return any(setup.air is not None and setup.air.cells[:2] != (1, 1) for setup in setups)


def has_servo(setups: Sequence[Setup]) -> bool:
    """Whether a wall of any replica may have a servo."""
    return any(setup.has_servos for setup in setups)


def refuse_thread_per_grain(grids: bool, servos: bool = False) -> None:
    """Raise BadInput for what has kernels for partitions only: grids of air, and walls that servos move."""
    if grids:
        raise BadInput(f"{GRIDS}; {REMEDY}")
    if servos:
        raise BadInput(f"one thread per grain has no walls under a constant force or torque; {REMEDY}")


def refuse_too_many_entries(capacities: Capacities) -> None:
    """Raise BadInput where the list entries of all replicas are more than 32 bits count."""
    places = 2 * capacities.replicas * max(capacities.pairs, capacities.cells)
    if places > PLACES_MOST:
        raise BadInput(
            f"{capacities.replicas} replicas of {capacities.grains} grains need {places} list entries; "
            f"at most {PLACES_MOST} can be counted: run fewer replicas at once"
        )
