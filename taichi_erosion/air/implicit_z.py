"""Predicted velocities: explicit rates, sources, and diffusion along z taken implicitly, column by column.

    eps (u' - u) / t = N + (1 - theta) D u + theta D u' + F - beta u' / rho

with t the time of the stage, N the weighted explicit rates, D diffusion along z, F `momentum.body_force` and
theta the implicitness. The tridiagonal system of each column is solved by elimination upwards and
substitution downwards; the new pressure corrects the result afterwards.

Reference: Spalart, Moser & Rogers (1991), J. Comput. Phys. 96, 297, appendix A (stages of the scheme).
"""

from taichi_erosion.air.momentum import (
    body_force,
    conductance_below,
    control_volume_height,
    drag_rate,
    face_void_fraction,
    is_velocity_unknown,
)
from taichi_erosion.core.ti import ti

real = ti.f64


@ti.func
def right_side_of_row(theta, inertia, below, above, here, jump_below, jump):
    """Right-hand side of a row by inertia and the explicit share of diffusion; `jump`: to the next above."""
    return inertia * here + (1.0 - theta) * (above * jump - below * jump_below)


@ti.func
def eliminate_row(theta, inertia, drag, below, above, right, reduced, factor):
    """One row of the elimination: reduced right-hand side and upper factor, from those of the row below.

    `below` and `above` are conductances, `inertia` and `drag` likewise stand for height over time [m s-1].
    """
    pivot = 1.0 / (inertia + drag + theta * (above + below * (1.0 - factor)))
    return (right + theta * below * reduced) * pivot, theta * above * pivot


@ti.func
def solve_column_velocity(air_out: ti.template(), r, i, j, axis: ti.template(), time, now, before):
    """Predicted velocities along an axis in one column; `now`, `before`: weights of explicit rates [1]."""
    values_out, rate, previous = ti.static(
        air_out.velocities[axis], air_out.rates[axis], air_out.previous_rates[axis]
    )
    first, n = ti.static(1 if axis == 2 else 0), ti.static(air_out.cells[2])
    theta = air_out.numbers.implicitness[r]
    below = conductance_below(air_out, r, i, j, first, axis)
    here, reduced = values_out[r, i, j, first], values_out[r, i, j, first - 1]
    jump_below, factor = here - reduced, real(0.0)
    for k in range(first, n):
        next_above, above = values_out[r, i, j, k + 1], conductance_below(air_out, r, i, j, k + 1, axis)
        jump = next_above - here
        height = control_volume_height(air_out, r, k, axis)
        inertia = height * face_void_fraction(air_out, r, i, j, k, axis) / time
        right = right_side_of_row(theta, inertia, below, above, here, jump_below, jump)
        force = body_force(air_out, r, i, j, k, axis)
        right += height * (now * rate[r, i, j, k] + before * previous[r, i, j, k] + force)
        drag = height * drag_rate(air_out, r, i, j, k, axis)
        reduced, factor = eliminate_row(theta, inertia, drag, below, above, right, reduced, factor)
        values_out[r, i, j, k] = reduced
        air_out.elimination[r, i, j, k] = factor
        below, jump_below, here = above, jump, next_above
    for down in range(n - first):
        k = n - 1 - down
        back = air_out.elimination[r, i, j, k] * values_out[r, i, j, k + 1]
        values_out[r, i, j, k] = values_out[r, i, j, k] + back


@ti.func
def predict_column_velocity(air_out: ti.template(), r, i, j, axis: ti.template(), share, now, before):
    """Velocities along an axis in one column at the end of a stage, unless a side gives them.

    The weights `now` and `before` of the explicit rates are over the whole step, `share` of which the stage
    takes.
    """
    if is_velocity_unknown(air_out, i, j, axis):
        time = share * air_out.numbers.time_step[r]
        solve_column_velocity(air_out, r, i, j, axis, time, now / share, before / share)


@ti.kernel
def predict_velocity(axis: ti.template(), share: ti.f64, now: ti.f64, before: ti.f64, air_out: ti.template()):
    """Predicted velocities along an axis of all replicas."""
    ti.loop_config(serialize=air_out.serial)
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        predict_column_velocity(air_out, r, i, j, axis, share, now, before)
