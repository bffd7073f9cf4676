"""What the grain decomposition cannot run yet, told at assembly."""

from collections.abc import Sequence

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Setup
from taichi_erosion.simulation.capacities import Capacities

PLACES_MOST = 2**31 - 1  # of a field: places are counted in 32 bits
REMEDY = "use --arch cpu, or --decomposition partitions"


def refuse_unsupported(setups: Sequence[Setup]) -> None:
    """Raise BadInput for parts of a scene whose kernels exist for partitions only."""
    for missing, present in (
        ("air: its exchange with the grains is summed by partitions", any(s.air is not None for s in setups)),
        ("clumps: their bodies are moved by partitions", any(s.clumps is not None for s in setups)),
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
