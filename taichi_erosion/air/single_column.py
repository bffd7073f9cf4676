"""The cheapest air: one column of cells (1 x 1 x nz), horizontally averaged, advanced by one thread.

    rho eps du/dt = d(eps tau)/dz + f - beta u - eps dp/dx,    tau = rho (nu + l^2 |du/dz|) du/dz

for u and v alike, with eps the void fraction, f and beta the exchange with grains, l the mixing length. Over
the column, stress at the lid less stress at the floor is the drag of grains and mean pressure gradient, to
rounding. All of the drag and the share `implicitness` of the stress are taken at the new time, so the step is
limited neither by the grid nor by the drag. Vertical flow of air that moving grains displace is neglected;
eddy viscosities are those of the old time.

Conductances, sources, wall law, mixing length over the floor and the elimination are those of the grid. Its
own are the one solve for both velocities, which have the same coefficients, and the strain, which is du/dz
alone.

Reference: Duran, Andreotti & Claudin (2012), Phys. Fluids 24, 103306, section II.
"""

from taichi_erosion.air.boundary import fill_velocity_ghosts_z
from taichi_erosion.air.implicit_z import eliminate_row, right_side_of_row
from taichi_erosion.air.momentum import body_force, conductance_below, drag_rate
from taichi_erosion.air.wall_law import floor_mixing_length
from taichi_erosion.core.ti import ti

real = ti.f64


@ti.func
def column_velocity(air: ti.template(), r, k):
    """Horizontal velocity in cell k [m s-1], in ghosts that of floor and lid."""
    return ti.Vector([air.velocity_x[r, 0, 0, k], air.velocity_y[r, 0, 0, k]])


@ti.func
def set_column_viscosity(air_out: ti.template(), r):
    """Mixing length and eddy viscosity on the inner faces, from the floor upwards."""
    root = real(0.0)
    for k in range(1, air_out.cells[2]):
        below = column_velocity(air_out, r, k - 1)
        speed = ti.sqrt(below[0] * below[0] + below[1] * below[1])
        length, root_here = floor_mixing_length(air_out, r, k, root, speed)
        length, root = ti.min(length, air_out.numbers.length_most[r]), root_here
        jump = column_velocity(air_out, r, k) - below
        gap = air_out.centre[r, k] - air_out.centre[r, k - 1]
        air_out.length[r, 0, 0, k] = length
        rise = ti.sqrt(jump[0] * jump[0] + jump[1] * jump[1])
        air_out.eddy_face[r, 0, 0, k] = length * length * rise / gap


@ti.func
def solve_column(air_out: ti.template(), r, dt):
    """Both velocities after dt [s]: elimination upwards, substitution downwards."""
    n, theta = ti.static(air_out.cells[2]), air_out.numbers.implicitness[r]
    below, factor = conductance_below(air_out, r, 0, 0, 0, 0), real(0.0)
    here, reduced = column_velocity(air_out, r, 0), column_velocity(air_out, r, -1)
    jump_below = here - reduced
    for k in range(n):
        next_above, above = column_velocity(air_out, r, k + 1), conductance_below(air_out, r, 0, 0, k + 1, 0)
        jump = next_above - here
        inertia = air_out.height[r, k] / dt
        if ti.static(air_out.model.exchange):
            inertia *= air_out.void_fraction[r, 0, 0, k]
        force = ti.Vector([body_force(air_out, r, 0, 0, k, 0), body_force(air_out, r, 0, 0, k, 1)])
        right = right_side_of_row(theta, inertia, below, above, here, jump_below, jump)
        right += air_out.height[r, k] * force
        drag = air_out.height[r, k] * drag_rate(air_out, r, 0, 0, k, 0)
        reduced, factor = eliminate_row(theta, inertia, drag, below, above, right, reduced, factor)
        air_out.velocity_x[r, 0, 0, k], air_out.velocity_y[r, 0, 0, k] = reduced[0], reduced[1]
        air_out.elimination[r, 0, 0, k] = factor
        below, jump_below, here = above, jump, next_above
    over = column_velocity(air_out, r, n)
    for down in range(n):
        k = n - 1 - down
        over = column_velocity(air_out, r, k) + air_out.elimination[r, 0, 0, k] * over
        air_out.velocity_x[r, 0, 0, k], air_out.velocity_y[r, 0, 0, k] = over[0], over[1]


@ti.func
def advance_column(air_out: ti.template(), r, dt):
    """The column of replica r after dt [s]; safe to call from the one thread that runs r."""
    if ti.static(air_out.model.closure == "mixing_length"):
        set_column_viscosity(air_out, r)
    fill_velocity_ghosts_z(air_out, r, 0, 0)
    solve_column(air_out, r, ti.cast(dt, real))
    fill_velocity_ghosts_z(air_out, r, 0, 0)
    air_out.numbers.time[r] = air_out.numbers.time[r] + dt


@ti.kernel
def advance_columns(steps: ti.i32, air_out: ti.template()):
    """The columns of all replicas after so many of their own time steps."""
    for r in range(air_out.count):
        for _ in range(steps):
            advance_column(air_out, r, air_out.numbers.time_step[r])
