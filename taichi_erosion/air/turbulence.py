"""Eddy viscosity: the turbulence closure, one of three chosen at assembly.

mixing_length:  nu_t = l^2 |S| on the lower faces of cells; l(z) grows from the floor by
                `wall_law.root_length_slope` (over a rough floor `wall_law.rough_mixing_length`), and never
                exceeds kappa times the distance to another wall, the stated largest length, or the stated
                share of the layer's thickness (Escudier: 0.09)
smagorinsky:    nu_t = l^2 |S| in cells,  1/l^2 = 1/(C_s D)^2 + 1/(kappa d (1 - exp(-d u*/(A+ nu))))^2, with
                D the cube root of the cell's volume, d the height over the floor, u* its friction velocity;
                over grains, those of bed and wind: in the bed nu_t is 0

Reference: Escudier (1966), Imperial College report TWF/TN/1; Mason & Thomson (1992), J. Fluid Mech. 242, 51;
van Driest (1956), J. Aeronaut. Sci. 23, 1007.
"""

from taichi_erosion.air.wall_law import FLOOR, SMALLEST, floor_mixing_length, rough_friction_velocity
from taichi_erosion.core.ti import ti

real = ti.f64

EDGE = 0.9900000095367432  # of the speed aloft at which a layer ends [1]; the f32 next to 0.99


@ti.func
def horizontal_velocity(air: ti.template(), r, i, j, k):
    """Horizontal velocity at the centre of a cell [m s-1]."""
    u = 0.5 * (air.velocity_x[r, i, j, k] + air.velocity_x[r, i + 1, j, k])
    v = 0.5 * (air.velocity_y[r, i, j, k] + air.velocity_y[r, i, j + 1, k])
    return ti.Vector([u, v])


@ti.func
def squared_strain_in_cell(air: ti.template(), r, i, j, k):
    """Share of 2 S_ij S_ij that lies in cells [s-2]: all but du/dz + dw/dx and dv/dz + dw/dy."""
    width = air.numbers.width[r]
    ux = (air.velocity_x[r, i + 1, j, k] - air.velocity_x[r, i, j, k]) / width[0]
    vy = (air.velocity_y[r, i, j + 1, k] - air.velocity_y[r, i, j, k]) / width[1]
    wz = (air.velocity_z[r, i, j, k + 1] - air.velocity_z[r, i, j, k]) / air.height[r, k]
    u, v = ti.static(air.velocity_x, air.velocity_y)
    uy = u[r, i, j + 1, k] + u[r, i + 1, j + 1, k] - u[r, i, j - 1, k] - u[r, i + 1, j - 1, k]
    vx = v[r, i + 1, j, k] + v[r, i + 1, j + 1, k] - v[r, i - 1, j, k] - v[r, i - 1, j + 1, k]
    shear = 0.25 * (uy / width[1] + vx / width[0])
    return 2.0 * (ux * ux + vy * vy + wz * wz) + shear * shear


@ti.func
def face_strain_squared(air: ti.template(), r, i, j, k):
    """(du/dz + dw/dx)^2 + (dv/dz + dw/dy)^2 on the lower face of a cell [s-2]; 0 on floor and lid."""
    value = real(0.0)
    if 0 < k < air.cells[2]:
        width = air.numbers.width[r]
        gap = air.centre[r, k] - air.centre[r, k - 1]
        slope = (horizontal_velocity(air, r, i, j, k) - horizontal_velocity(air, r, i, j, k - 1)) / gap
        w = ti.static(air.velocity_z)
        slope[0] += 0.5 * (w[r, i + 1, j, k] - w[r, i - 1, j, k]) / width[0]
        slope[1] += 0.5 * (w[r, i, j + 1, k] - w[r, i, j - 1, k]) / width[1]
        value = slope.dot(slope)
    return value


@ti.func
def layer_mixing_limit(air: ti.template(), r, i, j):
    """Largest mixing length [m] that the thickness of the layer over the floor allows."""
    limit = air.numbers.length_most[r]
    if air.numbers.length_share[r] > 0.0:
        fastest = real(0.0)
        for k in range(air.cells[2]):
            fastest = ti.max(fastest, horizontal_velocity(air, r, i, j, k).norm())
        k = 0
        while k < air.cells[2] - 1 and horizontal_velocity(air, r, i, j, k).norm() < EDGE * fastest:
            k += 1
        thickness = air.centre[r, k] - air.face[r, 0]
        limit = ti.min(limit, air.numbers.length_share[r] * thickness)
    return limit


