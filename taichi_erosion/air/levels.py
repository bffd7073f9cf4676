"""Fields of the grids on which the pressure is solved, all grids in one set of fields.

The pressure equation is  sum over faces of c (psi_neighbour - psi) - drain psi = right,  with conductances c
[m], area over distance times the share of the face that is air, and a drain [m] beside outlets. Coarser grids
have half as many cells along x, y or both and all layers along z, where lines are solved exactly. The columns
of cells of all grids are numbered on, finest grid first, so that one kernel serves every grid.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_erosion.core.air_setup import AirSetup
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import write

real = ti.f64

EVEN = 1.5  # cells along the other axis may be so much wider and still be merged with these [1]


@dataclass(frozen=True, eq=False)
class Grids:
    """Conductances, right-hand sides and solutions by replica, column and layer; `across_*` of low faces."""

    number: int  # of grids
    columns: tuple[int, ...]  # cells along the longer of x and y of every grid
    round_x: bool  # whether x is periodic
    round_y: bool  # whether y is periodic
    shape: Any  # i32 by grid: first column, cells along x and y, cells that merge in the next along x and y
    across_x: Any  # [m]
    across_y: Any  # [m]
    across_z: Any  # [m], one layer more than the cells
    drain: Any  # [m]
    pivot: Any  # inverse pivots of the lines along z [m-1]
    right: Any  # [m3 s-1]
    solution: Any  # [m2 s-1]
    rest: Any  # what the solution leaves of the right-hand side [m3 s-1]


@dataclass(frozen=True, eq=False)
class Krylov:
    """Fields of the conjugate gradients on the finest grid, by replica, column and layer."""

    found: Any  # psi [m2 s-1]
    search: Any  # direction
    image: Any  # of the direction
    partial: Any  # sums over single columns, by replica and column
    worst: Any  # air that appears in a cell in one step over its volume [1], largest by replica and column
    product: Any  # rest times preconditioned rest, by replica
    step: Any  # length of the last step, by replica
    ratio: Any  # new product over old one, by replica


@ti.func
def column_of(grids: ti.template(), level, i, j):
    """Number of a column of a grid; beyond an end that of the opposite one, where conductances are zero."""
    nx, ny = grids.shape[level, 1], grids.shape[level, 2]
    return grids.shape[level, 0] + ((i + nx) % nx) * ny + (j + ny) % ny


@ti.func
def around(grids: ti.template(), level, i, j):
    """Columns to the west, east, south and north."""
    west, east = column_of(grids, level, i - 1, j), column_of(grids, level, i + 1, j)
    return ti.Vector([west, east, column_of(grids, level, i, j - 1), column_of(grids, level, i, j + 1)])


def grid_shapes(setup: AirSetup) -> list[tuple[int, int, int, int]]:
    """Cells along x and y of every grid, and how many merge along x and y in the next; the last: 1, 1."""
    nx, ny, _ = setup.cells
    width_x, width_y = ((setup.high[axis] - setup.low[axis]) / setup.cells[axis] for axis in range(2))
    round_x, round_y = (setup.sides[name].kind == "periodic" for name in ("x_low", "y_low"))
    shapes = []
    while True:
        by_x, by_y = merging(nx, ny, width_x, width_y)
        if (round_x and nx > 1 and nx % 2) or (round_y and ny > 1 and ny % 2):
            by_x, by_y = 1, 1  # two colours do not go round an odd number of columns
        shapes.append((nx, ny, by_x, by_y))
        if by_x == by_y == 1:
            return shapes
        nx, ny, width_x, width_y = nx // by_x, ny // by_y, width_x * by_x, width_y * by_y


def merging(nx: int, ny: int, width_x: float, width_y: float) -> tuple[int, int]:
    """Cells that merge along x and y: two where their number is even and they are not already the wider."""
    can_x, can_y = nx % 2 == 0, ny % 2 == 0
    by_x = can_x and (width_x <= EVEN * width_y or ny == 1)
    by_y = can_y and (width_y <= EVEN * width_x or nx == 1)
    if not (by_x or by_y):
        by_x, by_y = can_x, can_y
    return (2 if by_x else 1), (2 if by_y else 1)


def allocate_grids(setup: AirSetup, replicas: int) -> Grids:
    """Fields of all grids, and where each begins."""
    shapes = np.array(grid_shapes(setup))
    sizes = shapes[:, 0] * shapes[:, 1]
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    layers = setup.cells[2]
    names = ("across_x", "across_y", "drain", "pivot", "right", "solution", "rest")
    grids = Grids(
        number=len(shapes),
        columns=tuple(int(n) for n in shapes[:, :2].max(axis=1)),
        round_x=setup.sides["x_low"].kind == "periodic",
        round_y=setup.sides["y_low"].kind == "periodic",
        shape=ti.field(ti.i32, shape=(len(shapes), 5)),
        across_z=ti.field(real, shape=(replicas, int(sizes.sum()), layers + 1)),
        **{name: ti.field(real, shape=(replicas, int(sizes.sum()), layers)) for name in names},
    )
    write(grids.shape, np.column_stack([first, shapes]))
    return grids


def allocate_krylov(setup: AirSetup, replicas: int) -> Krylov:
    """Fields of the conjugate gradients."""
    columns = setup.cells[0] * setup.cells[1]
    cells = (replicas, columns, setup.cells[2])
    blocks = {name: ti.field(real, shape=cells) for name in ("found", "search", "image")}
    sums = {name: ti.field(real, shape=(replicas, columns)) for name in ("partial", "worst")}
    scalars = {name: ti.field(real, shape=replicas) for name in ("product", "step", "ratio")}
    return Krylov(**blocks, **sums, **scalars)
