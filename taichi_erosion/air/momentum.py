"""Explicit part of the momentum balance on the staggered grid: advection, and diffusion across.

    eps du/dt = - eps u . grad u + div(eps (nu + nu_t) grad u) + ...

Advection is written with the flux q = eps u through the faces of a velocity's control volume,

    advection = sum q (u_face - u_centre) / width,

which vanishes for uniform u whatever the void fraction does. With the central u_face it takes no kinetic
energy from the flow and gives none; `limited` takes the upwind value and van Leer's share of the slope.
Transport of momentum by the transposed gradient (div of nu_t grad u^T) is left out.

Reference: Harlow & Welch (1965), Phys. Fluids 8, 2182; Verstappen & Veldman (2003), J. Comput. Phys. 187,
343; van Leer (1974), J. Comput. Phys. 14, 361.
"""

from taichi_erosion.core.ti import ti

real = ti.f64

UNIT = ((1, 0, 0), (0, 1, 0), (0, 0, 1))  # step to the next cell along each axis
PERIOD_SIDES = ("x_low", "y_low")
TINY = 2.0**-100  # keeps a ratio of slopes finite


@ti.func
def face_share(values: ti.template(), r, i, j, k, axis: ti.template()):
    """Mean of a cell quantity over the two cells that share the low face along an axis."""
    a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
    return 0.5 * (values[r, i, j, k] + values[r, i - a0, j - a1, k - a2])


@ti.func
def held(air: ti.template(), index, axis: ti.template()):
    """Place along x or y that holds what lies one below the ghosts: round the period, or the ghost."""
    found = ti.max(index, -1)
    if ti.static(air.kinds[PERIOD_SIDES[axis]] == "periodic"):
        found = ti.select(index < -1, index + air.cells[axis], index)
    return found