@ti.func
def wall_mixing_limit(air: ti.template(), r, j, k):
    """Largest mixing length [m] that walls beside and above allow."""
    (numbers,) = ti.static((air.numbers,))
    limit = numbers.length_most[r]
    width = numbers.width[r][1]
    if ti.static(air.kinds["y_low"] in ("wall", "rough")):
        limit = ti.min(limit, numbers.karman[r] * (j + 0.5) * width)
    if ti.static(air.kinds["y_high"] in ("wall", "rough")):
        limit = ti.min(limit, numbers.karman[r] * (air.cells[1] - j - 0.5) * width)
    if ti.static(air.kinds["z_high"] in ("wall", "rough")):
        limit = ti.min(limit, numbers.karman[r] * (air.face[r, air.cells[2]] - air.face[r, k]))
    return limit


@ti.func
def set_mixing_length_viscosity(air_out: ti.template(), r, i, j):
    """Mixing length and eddy viscosity on the inner faces of a column of cells."""
    root = real(0.0)
    most = layer_mixing_limit(air_out, r, i, j)
    below = squared_strain_in_cell(air_out, r, i, j, 0)
    for k in range(1, air_out.cells[2]):
        speed = horizontal_velocity(air_out, r, i, j, k - 1).norm()
        length, root_here = floor_mixing_length(air_out, r, k, root, speed)
        length, root = ti.min(ti.min(length, most), wall_mixing_limit(air_out, r, j, k)), root_here
        here = squared_strain_in_cell(air_out, r, i, j, k)
        strain = face_strain_squared(air_out, r, i, j, k) + 0.5 * (below + here)
        air_out.length[r, i, j, k] = length
        air_out.eddy_face[r, i, j, k] = length * length * ti.sqrt(strain)
        below = here


@ti.func
def floor_friction_velocity(air: ti.template(), r, i, j):
    """Friction velocity of the floor below a column of cells [m s-1]; 0 over a floor without friction."""
    friction = real(0.0)
    if ti.static(air.kinds["z_low"] in ("wall", "rough")):
        wall = air.numbers.side_velocity[r, FLOOR]
        relative = horizontal_velocity(air, r, i, j, 0) - ti.Vector([wall[0], wall[1]])
        distance, nu = 0.5 * air.height[r, 0], air.numbers.viscosity[r]
        speed = ti.sqrt(relative[0] * relative[0] + relative[1] * relative[1])
        friction = ti.sqrt(nu * speed / distance)
        if ti.static(air.kinds["z_low"] == "rough"):
            friction = rough_friction_velocity(air, r, FLOOR, speed, distance)
    return friction


@ti.func
def set_smagorinsky_viscosity(air_out: ti.template(), r, i, j):
    """Eddy viscosity of scales below the grid, in cells."""
    (numbers,) = ti.static((air_out.numbers,))
    friction, ground = floor_friction_velocity(air_out, r, i, j), air_out.face[r, 0]
    if ti.static(air_out.model.exchange):
        friction, ground = numbers.friction_velocity[r], numbers.ground[r]
    area = numbers.width[r][0] * numbers.width[r][1]
    for k in range(air_out.cells[2]):
        volume = area * air_out.height[r, k]
        inverse = 1.0 / (numbers.smagorinsky[r] * ti.exp(ti.log(volume) / real(3.0)))
        squares = inverse * inverse
        if ti.static(air_out.kinds["z_low"] in ("wall", "rough")):
            distance = ti.max(air_out.centre[r, k] - ground, SMALLEST)
            damping = 1.0 - ti.exp(-distance * friction / (numbers.van_driest[r] * numbers.viscosity[r]))
            near = numbers.karman[r] * distance * ti.max(damping, SMALLEST)
            squares += 1.0 / (near * near)
        upwards = face_strain_squared(air_out, r, i, j, k) + face_strain_squared(air_out, r, i, j, k + 1)
        strain = squared_strain_in_cell(air_out, r, i, j, k) + 0.5 * upwards
        air_out.eddy_cell[r, i, j, k] = ti.sqrt(strain) / squares


@ti.func
def interpolate_viscosity(air_out: ti.template(), r, i, j):
    """Cells take the mean of their faces, or faces of their cells, whichever the closure does not give."""
    n, face_out, cell_out = ti.static(air_out.cells[2], air_out.eddy_face, air_out.eddy_cell)
    if ti.static(air_out.model.closure == "mixing_length"):
        face_out[r, i, j, 0] = 0.0
        face_out[r, i, j, n] = face_out[r, i, j, n - 1]
        for k in range(n):
            cell_out[r, i, j, k] = 0.5 * (face_out[r, i, j, k] + face_out[r, i, j, k + 1])
    else:
        for k in range(1, n):
            face_out[r, i, j, k] = 0.5 * (cell_out[r, i, j, k] + cell_out[r, i, j, k - 1])


@ti.func
def set_eddy_viscosity(air_out: ti.template(), r, i, j):
    if ti.static(air_out.model.closure == "mixing_length"):
        set_mixing_length_viscosity(air_out, r, i, j)
    else:
        set_smagorinsky_viscosity(air_out, r, i, j)
    interpolate_viscosity(air_out, r, i, j)
