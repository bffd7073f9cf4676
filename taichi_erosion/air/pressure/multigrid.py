"""Multigrid cycle for the pressure: lines along z are solved exactly, x and y are coarsened.

The pressure equation is  sum over faces of c (psi_neighbour - psi) - c_out psi = right side,  with c the
conductance of a face [m], area over distance times mobility, and c_out that to outlets. Coarser levels
have half as many cells along x, y or both and all layers along z. The columns of all levels are numbered on,
finest level first, so that one field holds all levels.

Line solves make the cycle indifferent to how cells are stretched along z. On each level columns are relaxed
in two colours, (i + j) even and odd, downwards even first and upwards odd first, so that the cycle is a
symmetric operator, as conjugate gradients need. The coarsest level, whose numbers of columns are odd, gets
symmetric Gauss-Seidel sweeps, one thread a replica. Corrections are interpolated linearly, 3/4 and 1/4;
restriction is the transpose of that.

Reference: Trottenberg, Oosterlee & Schueller (2001), Multigrid, sections 2.8, 4.7 and 5.1.
"""

from typing import Any

import numpy as np

from taichi_erosion.core.air_setup import AirSetup
from taichi_erosion.core.device import is_serial_loop
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record, is_host_memory, write_field

real = ti.f64

WIDTH_RATIO_MOST = 1.5  # cells along the other axis may be so much wider and still be merged with these [1]
SHIFT = 2.0**-24  # of the diagonal of a line: a closed box fixes pressure up to a constant only [1]
SWEEPS_PER_COLUMN = 2  # symmetric sweeps on the coarsest level, over the longer side of it
SWEEPS_MOST = 12


@device_record
class MultigridLevels:
    """Conductances of low faces, right-hand sides and solutions by replica, column and layer."""

    number: int  # of levels
    serial: tuple[bool, ...]  # whether loops over the lines of a level run on the calling thread
    serial_replicas: bool  # the same of loops over replicas
    columns: tuple[int, ...]  # cells along the longer of x and y of every level
    periodic_x: bool
    periodic_y: bool
    shape: Any  # i32 by level: first column, cells along x and y, cells that merge in the next along x and y
    conductance_x: Any  # [m]
    conductance_y: Any  # [m]
    conductance_z: Any  # [m], one layer more than the cells
    outlet_conductance: Any  # [m]
    inverse_pivot: Any  # of the lines along z [m-1]
    right_side: Any  # [m3 s-1]
    solution: Any  # [m2 s-1]
    residual: Any  # [m3 s-1]


def merge_factors(nx: int, ny: int, width_x: float, width_y: float) -> tuple[int, int]:
    """Cells that merge along x and y: two where their number is even and they are not already the wider."""
    can_x, can_y = nx % 2 == 0, ny % 2 == 0
    by_x = can_x and (width_x <= WIDTH_RATIO_MOST * width_y or ny == 1)
    by_y = can_y and (width_y <= WIDTH_RATIO_MOST * width_x or nx == 1)
    if not (by_x or by_y):
        by_x, by_y = can_x, can_y
    return (2 if by_x else 1), (2 if by_y else 1)


