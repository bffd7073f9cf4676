"""Conjugate gradients on the finest grid, preconditioned by one multigrid cycle; every replica its own.

All replicas iterate together until the last has converged; one that has nothing left to do stays as it is.

Reference: Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd ed., algorithm 9.1.
"""

from taichi_erosion.air.grid import Air, around
from taichi_erosion.air.pressure.multigrid import applied, cycle
from taichi_erosion.air.pressure.projection import share_of_cell, total_of
from taichi_erosion.core.errors import SimulationStopped
from taichi_erosion.core.ti import ti

real = ti.f64

TOLERANCE = 1e-9  # air that may appear in a cell in one step over its volume [1]
ITERATIONS_MOST = 100


@ti.func
def product_of_column(air_out: ti.template(), r, i, j):
    """Product of rest and preconditioned rest in one column."""
    total, c = real(0.0), i * air_out.cells[1] + j
    for k in range(air_out.cells[2]):
        total += air_out.grids.right[r, c, k] * air_out.grids.solution[r, c, k]
    air_out.krylov.partial[r, c] = total


@ti.func
def product_of_replica(air_out: ti.template(), r):
    """Product of rest and preconditioned rest, and its ratio to the one before."""
    (krylov_out,) = ti.static((air_out.krylov,))
    product, before = total_of(air_out, r), krylov_out.product[r]
    krylov_out.ratio[r] = ti.select(before > 0.0, product / ti.max(before, ti.f64(1e-300)), 0.0)
    krylov_out.product[r] = product


@ti.func
def step_of_replica(air_out: ti.template(), r):
    """Length of the step along the search direction."""
    (krylov_out,) = ti.static((air_out.krylov,))
    bend = total_of(air_out, r)
    krylov_out.step[r] = ti.select(bend > 0.0, krylov_out.product[r] / ti.max(bend, ti.f64(1e-300)), 0.0)


@ti.func
def turn_column(air_out: ti.template(), r, i, j):
    """Next search direction in one column."""
    (krylov_out,) = ti.static((air_out.krylov,))
    c = i * air_out.cells[1] + j
    for k in range(air_out.cells[2]):
        kept = krylov_out.ratio[r] * krylov_out.search[r, c, k]
        krylov_out.search[r, c, k] = air_out.grids.solution[r, c, k] + kept


@ti.func
def image_of_column(air_out: ti.template(), r, i, j):
    """Image of the search direction in one column, and its product with it."""
    (krylov_out,) = ti.static((air_out.krylov,))
    total, c = real(0.0), i * air_out.cells[1] + j
    beside = around(air_out.grids, 0, i, j)
    for k in range(air_out.cells[2]):
        image = applied(air_out.grids, krylov_out.search, r, c, beside, k)
        krylov_out.image[r, c, k] = image
        total += image * krylov_out.search[r, c, k]
    krylov_out.partial[r, c] = total


@ti.func
def move_column(air_out: ti.template(), r, i, j):
    """Step along the search direction in one column; note its worst cell."""
    (krylov_out,) = ti.static((air_out.krylov,))
    worst, length, c = real(0.0), krylov_out.step[r], i * air_out.cells[1] + j
    for k in range(air_out.cells[2]):
        moved = length * krylov_out.search[r, c, k]
        krylov_out.found[r, c, k] = krylov_out.found[r, c, k] + moved
        rest = air_out.grids.right[r, c, k] - length * krylov_out.image[r, c, k]
        air_out.grids.right[r, c, k] = rest
        worst = ti.max(worst, share_of_cell(air_out, r, k, rest))
    krylov_out.worst[r, c] = worst


@ti.func
def worse_of(found, value):
    """The larger of two; NaN where the second is, and it stays."""
    return value if not value <= found else found


@ti.kernel
def multiply(
    # out
    air_out: ti.template(),
):
    """Product of rest and preconditioned rest, column by column."""
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        product_of_column(air_out, r, i, j)


@ti.kernel
def renew_product(
    # out
    air_out: ti.template(),
):
    """Product of rest and preconditioned rest, and its ratio to the one before."""
    for r in range(air_out.count):
        product_of_replica(air_out, r)


@ti.kernel
def turn(
    # out
    air_out: ti.template(),
):
    """Next search direction."""
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        turn_column(air_out, r, i, j)


@ti.kernel
def look_ahead(
    # out
    air_out: ti.template(),
):
    """Image of the search direction, and its product with it."""
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        image_of_column(air_out, r, i, j)


@ti.kernel
def renew_step(
    # out
    air_out: ti.template(),
):
    """Length of the step along the search direction."""
    for r in range(air_out.count):
        step_of_replica(air_out, r)


@ti.kernel
def move(
    # out
    air_out: ti.template(),
):
    """Step along the search direction; note the worst cell of every column."""
    for r, i, j in ti.ndrange(air_out.count, air_out.cells[0], air_out.cells[1]):
        move_column(air_out, r, i, j)


@ti.kernel
def largest(
    # in
    worst: ti.template(),
) -> ti.f64:
    """Largest of all columns of all replicas; NaN where one is NaN."""
    found = real(0.0)
    ti.loop_config(serialize=True)
    for r, column in ti.ndrange(worst.shape[0], worst.shape[1]):
        found = worse_of(found, worst[r, column])
    return found


def solve(air: Air, tolerance: float = TOLERANCE) -> int:
    """Find psi for the right-hand side on the finest grid; returns the iterations.

    Raises SimulationStopped where the flow has blown up or the solve stands still.
    """
    air.krylov.product.fill(0.0)
    worst = largest(air.krylov.worst)
    for iteration in range(ITERATIONS_MOST):
        if worst <= tolerance:
            return iteration
        if worst != worst:
            break
        cycle(air.grids)
        multiply(air)
        renew_product(air)
        turn(air)
        look_ahead(air)
        renew_step(air)
        move(air)
        worst = largest(air.krylov.worst)
    raise SimulationStopped(
        f"the pressure of the air was not found (air appears: {worst:.3g} of a cell in a step); "
        "likely cause: the time step is too long for the wind and the cells"
    )
