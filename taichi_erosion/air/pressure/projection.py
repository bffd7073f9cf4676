"""Projection: the pressure that makes the flow conserve air, found by conjugate gradients.

    d eps/dt + div(eps u) = 0,    u = u' - (t / rho) a grad phi,    a = 1 / (1 + t beta / (rho eps))

with u' the predicted velocity, t the time of the stage, phi the change of pressure and beta the exchange
coefficient: grains resist the correction too. With psi = t phi / rho the equation for psi has the same
coefficients at every step unless grains take part. The solve ends when the air that appears in any cell in
one step is less than TOLERANCE of the cell. Sums run over columns in a fixed order, so results repeat to the
bit on any number of threads.

Reference: Chorin (1968), Math. Comput. 22, 745; van Kan (1986), SIAM J. Sci. Stat. Comput. 7, 870.
"""

from taichi_erosion.air.grid import Air, column_of
from taichi_erosion.air.implicit_z import drag_on_face
from taichi_erosion.air.momentum import UNIT, face_void, first_unknown
from taichi_erosion.air.pressure.multigrid import factor_lines
from taichi_erosion.core.ti import ti

real = ti.f64


@ti.func
def yielding(air: ti.template(), r, i, j, k, axis: ti.template(), time):
    """Velocity that a gradient of psi changes, over that gradient [1]."""
    value = real(1.0)
    if ti.static(air.model.exchange):
        drag = drag_on_face(air, r, i, j, k, axis)
        value = 1.0 / (1.0 + time * drag / face_void(air, r, i, j, k, axis))
    return value


@ti.func
def open_face(air: ti.template(), r, i, j, k, axis: ti.template(), time):
    """Flux that a gradient of psi changes, over that gradient [1]."""
    return yielding(air, r, i, j, k, axis, time) * face_void(air, r, i, j, k, axis)


@ti.func
def conduct_across(air_out: ti.template(), r, i, j, k, time):
    """Conductances of the low faces of a cell along x and y [m]."""
    (grids_out,) = ti.static((air_out.grids,))
    width, height, c = air_out.numbers.width[r], air_out.height[r, k], i * air_out.cells[1] + j
    grids_out.across_x[r, c, k] = 0.0
    grids_out.across_y[r, c, k] = 0.0
    if ti.static(air_out.cells[0] > 1):
        if i >= first_unknown(air_out, 0):
            open_share = open_face(air_out, r, i, j, k, 0, time)
            grids_out.across_x[r, c, k] = open_share * width[1] * height / width[0]
    if ti.static(air_out.cells[1] > 1):
        if j >= first_unknown(air_out, 1):
            open_share = open_face(air_out, r, i, j, k, 1, time)
            grids_out.across_y[r, c, k] = open_share * width[0] * height / width[1]


@ti.func
def drain_of(air: ti.template(), r, i, j, k, time):
    """Conductance from a cell to outlets beside it, where the pressure is zero [m]."""
    width, height = air.numbers.width[r], air.height[r, k]
    value = real(0.0)
    if ti.static(air.kinds["x_high"] == "outlet"):
        if i == air.cells[0] - 1:
            value += 2.0 * open_face(air, r, i + 1, j, k, 0, time) * width[1] * height / width[0]
    if ti.static(air.kinds["z_high"] == "outlet"):
        if k == air.cells[2] - 1:
            value += 2.0 * open_face(air, r, i, j, k + 1, 2, time) * width[0] * width[1] / height
    return value


@ti.func
def conduct_column(air_out: ti.template(), r, i, j, share):
    """Conductances of one column of the finest grid."""
    (grids_out,) = ti.static((air_out.grids,))
    width, time = air_out.numbers.width[r], share * air_out.numbers.time_step[r]
    c = i * air_out.cells[1] + j
    for k in range(air_out.cells[2]):
        conduct_across(air_out, r, i, j, k, time)
        grids_out.drain[r, c, k] = drain_of(air_out, r, i, j, k, time)
        if k > 0:
            gap = air_out.centre[r, k] - air_out.centre[r, k - 1]
            open_share = open_face(air_out, r, i, j, k, 2, time)
            grids_out.across_z[r, c, k] = open_share * width[0] * width[1] / gap