def allocate_levels(setup: AirSetup, replicas: int) -> MultigridLevels:
    """Fields of all levels, and the first column of each; of the last level no cells merge."""
    nx, ny, _ = setup.cells
    width_x, width_y = ((setup.high[axis] - setup.low[axis]) / setup.cells[axis] for axis in range(2))
    periodic_x, periodic_y = (setup.sides[name].kind == "periodic" for name in ("x_low", "y_low"))
    rows, by_x, by_y = list[tuple[int, int, int, int]](), 0, 0
    while not by_x == by_y == 1:
        by_x, by_y = merge_factors(nx, ny, width_x, width_y)
        if (periodic_x and nx > 1 and nx % 2) or (periodic_y and ny > 1 and ny % 2):
            by_x, by_y = 1, 1  # two colours do not fit an odd period
        rows.append((nx, ny, by_x, by_y))
        nx, ny, width_x, width_y = nx // by_x, ny // by_y, width_x * by_x, width_y * by_y
    shapes = np.array(rows)
    sizes = shapes[:, 0] * shapes[:, 1]
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    cells = (replicas, int(sizes.sum()), setup.cells[2])
    names = ("conductance_x", "conductance_y", "outlet_conductance", "inverse_pivot")
    levels = MultigridLevels(
        number=len(shapes),
        serial=tuple(is_serial_loop(replicas * int(size)) for size in sizes),
        serial_replicas=is_host_memory(),
        columns=tuple(int(n) for n in shapes[:, :2].max(axis=1)),
        periodic_x=periodic_x,
        periodic_y=periodic_y,
        shape=ti.field(ti.i32, shape=(len(shapes), 5)),
        conductance_z=ti.field(real, shape=(*cells[:2], cells[2] + 1)),
        **{name: ti.field(real, shape=cells) for name in (*names, "right_side", "solution", "residual")},
    )
    write_field(levels.shape, np.column_stack([first, shapes]))
    return levels


@ti.func
def column_of(levels: ti.template(), level, i, j):
    """Number of a column of a level; beyond an end that of the opposite one, where conductances are zero."""
    nx, ny = levels.shape[level, 1], levels.shape[level, 2]
    return levels.shape[level, 0] + ((i + nx) % nx) * ny + (j + ny) % ny


@ti.func
def neighbour_columns(levels: ti.template(), level, i, j):
    """Columns to the west, east, south and north."""
    west, east = column_of(levels, level, i - 1, j), column_of(levels, level, i + 1, j)
    return ti.Vector([west, east, column_of(levels, level, i, j - 1), column_of(levels, level, i, j + 1)])


@ti.func
def neighbour_sum(levels: ti.template(), values: ti.template(), r, c, beside, k):
    """Sum of conductance times value over the four neighbours beside a cell."""
    total = levels.conductance_x[r, c, k] * values[r, beside[0], k]
    total += levels.conductance_x[r, beside[1], k] * values[r, beside[1], k]
    total += levels.conductance_y[r, c, k] * values[r, beside[2], k]
    return total + levels.conductance_y[r, beside[3], k] * values[r, beside[3], k]


@ti.func
def matrix_diagonal(levels: ti.template(), r, c, beside, k):
    """Sum of all conductances of a cell [m]."""
    total = levels.conductance_x[r, c, k] + levels.conductance_x[r, beside[1], k]
    total += levels.conductance_y[r, c, k] + levels.conductance_y[r, beside[3], k]
    total = total + levels.conductance_z[r, c, k] + levels.conductance_z[r, c, k + 1]
    return total + levels.outlet_conductance[r, c, k]


@ti.func
def negative_laplacian(levels: ti.template(), values: ti.template(), r, c, beside, k):
    """Minus the left-hand side of the pressure equation: positive definite."""
    total = matrix_diagonal(levels, r, c, beside, k) * values[r, c, k]
    total -= neighbour_sum(levels, values, r, c, beside, k)
    if k > 0:
        total -= levels.conductance_z[r, c, k] * values[r, c, k - 1]
    if k < values.shape[2] - 1:
        total -= levels.conductance_z[r, c, k + 1] * values[r, c, k + 1]
    return total


