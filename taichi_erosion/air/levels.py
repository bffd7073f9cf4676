"""Fields of the grids on which the pressure is solved, finest first."""

from dataclasses import dataclass
from typing import Any

from taichi_erosion.core.air_setup import AirSetup
from taichi_erosion.core.ti import ti


@dataclass(frozen=True, eq=False)
class Level:
    """One grid of the pressure solve; conductances are a face's area times coefficient over distance."""

    cells: tuple[int, int, int]
    halved: tuple[int, int]  # by how much the next coarser grid has fewer cells along x and y [1]


def allocate_levels(setup: AirSetup, replicas: int) -> tuple[Level, ...]:
    return ()
