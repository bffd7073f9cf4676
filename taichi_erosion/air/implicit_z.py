"""Predicted velocities: explicit rates, sources, and diffusion along z taken implicitly, column by column.

    eps (u' - u) / t = N + (1 - theta) D u + theta D u' + f / rho - beta u' / rho - eps grad p / rho

with t the time of the stage, N the weighted explicit rates, D diffusion along z. One sweep up and one down
solve each column, as in `column.py`; the new pressure corrects the result afterwards.

Reference: Spalart, Moser & Rogers (1991), J. Comput. Phys. 96, 297, appendix A (stages of the scheme).
"""

from taichi_erosion.air.momentum import UNIT, cell_viscosity, face_share, face_void, is_unknown
from taichi_erosion.air.wall_law import SMALLEST, wall_friction_velocity
from taichi_erosion.core.air_setup import SIDES
from taichi_erosion.core.ti import ti

real = ti.f64

FLOOR, LID = SIDES.index("z_low"), SIDES.index("z_high")


@ti.func
def spacing_below(air: ti.template(), r, k, axis: ti.template()):
    """Distance to the next velocity below [m]."""
    return air.height[r, k - 1] if ti.static(axis == 2) else air.centre[r, k] - air.centre[r, k - 1]


@ti.func
def control_height(air: ti.template(), r, k, axis: ti.template()):
    """Height of the control volume of a velocity [m]."""
    return air.centre[r, k] - air.centre[r, k - 1] if ti.static(axis == 2) else air.height[r, k]


@ti.func
def exchange_share(air: ti.template(), values: ti.template(), r, i, j, k, axis: ti.template()):
    """What grains exert on the control volume of a velocity: of each of its cells, by their volumes.

    What all velocities get is then what all cells hold, whatever the heights of these.
    """
    share = face_share(values, r, i, j, k, axis)
    if ti.static(axis == 2):
        above, below = air.height[r, k], air.height[r, k - 1]
        share = (above * values[r, i, j, k] + below * values[r, i, j, k - 1]) / (above + below)
    return share


