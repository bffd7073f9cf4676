"""What the air of a grid has felt of grains and pressure in one step, booked cell by cell over its stages.

    impulse   sum t (f - beta u)          with u the velocity that a stage t of the step T ends with
    gradient  sum (t / T) grad p          with p likewise, so that both are to rounding what the air has felt

Shares of cells in what a face feels are those of `sweep.exchange_share`, halves by volume.
"""

from taichi_erosion.core.ti import ti


@ti.func
def cell_air(air: ti.template(), r, i, j, k):
    """Mean velocity of the air in a cell [m s-1]: of its two faces along each axis."""
    u = air.velocity_x[r, i, j, k] + air.velocity_x[r, i + 1, j, k]
    v = air.velocity_y[r, i, j, k] + air.velocity_y[r, i, j + 1, k]
    w = air.velocity_z[r, i, j, k] + air.velocity_z[r, i, j, k + 1]
    return 0.5 * ti.Vector([u, v, w])


@ti.func
def pressure_slope(air: ti.template(), r, i, j, k):
    """Mean gradient of the pressure in a cell [Pa m-1]; beside floor and lid that of its other face."""
    (p,) = ti.static((air.pressure,))
    width, height = air.numbers.width[r], air.height[r, k]
    below, above = p[r, i, j, k] - p[r, i, j, k - 1], p[r, i, j, k + 1] - p[r, i, j, k]
    if k == 0:
        below = above
    if k == air.cells[2] - 1:
        above = below
    along = (p[r, i + 1, j, k] - p[r, i - 1, j, k]) / width[0]
    across = (p[r, i, j + 1, k] - p[r, i, j - 1, k]) / width[1]
    return 0.5 * ti.Vector([along, across, (below + above) / height])


@ti.func
def book_stage(air_out: ti.template(), r, share):
    """Note what the cells have felt of grains and pressure in one stage."""
    time = share * air_out.numbers.time_step[r]
    for i in range(air_out.cells[0]):
        for j in range(air_out.cells[1]):
            for k in range(air_out.cells[2]):
                drag = air_out.exchange_coefficient[r, i, j, k] * cell_air(air_out, r, i, j, k)
                gained = time * (air_out.exchange_force[r, i, j, k] - drag)
                slope = pressure_slope(air_out, r, i, j, k) + air_out.numbers.driving_gradient[r]
                air_out.impulse[r, i, j, k] = air_out.impulse[r, i, j, k] + gained
                air_out.gradient[r, i, j, k] = air_out.gradient[r, i, j, k] + share * slope


@ti.func
def open_book(air_out: ti.template(), r, i, j):
    """Begin a step with nothing booked in one column."""
    for k in range(air_out.cells[2]):
        air_out.impulse[r, i, j, k] = 0.0 * air_out.impulse[r, i, j, k]
        air_out.gradient[r, i, j, k] = 0.0 * air_out.gradient[r, i, j, k]


@ti.func
def remember_void_of(air_out: ti.template(), r, i, j):
    """Take the void fraction of one column as it stands for that of the step before."""
    for k in range(air_out.cells[2]):
        air_out.void_before[r, i, j, k] = air_out.void_fraction[r, i, j, k]
