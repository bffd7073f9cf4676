"""One time step of the air on a whole grid: a table of contents, in two launch styles of the same formulas.

runge_kutta: three stages, explicit terms to third order, diffusion along z and pressure to second
             (implicitness 1/2); stable up to u dt / dx = 1.7
euler:       one stage; for columns, where nothing is advected

`advance_air` launches each formula over the cells of all replicas in parallel. `advance_active_replicas`
gives each replica to one thread, which visits column after column in order: a small grid costs little
arithmetic and, kernel by kernel, hundreds of launches a step, of which this needs a dozen. There every
replica iterates its pressure until its own has converged, so that its bits do not depend on the others. It
serves boxes that are periodic along x and y.

Reference: Spalart, Moser & Rogers (1991), J. Comput. Phys. 96, 297, appendix A.
"""

from taichi_erosion.air.boundary import (
    fill_cell_ghosts,
    fill_cell_ghosts_in_range,
    fill_velocity_ghosts,
    fill_velocity_ghosts_in_range,
    fill_wall_viscosity,
)
from taichi_erosion.air.grid import (
    Air,
    apply_stage_to_all_columns,
    apply_stage_to_columns,
    apply_to_all_columns,
    apply_to_columns,
    cell_velocity,
    store_previous_void,
)
from taichi_erosion.air.implicit_z import predict_column_velocity, predict_velocity
from taichi_erosion.air.inlet_turbulence import update_inlet_fluctuation
from taichi_erosion.air.momentum import set_explicit_rates
from taichi_erosion.air.pressure.conjugate_gradient import (
    TOLERANCE,
    apply_to_all_replicas,
    max_or_nan,
    solve_pressure,
    solve_replica_pressure,
)
from taichi_erosion.air.pressure.projection import (
    correct_column_velocity,
    set_conductances,
    set_replica_conductances,
    set_right_hand_side,
    subtract_mean_divergence,
)
from taichi_erosion.air.turbulence import set_eddy_viscosity
from taichi_erosion.core.ti import ti

real = ti.f64


STAGES = {  # of a step: share of it that a stage takes, weights of the explicit rates now and before [1]
    "runge_kutta": (
        (8.0 / 15.0, 8.0 / 15.0, 0.0),
        (2.0 / 15.0, 5.0 / 12.0, -17.0 / 60.0),
        (1.0 / 3.0, 3.0 / 4.0, -5.0 / 12.0),
    ),
    "euler": ((1.0, 1.0, 0.0),),
}


@ti.func
def advance_clock(air_out: ti.template(), r):
    air_out.numbers.time[r] = air_out.numbers.time[r] + air_out.numbers.time_step[r]


@ti.kernel
def extrapolate_outlets(air_out: ti.template()):
    """Velocity on an outlet from the last face inside, until the pressure corrects it."""
    nx, ny, nz = ti.static(air_out.cells[0], air_out.cells[1], air_out.cells[2])
    if ti.static(air_out.kinds["x_high"] == "outlet"):
        ti.loop_config(serialize=air_out.serial)
        for r, j, k in ti.ndrange(air_out.count, ny, nz):
            air_out.velocity_x[r, nx, j, k] = air_out.velocity_x[r, nx - 1, j, k]
    if ti.static(air_out.kinds["z_high"] == "outlet"):
        ti.loop_config(serialize=air_out.serial)
        for r, i, j in ti.ndrange(air_out.count, nx, ny):
            air_out.velocity_z[r, i, j, nz] = air_out.velocity_z[r, i, j, nz - 1]


