"""Ghost cells and normal velocities on the sides of the box; with them the interior needs no exceptions.

Along x and y a ghost is the mirror image that gives a wall its velocity half-way; along z, where cells are
uneven, a ghost is the value on the side itself (`Air.centre` puts it there). Normal velocities on the
sides are set here too, except at an outlet, where the projection finds them. A rough side along x or y acts
through the eddy viscosity of its ghost cells: with the mirror image it makes the stress rho u*^2.
"""

from taichi_erosion.air.wall_law import SMALLEST, rough_side_friction
from taichi_erosion.core.air_setup import SIDES
from taichi_erosion.core.ti import ti

real = ti.f64

IMPOSED = ("wall", "rough", "inlet")  # kinds of sides that give the air beside them a velocity


@ti.func
def side_velocity_at(air: ti.template(), side: ti.template(), axis: ti.template(), r, j, k):
    """Velocity of a wall or of entering air [m s-1]."""
    value = air.numbers.side_velocity[r, side][axis]
    if ti.static(SIDES[side] == "x_low" and air.kinds["x_low"] == "inlet"):
        value = value * air.inlet_shape[r, k] + air.inlet_fluctuation[r, j, k][axis]
    return value


@ti.func
def mirror_value(kind: ti.template(), inside, wall):
    """Value beyond a side along x or y."""
    return 2.0 * wall - inside if ti.static(kind in IMPOSED) else inside


@ti.func
def side_value(kind: ti.template(), inside, wall):
    """Value on a side along z."""
    return wall if ti.static(kind in IMPOSED) else inside