@ti.func
def drag_on_face(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Exchange coefficient over density on a face [s-1]."""
    value = real(0.0)
    if ti.static(air.model.exchange):
        value = exchange_share(air, air.exchange_coefficient, r, i, j, k, axis) / air.numbers.density[r]
    return value


@ti.func
def pull(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Acceleration by pressure, its mean gradient, grains and a lid under stress, times eps [m s-2]."""
    a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
    (numbers,) = ti.static((air.numbers,))
    width = numbers.width[r][axis]
    if ti.static(axis == 2):
        width = control_height(air, r, k, 2)
    slope = (air.pressure[r, i, j, k] - air.pressure[r, i - a0, j - a1, k - a2]) / width
    value = -face_void(air, r, i, j, k, axis) * (slope + numbers.driving_gradient[r][axis])
    if ti.static(air.model.exchange):
        value += exchange_share(air, air.exchange_force, r, i, j, k, axis)[axis]
    value /= numbers.density[r]
    if ti.static(axis == 0 and air.kinds["z_high"] == "stress"):
        if k == air.cells[2] - 1:
            value += numbers.friction_velocity[r] ** 2 / air.height[r, k]
    return value


@ti.func
def inner_conductance(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Stress over density and velocity difference to the next velocity below [m s-1]."""
    value = real(0.0)
    if ti.static(axis == 2):
        value = cell_viscosity(air, r, i, j, k - 1)
    else:
        value = air.numbers.viscosity[r] + face_share(air.eddy_face, r, i, j, k, axis)
        if ti.static(air.model.exchange):
            void = face_share(air.void_fraction, r, i, j, k, axis)
            value *= 0.5 * (void + face_share(air.void_fraction, r, i, j, k - 1, axis))
    return value / spacing_below(air, r, k, axis)


@ti.func
def side_conductance(air: ti.template(), kind: ti.template(), r, place, axis: ti.template(), side):
    """Stress over density and velocity of an end cell, relative to floor or lid [m s-1]."""
    (numbers,) = ti.static((air.numbers,))
    i, j, k = place[0], place[1], place[2]
    value = real(0.0)
    distance, nu = 0.5 * air.height[r, k], numbers.viscosity[r]
    if ti.static(kind in ("wall", "inlet")):
        value = nu / distance
    if ti.static(kind == "rough"):
        wall = numbers.side_velocity[r, side]
        u, v = side_velocity_of_air(air, r, i, j, k, axis)
        speed = ti.max(ti.sqrt((u - wall[0]) ** 2 + (v - wall[1]) ** 2), SMALLEST)
        roughness = numbers.side_roughness[r, side]
        friction = wall_friction_velocity(speed, distance, roughness, nu, numbers.karman[r])
        value = friction * friction / speed
    return value * face_void(air, r, i, j, k, axis)


@ti.func
def side_velocity_of_air(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Both horizontal velocities at a face normal to x or y [m s-1]; the other one is a mean of four."""
    u, v = air.velocity_x[r, i, j, k], air.velocity_y[r, i, j, k]
    if ti.static(axis == 0):
        before = air.velocity_y[r, i - 1, j, k] + air.velocity_y[r, i - 1, j + 1, k]
        v = 0.25 * (before + v + air.velocity_y[r, i, j + 1, k])
    else:
        before = air.velocity_x[r, i, j - 1, k] + air.velocity_x[r, i + 1, j - 1, k]
        u = 0.25 * (before + u + air.velocity_x[r, i + 1, j, k])
    return u, v


@ti.func
def conductance_below(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Conductance towards what lies below a velocity: the next one, floor, or for k = nz the lid [m s-1]."""
    n = air.cells[2]
    value = real(0.0)
    if ti.static(axis == 2):
        value = inner_conductance(air, r, i, j, k, 2)
    elif k == 0:
        value = side_conductance(air, air.kinds["z_low"], r, ti.Vector([i, j, 0]), axis, FLOOR)
    elif k == n:
        value = side_conductance(air, air.kinds["z_high"], r, ti.Vector([i, j, n - 1]), axis, LID)
    else:
        value = inner_conductance(air, r, i, j, k, axis)
    return value


@ti.func
def sweep_column(air_out: ti.template(), r, i, j, axis: ti.template(), weights):
    """Predict velocities along an axis in one column; `weights`: share of the step, of rates, of past."""
    values_out, rate, past = ti.static(air_out.velocities[axis], air_out.rates[axis], air_out.pasts[axis])
    first, n = ti.static(1 if axis == 2 else 0), ti.static(air_out.cells[2])
    theta, time = air_out.numbers.implicitness[r], weights[0] * air_out.numbers.time_step[r]
    # the explicit rates act over the whole step, weighted; here they are rates over the stage
    now, before = weights[1] / weights[0], weights[2] / weights[0]
    below = conductance_below(air_out, r, i, j, first, axis)
    here, reduced = values_out[r, i, j, first], values_out[r, i, j, first - 1]
    jump_below, factor = here - reduced, real(0.0)
    for k in range(first, n):
        over, above = values_out[r, i, j, k + 1], conductance_below(air_out, r, i, j, k + 1, axis)
        jump = over - here
        height = control_height(air_out, r, k, axis)
        inertia = height * face_void(air_out, r, i, j, k, axis) / time
        right = inertia * here + (1.0 - theta) * (above * jump - below * jump_below)
        pushed = now * rate[r, i, j, k] + before * past[r, i, j, k] + pull(air_out, r, i, j, k, axis)
        right += height * pushed
        drag = height * drag_on_face(air_out, r, i, j, k, axis)
        pivot = 1.0 / (inertia + drag + theta * (above + below * (1.0 - factor)))
        reduced = (right + theta * below * reduced) * pivot
        factor = theta * above * pivot
        values_out[r, i, j, k] = reduced
        air_out.elimination[r, i, j, k] = factor
        below, jump_below, here = above, jump, over
    for upside in range(n - first):
        k = n - 1 - upside
        back = air_out.elimination[r, i, j, k] * values_out[r, i, j, k + 1]
        values_out[r, i, j, k] = values_out[r, i, j, k] + back


@ti.func
def predict_column(air_out: ti.template(), r, i, j, axis: ti.template(), weights):
    """Predict the velocities along an axis in one column, unless a side gives them."""
    if is_unknown(air_out, i, j, axis):
        sweep_column(air_out, r, i, j, axis, weights)


@ti.kernel
def predict(
    # parameters
    axis: ti.template(),
    share: ti.f64,
    rate_weight: ti.f64,
    past_weight: ti.f64,
    # out
    air_out: ti.template(),
):
    """Predict all velocities along an axis at the end of a stage."""
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        predict_column(air_out, r, i, j, axis, ti.Vector([share, rate_weight, past_weight]))