@ti.func
def coarsen_conductances(levels_out: ti.template(), level, r, i, j):
    """Conductances of one column of a coarser level: parallel faces add, doubled distances halve."""
    by_x, by_y = levels_out.shape[level - 1, 3], levels_out.shape[level - 1, 4]
    nx, ny, c = levels_out.shape[level, 1], levels_out.shape[level, 2], column_of(levels_out, level, i, j)
    for k in range(levels_out.right_side.shape[2]):
        along_x, along_y, along_z, to_outlet = real(0.0), real(0.0), real(0.0), real(0.0)
        for part in range(by_x * by_y):
            a, b = part // by_y, part % by_y
            fine = column_of(levels_out, level - 1, by_x * i + a, by_y * j + b)
            along_x += ti.select(a == 0, levels_out.conductance_x[r, fine, k], 0.0)
            along_y += ti.select(b == 0, levels_out.conductance_y[r, fine, k], 0.0)
            along_z += levels_out.conductance_z[r, fine, k]
            to_outlet += levels_out.outlet_conductance[r, fine, k]
        # a single column of a period is its own neighbour: no difference of pressure across its faces
        levels_out.conductance_x[r, c, k] = ti.select(nx > 1, along_x / by_x, 0.0)
        levels_out.conductance_y[r, c, k] = ti.select(ny > 1, along_y / by_y, 0.0)
        levels_out.conductance_z[r, c, k] = along_z
        levels_out.outlet_conductance[r, c, k] = to_outlet


@ti.func
def factor_line(levels_out: ti.template(), level, r, i, j):
    """Inverse pivots of one line."""
    c, neighbours = column_of(levels_out, level, i, j), neighbour_columns(levels_out, level, i, j)
    below = real(0.0)
    for k in range(levels_out.right_side.shape[2]):
        here = matrix_diagonal(levels_out, r, c, neighbours, k)
        here += SHIFT * here  # not times 1 + SHIFT, which single precision rounds to 1
        lower = levels_out.conductance_z[r, c, k]
        below = 1.0 / (here - lower * lower * below)
        levels_out.inverse_pivot[r, c, k] = below


@ti.func
def clear_line(levels_out: ti.template(), level, r, i, j):
    """Zero initial guess of one line."""
    c = column_of(levels_out, level, i, j)
    for k in range(levels_out.right_side.shape[2]):
        levels_out.solution[r, c, k] = 0.0


@ti.func
def relax_line(levels_out: ti.template(), level, r, i, j):
    """Exact solution of one line with its neighbours as they stand."""
    n = ti.static(levels_out.right_side.shape[2])
    c, neighbours = column_of(levels_out, level, i, j), neighbour_columns(levels_out, level, i, j)
    below = real(0.0)
    for k in range(n):
        right = levels_out.right_side[r, c, k]
        right += neighbour_sum(levels_out, levels_out.solution, r, c, neighbours, k)
        below = (right + levels_out.conductance_z[r, c, k] * below) * levels_out.inverse_pivot[r, c, k]
        levels_out.solution[r, c, k] = below
    above = real(0.0)
    for down in range(n):
        k = n - 1 - down
        back = levels_out.conductance_z[r, c, k + 1] * levels_out.inverse_pivot[r, c, k] * above
        above = levels_out.solution[r, c, k] + back
        levels_out.solution[r, c, k] = above


@ti.func
def relax_coloured_line(levels_out: ti.template(), level, colour, r, i, j):
    if (i + j) % 2 == colour:
        relax_line(levels_out, level, r, i, j)


@ti.func
def set_residual(levels_out: ti.template(), level, r, i, j):
    c, neighbours = column_of(levels_out, level, i, j), neighbour_columns(levels_out, level, i, j)
    for k in range(levels_out.right_side.shape[2]):
        operator = negative_laplacian(levels_out, levels_out.solution, r, c, neighbours, k)
        levels_out.residual[r, c, k] = levels_out.right_side[r, c, k] - operator


@ti.func
def interpolation_weight(fine, coarse, fine_cells, merged, is_periodic: ti.template()):
    """Weight of a coarse cell in the interpolation to a fine cell [1].

    A fine cell beyond an end has weight 0 unless the axis is periodic.
    """
    weight = real(1.0)
    if merged == 2:
        inside = fine // 2 == coarse
        weight = ti.select(inside, real(0.75), real(0.25))
        if ti.static(not is_periodic):
            if fine < 0 or fine >= fine_cells:
                weight = 0.0
            elif inside and (fine == 0 or fine == fine_cells - 1):
                weight = 1.0
    return weight