@ti.kernel
def conduct(
    # parameters
    share: ti.f64,
    # out
    air_out: ti.template(),
):
    """Conductances of the finest grid for a stage that takes so large a share of the step."""
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        conduct_column(air_out, r, i, j, share)


@ti.func
def merge_column(grids_out: ti.template(), level, r, i, j):
    """Conductances of one column of a coarser grid: parallel faces add, doubled distances halve."""
    by_x, by_y = grids_out.shape[level - 1, 3], grids_out.shape[level - 1, 4]
    nx, ny, c = grids_out.shape[level, 1], grids_out.shape[level, 2], column_of(grids_out, level, i, j)
    for k in range(grids_out.right.shape[2]):
        along_x, along_y, along_z, drain = real(0.0), real(0.0), real(0.0), real(0.0)
        for part in range(by_x * by_y):
            a, b = part // by_y, part % by_y
            fine = column_of(grids_out, level - 1, by_x * i + a, by_y * j + b)
            along_x += ti.select(a == 0, grids_out.across_x[r, fine, k], 0.0)
            along_y += ti.select(b == 0, grids_out.across_y[r, fine, k], 0.0)
            along_z += grids_out.across_z[r, fine, k]
            drain += grids_out.drain[r, fine, k]
        # a single column round a period is its own neighbour and feels nothing of itself
        grids_out.across_x[r, c, k] = ti.select(nx > 1, along_x / by_x, 0.0)
        grids_out.across_y[r, c, k] = ti.select(ny > 1, along_y / by_y, 0.0)
        grids_out.across_z[r, c, k] = along_z
        grids_out.drain[r, c, k] = drain


@ti.kernel
def conduct_coarser(
    # parameters
    level: ti.i32,
    # out
    grids_out: ti.template(),
):
    """Conductances of a coarser grid."""
    for r, i, j in ti.ndrange(grids_out.right.shape[0], grids_out.shape[level, 1], grids_out.shape[level, 2]):
        merge_column(grids_out, level, r, i, j)


def set_conductances(air: Air, share: float) -> None:
    """Conductances of all grids for a stage."""
    conduct(share, air)
    for level in range(1, air.grids.number):
        conduct_coarser(level, air.grids)
    for level in range(air.grids.number):
        factor_lines(level, air.grids)


