"""Momentum balance of the air on the staggered grid, term by term.

    eps du/dt =
      - q . grad u                      explicit    advection, with the flux q = eps u
      + div_xy(eps (nu + nu_t) grad u)  explicit    horizontal_diffusion
      + d/dz(eps (nu + nu_t) du/dz)     theta       conductance_below, in implicit_z.py
      - (eps / rho) (grad p + G)        explicit    pressure_gradient and driving; see pressure/
      + f / rho                         explicit    of grains, in body_force
      - beta u / rho                    implicit    drag_rate
      + u*^2 / h                        explicit    stress on a lid, in the layer of height h below it

`explicit_rate` sums the first two, `body_force` the sources. Advection is written with the flux through
the faces of a velocity's control volume,

    advection = sum q (u_face - u_centre) / width,

which vanishes for uniform u whatever the void fraction does. With the central u_face it conserves kinetic
energy; `limited` takes the upwind value and van Leer's share of the slope. Transport of momentum by the
transposed gradient (div of nu_t grad u^T) is left out.

Reference: Harlow & Welch (1965), Phys. Fluids 8, 2182; Verstappen & Veldman (2003), J. Comput. Phys. 187,
343; van Leer (1974), J. Comput. Phys. 14, 361.
"""

from taichi_erosion.air.wall_law import FLOOR, wall_conductance
from taichi_erosion.core.air_setup import SIDES
from taichi_erosion.core.ti import ti

real = ti.f64

UNIT = ((1, 0, 0), (0, 1, 0), (0, 0, 1))  # step to the next cell along each axis
LID = SIDES.index("z_high")
TINY = 2.0**-100  # keeps a ratio of slopes finite


@ti.func
def face_mean(air: ti.template(), values: ti.template(), r, i, j, k, axis: ti.template()):
    """Mean of a cell quantity over the two cells that share the low face along an axis."""
    a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
    value = values[r, i, j, k]
    if ti.static(axis == 2 or not air.is_column):
        value = 0.5 * (values[r, i, j, k] + values[r, i - a0, j - a1, k - a2])
    return value


@ti.func
def index_below(air: ti.template(), index, axis: ti.template()):
    """Index along x or y of what lies one below the ghosts: round the period, or the ghost."""
    below = ti.max(index, -1)
    if ti.static(air.kinds[SIDES[2 * axis]] == "periodic"):
        below = ti.select(index < -1, index + air.cells[axis], index)
    return below


