"""Momentum and pressure gradient of one step, cell by cell and summed over its stages, for the grains' side.

    impulse   sum t (f - beta u)          with u the velocity at the end of a stage t of the step T
    gradient  sum (t / T) grad p          with p likewise, so that both are to rounding what acted on the air

The share of a cell in a face is that of `momentum.grain_share`, halves by volume.
"""

from taichi_erosion.air.grid import cell_velocity
from taichi_erosion.core.ti import ti


@ti.func
def cell_pressure_gradient(air: ti.template(), r, i, j, k):
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
def add_stage_exchange(air_out: ti.template(), r, i, j, share):
    """Impulse and pressure gradient of one column, plus those of a stage."""
    time = share * air_out.numbers.time_step[r]
    for k in range(air_out.cells[2]):
        drag = air_out.exchange_coefficient[r, i, j, k] * cell_velocity(air_out, r, i, j, k)
        gained = time * (air_out.exchange_force[r, i, j, k] - drag)
        slope = cell_pressure_gradient(air_out, r, i, j, k) + air_out.numbers.driving_gradient[r]
        air_out.impulse[r, i, j, k] = air_out.impulse[r, i, j, k] + gained
        air_out.gradient[r, i, j, k] = air_out.gradient[r, i, j, k] + share * slope


@ti.func
def reset_exchange(air_out: ti.template(), r, i, j):
    """Zero impulse and pressure gradient of one column."""
    for k in range(air_out.cells[2]):
        air_out.impulse[r, i, j, k] = 0.0 * air_out.impulse[r, i, j, k]
        air_out.gradient[r, i, j, k] = 0.0 * air_out.gradient[r, i, j, k]