@ti.func
def restrict_line(levels_out: ti.template(), level, r, i, j):
    """Right-hand side of one line of a coarser level: the restricted residual of the next finer one."""
    layers = ti.static(levels_out.right_side.shape[2])
    fine_x, fine_y = levels_out.shape[level - 1, 1], levels_out.shape[level - 1, 2]
    by_x, by_y = levels_out.shape[level - 1, 3], levels_out.shape[level - 1, 4]
    c = column_of(levels_out, level, i, j)
    for k in range(layers):
        levels_out.right_side[r, c, k] = 0.0
    # a coarse cell reaches the fine cells inside it and one beyond each of its ends
    for a in range(3 * by_x - 2):
        for b in range(3 * by_y - 2):
            x, y = by_x * i + 1 - by_x + a, by_y * j + 1 - by_y + b
            weight = interpolation_weight(x, i, fine_x, by_x, levels_out.periodic_x)
            weight *= interpolation_weight(y, j, fine_y, by_y, levels_out.periodic_y)
            fine = column_of(levels_out, level - 1, x, y)
            for k in range(layers):
                more = weight * levels_out.residual[r, fine, k]
                levels_out.right_side[r, c, k] = levels_out.right_side[r, c, k] + more


@ti.func
def second_coarse_cell(fine, coarse_cells, merged, is_periodic: ti.template()):
    """The second coarse cell that a fine cell is interpolated from; at a closed end the first again."""
    other = fine // merged
    if merged == 2:
        other += 2 * (fine % 2) - 1
        if ti.static(is_periodic):
            other = (other + coarse_cells) % coarse_cells
        else:
            other = ti.min(ti.max(other, 0), coarse_cells - 1)
    return other


