"""What a grain feels of its surroundings: the air, averaged over its volume, and effects on single grains.

The pull of the pressure gradient on a grain of volume V is that of the weight of the air it displaces,
-rho V g, and, where air rises through the bed, of the gradient that carries grains.
"""

from math import pi

from taichi_erosion.core.effect_device import push_of, update_memory
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling.noise import normal, uniform
from taichi_erosion.coupling.slices import layer_range, share_below
from taichi_erosion.grains.cells import position_of
from taichi_erosion.grains.integrate import SPHERE
from taichi_erosion.grains.state import partition_first, side_block

real = ti.f64

SPHERE_VOLUME = 4.0 * pi / 3.0  # of radius 1 [1]


@ti.func
def felt(around: ti.template(), r, height, radius):
    """Velocity [m s-1], void fraction, upward pressure gradient [Pa m-1] and shear [s-1] around a grain."""
    air, exchange = ti.static((around.air, around.exchange))
    first, last = layer_range(air, r, height, radius)
    velocity = ti.Vector([real(0.0), real(0.0), real(0.0)])
    void, lift, below = real(0.0), real(0.0), real(0.0)
    for k in range(first, last + 1):
        above = ti.select(k == last, real(1.0), share_below(air, r, height, radius, k + 1))
        share = above - below
        velocity[0] += share * air.velocity_x[r, 0, 0, k]
        velocity[1] += share * air.velocity_y[r, 0, 0, k]
        void += share * air.void_fraction[r, 0, 0, k]
        if ti.static(around.rising):
            velocity[2] += share * exchange.rise[r, k]
            lift += share * exchange.lift[r, k]
        below = above
    rise = air.centre[r, last + 1] - air.centre[r, first - 1]
    shear = (air.velocity_x[r, 0, 0, last + 1] - air.velocity_x[r, 0, 0, first - 1]) / rise
    return velocity, void, lift, shear


@ti.func
def feel_air(world_out: ti.template(), around: ti.template(), r, i, height):
    """Hold drag and buoyancy of the grain at place i; returns void fraction [1] and shear [s-1]."""
    grains, held_out, air = ti.static((world_out.grains, world_out.held, around.air))
    radius, inverse = grains.radius[i], grains.mass_inverse[i]
    exact, void, lift, shear = felt(around, r, height, ti.cast(radius, real))
    drift = ti.cast(exact, float)
    density = ti.cast(air.numbers.density[r], float)
    viscosity = ti.cast(air.numbers.viscosity[r], float)
    slip = (drift - grains.velocity[i]).norm()
    open_share = ti.cast(void, float)
    held_out.drift[i] = drift
    held_out.drift_rate[i] = around.drag_rate(slip, radius, 1.0 / inverse, density, viscosity, open_share)
    volume = SPHERE_VOLUME * radius * radius * radius
    push = -density * world_out.replicas.gravity[r]
    push[2] += ti.cast(lift, float)
    held_out.push[i] = volume * inverse * push
    return open_share, ti.cast(shear, float)


@ti.func
def seen(world: ti.template(), around: ti.template(), r, i, open_share, shear):
    """The grain at place i and the air around it, as effects see them."""
    grains, replicas = ti.static((world.grains, world.replicas))
    position = ti.cast(position_of(grains, replicas, r, i), float)
    grain = around.grain_type(
        position=position,
        velocity=grains.velocity[i],
        spin=grains.spin[i],
        radius=grains.radius[i],
        mass=1.0 / grains.mass_inverse[i],
        air_shear=shear,
        void_fraction=open_share,
        height=position[2] - ti.cast(around.exchange.surface[r], float),
        period=ti.cast(replicas.period[r], float),
        noise=normal(around.exchange.seed[r], grains.ident[i], replicas.step[r]),
        interval=replicas.time_step[r] * around.exchange.look_steps[r],
        time=replicas.time_step[r] * replicas.step[r],
        chance=ti.cast(uniform(around.exchange.seed[r], 0, 0)[0], float),
    )
    if ti.static(world.driven):
        grain.air_velocity = world.held.drift[i]
    if ti.static(around.windy):
        grain.air_density = ti.cast(around.air.numbers.density[r], float)
        grain.air_viscosity = grain.air_density * ti.cast(around.air.numbers.viscosity[r], float)
        grain.friction_velocity = ti.cast(around.air.numbers.friction_velocity[r], float)
    return grain


@ti.func
def feel_effects(world_out: ti.template(), r, i, grain: ti.template()):
    """Add forces and torques of the grain effects to what the grain at place i holds."""
    grains, held_out = ti.static((world_out.grains, world_out.held))
    force, torque = push_of(world_out.grain_effects, r, grain, i)
    held_out.push[i] = held_out.push[i] + force * grains.mass_inverse[i]
    held_out.twist[i] = torque * (SPHERE * grains.mass_inverse[i] / grains.radius[i] ** 2)


@ti.func
def feel_partition(world_out: ti.template(), around: ti.template(), r, p, counts):
    """Renew what the grains of one partition hold; a look that `counts` is remembered by the effects."""
    grains, held_out, replicas = ti.static((world_out.grains, world_out.held, world_out.replicas))
    base = side_block(grains, r, replicas.side[r])
    for rank in range(partition_first(replicas, r, p), partition_first(replicas, r, p + 1)):
        i = base + rank
        open_share, shear = 1.0, 0.0
        if ti.static(world_out.driven):
            held_out.push[i] = 0.0 * held_out.push[i]
        if ti.static(around.windy):
            height = position_of(grains, world_out.replicas, r, i)[2]
            open_share, shear = feel_air(world_out, around, r, i, height)
        if ti.static(world_out.grain_effects.any or world_out.remembers):
            grain = seen(world_out, around, r, i, open_share, shear)
            if ti.static(world_out.remembers):
                if counts:
                    update_memory(world_out.pair_effects, r, grain, i)
                    update_memory(world_out.grain_effects, r, grain, i)
            if ti.static(world_out.grain_effects.any):
                feel_effects(world_out, r, i, grain)
