"""The step of `step.py` for small grids: every replica's grid by one worker, in a dozen launches.

A small grid costs little arithmetic and, kernel by kernel, hundreds of launches a step. One worker that walks
from column to column needs few, and no replica waits for another: each solves for its own pressure until it
is found, so that its bits do not depend on company. It serves boxes that are periodic along x and y. Only
replicas that are `moving` take part.
"""

from taichi_erosion.air.books import book_stage, open_book, remember_void_of
from taichi_erosion.air.conjugate import worse_of
from taichi_erosion.air.eddies import spread_over_column
from taichi_erosion.air.momentum import rates_of_column
from taichi_erosion.air.pressure import correct_column, excess_of_column, spread_mean_excess
from taichi_erosion.air.state import Air
from taichi_erosion.air.step import STAGES
from taichi_erosion.air.sweep import predict_column
from taichi_erosion.air.walk import close_flow, close_values, each_column
from taichi_erosion.air.walk_pressure import set_conductances_of, solve_replica
from taichi_erosion.core.ti import ti

real = ti.f64


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
