"""What the grain decomposition cannot run, told before anything is allocated."""

from collections.abc import Sequence

from taichi_erosion.core.air_setup import AirSetup
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Setup
from taichi_erosion.simulation.capacities import Capacities, initial_capacities

PLACES_MOST = 2**31 - 1  # of a field: places are counted in 32 bits
GRIDS = "one thread per grain has no grids of air: one thread solves the pressure of a whole grid"
REMEDY = "use --arch cpu, or --decomposition partitions"


def is_grid(air: AirSetup | None) -> bool:
    """Whether there is air in more than one column of cells."""
    return air is not None and air.cells[:2] != (1, 1)


def has_grids(setups: Sequence[Setup]) -> bool:
    """Whether any replica has a grid of air."""
    return any(is_grid(setup.air) for setup in setups)


def refuse_unsupported(setups: Sequence[Setup]) -> None:
    """Raise BadInput where one thread per grain cannot run an ensemble."""
    refuse_grids(has_grids(setups))
    refuse_too_large(initial_capacities(list(setups), by_grain=True))


def refuse_grids(present: bool) -> None:
    """Raise BadInput for grids of air, whose kernels exist for partitions only."""
    if present:
        raise BadInput(f"{GRIDS}; {REMEDY}")


def refuse_too_large(capacities: Capacities) -> None:
    """Raise BadInput where the list entries of all replicas are more than 32 bits count."""
    places = 2 * capacities.replicas * max(capacities.pairs, capacities.cells)
    if places > PLACES_MOST:
        raise BadInput(
            f"{capacities.replicas} replicas of {capacities.grains} grains need {places} list entries; "
            f"at most {PLACES_MOST} can be counted: run fewer replicas at once"
        )