@ti.func
def outflow(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Air that passes the low face of a cell [m3 s-1]."""
    width = air.numbers.width[r]
    area = width[0] * width[1]
    if ti.static(axis < 2):
        area = width[1 - axis] * air.height[r, k]
    return face_void(air, r, i, j, k, axis) * air.velocities[axis][r, i, j, k] * area


@ti.func
def appearing(air: ti.template(), r, i, j, k):
    """Air that a cell gives off in excess of what it takes up [m3 s-1]."""
    total = real(0.0)
    for axis in ti.static(range(3)):
        a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
        total += outflow(air, r, i + a0, j + a1, k + a2, axis) - outflow(air, r, i, j, k, axis)
    if ti.static(air.model.exchange):
        width = air.numbers.width[r]
        change = (air.void_fraction[r, i, j, k] - air.void_before[r, i, j, k]) / air.numbers.time_step[r]
        total += change * width[0] * width[1] * air.height[r, k]
    return total


@ti.func
def share_of_cell(air: ti.template(), r, k, excess):
    """Air that appears in a cell [m3 s-1] in one step over the volume of the cell [1]."""
    width = air.numbers.width[r]
    return ti.abs(excess) * air.numbers.time_step[r] / (width[0] * width[1] * air.height[r, k])


@ti.func
def total_of(air: ti.template(), r):
    """Sum over columns in a fixed order."""
    total = real(0.0)
    for column in range(ti.static(air.cells[0] * air.cells[1])):
        total += air.krylov.partial[r, column]
    return total


@ti.func
def excess_of_column(air_out: ti.template(), r, i, j):
    """Right-hand side of one column."""
    (krylov_out,) = ti.static((air_out.krylov,))
    worst, total, c = real(0.0), real(0.0), i * air_out.cells[1] + j
    for k in range(air_out.cells[2]):
        excess = appearing(air_out, r, i, j, k)
        air_out.grids.right[r, c, k] = -excess
        krylov_out.found[r, c, k] = 0.0
        worst = ti.max(worst, share_of_cell(air_out, r, k, excess))
        total += excess
    krylov_out.worst[r, c] = worst
    krylov_out.partial[r, c] = total


@ti.kernel
def find_excess(
    # out
    air_out: ti.template(),
):
    """Right-hand side of the pressure equation; the solution starts at 0."""
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        excess_of_column(air_out, r, i, j)


@ti.func
def spread_mean_excess(air_out: ti.template(), r):
    """Take the mean off the right-hand side of one replica: in a closed box grains cannot press air out."""
    total = total_of(air_out, r)
    width, height = air_out.numbers.width[r], air_out.face[r, air_out.cells[2]] - air_out.face[r, 0]
    density = total / (air_out.cells[0] * air_out.cells[1] * width[0] * width[1] * height)
    for c in range(air_out.cells[0] * air_out.cells[1]):
        for k in range(air_out.cells[2]):
            back = density * width[0] * width[1] * air_out.height[r, k]
            air_out.grids.right[r, c, k] = air_out.grids.right[r, c, k] + back


@ti.kernel
def spread_excess(
    # out
    air_out: ti.template(),
):
    """Take the mean off the right-hand sides."""
    for r in range(air_out.count):
        spread_mean_excess(air_out, r)


@ti.func
def take_slope(air_out: ti.template(), r, place, axis: ti.template(), slope, time):
    """Take a gradient of psi [m s-1] off the velocity on a face."""
    i, j, k = place[0], place[1], place[2]
    change = yielding(air_out, r, i, j, k, axis, time) * slope
    air_out.velocities[axis][r, i, j, k] = air_out.velocities[axis][r, i, j, k] - change


@ti.func
def correct_outlets(air_out: ti.template(), r, i, j, k, here, time):
    """Velocities on outlets beside a cell, where psi is zero."""
    if ti.static(air_out.kinds["x_high"] == "outlet"):
        if i == air_out.cells[0] - 1:
            slope = -2.0 * here / air_out.numbers.width[r][0]
            take_slope(air_out, r, ti.Vector([i + 1, j, k]), 0, slope, time)
    if ti.static(air_out.kinds["z_high"] == "outlet"):
        if k == air_out.cells[2] - 1:
            slope = -2.0 * here / air_out.height[r, k]
            take_slope(air_out, r, ti.Vector([i, j, k + 1]), 2, slope, time)


@ti.func
def correct_column(air_out: ti.template(), r, i, j, share):
    """Correct the velocities on the low faces of one column, and its pressure."""
    (found,) = ti.static((air_out.krylov.found,))
    width, time = air_out.numbers.width[r], share * air_out.numbers.time_step[r]
    c = i * air_out.cells[1] + j
    west, south = column_of(air_out.grids, 0, i - 1, j), column_of(air_out.grids, 0, i, j - 1)
    for k in range(air_out.cells[2]):
        here, place = found[r, c, k], ti.Vector([i, j, k])
        if i >= first_unknown(air_out, 0):
            take_slope(air_out, r, place, 0, (here - found[r, west, k]) / width[0], time)
        if j >= first_unknown(air_out, 1):
            take_slope(air_out, r, place, 1, (here - found[r, south, k]) / width[1], time)
        if k > 0:
            gap = air_out.centre[r, k] - air_out.centre[r, k - 1]
            take_slope(air_out, r, place, 2, (here - found[r, c, k - 1]) / gap, time)
        correct_outlets(air_out, r, i, j, k, here, time)
        rise = here * air_out.numbers.density[r] / time
        air_out.pressure[r, i, j, k] = air_out.pressure[r, i, j, k] + rise


@ti.kernel
def correct(
    # parameters
    share: ti.f64,
    # out
    air_out: ti.template(),
):
    """Take the gradient of psi off the velocities and add its pressure."""
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        correct_column(air_out, r, i, j, share)
