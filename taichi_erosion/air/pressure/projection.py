"""Projection: the pressure that makes the flow conserve air.

    d eps/dt + div(eps u) = 0,    u = u' - (t / rho) a grad phi,    a = 1 / (1 + t beta / (rho eps))

with u' the predicted velocity, t the time of the stage, phi the change of pressure, beta the exchange
coefficient and a the projection factor: drag resists the correction too. With psi = t phi / rho the equation
for psi has the same coefficients at every step unless grains take part. The solve ends when the divergence of
every cell times the time step is below the tolerance. Sums run over columns in a fixed order, so results
repeat to the bit on any number of threads.

Reference: Chorin (1968), Math. Comput. 22, 745; van Kan (1986), SIAM J. Sci. Stat. Comput. 7, 870.
"""

from taichi_erosion.air.grid import Air, apply_stage_to_all_columns, apply_stage_to_columns
from taichi_erosion.air.momentum import UNIT, drag_rate, face_flux, face_void_fraction, is_velocity_unknown
from taichi_erosion.air.pressure.multigrid import (
    apply_to_all_lines,
    apply_to_lines,
    coarsen_conductances,
    factor_line,
    neighbour_columns,
)
from taichi_erosion.core.ti import ti

real = ti.f64


@ti.func
def projection_factor(air: ti.template(), r, i, j, k, axis: ti.template(), time):
    """Change of velocity over the gradient of psi that causes it [1]."""
    value = real(1.0)
    if ti.static(air.model.exchange):
        drag = drag_rate(air, r, i, j, k, axis)
        value = 1.0 / (1.0 + time * drag / face_void_fraction(air, r, i, j, k, axis))
    return value


@ti.func
def mobility(air: ti.template(), r, i, j, k, axis: ti.template(), time):
    """Change of volume flux through a face over the gradient of psi that causes it [1]."""
    return projection_factor(air, r, i, j, k, axis, time) * face_void_fraction(air, r, i, j, k, axis)


@ti.func
def horizontal_conductance(air: ti.template(), r, i, j, k, axis: ti.template(), time):
    """Conductance of the low face of a cell along x or y [m]; 0 on a side."""
    value = real(0.0)
    if ti.static(air.cells[axis] > 1):
        if is_velocity_unknown(air, i, j, axis):
            width = air.numbers.width[r]
            value = mobility(air, r, i, j, k, axis, time) * width[1 - axis] * air.height[r, k] / width[axis]
    return value


@ti.func
def outlet_conductance(air: ti.template(), r, i, j, k, time):
    """Conductance from a cell to outlets beside it, where the pressure is zero [m]."""
    width, height = air.numbers.width[r], air.height[r, k]
    value = real(0.0)
    if ti.static(air.kinds["x_high"] == "outlet"):
        if i == air.cells[0] - 1:
            value += 2.0 * mobility(air, r, i + 1, j, k, 0, time) * width[1] * height / width[0]
    if ti.static(air.kinds["z_high"] == "outlet"):
        if k == air.cells[2] - 1:
            value += 2.0 * mobility(air, r, i, j, k + 1, 2, time) * width[0] * width[1] / height
    return value


@ti.func
def set_finest_conductances(air_out: ti.template(), r, i, j, share):
    """Conductances of one column of the finest level, for a stage of so large a share of the step."""
    (levels_out,) = ti.static((air_out.levels,))
    width, time = air_out.numbers.width[r], share * air_out.numbers.time_step[r]
    c = i * air_out.cells[1] + j
    for k in range(air_out.cells[2]):
        levels_out.conductance_x[r, c, k] = horizontal_conductance(air_out, r, i, j, k, 0, time)
        levels_out.conductance_y[r, c, k] = horizontal_conductance(air_out, r, i, j, k, 1, time)
        levels_out.outlet_conductance[r, c, k] = outlet_conductance(air_out, r, i, j, k, time)
        if k > 0:
            gap = air_out.centre[r, k] - air_out.centre[r, k - 1]
            along_z = mobility(air_out, r, i, j, k, 2, time)
            levels_out.conductance_z[r, c, k] = along_z * width[0] * width[1] / gap


@ti.func
def set_replica_conductances(air_out: ti.template(), r, share):
    """Conductances of all levels of one replica, on one thread."""
    apply_stage_to_columns(set_finest_conductances, air_out, r, r + 1, share)
    for level in range(1, air_out.levels.number):
        apply_to_lines(coarsen_conductances, True, air_out.levels, level, r, r + 1)
    for level in range(air_out.levels.number):
        apply_to_lines(factor_line, True, air_out.levels, level, r, r + 1)


def set_conductances(air: Air, share: float) -> None:
    """Conductances of all levels of all replicas for a stage, in parallel."""
    apply_stage_to_all_columns(set_finest_conductances, share, air)
    for level in range(1, air.levels.number):
        apply_to_all_lines(coarsen_conductances, air.levels.serial[level], level, air.levels)
    for level in range(air.levels.number):
        apply_to_all_lines(factor_line, air.levels.serial[level], level, air.levels)


