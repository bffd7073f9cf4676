"""The cheapest air: one column of cells (1 x 1 x nz), horizontally averaged, that one worker advances.

    rho eps du/dt = d(eps tau)/dz + f - beta u - eps dp/dx,    tau = rho (nu + l^2 |du/dz|) du/dz

for u and v alike, with eps the void fraction, f and beta what the grains exert, l the mixing length. Over
the column, stress at the lid less stress at the floor is what grains and mean pressure gradient take out, to
rounding. All of the drag and the share `implicitness` of the stress are taken at the new time, by one sweep
up and one down: the step is the flow's, not the grid's or the drag's. The slow vertical breathing of air that
moving grains displace is left out; eddy viscosities are those of the old time.

Reference: Duran, Andreotti & Claudin (2012), Phys. Fluids 24, 103306, section II.
"""

from taichi_erosion.air.wall_law import risen_root, rough_floor_length, wall_friction_velocity
from taichi_erosion.core.air_setup import SIDES
from taichi_erosion.core.ti import ti

real = ti.f64

FLOOR, LID = SIDES.index("z_low"), SIDES.index("z_high")


@ti.func
def speed_at(air: ti.template(), r, k):
    """Horizontal speed in cell k [m s-1]."""
    u, v = air.velocity_x[r, 0, 0, k], air.velocity_y[r, 0, 0, k]
    return ti.sqrt(u * u + v * v)


@ti.func
def spread_column_eddies(air_out: ti.template(), r):
    """Mixing length and eddy viscosity on the inner faces, from the floor upwards."""
    (numbers,) = ti.static((air_out.numbers,))
    root = real(0.0)
    for k in range(1, air_out.cells[2]):
        speed, below = speed_at(air_out, r, k - 1), air_out.height[r, k - 1]
        length = real(0.0)
        if ti.static(air_out.kinds["z_low"] == "rough"):
            length = rough_floor_length(air_out, r, k)
        else:
            nu = numbers.viscosity[r]
            root = risen_root(root, speed, below, nu, numbers.sublayer[r], numbers.karman[r])
            length = root * root
        length = ti.min(length, numbers.length_most[r])
        du = air_out.velocity_x[r, 0, 0, k] - air_out.velocity_x[r, 0, 0, k - 1]
        dv = air_out.velocity_y[r, 0, 0, k] - air_out.velocity_y[r, 0, 0, k - 1]
        gap = air_out.centre[r, k] - air_out.centre[r, k - 1]
        air_out.length[r, 0, 0, k] = length
        air_out.eddy_face[r, 0, 0, k] = length * length * ti.sqrt(du * du + dv * dv) / gap


@ti.func
def face_conductance(air: ti.template(), r, k):
    """Stress over density and velocity difference across an inner face [m s-1]."""
    share = real(1.0)
    if ti.static(air.model.exchange):
        share = 0.5 * (air.void_fraction[r, 0, 0, k] + air.void_fraction[r, 0, 0, k - 1])
    gap = air.centre[r, k] - air.centre[r, k - 1]
    return share * (air.numbers.viscosity[r] + air.eddy_face[r, 0, 0, k]) / gap


@ti.func
def side_conductance(air: ti.template(), kind: ti.template(), r, side, k):
    """Stress over density and velocity of cell k seen from floor or lid [m s-1]."""
    (numbers,) = ti.static((air.numbers,))
    distance = 0.5 * air.height[r, k]
    value = real(0.0)
    if ti.static(kind == "wall"):
        value = numbers.viscosity[r] / distance
    if ti.static(kind == "rough"):
        wall = numbers.side_velocity[r, side]
        u, v = air.velocity_x[r, 0, 0, k] - wall[0], air.velocity_y[r, 0, 0, k] - wall[1]
        speed = ti.max(ti.sqrt(u * u + v * v), 2.0**-60)
        roughness, nu = numbers.side_roughness[r, side], numbers.viscosity[r]
        friction = wall_friction_velocity(speed, distance, roughness, nu, numbers.karman[r])
        value = friction * friction / speed
    if ti.static(air.model.exchange):
        value *= air.void_fraction[r, 0, 0, k]
    return value


@ti.func
def lower_conductance(air: ti.template(), r, k):
    """Conductance of the face below cell k, the floor included [m s-1]."""
    value = real(0.0)
    if k == 0:
        value = side_conductance(air, air.kinds["z_low"], r, FLOOR, 0)
    elif k == air.cells[2]:
        value = side_conductance(air, air.kinds["z_high"], r, LID, air.cells[2] - 1)
    else:
        value = face_conductance(air, r, k)
    return value


