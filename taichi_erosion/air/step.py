"""One time step of the air on a whole grid: a table of contents.

runge_kutta: three stages, explicit terms to third order, diffusion along z and pressure to second
             (implicitness 1/2); stable up to u dt / dx = 1.7
euler:       one stage; for columns, where nothing is advected

Reference: Spalart, Moser & Rogers (1991), J. Comput. Phys. 96, 297, appendix A.
"""

from dataclasses import dataclass

from taichi_erosion.air.boundary import close_cells, close_eddies, close_velocities
from taichi_erosion.air.exchange_budget import remember_void_of
from taichi_erosion.air.grid import Air
from taichi_erosion.air.implicit_z import predict
from taichi_erosion.air.inlet_turbulence import blow_gusts
from taichi_erosion.air.momentum import find_rates
from taichi_erosion.air.pressure.conjugate_gradient import TOLERANCE, solve
from taichi_erosion.air.pressure.projection import correct, find_excess, set_conductances, spread_excess
from taichi_erosion.air.turbulence import spread_eddies
from taichi_erosion.core.ti import ti


@dataclass(frozen=True)
class Stage:
    """Share of the step that a stage takes, and weights of the explicit rates now and before [1]."""

    share: float
    now: float
    before: float


STAGES = {
    "runge_kutta": (
        Stage(8.0 / 15.0, 8.0 / 15.0, 0.0),
        Stage(2.0 / 15.0, 5.0 / 12.0, -17.0 / 60.0),
        Stage(1.0 / 3.0, 3.0 / 4.0, -5.0 / 12.0),
    ),
    "euler": (Stage(1.0, 1.0, 0.0),),
}


@ti.kernel
def tick(
    # out
    air_out: ti.template(),
):
    """Advance the clocks."""
    for r in range(air_out.count):
        air_out.numbers.time[r] = air_out.numbers.time[r] + air_out.numbers.time_step[r]


@ti.kernel
def remember_void(
    # out
    air_out: ti.template(),
):
    """Take the void fraction as it stands for that of the step before; once grains have been placed."""
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        remember_void_of(air_out, r, i, j)


@ti.kernel
def open_outlets(
    # out
    air_out: ti.template(),
):
    """Let the velocity on an outlet be that of the last face inside, until the pressure corrects it."""
    nx, ny, nz = ti.static(air_out.cells[0], air_out.cells[1], air_out.cells[2])
    if ti.static(air_out.kinds["x_high"] == "outlet"):
        for r, j, k in ti.ndrange(air_out.count, ny, nz):
            air_out.velocity_x[r, nx, j, k] = air_out.velocity_x[r, nx - 1, j, k]
    if ti.static(air_out.kinds["z_high"] == "outlet"):
        for r, i, j in ti.ndrange(air_out.count, nx, ny):
            air_out.velocity_z[r, i, j, nz] = air_out.velocity_z[r, i, j, nz - 1]


def close_all(air: Air) -> None:
    """Fill all ghosts from what the grid holds now."""
    close_velocities(air)
    close_cells(-1, air, air.pressure)
    if air.model.exchange:
        close_cells(1, air, air.void_fraction)
        close_cells(1, air, air.exchange_coefficient)
        close_cells(1, air, air.exchange_force)


def advance_stage(air: Air, stage: Stage, tolerance: float) -> int:
    """Advance by one stage; returns the iterations of its pressure solve."""
    if air.model.closure != "none":
        spread_eddies(air)
        close_cells(1, air, air.eddy_cell)
        close_cells(1, air, air.eddy_face)
        close_eddies(air)
    find_rates(air)
    for axis in range(3):
        predict(axis, stage.share, stage.now, stage.before, air)
    open_outlets(air)
    close_velocities(air)
    if air.model.exchange:
        set_conductances(air, stage.share)
    find_excess(air)
    if air.model.exchange and "outlet" not in air.kinds.values():
        spread_excess(air)
    iterations = solve(air, tolerance)
    correct(stage.share, air)
    close_velocities(air)
    close_cells(-1, air, air.pressure)
    return iterations


def advance_air(air: Air, steps: int = 1, tolerance: float = TOLERANCE) -> int:
    """Advance the air of all replicas by so many of their own time steps.

    Returns the iterations of all pressure solves. Raises SimulationStopped where the flow blows up.
    """
    close_all(air)
    if not air.model.exchange:
        set_conductances(air, 1.0)
    iterations = 0
    for _ in range(steps):
        if air.waves.number:
            blow_gusts(air)
        for stage in STAGES[air.model.scheme]:
            iterations += advance_stage(air, stage, tolerance)
        if air.model.exchange:
            remember_void(air)
        tick(air)
    return iterations
