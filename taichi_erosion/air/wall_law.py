"""Laws near walls, shared by every launch style and grid: wall stress, and mixing length over a floor.

Reference for the numbers behind smooth walls: Schlichting & Gersten (2017), Boundary-Layer Theory, 17.1.2.
"""

from taichi_erosion.core.air_setup import SIDES
from taichi_erosion.core.ti import ti

real = ti.f64

FLOOR = SIDES.index("z_low")
SMOOTH = 0.109375  # z0 u* / nu of a smooth wall, exp(-kappa C) = 0.11 within its own scatter [1]
WALL_ROUNDS = 6  # fixed-point rounds of the wall stress; each gains a factor of ten or more
SMALLEST = 2.0**-60  # keeps divisions by a speed or a length finite; binary, so exact in any precision


@ti.func
def wall_friction_velocity(speed, distance, roughness, viscosity, karman):
    """Friction velocity u* [m s-1] of a wall, from the speed in the nearest cell.

    U = (u* / kappa) ln(1 + z / z0e),   z0e = z0 + 0.11 nu / u*

    with U the speed [m s-1] at distance z [m] and z0 the roughness length [m]. Where the viscous sublayer
    reaches the cell, u*^2 = nu U / z is larger and counts.
    """
    laminar = ti.sqrt(viscosity * speed / distance)
    friction = ti.max(laminar, SMALLEST)
    for _ in range(WALL_ROUNDS):
        effective = roughness + SMOOTH * viscosity / friction
        friction = ti.max(karman * speed / ti.log(1.0 + distance / effective), SMALLEST)
    return ti.max(friction, laminar)


@ti.func
def rough_friction_velocity(air: ti.template(), r, side, speed, distance):
    """Friction velocity of a rough side [m s-1] by `wall_friction_velocity`."""
    (numbers,) = ti.static((air.numbers,))
    roughness, nu = numbers.side_roughness[r, side], numbers.viscosity[r]
    return wall_friction_velocity(speed, distance, roughness, nu, numbers.karman[r])


@ti.func
def wall_conductance(air: ti.template(), kind: ti.template(), r, side, speed, distance):
    """Stress over density and speed [m s-1]: nu / z at a wall, u*^2 / U at a rough one, else 0."""
    value = real(0.0)
    if ti.static(kind in ("wall", "inlet")):
        value = air.numbers.viscosity[r] / distance
    if ti.static(kind == "rough"):
        moving = ti.max(speed, SMALLEST)
        friction = rough_friction_velocity(air, r, side, moving, distance)
        value = friction * friction / moving
    return value


@ti.func
def rough_mixing_length(below, above, roughness, karman):
    """Mixing length between two cells over a rough floor [m]: kappa times the logarithmic mean height.

    l = kappa (z_2 - z_1) / ln((z_2 + z0) / (z_1 + z0))

    with z_1, z_2 the heights of their centres [m]. It tends to kappa (z + z0) as cells shrink, and gives the
    log law its exact stress on any cells, where the height of the face would give up to a fifth too much.
    """
    return karman * (above - below) / ti.log((above + roughness) / (below + roughness))


@ti.func
def root_length_slope(root, rate, karman):
    """Slope of sqrt(l) along z [m-1/2]; the root is taken because l = 0 would stay zero for ever.

    dl/dz = kappa (1 - exp(-sqrt(u l / (R_c nu))))   ->   ds/dz = (kappa / 2) (1 - exp(-a s)) / s

    with s = sqrt(l) and a = sqrt(u / (R_c nu)), `rate` [m-1/2].

    Reference: Duran, Andreotti & Claudin (2012), Phys. Fluids 24, 103306.
    """
    exponent = rate * root
    slope = rate * (1.0 - 0.5 * exponent)
    if exponent > 0.0009765625:  # 2^-10: below, the series is exact to 2e-7
        slope = (1.0 - ti.exp(-exponent)) / root
    return 0.5 * karman * slope


@ti.func
def integrate_root_length(root, speed, rise, viscosity, sublayer, karman):
    """sqrt(l) [m1/2] after a rise [m] through air of a speed [m s-1]; midpoint rule."""
    rate = ti.sqrt(speed / (sublayer * viscosity))
    middle = root + 0.5 * rise * root_length_slope(root, rate, karman)
    return root + rise * root_length_slope(middle, rate, karman)


@ti.func
def floor_mixing_length(air: ti.template(), r, k, root_below, speed):
    """Mixing length [m] on the lower face of layer k over the floor, and its root [m1/2].

    Over a rough floor that of `rough_mixing_length`; else grown from `root_below` on the face below through
    layer k - 1, where the air has `speed` [m s-1].
    """
    (numbers,) = ti.static((air.numbers,))
    root, length = root_below, real(0.0)
    if ti.static(air.kinds["z_low"] == "rough"):
        below, above = air.centre[r, k - 1] - air.face[r, 0], air.centre[r, k] - air.face[r, 0]
        length = rough_mixing_length(below, above, numbers.side_roughness[r, FLOOR], numbers.karman[r])
    else:
        rise, nu = air.height[r, k - 1], numbers.viscosity[r]
        root = integrate_root_length(root_below, speed, rise, nu, numbers.sublayer[r], numbers.karman[r])
        length = root * root
    return length, root
