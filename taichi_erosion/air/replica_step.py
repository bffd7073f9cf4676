"""One worker that walks over the grid of one replica, from column to column of cells.

The pressure of one replica, found by one worker as `conjugate.py` and `multigrid.py` find that of all.

The step of `step.py` for small grids: every replica's grid by one worker, in a dozen launches.

A small grid costs little arithmetic and, kernel by kernel, hundreds of launches a step. One worker that walks
from column to column needs few, and no replica waits for another: each solves for its own pressure until it
is found, so that its bits do not depend on company. It serves boxes that are periodic along x and y. Only
replicas that are `moving` take part.
"""

from taichi_erosion.air.boundary import close_cells_x, close_cells_y, close_cells_z, close_x, close_y, close_z
from taichi_erosion.air.exchange_budget import book_stage, open_book, remember_void_of
from taichi_erosion.air.grid import Air
from taichi_erosion.air.implicit_z import predict_column
from taichi_erosion.air.momentum import rates_of_column
from taichi_erosion.air.pressure.conjugate_gradient import (
    ITERATIONS_MOST,
    image_of_column,
    move_column,
    product_of_column,
    product_of_replica,
    step_of_replica,
    turn_column,
    worse_of,
)
from taichi_erosion.air.pressure.multigrid import (
    clear_line,
    coarsest_sweeps,
    factor_line,
    prolong_to_line,
    relax_colour,
    rest_of_line,
    restrict_to_line,
    sweep_to_and_fro,
)
from taichi_erosion.air.pressure.projection import (
    conduct_column,
    correct_column,
    excess_of_column,
    merge_column,
    spread_mean_excess,
)
from taichi_erosion.air.step import STAGES
from taichi_erosion.air.turbulence import spread_over_column
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


@ti.func
def stage_weights(air: ti.template(), number):
    """Share of the step, and weights of the explicit rates now and before, of one stage [1]."""
    weights = ti.Vector([real(0.0), real(0.0), real(0.0)])
    for n in ti.static(range(len(STAGES[air.model.scheme]))):
        (stage,) = ti.static((STAGES[air.model.scheme][n],))
        if n == number:
            weights = ti.Vector([real(stage.share), real(stage.now), real(stage.before)])
    return weights


@ti.func
def open_step(air_out: ti.template(), r):
    """Fill all ghosts from what the grid holds now, and open the books."""
    close_values(air_out, air_out.void_fraction, r)
    close_values(air_out, air_out.exchange_coefficient, r)
    close_values(air_out, air_out.exchange_force, r)
    close_values(air_out, air_out.pressure, r)
    close_flow(air_out, r)
    each_column(open_book, air_out, r)
    air_out.left[r] = 0.0


@ti.func
def predict_stage(air_out: ti.template(), r, stage):
    """Velocities at the end of a stage, before the pressure has corrected them; the first opens the step."""
    if stage == 0:
        open_step(air_out, r)
    if ti.static(air_out.model.closure != "none"):
        each_column(spread_over_column, air_out, r)
        close_values(air_out, air_out.eddy_cell, r)
        close_values(air_out, air_out.eddy_face, r)
    each_column(rates_of_column, air_out, r)
    weights = stage_weights(air_out, stage)
    for axis in ti.static(range(3)):
        for i in range(air_out.cells[0]):
            for j in range(air_out.cells[1]):
                predict_column(air_out, r, i, j, axis, weights)
    close_flow(air_out, r)


@ti.func
def find_pressure(air_out: ti.template(), r, stage):
    """Pressure that the predicted velocities need; notes the worst that it leaves."""
    set_conductances_of(air_out, r, stage_weights(air_out, stage)[0])
    each_column(excess_of_column, air_out, r)
    spread_mean_excess(air_out, r)
    worst = solve_replica(air_out, r)
    air_out.left[r] = worse_of(air_out.left[r], worst)


@ti.func
def close_step(air_out: ti.template(), r):
    """End the step."""
    each_column(remember_void_of, air_out, r)
    air_out.numbers.time[r] = air_out.numbers.time[r] + air_out.numbers.time_step[r]


@ti.func
def correct_stage(air_out: ti.template(), r, stage):
    """Correct the velocities by the pressure, and book the stage; the last closes the step."""
    share = stage_weights(air_out, stage)[0]
    for i in range(air_out.cells[0]):
        for j in range(air_out.cells[1]):
            correct_column(air_out, r, i, j, share)
    close_flow(air_out, r)
    close_values(air_out, air_out.pressure, r)
    book_stage(air_out, r, share)
    if stage == ti.static(len(STAGES[air_out.model.scheme]) - 1):
        close_step(air_out, r)


@ti.kernel
def each_moving(
    # parameters
    task: ti.template(),
    count: ti.i32,
    chunk: ti.i32,
    stage: ti.i32,
    # out
    air_out: ti.template(),
):
    """Do one task of a stage for every moving replica."""
    for lane in range(count * chunk):
        if lane % chunk == 0 and air_out.moving[lane // chunk] == 1:
            task(air_out, lane // chunk, stage)


def advance_moving(air: Air, count: int, chunk: int) -> None:
    """Advance the grids of those of the first `count` replicas that are moving by their own time steps.

    `chunk` iterations of a parallel loop go to one worker. What no pressure corrected is noted in `air.left`.
    """
    for stage in range(len(STAGES[air.model.scheme])):
        for task in (predict_stage, find_pressure, correct_stage):
            each_moving(task, count, chunk, stage, air)