def advance_stage(air: Air, stage: tuple[float, float, float], tolerance: float) -> int:
    """One of STAGES for all replicas in parallel; returns the iterations of its pressure solve."""
    share, now, before = stage
    if air.model.closure != "none":
        apply_to_all_columns(set_eddy_viscosity, air)
        fill_cell_ghosts(1, air, air.eddy_cell)
        fill_cell_ghosts(1, air, air.eddy_face)
        fill_wall_viscosity(air)
    apply_to_all_columns(set_explicit_rates, air)
    for axis in range(3):
        predict_velocity(axis, share, now, before, air)
    extrapolate_outlets(air)
    fill_velocity_ghosts(air)
    if air.model.exchange:
        set_conductances(air, share)
    apply_to_all_columns(set_right_hand_side, air)
    if air.model.exchange and "outlet" not in air.kinds.values():
        apply_to_all_replicas(subtract_mean_divergence, air)
    iterations = solve_pressure(air, tolerance)
    apply_stage_to_all_columns(correct_column_velocity, share, air)
    fill_velocity_ghosts(air)
    fill_cell_ghosts(-1, air, air.pressure)
    return iterations


def advance_air(air: Air, steps: int = 1, tolerance: float = TOLERANCE) -> int:
    """The air of all replicas after so many of their own time steps, in parallel.

    Returns the iterations of all pressure solves. Raises SimulationStopped where the flow blows up.
    """
    fill_velocity_ghosts(air)
    fill_cell_ghosts(-1, air, air.pressure)
    if air.model.exchange:
        for values in (air.void_fraction, air.exchange_coefficient, air.exchange_force):
            fill_cell_ghosts(1, air, values)
    else:
        set_conductances(air, 1.0)
    iterations = 0
    for _ in range(steps):
        if air.waves.number:
            update_inlet_fluctuation(air)
        for stage in STAGES[air.model.scheme]:
            iterations += advance_stage(air, stage, tolerance)
        if air.model.exchange:
            apply_to_all_columns(store_previous_void, air)
        apply_to_all_replicas(advance_clock, air)
    return iterations


@ti.func
def stage_weights(air: ti.template(), number):
    """Share of the step, and weights of the explicit rates now and before, of one stage [1]."""
    share, now, before = real(0.0), real(0.0), real(0.0)
    for n in ti.static(range(len(STAGES[air.model.scheme]))):
        stage = ti.static(STAGES[air.model.scheme][n])
        if n == number:
            share, now, before = real(stage[0]), real(stage[1]), real(stage[2])
    return share, now, before


@ti.func
def cell_pressure_gradient(air: ti.template(), r, i, j, k):
    """Mean gradient of the pressure in a cell [Pa m-1]; beside floor and lid that of its other face."""
    (p,) = ti.static((air.pressure,))
    width, height = air.numbers.width[r], air.height[r, k]
    below, above = p[r, i, j, k] - p[r, i, j, k - 1], p[r, i, j, k + 1] - p[r, i, j, k]
    if k == 0:
        below = above
    if k == air.cells[2] - 1:
        above = below
    along = (p[r, i + 1, j, k] - p[r, i - 1, j, k]) / width[0]
    across = (p[r, i, j + 1, k] - p[r, i, j - 1, k]) / width[1]
    return 0.5 * ti.Vector([along, across, (below + above) / height])


@ti.func
def add_stage_exchange(air_out: ti.template(), r, i, j, share):
    """Momentum and pressure gradient of one column, plus those of a stage, for the side of the grains.

    impulse   sum t (f - beta u)          with u the velocity at the end of a stage t of the step T
    gradient  sum (t / T) grad p          with p likewise, so that both are to rounding what acted on the air

    The share of a cell in a face is that of `momentum.control_volume_mean`, halves by volume.
    """
    time = share * air_out.numbers.time_step[r]
    for k in range(air_out.cells[2]):
        drag = air_out.exchange_coefficient[r, i, j, k] * cell_velocity(air_out, r, i, j, k)
        gained = time * (air_out.exchange_force[r, i, j, k] - drag)
        slope = cell_pressure_gradient(air_out, r, i, j, k) + air_out.numbers.driving_gradient[r]
        air_out.impulse[r, i, j, k] = air_out.impulse[r, i, j, k] + gained
        air_out.gradient[r, i, j, k] = air_out.gradient[r, i, j, k] + share * slope


