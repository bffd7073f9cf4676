"""What the grain decomposition cannot run yet, told at assembly."""

from collections.abc import Sequence

from taichi_erosion.core.air_setup import AirSetup
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Setup
from taichi_erosion.simulation.capacities import Capacities

PLACES_MOST = 2**31 - 1  # of a field: places are counted in 32 bits
REMEDY = "use --arch cpu, or --decomposition partitions"


def is_grid(air: AirSetup | None) -> bool:
    """Whether there is air in more than one column of cells."""
    return air is not None and air.cells[:2] != (1, 1)


def refuse_unsupported(setups: Sequence[Setup]) -> None:
    """Raise BadInput for parts of setups whose kernels exist for partitions only."""
    refuse_parts(any(is_grid(s.air) for s in setups), any(s.clumps is not None for s in setups))


def refuse_parts(has_grids: bool, has_clumps: bool) -> None:
    """Raise BadInput for grids of air and for clumps."""
    for missing, present in (
        ("grids of air: the exchange with them is driven by partitions", has_grids),
        ("clumps: their bodies are moved by partitions", has_clumps),
    ):
        if present:
            raise BadInput(f"one thread per grain has no {missing}; {REMEDY}")


def refuse_too_large(capacities: Capacities) -> None:
    """Raise BadInput where the list entries of all replicas are more than 32 bits count."""
    places = 2 * capacities.replicas * max(capacities.pairs, capacities.cells)
    if places > PLACES_MOST:
        raise BadInput(
            f"{capacities.replicas} replicas of {capacities.grains} grains need {places} list entries; "
            f"at most {PLACES_MOST} can be counted: run fewer replicas at once"
        )