@ti.func
def low_face_flow(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Air that passes the low face of a cell [m3 s-1]."""
    width = air.numbers.width[r]
    area = width[0] * width[1]
    if ti.static(axis < 2):
        area = width[1 - axis] * air.height[r, k]
    return face_flux(air, r, i, j, k, axis) * area


@ti.func
def cell_divergence(air: ti.template(), r, i, j, k):
    """Volume of air that a cell gives off in excess of what it takes up: d eps/dt + div(eps u) [m3 s-1]."""
    total = real(0.0)
    for axis in ti.static(range(3)):
        a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
        total += low_face_flow(air, r, i + a0, j + a1, k + a2, axis) - low_face_flow(air, r, i, j, k, axis)
    if ti.static(air.model.exchange):
        width = air.numbers.width[r]
        change = (air.void_fraction[r, i, j, k] - air.void_before[r, i, j, k]) / air.numbers.time_step[r]
        total += change * width[0] * width[1] * air.height[r, k]
    return total


@ti.func
def relative_divergence(air: ti.template(), r, k, excess):
    """Divergence of a cell [m3 s-1] times the time step over its volume [1]."""
    width = air.numbers.width[r]
    return ti.abs(excess) * air.numbers.time_step[r] / (width[0] * width[1] * air.height[r, k])


@ti.func
def sum_over_columns(air: ti.template(), r):
    """Sum of `krylov.column_sum` in a fixed order."""
    total = real(0.0)
    for column in range(ti.static(air.cells[0] * air.cells[1])):
        total += air.krylov.column_sum[r, column]
    return total


@ti.func
def set_right_hand_side(air_out: ti.template(), r, i, j):
    """Right-hand side of the pressure equation in one column; the solution starts at 0."""
    (krylov_out,) = ti.static((air_out.krylov,))
    worst, total, c = real(0.0), real(0.0), i * air_out.cells[1] + j
    for k in range(air_out.cells[2]):
        excess = cell_divergence(air_out, r, i, j, k)
        air_out.levels.right_side[r, c, k] = -excess
        krylov_out.psi[r, c, k] = 0.0
        worst = ti.max(worst, relative_divergence(air_out, r, k, excess))
        total += excess
    krylov_out.column_worst[r, c] = worst
    krylov_out.column_sum[r, c] = total


@ti.func
def subtract_mean_divergence(air_out: ti.template(), r):
    """Solvability: right-hand side less its mean, since in a closed box grains cannot press air out."""
    total = sum_over_columns(air_out, r)
    width, height = air_out.numbers.width[r], air_out.face[r, air_out.cells[2]] - air_out.face[r, 0]
    density = total / (air_out.cells[0] * air_out.cells[1] * width[0] * width[1] * height)
    for c in range(air_out.cells[0] * air_out.cells[1]):
        for k in range(air_out.cells[2]):
            back = density * width[0] * width[1] * air_out.height[r, k]
            air_out.levels.right_side[r, c, k] = air_out.levels.right_side[r, c, k] + back


@ti.func
def subtract_gradient(air_out: ti.template(), r, cell, axis: ti.template(), slope, time):
    """Velocity on a low face less its projection factor times a gradient of psi [m s-1]."""
    i, j, k = cell[0], cell[1], cell[2]
    change = projection_factor(air_out, r, i, j, k, axis, time) * slope
    air_out.velocities[axis][r, i, j, k] = air_out.velocities[axis][r, i, j, k] - change


@ti.func
def correct_outlet_velocity(air_out: ti.template(), r, i, j, k, here, time):
    """Velocities on outlets beside a cell, where psi is zero."""
    if ti.static(air_out.kinds["x_high"] == "outlet"):
        if i == air_out.cells[0] - 1:
            slope = -2.0 * here / air_out.numbers.width[r][0]
            subtract_gradient(air_out, r, ti.Vector([i + 1, j, k]), 0, slope, time)
    if ti.static(air_out.kinds["z_high"] == "outlet"):
        if k == air_out.cells[2] - 1:
            slope = -2.0 * here / air_out.height[r, k]
            subtract_gradient(air_out, r, ti.Vector([i, j, k + 1]), 2, slope, time)


@ti.func
def correct_column_velocity(air_out: ti.template(), r, i, j, share):
    """Velocities on the low faces of one column less the gradient of psi, and its pressure."""
    (psi,) = ti.static((air_out.krylov.psi,))
    width, time = air_out.numbers.width[r], share * air_out.numbers.time_step[r]
    c, neighbours = i * air_out.cells[1] + j, neighbour_columns(air_out.levels, 0, i, j)
    for k in range(air_out.cells[2]):
        here, cell = psi[r, c, k], ti.Vector([i, j, k])
        for axis, low in ti.static(((0, 0), (1, 2))):  # west, south
            if is_velocity_unknown(air_out, i, j, axis):
                slope = (here - psi[r, neighbours[low], k]) / width[axis]
                subtract_gradient(air_out, r, cell, axis, slope, time)
        if k > 0:
            gap = air_out.centre[r, k] - air_out.centre[r, k - 1]
            subtract_gradient(air_out, r, cell, 2, (here - psi[r, c, k - 1]) / gap, time)
        correct_outlet_velocity(air_out, r, i, j, k, here, time)
        rise = here * air_out.numbers.density[r] / time
        air_out.pressure[r, i, j, k] = air_out.pressure[r, i, j, k] + rise
