"""Ghost cells and normal velocities on the sides of the box; with them the interior needs no exceptions.

Along x and y a ghost is the mirror image that gives a wall its velocity half-way; along z, where cells are
uneven, a ghost is the value on the side itself (`Air.centre` puts it there). Normal velocities on the
sides are set here too, except at an outlet, where the projection finds them. A rough side along x or y acts
through the eddy viscosity of its ghost cells: with the mirror image it makes the stress rho u*^2.
"""

from taichi_erosion.air.grid import cell_velocity
from taichi_erosion.air.wall_law import SMALLEST, rough_friction_velocity
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
def value_beyond_side(kind: ti.template(), inside, wall):
    """Value beyond a side along x or y."""
    return 2.0 * wall - inside if ti.static(kind in IMPOSED) else inside


@ti.func
def value_on_side(kind: ti.template(), inside, wall):
    return wall if ti.static(kind in IMPOSED) else inside


@ti.func
def normal_velocity(air: ti.template(), side: ti.template(), r, j, k):
    """Normal velocity on a side that is not an outlet [m s-1]."""
    value = real(0.0)
    if ti.static(air.kinds[SIDES[side]] == "inlet"):
        value = side_velocity_at(air, side, side // 2, r, j, k)
    return value


@ti.func
def cell_indices_across(axis: ti.template(), index, other, k):
    """Cell at an index along x or y (`axis`), and at `other` along the other of the two."""
    cell = ti.Vector([index, other, k])
    if ti.static(axis == 1):
        cell = ti.Vector([other, index, k])
    return cell


@ti.func
def fill_velocity_ghosts_across(air_out: ti.template(), across: ti.template(), r, other, k):
    """Velocities in ghosts and on the sides along x or y (`across`)."""
    n, low, high = ti.static(air_out.cells[across], 2 * across, 2 * across + 1)
    low_kind, high_kind = ti.static((air_out.kinds[SIDES[low]], air_out.kinds[SIDES[high]]))
    before, first = cell_indices_across(across, -1, other, k), cell_indices_across(across, 0, other, k)
    last, after = cell_indices_across(across, n - 1, other, k), cell_indices_across(across, n, other, k)
    for axis in ti.static(range(3)):
        values_out = ti.static(air_out.velocities[axis])
        start, end = values_out[r, first], values_out[r, last]
        if ti.static(low_kind == "periodic"):
            values_out[r, before] = end
            values_out[r, after] = start
        elif ti.static(axis == across):
            values_out[r, first] = normal_velocity(air_out, low, r, other, k)
            values_out[r, before] = values_out[r, first]
            if ti.static(high_kind != "outlet"):
                values_out[r, after] = 0.0
        else:
            side = side_velocity_at(air_out, low, axis, r, other, k)
            values_out[r, before] = value_beyond_side(low_kind, start, side)
            side = side_velocity_at(air_out, high, axis, r, other, k)
            values_out[r, after] = value_beyond_side(high_kind, end, side)


@ti.func
def fill_velocity_ghosts_z(air_out: ti.template(), r, i, j):
    n = air_out.cells[2]
    low, high = ti.static((air_out.kinds["z_low"], air_out.kinds["z_high"]))
    for axis in ti.static(range(2)):
        values_out = ti.static(air_out.velocities[axis])
        first, last = values_out[r, i, j, 0], values_out[r, i, j, n - 1]
        values_out[r, i, j, -1] = value_on_side(low, first, side_velocity_at(air_out, 4, axis, r, j, 0))
        values_out[r, i, j, n] = value_on_side(high, last, side_velocity_at(air_out, 5, axis, r, j, 0))
    air_out.velocity_z[r, i, j, 0] = normal_velocity(air_out, 4, r, j, 0)
    air_out.velocity_z[r, i, j, -1] = air_out.velocity_z[r, i, j, 0]
    if ti.static(high != "outlet"):
        air_out.velocity_z[r, i, j, n] = 0.0


@ti.func
def fill_velocity_ghosts_in_range(air_out: ti.template(), first, last):
    """Velocities in all ghosts of replicas from first to last; x first, since y and z read the corners."""
    nx, ny, nz = ti.static(air_out.cells[0], air_out.cells[1], air_out.cells[2])
    ti.loop_config(serialize=air_out.serial)
    for r, j, k in ti.ndrange((first, last), ny, nz):
        fill_velocity_ghosts_across(air_out, 0, r, j, k)
    ti.loop_config(serialize=air_out.serial)
    for r, i, k in ti.ndrange((first, last), nx + 2, nz):
        fill_velocity_ghosts_across(air_out, 1, r, i - 1, k)
    ti.loop_config(serialize=air_out.serial)
    for r, i, j in ti.ndrange((first, last), nx + 2, ny + 2):
        fill_velocity_ghosts_z(air_out, r, i - 1, j - 1)


@ti.kernel
def fill_velocity_ghosts(air_out: ti.template()):
    fill_velocity_ghosts_in_range(air_out, 0, air_out.count)


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
def fill_cell_ghosts_across(
    air: ti.template(), values_out: ti.template(), sign: ti.template(), across: ti.template(), r, other, k
):
    """Ghosts of a cell quantity beyond the sides along x or y (`across`)."""
    n = ti.static(air.cells[across])
    low, high = ti.static((air.kinds[SIDES[2 * across]], air.kinds[SIDES[2 * across + 1]]))
    start = values_out[r, cell_indices_across(across, 0, other, k)]
    end = values_out[r, cell_indices_across(across, n - 1, other, k)]
    values_out[r, cell_indices_across(across, -1, other, k)] = ghost_value(low, start, end, sign)
    values_out[r, cell_indices_across(across, n, other, k)] = ghost_value(high, end, start, sign)


@ti.func
def fill_cell_ghosts_z(air: ti.template(), values_out: ti.template(), outlet_sign: ti.template(), r, i, j):
    """Ghosts of a cell quantity below the floor and above the lid."""
    n = ti.static(air.cells[2])
    values_out[r, i, j, -1] = values_out[r, i, j, 0]
    values_out[r, i, j, n] = values_out[r, i, j, n - 1]
    if ti.static(air.kinds["z_high"] == "outlet" and outlet_sign < 0):
        values_out[r, i, j, n] = 0.0


@ti.func
def fill_cell_ghosts_in_range(
    outlet_sign: ti.template(), air: ti.template(), quantities_out: ti.template(), first, last
):
    """Ghosts of several cell quantities of the replicas from first to last.

    `outlet_sign` -1 makes them vanish on an outlet, as pressure does. All quantities share three loops: the
    compiler takes much longer over more loops.
    """
    nx, ny, nz = ti.static(air.cells[0], air.cells[1], air.cells[2])
    ti.loop_config(serialize=air.serial)
    for r, j, k in ti.ndrange((first, last), ny, nz):
        for values_out in ti.static(quantities_out):
            fill_cell_ghosts_across(air, values_out, outlet_sign, 0, r, j, k)
    ti.loop_config(serialize=air.serial)
    for r, i, k in ti.ndrange((first, last), nx + 2, nz):
        for values_out in ti.static(quantities_out):
            fill_cell_ghosts_across(air, values_out, outlet_sign, 1, r, i - 1, k)
    ti.loop_config(serialize=air.serial)
    for r, i, j in ti.ndrange((first, last), nx + 2, ny + 2):
        for values_out in ti.static(quantities_out):
            fill_cell_ghosts_z(air, values_out, outlet_sign, r, i - 1, j - 1)


@ti.kernel
def fill_cell_ghosts(outlet_sign: ti.template(), air: ti.template(), values_out: ti.template()):
    """Ghosts of a cell quantity of all replicas."""
    fill_cell_ghosts_in_range(outlet_sign, air, ti.static((values_out,)), 0, air.count)


@ti.func
def fill_wall_ghost(air_out: ti.template(), across: ti.template(), upper: ti.template(), r, other, k):
    """Eddy viscosity in the ghost of a wall along x or y (`across`) that gives its stress [m2 s-1]."""
    side = ti.static(2 * across + upper)
    kind, n = ti.static((air_out.kinds[SIDES[side]], air_out.cells[across]))
    if ti.static(kind in ("wall", "rough")):
        ghost = cell_indices_across(across, ti.static(n if upper else -1), other, k)
        inside = cell_indices_across(across, ti.static(n - 1 if upper else 0), other, k)
        eddy = air_out.eddy_cell[r, inside]
        value = -eddy
        if ti.static(kind == "rough"):
            velocity = cell_velocity(air_out, r, inside[0], inside[1], k)
            along = velocity[1 - across]
            speed = ti.max(ti.sqrt(along * along + velocity[2] * velocity[2]), SMALLEST)
            distance = 0.5 * air_out.numbers.width[r][across]
            friction = rough_friction_velocity(air_out, r, side, speed, distance)
            value = 2.0 * (friction * friction * distance / speed - air_out.numbers.viscosity[r]) - eddy
        air_out.eddy_cell[r, ghost] = value


@ti.kernel
def fill_wall_viscosity(air_out: ti.template()):
    """Eddy viscosity in ghosts of walls along x and y; after `fill_cell_ghosts`."""
    nx, ny, nz = ti.static(air_out.cells[0], air_out.cells[1], air_out.cells[2])
    ti.loop_config(serialize=air_out.serial)
    for r, j, k in ti.ndrange(air_out.count, ny, nz):
        for upper in ti.static(range(2)):
            fill_wall_ghost(air_out, 0, upper, r, j, k)
    ti.loop_config(serialize=air_out.serial)
    for r, i, k in ti.ndrange(air_out.count, nx, nz):
        for upper in ti.static(range(2)):
            fill_wall_ghost(air_out, 1, upper, r, i, k)
