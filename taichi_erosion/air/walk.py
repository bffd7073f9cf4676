"""One worker that walks over the grid of one replica, from column to column of cells."""

from taichi_erosion.air.ghosts import (
    close_cells_x,
    close_cells_y,
    close_cells_z,
    close_x,
    close_y,
    close_z,
)
from taichi_erosion.core.ti import ti


@ti.func
def each_column(task: ti.template(), air_out: ti.template(), r):
    """Do one task in every column of cells."""
    for i in range(air_out.cells[0]):
        for j in range(air_out.cells[1]):
            task(air_out, r, i, j)


@ti.func
def each_line(task: ti.template(), grids_out: ti.template(), level, r):
    """Do one task in every line of one grid of the pressure."""
    for i in range(grids_out.shape[level, 1]):
        for j in range(grids_out.shape[level, 2]):
            task(grids_out, level, r, i, j)


@ti.func
def close_flow(air_out: ti.template(), r):
    """Ghosts of all velocities; x first, so that y and z find the corners filled."""
    nx, ny, nz = ti.static(air_out.cells[0], air_out.cells[1], air_out.cells[2])
    for j in range(ny):
        for k in range(nz):
            close_x(air_out, r, j, k)
    for i in range(-1, nx + 1):
        for k in range(nz):
            close_y(air_out, r, i, k)
    for i in range(-1, nx + 1):
        for j in range(-1, ny + 1):
            close_z(air_out, r, i, j)


@ti.func
def close_values(air: ti.template(), values_out: ti.template(), r):
    """Ghosts of a cell quantity."""
    nx, ny, nz = ti.static(air.cells[0], air.cells[1], air.cells[2])
    for j in range(ny):
        for k in range(nz):
            close_cells_x(air, values_out, 1, r, j, k)
    for i in range(-1, nx + 1):
        for k in range(nz):
            close_cells_y(air, values_out, 1, r, i, k)
    for i in range(-1, nx + 1):
        for j in range(-1, ny + 1):
            close_cells_z(air, values_out, 1, r, i, j)
