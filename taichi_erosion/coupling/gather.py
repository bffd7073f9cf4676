"""Gather: the air around each grain, averaged over its volume, and the effects on single grains.

The pressure force on a grain of volume V is the buoyancy  -rho V g  and that of the gradient in the flow,
-V grad p: of a grid of several columns as it was in the last step, of a single one where air rises through
the bed and carries grains.

Random numbers depend on their keys alone: seed, grain and step.

Reference: Jarzynski & Olano (2020), J. Comput. Graph. Tech. 9, 21 (pcg3d); Box & Muller (1958), Ann. Math.
Stat. 29, 610.
"""

from math import pi

from taichi_erosion.core.effect_device import add_gusts, advance_states, total_drag_factor, total_grain_force
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.deposit import SPHERE_VOLUME, cell_wind, column_share, share_below, sphere_layers
from taichi_erosion.grains.cells import wrapped_position
from taichi_erosion.grains.integrate import SPHERE
from taichi_erosion.grains.state import side_start

real = ti.f64

MULTIPLIER = 1664525
INCREMENT = 1013904223
UNIT = 2.0**-32  # of a 32-bit number
HALF = 2.0**-33  # keeps the logarithm away from zero


@ti.func
def scramble_bits(key):
    """Three scrambled 32-bit numbers of three."""
    v = key * ti.u32(MULTIPLIER) + ti.u32(INCREMENT)
    for _ in ti.static(range(2)):
        v[0] = v[0] + v[1] * v[2]
        v[1] = v[1] + v[2] * v[0]
        v[2] = v[2] + v[0] * v[1]
        v = v ^ (v >> ti.u32(16))
    return v


@ti.func
def uniform_numbers(seed, ident, step):
    """Three numbers between 0 and 1."""
    key = ti.Vector([ti.cast(seed, ti.u32), ti.cast(ident, ti.u32), ti.cast(step, ti.u32)])
    return ti.cast(scramble_bits(key), ti.f64) * UNIT + HALF


@ti.func
def normal_numbers(seed, ident, step):
    """Three standard normal numbers."""
    u = uniform_numbers(seed, ident, step)
    w = uniform_numbers(seed, -1 - ident, step)
    length = ti.sqrt(-2.0 * ti.log(u[0]))
    other = ti.sqrt(-2.0 * ti.log(w[0]))
    turn, more = 2.0 * pi * u[1], 2.0 * pi * w[1]
    return ti.cast(ti.Vector([length * ti.cos(turn), length * ti.sin(turn), other * ti.cos(more)]), float)


@ti.func
def gather_column(coupling: ti.template(), r, column, height, radius):
    """Velocity [m s-1], void fraction, -grad p [Pa m-1] and shear [s-1] around a grain in one column."""
    air, exchange = ti.static((coupling.air, coupling.exchange))
    i, j = column[0], column[1]
    first, last = sphere_layers(air, r, height, radius)
    velocity = ti.Vector([real(0.0), real(0.0), real(0.0)])
    void, pressure_force, below = real(0.0), 0.0 * velocity, real(0.0)
    for k in range(first, last + 1):
        above = ti.select(k == last, real(1.0), share_below(air, r, height, radius, k + 1))
        share = above - below
        velocity += share * cell_wind(air, r, column, k)
        void += share * air.void_fraction[r, i, j, k]
        if ti.static(coupling.has_through_flow):
            velocity[2] += share * exchange.rise_velocity[r, k]
            pressure_force[2] += share * exchange.pressure_lift[r, k]
        if ti.static(not air.is_column):
            pressure_force -= share * air.gradient[r, i, j, k]
        below = above
    span = air.centre[r, last + 1] - air.centre[r, first - 1]
    shear = (cell_wind(air, r, column, last + 1)[0] - cell_wind(air, r, column, first - 1)[0]) / span
    return velocity, void, pressure_force, shear


@ti.func
def gather_flow(coupling: ti.template(), r, position, radius):
    """Velocity [m s-1], void fraction, -grad p [Pa m-1] and shear [s-1] around a grain."""
    velocity = ti.Vector([real(0.0), real(0.0), real(0.0)])
    pressure_force, void, shear = 0.0 * velocity, real(0.0), real(0.0)
    for corner in range(coupling.air.columns_per_grain):
        column, share = column_share(coupling.air, r, position, corner)
        wind, open_share, gradient, slope = gather_column(coupling, r, column, position[2], radius)
        velocity += share * wind
        void += share * open_share
        pressure_force += share * gradient
        shear += share * slope
    return velocity, void, pressure_force, shear