@ti.func
def reset_exchange(air_out: ti.template(), r, i, j):
    """Zero impulse and pressure gradient of one column."""
    for k in range(air_out.cells[2]):
        air_out.impulse[r, i, j, k] = 0.0 * air_out.impulse[r, i, j, k]
        air_out.gradient[r, i, j, k] = 0.0 * air_out.gradient[r, i, j, k]


@ti.func
def begin_step(air_out: ti.template(), r):
    """Ghosts from the state of the grid, and a zero exchange budget."""
    void, coefficient, force = ti.static(
        air_out.void_fraction, air_out.exchange_coefficient, air_out.exchange_force
    )
    fill_cell_ghosts_in_range(1, air_out, ti.static((void, coefficient, force, air_out.pressure)), r, r + 1)
    fill_velocity_ghosts_in_range(air_out, r, r + 1)
    apply_to_columns(reset_exchange, air_out, r, r + 1)
    air_out.mass_residual[r] = 0.0


@ti.func
def predict_stage(air_out: ti.template(), r, stage):
    """Velocities at the end of a stage, before the pressure has corrected them; the first opens the step."""
    if stage == 0:
        begin_step(air_out, r)
    if ti.static(air_out.model.closure != "none"):
        apply_to_columns(set_eddy_viscosity, air_out, r, r + 1)
        fill_cell_ghosts_in_range(1, air_out, ti.static((air_out.eddy_cell, air_out.eddy_face)), r, r + 1)
    apply_to_columns(set_explicit_rates, air_out, r, r + 1)
    share, now, before = stage_weights(air_out, stage)
    for axis in ti.static(range(3)):
        for i in range(air_out.cells[0]):
            for j in range(air_out.cells[1]):
                predict_column_velocity(air_out, r, i, j, axis, share, now, before)
    fill_velocity_ghosts_in_range(air_out, r, r + 1)


@ti.func
def solve_stage(air_out: ti.template(), r, stage):
    """Change of pressure that makes the predicted velocities conserve air, and the worst divergence left."""
    share, _, _ = stage_weights(air_out, stage)
    set_replica_conductances(air_out, r, share)
    apply_to_columns(set_right_hand_side, air_out, r, r + 1)
    subtract_mean_divergence(air_out, r)
    worst = solve_replica_pressure(air_out, r)
    air_out.mass_residual[r] = max_or_nan(air_out.mass_residual[r], worst)


@ti.func
def correct_stage(air_out: ti.template(), r, stage):
    """Velocities corrected by the pressure, and the exchange budget; the last closes the step."""
    share, _, _ = stage_weights(air_out, stage)
    apply_stage_to_columns(correct_column_velocity, air_out, r, r + 1, share)
    fill_velocity_ghosts_in_range(air_out, r, r + 1)
    fill_cell_ghosts_in_range(1, air_out, ti.static((air_out.pressure,)), r, r + 1)
    apply_stage_to_columns(add_stage_exchange, air_out, r, r + 1, share)
    if stage == ti.static(len(STAGES[air_out.model.scheme]) - 1):
        apply_to_columns(store_previous_void, air_out, r, r + 1)
        advance_clock(air_out, r)


@ti.kernel
def apply_to_active(task: ti.template(), count: ti.i32, chunk: ti.i32, stage: ti.i32, air_out: ti.template()):
    """One task of a stage applied to every active replica, each on one thread."""
    for lane in range(count * chunk):
        if lane % chunk == 0 and air_out.active[lane // chunk] == 1:
            task(air_out, lane // chunk, stage)


def advance_active_replicas(air: Air, count: int, chunk: int) -> None:
    """The active among the first `count` replicas after one of their own time steps, one thread a replica.

    `chunk` iterations of a parallel loop go to one thread. The largest divergence left is in
    `air.mass_residual`.
    """
    for stage in range(len(STAGES[air.model.scheme])):
        for task in (predict_stage, solve_stage, correct_stage):
            apply_to_active(task, count, chunk, stage, air)