@ti.func
def face_void_fraction(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Void fraction on the low face along an axis [1]."""
    share = real(1.0)
    if ti.static(air.model.exchange):
        share = air.void_fraction[r, i, j, k]
        if ti.static(axis == 2 or not air.is_column):
            a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
            low = air.void_fraction[r, index_below(air, i - a0, 0), index_below(air, j - a1, 1), k - a2]
            share = 0.5 * (share + low)
    return share


@ti.func
def face_flux(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Flux of air through the low face of a cell along an axis [m s-1]."""
    return face_void_fraction(air, r, i, j, k, axis) * air.velocities[axis][r, i, j, k]


@ti.func
def cell_viscosity(air: ti.template(), r, i, j, k):
    """Viscosity eps (nu + nu_t) in a cell [m2 s-1]."""
    value = air.numbers.viscosity[r] + air.eddy_cell[r, i, j, k]
    if ti.static(air.model.exchange):
        value *= air.void_fraction[r, i, j, k]
    return value


@ti.func
def control_volume_height(air: ti.template(), r, k, axis: ti.template()):
    """Height of the control volume of a velocity [m]."""
    return air.centre[r, k] - air.centre[r, k - 1] if ti.static(axis == 2) else air.height[r, k]


@ti.func
def control_volume_width(air: ti.template(), r, k, axis: ti.template(), direction: ti.template()):
    """Width of the control volume of a velocity along a direction [m]."""
    width = real(0.0)
    if ti.static(direction < 2):
        width = air.numbers.width[r][direction]
    else:
        width = control_volume_height(air, r, k, axis)
    return width


@ti.func
def control_volume_flux(air: ti.template(), r, at, axis: ti.template(), direction: ti.template()):
    """Flux through the low face, along a direction, of the control volume of a velocity [m s-1]."""
    a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
    i, j, k = at[0], at[1], at[2]
    here = face_flux(air, r, i, j, k, direction)
    there = face_flux(air, r, i - a0, j - a1, k - a2, direction)
    value = 0.5 * (here + there)
    if ti.static(axis == 2 and direction < 2):
        lower, upper = air.height[r, k - 1], air.height[r, k]
        value = (upper * here + lower * there) / (upper + lower)
    return value


@ti.func
def index_two_beyond(air: ti.template(), index, axis: ti.template()):
    """Index along an axis of a value two beyond a side: round the period, or the last ghost."""
    n = ti.static(air.cells[axis])
    place = ti.min(ti.max(index, -1), n)
    if ti.static(axis < 2 and air.kinds[SIDES[2 * axis]] == "periodic"):
        place = (index + 2 * n) % n
    return place


@ti.func
def far_upwind_velocity(air: ti.template(), r, at, axis: ti.template(), direction: ti.template()):
    """Velocity at indices that may lie one beyond the ghosts [m s-1]."""
    i, j, k = at[0], at[1], at[2]
    if ti.static(direction == 0):
        i = index_two_beyond(air, i, 0)
    if ti.static(direction == 1):
        j = index_two_beyond(air, j, 1)
    if ti.static(direction == 2):
        k = index_two_beyond(air, k, 2)
    return air.velocities[axis][r, i, j, k]


@ti.func
def van_leer_slope(behind, ahead):
    """Limited rise from an upwind value to the face half-way to the next one [of the slopes' unit]."""
    product = behind * ahead
    return ti.select(product > 0.0, product / (behind + ahead + ti.select(behind > 0.0, TINY, -TINY)), 0.0)


@ti.func
def face_value(air: ti.template(), r, low, axis: ti.template(), direction: ti.template(), speed):
    """Velocity u_face that a flux carries through the face above indices `low` [m s-1]."""
    step = ti.Vector([UNIT[direction][0], UNIT[direction][1], UNIT[direction][2]])
    high = low + step
    values = ti.static(air.velocities[axis])
    first, last = values[r, low[0], low[1], low[2]], values[r, high[0], high[1], high[2]]
    value = 0.5 * (first + last)
    if ti.static(air.model.advection == "limited"):
        upwind, downwind, beyond = last, first, high + step
        if speed > 0.0:
            upwind, downwind, beyond = first, last, low - step
        behind = far_upwind_velocity(air, r, beyond, axis, direction)
        value = upwind + van_leer_slope(upwind - behind, downwind - upwind)
    return value


@ti.func
def advection_term(air: ti.template(), r, at, axis: ti.template()):
    """Advection term q . grad u of a velocity [m s-2]."""
    here = air.velocities[axis][r, at[0], at[1], at[2]]
    total = real(0.0)
    for direction in ti.static(range(3)):
        step = ti.Vector([UNIT[direction][0], UNIT[direction][1], UNIT[direction][2]])
        into = control_volume_flux(air, r, at, axis, direction)
        out = control_volume_flux(air, r, at + step, axis, direction)
        net_flux = out * (face_value(air, r, at, axis, direction, out) - here)
        net_flux -= into * (face_value(air, r, at - step, axis, direction, into) - here)
        total += net_flux / control_volume_width(air, r, at[2], axis, direction)
    return total


@ti.func
def stress_viscosity(air: ti.template(), r, at, axis: ti.template(), direction: ti.template()):
    """Viscosity eps (nu + nu_t) on the low face, along x or y, of a control volume [m2 s-1]."""
    a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
    d0, d1 = ti.static(UNIT[direction][0], UNIT[direction][1])
    i, j, k = at[0], at[1], at[2]
    value = cell_viscosity(air, r, i - a0, j - a1, k - a2)
    if ti.static(axis != direction):
        value += cell_viscosity(air, r, i, j, k)
        value += cell_viscosity(air, r, i - d0, j - d1, k)
        value += cell_viscosity(air, r, i - a0 - d0, j - a1 - d1, k - a2)
        value *= 0.25
    return value


@ti.func
def horizontal_diffusion(air: ti.template(), r, at, axis: ti.template()):
    """Diffusion term along x and y [m s-2]."""
    values = ti.static(air.velocities[axis])
    here = values[r, at[0], at[1], at[2]]
    total = real(0.0)
    for direction in ti.static(range(2)):
        step = ti.Vector([UNIT[direction][0], UNIT[direction][1], UNIT[direction][2]])
        low, high = at - step, at + step
        width = air.numbers.width[r][direction]
        rise = stress_viscosity(air, r, high, axis, direction) * (values[r, high[0], high[1], high[2]] - here)
        fall = stress_viscosity(air, r, at, axis, direction) * (here - values[r, low[0], low[1], low[2]])
        total += (rise - fall) / (width * width)
    return total


@ti.func
def explicit_rate(air: ti.template(), r, at, axis: ti.template()):
    """Horizontal diffusion less advection of a velocity [m s-2]."""
    rate = horizontal_diffusion(air, r, at, axis)
    if ti.static(air.model.advection != "none"):
        rate -= advection_term(air, r, at, axis)
    return rate


@ti.func
def control_volume_mean(air: ti.template(), values: ti.template(), r, i, j, k, axis: ti.template()):
    """Exchange with grains in the control volume of a velocity: mean of its two cells by their volumes.

    The sum over all velocities then is the sum over all cells, whatever their heights.
    """
    share = face_mean(air, values, r, i, j, k, axis)
    if ti.static(axis == 2):
        above, below = air.height[r, k], air.height[r, k - 1]
        share = (above * values[r, i, j, k] + below * values[r, i, j, k - 1]) / (above + below)
    return share


@ti.func
def drag_rate(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Implicit drag beta / rho on a face [s-1]."""
    value = real(0.0)
    if ti.static(air.model.exchange):
        value = control_volume_mean(air, air.exchange_coefficient, r, i, j, k, axis) / air.numbers.density[r]
    return value


@ti.func
def pressure_gradient(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Gradient of the pressure across the low face, without its driving part [Pa m-1]."""
    slope = real(0.0)
    if ti.static(axis == 2 or not air.is_column):
        a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
        rise = air.pressure[r, i, j, k] - air.pressure[r, i - a0, j - a1, k - a2]
        slope = rise / control_volume_width(air, r, k, axis, axis)
    return slope


@ti.func
def body_force(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Acceleration by pressure, its driving gradient, grains and a lid under stress, times eps [m s-2]."""
    (numbers,) = ti.static((air.numbers,))
    slope = pressure_gradient(air, r, i, j, k, axis) + numbers.driving_gradient[r][axis]
    value = -face_void_fraction(air, r, i, j, k, axis) * slope
    if ti.static(air.model.exchange):
        value += control_volume_mean(air, air.exchange_force, r, i, j, k, axis)[axis]
    value /= numbers.density[r]
    if ti.static(axis == 0 and air.kinds["z_high"] == "stress"):
        if k == air.cells[2] - 1:
            value += numbers.friction_velocity[r] ** 2 / air.height[r, k]
    return value


@ti.func
def viscous_conductance(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Eps (nu + nu_t) over the distance to the next velocity below [m s-1]."""
    value, distance = real(0.0), air.height[r, k - 1]
    if ti.static(axis == 2):
        value = cell_viscosity(air, r, i, j, k - 1)
    else:
        distance = air.centre[r, k] - air.centre[r, k - 1]
        value = air.numbers.viscosity[r] + face_mean(air, air.eddy_face, r, i, j, k, axis)
        if ti.static(air.model.exchange):
            void = face_mean(air, air.void_fraction, r, i, j, k, axis)
            value *= 0.5 * (void + face_mean(air, air.void_fraction, r, i, j, k - 1, axis))
    return value / distance


@ti.func
def horizontal_face_velocity(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Both horizontal velocities at a face normal to x or y [m s-1]; the other one is a mean of four."""
    u, v = air.velocity_x[r, i, j, k], air.velocity_y[r, i, j, k]
    if ti.static(axis == 0 and not air.is_column):
        before = air.velocity_y[r, i - 1, j, k] + air.velocity_y[r, i - 1, j + 1, k]
        v = 0.25 * (before + v + air.velocity_y[r, i, j + 1, k])
    elif ti.static(not air.is_column):
        before = air.velocity_x[r, i, j - 1, k] + air.velocity_x[r, i + 1, j - 1, k]
        u = 0.25 * (before + u + air.velocity_x[r, i + 1, j, k])
    return u, v


@ti.func
def side_conductance(air: ti.template(), kind: ti.template(), r, i, j, k, axis: ti.template(), side):
    """Stress over density and velocity of an end cell, relative to floor or lid [m s-1]."""
    wall = air.numbers.side_velocity[r, side]
    u, v = horizontal_face_velocity(air, r, i, j, k, axis)
    speed = ti.sqrt((u - wall[0]) ** 2 + (v - wall[1]) ** 2)
    value = wall_conductance(air, kind, r, side, speed, 0.5 * air.height[r, k])
    return value * face_void_fraction(air, r, i, j, k, axis)


@ti.func
def conductance_below(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Conductance towards what lies below a velocity: the next one, floor, or for k = nz the lid [m s-1]."""
    n = ti.static(air.cells[2])
    value = real(0.0)
    if ti.static(axis == 2):
        value = viscous_conductance(air, r, i, j, k, axis)
    elif k == 0:
        value = side_conductance(air, air.kinds["z_low"], r, i, j, 0, axis, FLOOR)
    elif k == n:
        value = side_conductance(air, air.kinds["z_high"], r, i, j, n - 1, axis, LID)
    else:
        value = viscous_conductance(air, r, i, j, k, axis)
    return value


@ti.func
def is_velocity_unknown(air: ti.template(), i, j, axis: ti.template()):
    """Whether the velocities along an axis in a column of cells are unknowns, not given by a side."""
    by_side = False
    if ti.static(axis < 2 and air.kinds[SIDES[2 * axis]] != "periodic"):
        by_side = (i if ti.static(axis == 0) else j) == 0
    return not by_side


@ti.func
def set_explicit_rates(air_out: ti.template(), r, i, j):
    """Explicit rates of the velocities of one column of cells [m s-2]; those of the stage before are kept."""
    for axis in ti.static(range(3)):
        rate_out, previous_out = ti.static(air_out.rates[axis], air_out.previous_rates[axis])
        if is_velocity_unknown(air_out, i, j, axis):
            for k in range(ti.static(1 if axis == 2 else 0), air_out.cells[2]):
                previous_out[r, i, j, k] = rate_out[r, i, j, k]
                rate_out[r, i, j, k] = explicit_rate(air_out, r, ti.Vector([i, j, k]), axis)
