"""Preconditioned conjugate gradients on the finest level; one multigrid cycle is the preconditioner.

    A psi = b,    p = z + (r.z / r_before.z_before) p,    a = r.z / p.A p,    psi += a p,    r -= a A p

with A the negative Laplacian of `multigrid`, b and then the residual r in `levels.right_side`, the
preconditioned residual z in `levels.solution`, p the search direction. `solve_pressure` iterates all replicas
in parallel until the last has converged; a converged one does not change. `solve_replica_pressure` does the
same for one replica on one thread.

Reference: Saad (2003), Iterative Methods for Sparse Linear Systems, 2nd ed., algorithm 9.1.
"""

from taichi_erosion.air.grid import Air, apply_to_all_columns, apply_to_columns
from taichi_erosion.air.pressure.multigrid import cycle, cycle_replica, negative_laplacian, neighbour_columns
from taichi_erosion.air.pressure.projection import relative_divergence, sum_over_columns
from taichi_erosion.core.errors import SimulationStopped
from taichi_erosion.core.ti import ti

real = ti.f64

TOLERANCE = 1e-9  # largest divergence of a cell times the time step [1]
REPLICA_TOLERANCE = 1e-7  # of grids over grains, likewise [1]
ITERATIONS_MOST = 100


@ti.func
def sum_residual_product(air_out: ti.template(), r, i, j):
    """Product r.z of residual and preconditioned residual in one column."""
    total, c = real(0.0), i * air_out.cells[1] + j
    for k in range(air_out.cells[2]):
        total += air_out.levels.right_side[r, c, k] * air_out.levels.solution[r, c, k]
    air_out.krylov.column_sum[r, c] = total


@ti.func
def set_direction_weight(air_out: ti.template(), r):
    """Product r.z of a replica, and its ratio to the one before."""
    (krylov_out,) = ti.static((air_out.krylov,))
    product, before = sum_over_columns(air_out, r), krylov_out.residual_product[r]
    krylov_out.direction_weight[r] = ti.select(before > 0.0, product / ti.max(before, ti.f64(1e-300)), 0.0)
    krylov_out.residual_product[r] = product


@ti.func
def set_step_length(air_out: ti.template(), r):
    """Step length of a replica along the search direction."""
    (krylov_out,) = ti.static((air_out.krylov,))
    curvature, product = sum_over_columns(air_out, r), krylov_out.residual_product[r]
    krylov_out.step_length[r] = ti.select(curvature > 0.0, product / ti.max(curvature, ti.f64(1e-300)), 0.0)


@ti.func
def set_direction(air_out: ti.template(), r, i, j):
    """Next search direction in one column."""
    (krylov_out,) = ti.static((air_out.krylov,))
    c = i * air_out.cells[1] + j
    for k in range(air_out.cells[2]):
        share = krylov_out.direction_weight[r] * krylov_out.direction[r, c, k]
        krylov_out.direction[r, c, k] = air_out.levels.solution[r, c, k] + share


@ti.func
def set_matrix_product(air_out: ti.template(), r, i, j):
    """A p in one column, and its product with p."""
    (krylov_out,) = ti.static((air_out.krylov,))
    total, c = real(0.0), i * air_out.cells[1] + j
    neighbours = neighbour_columns(air_out.levels, 0, i, j)
    for k in range(air_out.cells[2]):
        product = negative_laplacian(air_out.levels, krylov_out.direction, r, c, neighbours, k)
        krylov_out.laplacian[r, c, k] = product
        total += product * krylov_out.direction[r, c, k]
    krylov_out.column_sum[r, c] = total


@ti.func
def update_solution(air_out: ti.template(), r, i, j):
    """Psi and residual of one column after the step along the search direction, and its worst cell."""
    (krylov_out,) = ti.static((air_out.krylov,))
    worst, length, c = real(0.0), krylov_out.step_length[r], i * air_out.cells[1] + j
    for k in range(air_out.cells[2]):
        step = length * krylov_out.direction[r, c, k]
        krylov_out.psi[r, c, k] = krylov_out.psi[r, c, k] + step
        residual = air_out.levels.right_side[r, c, k] - length * krylov_out.laplacian[r, c, k]
        air_out.levels.right_side[r, c, k] = residual
        worst = ti.max(worst, relative_divergence(air_out, r, k, residual))
    krylov_out.column_worst[r, c] = worst


@ti.func
def max_or_nan(largest, value):
    """The larger of two; NaN where the second is, and it stays."""
    return value if not value <= largest else largest


@ti.func
def worst_cell_divergence(air: ti.template(), r):
    """Largest divergence of a cell of one replica times the time step [1], or NaN."""
    worst = real(0.0)
    for c in range(ti.static(air.cells[0] * air.cells[1])):
        worst = max_or_nan(worst, air.krylov.column_worst[r, c])
    return worst


@ti.func
def solve_replica_pressure(air_out: ti.template(), r):
    """The solve of one replica on one thread; returns its worst cell [1]."""
    air_out.krylov.residual_product[r] = 0.0
    worst, rounds = worst_cell_divergence(air_out, r), 0
    while worst > REPLICA_TOLERANCE and rounds < ITERATIONS_MOST:
        cycle_replica(air_out.levels, r)
        apply_to_columns(sum_residual_product, air_out, r, r + 1)
        set_direction_weight(air_out, r)
        apply_to_columns(set_direction, air_out, r, r + 1)
        apply_to_columns(set_matrix_product, air_out, r, r + 1)
        set_step_length(air_out, r)
        apply_to_columns(update_solution, air_out, r, r + 1)
        worst = worst_cell_divergence(air_out, r)
        rounds += 1
    return worst


@ti.kernel
def apply_to_all_replicas(task: ti.template(), air_out: ti.template()):
    """One device function applied to every replica, in parallel."""
    ti.loop_config(serialize=air_out.serial_replicas)
    for r in range(air_out.count):
        task(air_out, r)


@ti.kernel
def largest_of_columns(worst: ti.template()) -> ti.f64:
    """Largest of all columns of all replicas; NaN where one is NaN."""
    largest = real(0.0)
    ti.loop_config(serialize=True)
    for r, column in ti.ndrange(worst.shape[0], worst.shape[1]):
        largest = max_or_nan(largest, worst[r, column])
    return largest


def solve_pressure(air: Air, tolerance: float = TOLERANCE) -> int:
    """Psi of all replicas for the right-hand side on the finest level; returns the iterations.

    Raises SimulationStopped where the flow has blown up or the solve does not converge.
    """
    air.krylov.residual_product.fill(0.0)
    worst = largest_of_columns(air.krylov.column_worst)
    for iteration in range(ITERATIONS_MOST):
        if worst <= tolerance:
            return iteration
        if worst != worst:
            break
        cycle(air.levels)
        apply_to_all_columns(sum_residual_product, air)
        apply_to_all_replicas(set_direction_weight, air)
        apply_to_all_columns(set_direction, air)
        apply_to_all_columns(set_matrix_product, air)
        apply_to_all_replicas(set_step_length, air)
        apply_to_all_columns(update_solution, air)
        worst = largest_of_columns(air.krylov.column_worst)
    fault = f"the pressure of the air was not found (air appears: {worst:.3g} of a cell in a step)"
    raise SimulationStopped(f"{fault}; likely cause: the time step is too long for the wind and the cells")