@ti.func
def face_void(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Void fraction on the low face along an axis [1]."""
    share = real(1.0)
    if ti.static(air.model.exchange):
        a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
        low = air.void_fraction[r, held(air, i - a0, 0), held(air, j - a1, 1), k - a2]
        share = 0.5 * (air.void_fraction[r, i, j, k] + low)
    return share


@ti.func
def flux(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Flux of air through the low face along an axis [m s-1]."""
    return face_void(air, r, i, j, k, axis) * air.velocities[axis][r, i, j, k]


@ti.func
def cell_viscosity(air: ti.template(), r, i, j, k):
    """Viscosity eps (nu + nu_t) in a cell [m2 s-1]."""
    value = air.numbers.viscosity[r] + air.eddy_cell[r, i, j, k]
    if ti.static(air.model.exchange):
        value *= air.void_fraction[r, i, j, k]
    return value


@ti.func
def volume_width(air: ti.template(), r, k, axis: ti.template(), direction: ti.template()):
    """Width of the control volume of a velocity along a direction [m]."""
    width = real(0.0)
    if ti.static(direction < 2):
        width = air.numbers.width[r][direction]
    elif ti.static(axis == 2):
        width = air.centre[r, k] - air.centre[r, k - 1]
    else:
        width = air.height[r, k]
    return width


@ti.func
def through(air: ti.template(), r, place, axis: ti.template(), direction: ti.template()):
    """Flux through the low face, along a direction, of the control volume of a velocity [m s-1]."""
    a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
    i, j, k = place[0], place[1], place[2]
    here = flux(air, r, i, j, k, direction)
    there = flux(air, r, i - a0, j - a1, k - a2, direction)
    value = 0.5 * (here + there)
    if ti.static(axis == 2 and direction < 2):
        lower, upper = air.height[r, k - 1], air.height[r, k]
        value = (upper * here + lower * there) / (upper + lower)
    return value


@ti.func
def stress_viscosity(air: ti.template(), r, place, axis: ti.template(), direction: ti.template()):
    """Viscosity eps (nu + nu_t) on the low face, along x or y, of a control volume [m2 s-1]."""
    a0, a1, a2 = ti.static(UNIT[axis][0], UNIT[axis][1], UNIT[axis][2])
    d0, d1 = ti.static(UNIT[direction][0], UNIT[direction][1])
    i, j, k = place[0], place[1], place[2]
    value = cell_viscosity(air, r, i - a0, j - a1, k - a2)
    if ti.static(axis != direction):
        value += cell_viscosity(air, r, i, j, k)
        value += cell_viscosity(air, r, i - d0, j - d1, k)
        value += cell_viscosity(air, r, i - a0 - d0, j - a1 - d1, k - a2)
        value *= 0.25
    return value


@ti.func
def outside(air: ti.template(), index, axis: ti.template()):
    """Place two beyond along an axis: round the period, or the last ghost."""
    n = ti.static(air.cells[axis])
    found = ti.min(ti.max(index, -1), n)
    if ti.static(axis < 2):
        if ti.static(air.kinds[PERIOD_SIDES[axis]] == "periodic"):
            found = (index + 2 * n) % n
    return found


@ti.func
def second_upwind(air: ti.template(), r, place, axis: ti.template(), direction: ti.template()):
    """Velocity at a place that may lie one beyond the ghosts [m s-1]."""
    i, j, k = place[0], place[1], place[2]
    if ti.static(direction == 0):
        i = outside(air, i, 0)
    if ti.static(direction == 1):
        j = outside(air, j, 1)
    if ti.static(direction == 2):
        k = outside(air, k, 2)
    return air.velocities[axis][r, i, j, k]


@ti.func
def van_leer(behind, ahead):
    """Limited rise from an upwind value to the face half-way to the next one [of the slopes' unit]."""
    product = behind * ahead
    return ti.select(product > 0.0, product / (behind + ahead + ti.select(behind > 0.0, TINY, -TINY)), 0.0)


@ti.func
def carried(air: ti.template(), r, low, axis: ti.template(), direction: ti.template(), speed):
    """Velocity that a flux carries through the face above place `low` [m s-1]."""
    step = ti.Vector([UNIT[direction][0], UNIT[direction][1], UNIT[direction][2]])
    high = low + step
    values = ti.static(air.velocities[axis])
    first, last = values[r, low[0], low[1], low[2]], values[r, high[0], high[1], high[2]]
    value = 0.5 * (first + last)
    if ti.static(air.model.advection == "limited"):
        if speed > 0.0:
            behind = second_upwind(air, r, low - step, axis, direction)
            value = first + van_leer(first - behind, last - first)
        else:
            behind = second_upwind(air, r, high + step, axis, direction)
            value = last + van_leer(last - behind, first - last)
    return value


@ti.func
def advection(air: ti.template(), r, place, axis: ti.template()):
    """Rate at which the flow carries a velocity away, times eps [m s-2]."""
    here = air.velocities[axis][r, place[0], place[1], place[2]]
    total = real(0.0)
    for direction in ti.static(range(3)):
        step = ti.Vector([UNIT[direction][0], UNIT[direction][1], UNIT[direction][2]])
        into = through(air, r, place, axis, direction)
        out = through(air, r, place + step, axis, direction)
        taken = out * (carried(air, r, place, axis, direction, out) - here)
        taken -= into * (carried(air, r, place - step, axis, direction, into) - here)
        total += taken / volume_width(air, r, place[2], axis, direction)
    return total


@ti.func
def diffusion_across(air: ti.template(), r, place, axis: ti.template()):
    """Diffusion along x and y, times eps [m s-2]."""
    values = ti.static(air.velocities[axis])
    here = values[r, place[0], place[1], place[2]]
    total = real(0.0)
    for direction in ti.static(range(2)):
        step = ti.Vector([UNIT[direction][0], UNIT[direction][1], UNIT[direction][2]])
        low, high = place - step, place + step
        width = air.numbers.width[r][direction]
        rise = stress_viscosity(air, r, high, axis, direction) * (values[r, high[0], high[1], high[2]] - here)
        fall = stress_viscosity(air, r, place, axis, direction) * (here - values[r, low[0], low[1], low[2]])
        total += (rise - fall) / (width * width)
    return total


@ti.func
def first_unknown(air: ti.template(), axis: ti.template()):
    """Index of the first face along an axis whose velocity is not given by a side."""
    first = 1
    if ti.static(axis < 2):
        if ti.static(air.kinds[PERIOD_SIDES[axis]] == "periodic"):
            first = 0
    return first


@ti.func
def is_unknown(air: ti.template(), i, j, axis: ti.template()):
    """Whether the velocities along an axis in a column of cells are found, not given."""
    known = True
    if ti.static(axis == 0):
        known = i < first_unknown(air, 0)
    elif ti.static(axis == 1):
        known = j < first_unknown(air, 1)
    else:
        known = False
    return not known


@ti.func
def rates_of_column(air_out: ti.template(), r, i, j):
    """Explicit rates of the velocities of one column of cells [m s-2]."""
    for axis in ti.static(range(3)):
        rate_out, past_out = ti.static(air_out.rates[axis], air_out.pasts[axis])
        if is_unknown(air_out, i, j, axis):
            for k in range(ti.static(1 if axis == 2 else 0), air_out.cells[2]):
                past_out[r, i, j, k] = rate_out[r, i, j, k]
                place = ti.Vector([i, j, k])
                rate = diffusion_across(air_out, r, place, axis)
                if ti.static(air_out.model.advection != "none"):
                    rate -= advection(air_out, r, place, axis)
                rate_out[r, i, j, k] = rate


@ti.kernel
def find_rates(
    # out
    air_out: ti.template(),
):
    """Explicit rates of all velocities [m s-2]; what the stage before found is kept as the past."""
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        rates_of_column(air_out, r, i, j)