@ti.func
def gather_drag(world_out: ti.template(), coupling: ti.template(), r, i):
    """Drag and pressure force on the grain at place i; returns void fraction [1] and shear [s-1]."""
    grains, frozen_out, air = ti.static((world_out.grains, world_out.frozen_drag, coupling.air))
    radius, inverse = grains.radius[i], grains.mass_inverse[i]
    position = wrapped_position(grains, world_out.replicas, r, i)
    exact, void_mean, pressure_force, shear = gather_flow(coupling, r, position, ti.cast(radius, real))
    air_velocity = ti.cast(exact, float)
    density = ti.cast(air.numbers.density[r], float)
    viscosity = ti.cast(air.numbers.viscosity[r], float)
    slip = (air_velocity - grains.velocity[i]).norm()
    void = ti.cast(void_mean, float)
    frozen_out.air_velocity[i] = air_velocity
    frozen_out.drag_rate[i] = coupling.drag_law(slip, radius, 1.0 / inverse, density, viscosity, void)
    volume = SPHERE_VOLUME * radius * radius * radius
    force = -density * world_out.replicas.gravity[r]
    force += ti.cast(pressure_force, float)
    frozen_out.steady_acceleration[i] = volume * inverse * force
    return void, ti.cast(shear, float)


@ti.func
def grain_for_effects(world: ti.template(), coupling: ti.template(), r, i, void, shear):
    """The grain at place i and the air around it, as effects read them."""
    grains, replicas = ti.static((world.grains, world.replicas))
    position = ti.cast(wrapped_position(grains, replicas, r, i), float)
    grain = coupling.grain_type(
        position=position,
        velocity=grains.velocity[i],
        spin=grains.spin[i],
        radius=grains.radius[i],
        mass=1.0 / grains.mass_inverse[i],
        air_shear=shear,
        void_fraction=void,
        height=position[2] - ti.cast(coupling.exchange.surface[r], float),
        period=ti.cast(replicas.period[r], float),
        noise=normal_numbers(coupling.exchange.seed[r], grains.ident[i], replicas.step[r]),
        interval=replicas.time_step[r] * coupling.exchange.look_steps[r],
        time=replicas.time_step[r] * replicas.step[r],
        chance=ti.cast(uniform_numbers(coupling.exchange.seed[r], 0, 0)[0], float),
        drag_factor=1.0,
    )
    if ti.static(world.has_external_forces):
        grain.air_velocity = world.frozen_drag.air_velocity[i]
    if ti.static(coupling.has_air):
        grain.air_density = ti.cast(coupling.air.numbers.density[r], float)
        grain.air_viscosity = grain.air_density * ti.cast(coupling.air.numbers.viscosity[r], float)
        grain.friction_velocity = ti.cast(coupling.air.numbers.friction_velocity[r], float)
    return grain


@ti.func
def apply_grain_effects(world_out: ti.template(), r, i, grain_out: ti.template()):
    """Add forces, torques and drag of the grain effects to the frozen terms of the grain at place i.

    Writes grain_out.drag_factor and, where there are gusts, grain_out.air_velocity, grain_out.air_shear.
    """
    effects, grains, frozen_out = ti.static(
        (world_out.grain_effects, world_out.grains, world_out.frozen_drag)
    )
    gust_drag = 0.0 * grain_out.velocity
    if ti.static(effects.any_drag):
        grain_out.drag_factor = total_drag_factor(effects, r, grain_out)
        frozen_out.drag_rate[i] = grain_out.drag_factor * frozen_out.drag_rate[i]
    if ti.static(effects.any_gust):
        gust_drag = add_gusts(effects, r, grain_out)
    force, torque = total_grain_force(effects, r, grain_out, i)
    force += gust_drag
    frozen_out.steady_acceleration[i] = frozen_out.steady_acceleration[i] + force * grains.mass_inverse[i]
    frozen_out.steady_spin_rate[i] = torque * (SPHERE * grains.mass_inverse[i] / grains.radius[i] ** 2)


@ti.func
def gather_partition(world_out: ti.template(), coupling: ti.template(), r, p, updates_state):
    """Frozen terms of the grains of one partition; effects update their state where `updates_state`."""
    (replicas,) = ti.static((world_out.replicas,))
    base = side_start(world_out.grains, r, replicas.side[r])
    for rank in range(replicas.bounds[r, p], replicas.bounds[r, p + 1]):
        gather_grain(world_out, coupling, r, base + rank, updates_state)


@ti.func
def gather_grain(world_out: ti.template(), coupling: ti.template(), r, i, updates_state):
    """Frozen terms of the grain at place i; effects update its state where `updates_state`."""
    (frozen_out,) = ti.static((world_out.frozen_drag,))
    void, shear = 1.0, 0.0
    if ti.static(world_out.has_external_forces):
        frozen_out.steady_acceleration[i] = 0.0 * frozen_out.steady_acceleration[i]
    if ti.static(coupling.has_air):
        void, shear = gather_drag(world_out, coupling, r, i)
    if ti.static(world_out.grain_effects.any or world_out.has_state):
        grain = grain_for_effects(world_out, coupling, r, i, void, shear)
        if ti.static(world_out.has_state):
            if updates_state:
                advance_states(world_out.pair_effects, r, grain, i)
                advance_states(world_out.grain_effects, r, grain, i)
        if ti.static(world_out.grain_effects.any):
            apply_grain_effects(world_out, r, i, grain)
