"""The pressure of one replica, found by one worker as `conjugate.py` and `multigrid.py` find that of all."""

from taichi_erosion.air.conjugate import (
    ITERATIONS_MOST,
    image_of_column,
    move_column,
    product_of_column,
    product_of_replica,
    step_of_replica,
    turn_column,
    worse_of,
)
from taichi_erosion.air.interpolate import prolong_to_line, restrict_to_line
from taichi_erosion.air.multigrid import (
    clear_line,
    coarsest_sweeps,
    factor_line,
    relax_colour,
    rest_of_line,
    sweep_to_and_fro,
)
from taichi_erosion.air.pressure import conduct_column, merge_column
from taichi_erosion.air.walk import each_column, each_line
from taichi_erosion.core.ti import ti

real = ti.f64

TOLERANCE = 1e-7  # air that may appear in a cell in one step over its volume [1]


@ti.func
def relax_lines(grids_out: ti.template(), level, colour, r):
    """Relax the lines of one colour."""
    for i in range(grids_out.shape[level, 1]):
        for j in range(grids_out.shape[level, 2]):
            relax_colour(grids_out, level, colour, r, i, j)


@ti.func
def go_down(grids_out: ti.template(), level, r):
    """Relax one grid from 0, and hand its rest to the next."""
    each_line(clear_line, grids_out, level, r)
    relax_lines(grids_out, level, 0, r)
    relax_lines(grids_out, level, 1, r)
    each_line(rest_of_line, grids_out, level, r)
    each_line(restrict_to_line, grids_out, level, r)


@ti.func
def go_up(grids_out: ti.template(), level, r):
    """Take up what the next grid has found, and relax."""
    each_line(prolong_to_line, grids_out, level, r)
    relax_lines(grids_out, level, 1, r)
    relax_lines(grids_out, level, 0, r)


@ti.func
def cycle_replica(grids_out: ti.template(), r):
    """One multigrid cycle, down to the coarsest grid and up again."""
    last = ti.static(grids_out.number - 1)
    for level in range(last):
        go_down(grids_out, level, r)
    each_line(clear_line, grids_out, last, r)
    sweep_to_and_fro(grids_out, last, ti.static(coarsest_sweeps(grids_out)), r)
    for level in range(last):
        go_up(grids_out, last - 1 - level, r)


@ti.func
def worst_of(air: ti.template(), r):
    """Air that appears in the worst cell in one step over its volume [1], or NaN."""
    worst = real(0.0)
    for c in range(ti.static(air.cells[0] * air.cells[1])):
        worst = worse_of(worst, air.krylov.worst[r, c])
    return worst


@ti.func
def solve_replica(air_out: ti.template(), r):
    """Find psi by conjugate gradients; returns what is left in the worst cell [1]."""
    air_out.krylov.product[r] = 0.0
    worst, done = worst_of(air_out, r), 0
    while worst > TOLERANCE and done < ITERATIONS_MOST:
        cycle_replica(air_out.grids, r)
        each_column(product_of_column, air_out, r)
        product_of_replica(air_out, r)
        each_column(turn_column, air_out, r)
        each_column(image_of_column, air_out, r)
        step_of_replica(air_out, r)
        each_column(move_column, air_out, r)
        worst = worst_of(air_out, r)
        done += 1
    return worst


@ti.func
def set_conductances_of(air_out: ti.template(), r, share):
    """Conductances of all grids for a stage."""
    for i in range(air_out.cells[0]):
        for j in range(air_out.cells[1]):
            conduct_column(air_out, r, i, j, share)
    for level in range(1, air_out.grids.number):
        each_line(merge_column, air_out.grids, level, r)
    for level in range(air_out.grids.number):
        each_line(factor_line, air_out.grids, level, r)
