"""The air at a point: velocity, its gradient and the pressure gradient, interpolated on the staggered grid.

Each velocity component is linear between the faces it lives on; along z it joins centres of cells, and the
ghosts carry what floor and lid impose. Points outside the box see its nearest layer.
"""

from taichi_erosion.core.ti import ti

real = ti.f64


@ti.func
def layer_of(air: ti.template(), r, z):
    """Index k of the layer of cells that holds a height [m], by bisection; the nearest one outside."""
    low, high = 0, air.cells[2]
    while high - low > 1:
        middle = (low + high) // 2
        if air.face[r, middle] <= z:
            low = middle
        else:
            high = middle
    return low


@ti.func
def cell_along(air: ti.template(), r, axis: ti.template(), x):
    """Index of the cell that holds a coordinate along x or y [m]; the nearest one outside."""
    width, low = air.numbers.width[r][axis], air.numbers.low[r][axis]
    index = ti.cast(ti.floor((x - low) / width), ti.i32)
    return ti.min(ti.max(index, 0), air.cells[axis] - 1)


@ti.func
def cell_of(air: ti.template(), r, position):
    """Cell (i, j, k) that holds a position [m]; the nearest one outside."""
    i, j = 0, 0
    if ti.static(air.cells[0] > 1):
        i = cell_along(air, r, 0, position[0])
    if ti.static(air.cells[1] > 1):
        j = cell_along(air, r, 1, position[1])
    return ti.Vector([i, j, layer_of(air, r, position[2])])


@ti.func
def cell_volume(air: ti.template(), r, k):
    """Volume of a cell of layer k [m3]."""
    width = air.numbers.width[r]
    return width[0] * width[1] * air.height[r, k]


@ti.func
def between_centres(air: ti.template(), r, z, k):
    """Lower layer of the two whose centres enclose a height z [m] in layer k, their gap [m], weight [1]."""
    base = k
    if z < air.centre[r, k]:
        base = k - 1
    gap = air.centre[r, base + 1] - air.centre[r, base]
    weight = (z - air.centre[r, base]) / gap
    return base, gap, ti.min(ti.max(weight, 0.0), 1.0)


@ti.func
def beside(air: ti.template(), r, axis: ti.template(), x, cell, on_faces: ti.template()):
    """Lower place of the two that enclose a coordinate along x or y, and the weight of the upper [1]."""
    place = (x - air.numbers.low[r][axis]) / air.numbers.width[r][axis] - cell
    base = cell
    if ti.static(not on_faces):
        place -= 0.5
        if place < 0.0:
            base, place = cell - 1, place + 1.0
    return base, ti.min(ti.max(place, 0.0), 1.0)


@ti.func
def along_z(values: ti.template(), r, i, j, k, weight):
    """Value between places k and k + 1 of a column."""
    return values[r, i, j, k] + weight * (values[r, i, j, k + 1] - values[r, i, j, k])


@ti.func
def blend(values: ti.template(), r, base, weight):
    """Trilinear value above a lower corner."""
    i, j, k = base[0], base[1], base[2]
    near = along_z(values, r, i, j, k, weight[2])
    near += weight[0] * (along_z(values, r, i + 1, j, k, weight[2]) - near)
    far = along_z(values, r, i, j + 1, k, weight[2])
    far += weight[0] * (along_z(values, r, i + 1, j + 1, k, weight[2]) - far)
    return near + weight[1] * (far - near)


@ti.func
def surroundings(air: ti.template(), r, position, axis: ti.template()):
    """Lower corner, weights and distances of the eight values around a position [m].

    The values are those of the velocity along `axis`, or of a cell's quantity for axis 3.
    """
    cell = cell_of(air, r, position)
    i, x_weight = beside(air, r, 0, position[0], cell[0], axis == 0)
    j, y_weight = beside(air, r, 1, position[1], cell[1], axis == 1)
    k, gap, z_weight = cell[2], air.height[r, cell[2]], real(0.0)
    if ti.static(axis == 2):
        z_weight = ti.min(ti.max((position[2] - air.face[r, k]) / gap, 0.0), 1.0)
    else:
        k, gap, z_weight = between_centres(air, r, position[2], cell[2])
    width = air.numbers.width[r]
    distances = ti.Vector([width[0], width[1], gap])
    return ti.Vector([i, j, k]), ti.Vector([x_weight, y_weight, z_weight]), distances


@ti.func
def slope_of(values: ti.template(), r, base, weight, distances):
    """Gradient of a trilinear value."""
    slope = 0.0 * distances
    for axis in ti.static(range(3)):
        low, high = weight, weight
        low[axis], high[axis] = 0.0, 1.0
        rise = blend(values, r, base, high) - blend(values, r, base, low)
        slope[axis] = rise / distances[axis]
    return slope


@ti.func
def air_velocity_at(air: ti.template(), r, position):
    """Velocity of the air at a position [m s-1]."""
    velocity = ti.Vector([real(0.0), real(0.0), real(0.0)])
    if ti.static(air.is_column):
        k, _, weight = between_centres(air, r, position[2], layer_of(air, r, position[2]))
        velocity[0] = along_z(air.velocity_x, r, 0, 0, k, weight)
        velocity[1] = along_z(air.velocity_y, r, 0, 0, k, weight)
    else:
        for axis in ti.static(range(3)):
            base, weight, _ = surroundings(air, r, position, axis)
            velocity[axis] = blend(air.velocities[axis], r, base, weight)
    return velocity


@ti.func
def velocity_gradient_at(air: ti.template(), r, position):
    """Gradient of the velocity at a position [s-1]: row i, column j holds du_i/dx_j."""
    gradient = ti.Matrix.zero(real, 3, 3)
    if ti.static(air.is_column):
        k, gap, _ = between_centres(air, r, position[2], layer_of(air, r, position[2]))
        gradient[0, 2] = (air.velocity_x[r, 0, 0, k + 1] - air.velocity_x[r, 0, 0, k]) / gap
        gradient[1, 2] = (air.velocity_y[r, 0, 0, k + 1] - air.velocity_y[r, 0, 0, k]) / gap
    else:
        for row in ti.static(range(3)):
            base, weight, distances = surroundings(air, r, position, row)
            slope = slope_of(air.velocities[row], r, base, weight, distances)
            for column in ti.static(range(3)):
                gradient[row, column] = slope[column]
    return gradient


@ti.func
def pressure_gradient_at(air: ti.template(), r, position):
    """Gradient of the pressure at a position [Pa m-1], its mean included; without weight of the air."""
    gradient = air.numbers.driving_gradient[r]
    if ti.static(not air.is_column):
        base, weight, distances = surroundings(air, r, position, 3)
        gradient += slope_of(air.pressure, r, base, weight, distances)
    return gradient