@ti.func
def normal_velocity(air: ti.template(), side: ti.template(), r, j, k):
    """Normal velocity on a side that is not an outlet [m s-1]."""
    value = real(0.0)
    if ti.static(air.kinds[SIDES[side]] == "inlet"):
        value = side_velocity_at(air, side, side // 2, r, j, k)
    return value


@ti.func
def fill_velocity_ghosts_x(air_out: ti.template(), r, j, k):
    """Velocities in ghosts and on the sides along x."""
    n = air_out.cells[0]
    low, high = ti.static((air_out.kinds["x_low"], air_out.kinds["x_high"]))
    for axis in ti.static(range(3)):
        values_out = ti.static(air_out.velocities[axis])
        first, last = values_out[r, 0, j, k], values_out[r, n - 1, j, k]
        if ti.static(low == "periodic"):
            values_out[r, -1, j, k] = last
            values_out[r, n, j, k] = first
        elif ti.static(axis == 0):
            values_out[r, 0, j, k] = normal_velocity(air_out, 0, r, j, k)
            values_out[r, -1, j, k] = values_out[r, 0, j, k]
            if ti.static(high != "outlet"):
                values_out[r, n, j, k] = 0.0
        else:
            values_out[r, -1, j, k] = mirror_value(low, first, side_velocity_at(air_out, 0, axis, r, j, k))
            values_out[r, n, j, k] = mirror_value(high, last, side_velocity_at(air_out, 1, axis, r, j, k))


@ti.func
def fill_velocity_ghosts_y(air_out: ti.template(), r, i, k):
    """Velocities in ghosts and on the sides along y."""
    n = air_out.cells[1]
    low, high = ti.static((air_out.kinds["y_low"], air_out.kinds["y_high"]))
    for axis in ti.static(range(3)):
        values_out = ti.static(air_out.velocities[axis])
        first, last = values_out[r, i, 0, k], values_out[r, i, n - 1, k]
        if ti.static(low == "periodic"):
            values_out[r, i, -1, k] = last
            values_out[r, i, n, k] = first
        elif ti.static(axis == 1):
            for j in ti.static((-1, 0)):
                values_out[r, i, j, k] = 0.0
            values_out[r, i, n, k] = 0.0
        else:
            values_out[r, i, -1, k] = mirror_value(low, first, side_velocity_at(air_out, 2, axis, r, 0, k))
            values_out[r, i, n, k] = mirror_value(high, last, side_velocity_at(air_out, 3, axis, r, 0, k))


@ti.func
def fill_velocity_ghosts_z(air_out: ti.template(), r, i, j):
    """Velocities on floor and lid."""
    n = air_out.cells[2]
    low, high = ti.static((air_out.kinds["z_low"], air_out.kinds["z_high"]))
    for axis in ti.static(range(2)):
        values_out = ti.static(air_out.velocities[axis])
        first, last = values_out[r, i, j, 0], values_out[r, i, j, n - 1]
        values_out[r, i, j, -1] = side_value(low, first, side_velocity_at(air_out, 4, axis, r, j, 0))
        values_out[r, i, j, n] = side_value(high, last, side_velocity_at(air_out, 5, axis, r, j, 0))
    air_out.velocity_z[r, i, j, 0] = normal_velocity(air_out, 4, r, j, 0)
    air_out.velocity_z[r, i, j, -1] = air_out.velocity_z[r, i, j, 0]
    if ti.static(high != "outlet"):
        air_out.velocity_z[r, i, j, n] = 0.0


@ti.kernel
def fill_velocity_ghosts(
    # out
    air_out: ti.template(),
):
    """Velocities in all ghosts; x first, since y and z read the corners."""
    nx, ny, nz = ti.static(air_out.cells[0], air_out.cells[1], air_out.cells[2])
    for r, j, k in ti.ndrange(air_out.count, ny, nz):
        fill_velocity_ghosts_x(air_out, r, j, k)
    for r, i, k in ti.ndrange(air_out.count, nx + 2, nz):
        fill_velocity_ghosts_y(air_out, r, i - 1, k)
    for r, i, j in ti.ndrange(air_out.count, nx + 2, ny + 2):
        fill_velocity_ghosts_z(air_out, r, i - 1, j - 1)


@ti.func
def serial_velocity_ghosts(air_out: ti.template(), r):
    """Velocities in all ghosts of one replica, on one thread."""
    nx, ny, nz = ti.static(air_out.cells[0], air_out.cells[1], air_out.cells[2])
    for j in range(ny):
        for k in range(nz):
            fill_velocity_ghosts_x(air_out, r, j, k)
    for i in range(-1, nx + 1):
        for k in range(nz):
            fill_velocity_ghosts_y(air_out, r, i, k)
    for i in range(-1, nx + 1):
        for j in range(-1, ny + 1):
            fill_velocity_ghosts_z(air_out, r, i, j)


@ti.func
def ghost_value(kind: ti.template(), inside, opposite, outlet_sign: ti.template()):
    """Cell value beyond a side: from the opposite end of a period, else from the cell inside."""
    value = inside
    if ti.static(kind == "periodic"):
        value = opposite
    elif ti.static(kind == "outlet"):
        value = outlet_sign * inside
    return value


@ti.func
def fill_cell_ghosts_x(air: ti.template(), values_out: ti.template(), outlet_sign: ti.template(), r, j, k):
    """Ghosts of a cell quantity beyond the sides along x."""
    n = ti.static(air.cells[0])
    low, high = ti.static((air.kinds["x_low"], air.kinds["x_high"]))
    first, last = values_out[r, 0, j, k], values_out[r, n - 1, j, k]
    values_out[r, -1, j, k] = ghost_value(low, first, last, outlet_sign)
    values_out[r, n, j, k] = ghost_value(high, last, first, outlet_sign)


@ti.func
def fill_cell_ghosts_y(air: ti.template(), values_out: ti.template(), outlet_sign: ti.template(), r, i, k):
    """Ghosts of a cell quantity beyond the sides along y."""
    n = ti.static(air.cells[1])
    low, high = ti.static((air.kinds["y_low"], air.kinds["y_high"]))
    first, last = values_out[r, i, 0, k], values_out[r, i, n - 1, k]
    values_out[r, i, -1, k] = ghost_value(low, first, last, outlet_sign)
    values_out[r, i, n, k] = ghost_value(high, last, first, outlet_sign)


@ti.func
def fill_cell_ghosts_z(air: ti.template(), values_out: ti.template(), outlet_sign: ti.template(), r, i, j):
    """Ghosts of a cell quantity below the floor and above the lid."""
    n = ti.static(air.cells[2])
    values_out[r, i, j, -1] = values_out[r, i, j, 0]
    values_out[r, i, j, n] = values_out[r, i, j, n - 1]
    if ti.static(air.kinds["z_high"] == "outlet" and outlet_sign < 0):
        values_out[r, i, j, n] = 0.0


@ti.kernel
def fill_cell_ghosts(
    # parameters
    outlet_sign: ti.template(),
    # in
    air: ti.template(),
    # out
    values_out: ti.template(),
):
    """Ghosts of a cell quantity; `outlet_sign` -1 makes it vanish on an outlet, as pressure does."""
    nx, ny, nz = ti.static(air.cells[0], air.cells[1], air.cells[2])
    for r, j, k in ti.ndrange(air.count, ny, nz):
        fill_cell_ghosts_x(air, values_out, outlet_sign, r, j, k)
    for r, i, k in ti.ndrange(air.count, nx + 2, nz):
        fill_cell_ghosts_y(air, values_out, outlet_sign, r, i - 1, k)
    for r, i, j in ti.ndrange(air.count, nx + 2, ny + 2):
        fill_cell_ghosts_z(air, values_out, outlet_sign, r, i - 1, j - 1)


@ti.func
def serial_cell_ghosts(air: ti.template(), values_out: ti.template(), r):
    """Ghosts of a cell quantity of one replica without outlets, on one thread."""
    nx, ny, nz = ti.static(air.cells[0], air.cells[1], air.cells[2])
    for j in range(ny):
        for k in range(nz):
            fill_cell_ghosts_x(air, values_out, 1, r, j, k)
    for i in range(-1, nx + 1):
        for k in range(nz):
            fill_cell_ghosts_y(air, values_out, 1, r, i, k)
    for i in range(-1, nx + 1):
        for j in range(-1, ny + 1):
            fill_cell_ghosts_z(air, values_out, 1, r, i, j)


@ti.func
def wall_ghost_viscosity(air: ti.template(), side: ti.template(), r, speed, inside):
    """Eddy viscosity beyond a side along x or y that gives its stress [m2 s-1]."""
    value = -inside
    if ti.static(air.kinds[SIDES[side]] == "rough"):
        distance, moving = 0.5 * air.numbers.width[r][side // 2], ti.max(speed, SMALLEST)
        friction = rough_side_friction(air, r, side, moving, distance)
        value = 2.0 * (friction * friction * distance / moving - air.numbers.viscosity[r]) - inside
    return value


@ti.func
def speed_along_side(air: ti.template(), r, i, j, k, axis: ti.template()):
    """Speed of cell (i, j, k) along a side normal to `axis` [m s-1]."""
    w = 0.5 * (air.velocity_z[r, i, j, k] + air.velocity_z[r, i, j, k + 1])
    other = real(0.0)
    if ti.static(axis == 0):
        other = 0.5 * (air.velocity_y[r, i, j, k] + air.velocity_y[r, i, j + 1, k])
    else:
        other = 0.5 * (air.velocity_x[r, i, j, k] + air.velocity_x[r, i + 1, j, k])
    return ti.sqrt(other * other + w * w)


@ti.kernel
def fill_wall_viscosity(
    # out
    air_out: ti.template(),
):
    """Eddy viscosity in ghosts of walls along x and y; after `fill_cell_ghosts`."""
    nx, ny, nz = ti.static(air_out.cells[0], air_out.cells[1], air_out.cells[2])
    (eddy_out,) = ti.static((air_out.eddy_cell,))
    for r, j, k in ti.ndrange(air_out.count, ny, nz):
        for side, i, ghost in ti.static(((0, 0, -1), (1, nx - 1, nx))):
            if ti.static(air_out.kinds[SIDES[side]] in ("wall", "rough")):
                speed = speed_along_side(air_out, r, i, j, k, 0)
                eddy_out[r, ghost, j, k] = wall_ghost_viscosity(air_out, side, r, speed, eddy_out[r, i, j, k])
    for r, i, k in ti.ndrange(air_out.count, nx, nz):
        for side, j, ghost in ti.static(((2, 0, -1), (3, ny - 1, ny))):
            if ti.static(air_out.kinds[SIDES[side]] in ("wall", "rough")):
                speed = speed_along_side(air_out, r, i, j, k, 1)
                eddy_out[r, i, ghost, k] = wall_ghost_viscosity(air_out, side, r, speed, eddy_out[r, i, j, k])