@ti.func
def neighbour_velocity(air: ti.template(), r, k):
    """Velocity in cell k [m s-1], beyond the ends that of floor and lid."""
    velocity = ti.Vector([air.velocity_x[r, 0, 0, k], air.velocity_y[r, 0, 0, k]])
    if k < 0 or k == air.cells[2]:
        wall = air.numbers.side_velocity[r, ti.select(k < 0, FLOOR, LID)]
        velocity = ti.Vector([wall[0], wall[1]])
    return velocity


@ti.func
def source(air: ti.template(), r, k):
    """Acceleration by mean pressure gradient, grains and a lid under stress, times eps [m s-2]."""
    (numbers,) = ti.static((air.numbers,))
    gradient = numbers.driving_gradient[r]
    pull = -ti.Vector([gradient[0], gradient[1]]) / numbers.density[r]
    if ti.static(air.model.exchange):
        force = air.exchange_force[r, 0, 0, k]
        pull *= air.void_fraction[r, 0, 0, k]
        pull += ti.Vector([force[0], force[1]]) / numbers.density[r]
    if ti.static(air.kinds["z_high"] == "stress"):
        if k == air.cells[2] - 1:
            pull[0] += numbers.friction_velocity[r] ** 2 / air.height[r, k]
    return pull


@ti.func
def sweep_up(air_out: ti.template(), r, dt):
    """Eliminate what lies below each cell; velocities then hold the reduced right-hand sides."""
    theta = air_out.numbers.implicitness[r]
    below = lower_conductance(air_out, r, 0)
    here = neighbour_velocity(air_out, r, 0)
    jump_below = here - neighbour_velocity(air_out, r, -1)
    reduced = neighbour_velocity(air_out, r, -1)
    factor = real(0.0)
    for k in range(air_out.cells[2]):
        over = neighbour_velocity(air_out, r, k + 1)
        above, jump = lower_conductance(air_out, r, k + 1), over - here
        inertia, drag = air_out.height[r, k] / dt, real(0.0)
        if ti.static(air_out.model.exchange):
            inertia *= air_out.void_fraction[r, 0, 0, k]
            rate = air_out.exchange_coefficient[r, 0, 0, k] / air_out.numbers.density[r]
            drag = air_out.height[r, k] * rate
        right = inertia * here + (1.0 - theta) * (above * jump - below * jump_below)
        right += air_out.height[r, k] * source(air_out, r, k)
        pivot = 1.0 / (inertia + drag + theta * (above + below * (1.0 - factor)))
        reduced = (right + theta * below * reduced) * pivot
        factor = theta * above * pivot
        air_out.velocity_x[r, 0, 0, k] = reduced[0]
        air_out.velocity_y[r, 0, 0, k] = reduced[1]
        air_out.elimination[r, 0, 0, k] = factor
        below, jump_below, here = above, jump, over


@ti.func
def sweep_down(air_out: ti.template(), r):
    """Put the velocities in from the lid downwards."""
    over = neighbour_velocity(air_out, r, air_out.cells[2])
    for upside in range(air_out.cells[2]):
        k = air_out.cells[2] - 1 - upside
        over = neighbour_velocity(air_out, r, k) + air_out.elimination[r, 0, 0, k] * over
        air_out.velocity_x[r, 0, 0, k] = over[0]
        air_out.velocity_y[r, 0, 0, k] = over[1]
    close_column(air_out, air_out.kinds["z_low"], r, FLOOR, -1, 0)
    close_column(air_out, air_out.kinds["z_high"], r, LID, air_out.cells[2], air_out.cells[2] - 1)


@ti.func
def close_column(air_out: ti.template(), kind: ti.template(), r, side, ghost, cell):
    """Velocity on floor or lid, for whoever interpolates: that of a wall, else that of the nearest cell."""
    if ti.static(kind in ("wall", "rough")):
        wall = air_out.numbers.side_velocity[r, side]
        air_out.velocity_x[r, 0, 0, ghost], air_out.velocity_y[r, 0, 0, ghost] = wall[0], wall[1]
    else:
        air_out.velocity_x[r, 0, 0, ghost] = air_out.velocity_x[r, 0, 0, cell]
        air_out.velocity_y[r, 0, 0, ghost] = air_out.velocity_y[r, 0, 0, cell]


@ti.func
def advance_column(air_out: ti.template(), r, dt):
    """Advance the column of replica r by dt [s]; safe to call from the one worker that runs r."""
    if ti.static(air_out.model.closure == "mixing_length"):
        spread_column_eddies(air_out, r)
    sweep_up(air_out, r, ti.cast(dt, real))
    sweep_down(air_out, r)
    air_out.numbers.time[r] = air_out.numbers.time[r] + dt


@ti.kernel
def advance_columns(
    # parameters
    steps: ti.i32,
    # out
    air_out: ti.template(),
):
    """Advance the columns of all replicas by so many of their own time steps."""
    for r in range(air_out.count):
        for _ in range(steps):
            advance_column(air_out, r, air_out.numbers.time_step[r])