@ti.func
def prolong_line(levels_out: ti.template(), level, r, i, j):
    """Coarse-grid correction of one line: plus the interpolated solution of the next level."""
    fine_x, fine_y = levels_out.shape[level, 1], levels_out.shape[level, 2]
    by_x, by_y = levels_out.shape[level, 3], levels_out.shape[level, 4]
    c = column_of(levels_out, level, i, j)
    east = second_coarse_cell(i, fine_x // by_x, by_x, levels_out.periodic_x)
    north = second_coarse_cell(j, fine_y // by_y, by_y, levels_out.periodic_y)
    west, south = i // by_x, j // by_y
    column = column_of(levels_out, level + 1, west, south)
    coarse_column = column_of(levels_out, level + 1, east, south)
    ahead = column_of(levels_out, level + 1, west, north)
    corner = column_of(levels_out, level + 1, east, north)
    for k in range(levels_out.right_side.shape[2]):
        near = 0.75 * levels_out.solution[r, column, k] + 0.25 * levels_out.solution[r, coarse_column, k]
        far = 0.75 * levels_out.solution[r, ahead, k] + 0.25 * levels_out.solution[r, corner, k]
        levels_out.solution[r, c, k] = levels_out.solution[r, c, k] + 0.75 * near + 0.25 * far


@ti.func
def sweep_symmetrically(levels_out: ti.template(), level, sweeps, r):
    """Gauss-Seidel over all columns of one replica in order, then in reverse order, so many times."""
    nx, ny = levels_out.shape[level, 1], levels_out.shape[level, 2]
    for turn in range(sweeps * 2 * nx * ny):
        column = turn % (2 * nx * ny)
        if column >= nx * ny:
            column = 2 * nx * ny - 1 - column
        relax_line(levels_out, level, r, column // ny, column % ny)


def coarsest_sweep_count(levels: MultigridLevels) -> int:
    longer = levels.columns[-1]
    return 1 if longer == 1 else min(SWEEPS_PER_COLUMN * longer, SWEEPS_MOST)


@ti.func
def apply_to_lines(task: ti.template(), serial: ti.template(), levels_out: ti.template(), level, first, last):
    """One device function applied to every line of one level of the replicas from first to last.

    As the outermost loop of a kernel it runs in parallel unless it is to be `serial`.
    """
    nx, ny = levels_out.shape[level, 1], levels_out.shape[level, 2]
    ti.loop_config(serialize=serial)
    for r, i, j in ti.ndrange((first, last), nx, ny):
        task(levels_out, level, r, i, j)


@ti.func
def relax_level(serial: ti.template(), levels_out: ti.template(), level, colour, first, last):
    """Relaxation of one level of the replicas from first to last, a colour (0 or 1) before the other."""
    nx, ny = levels_out.shape[level, 1], levels_out.shape[level, 2]
    ti.loop_config(serialize=serial)
    for r, i, j in ti.ndrange((first, last), nx, ny):
        relax_coloured_line(levels_out, level, colour, r, i, j)
    ti.loop_config(serialize=serial)
    for r, i, j in ti.ndrange((first, last), nx, ny):
        relax_coloured_line(levels_out, level, 1 - colour, r, i, j)


@ti.func
def cycle_replica(levels_out: ti.template(), r):
    """One V-cycle of one replica on one thread, from a zero solution."""
    last = ti.static(levels_out.number - 1)
    for level in range(last):
        apply_to_lines(clear_line, True, levels_out, level, r, r + 1)
        relax_level(True, levels_out, level, 0, r, r + 1)
        apply_to_lines(set_residual, True, levels_out, level, r, r + 1)
        apply_to_lines(restrict_line, True, levels_out, level + 1, r, r + 1)
    apply_to_lines(clear_line, True, levels_out, last, r, r + 1)
    sweep_symmetrically(levels_out, last, ti.static(coarsest_sweep_count(levels_out)), r)
    for up in range(last):
        apply_to_lines(prolong_line, True, levels_out, last - 1 - up, r, r + 1)
        relax_level(True, levels_out, last - 1 - up, 1, r, r + 1)


@ti.kernel
def apply_to_all_lines(task: ti.template(), serial: ti.template(), level: ti.i32, levels_out: ti.template()):
    """One device function applied to every line of one level of all replicas, in parallel."""
    apply_to_lines(task, serial, levels_out, level, 0, levels_out.right_side.shape[0])


@ti.kernel
def relax_all_lines(serial: ti.template(), level: ti.i32, first: ti.i32, levels_out: ti.template()):
    """Relaxation of one level of all replicas in parallel, colour `first` (0 or 1) before the other."""
    relax_level(serial, levels_out, level, first, 0, levels_out.right_side.shape[0])


@ti.kernel
def sweep_coarsest(level: ti.i32, sweeps: ti.i32, levels_out: ti.template()):
    """Symmetric Gauss-Seidel on the coarsest level, one thread a replica."""
    ti.loop_config(serialize=levels_out.serial_replicas)
    for r in range(levels_out.right_side.shape[0]):
        sweep_symmetrically(levels_out, level, sweeps, r)


def cycle(levels: MultigridLevels) -> None:
    """One V-cycle of all replicas in parallel, from a zero solution."""
    last = levels.number - 1
    for level in range(last):
        apply_to_all_lines(clear_line, levels.serial[level], level, levels)
        relax_all_lines(levels.serial[level], level, 0, levels)
        apply_to_all_lines(set_residual, levels.serial[level], level, levels)
        apply_to_all_lines(restrict_line, levels.serial[level + 1], level + 1, levels)
    apply_to_all_lines(clear_line, levels.serial[last], last, levels)
    sweep_coarsest(last, coarsest_sweep_count(levels), levels)
    for level in reversed(range(last)):
        apply_to_all_lines(prolong_line, levels.serial[level], level, levels)
        relax_all_lines(levels.serial[level], level, 1, levels)
