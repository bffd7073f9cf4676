"""Between a grid of the pressure and the next coarser one.

Corrections are interpolated linearly, 3/4 and 1/4; restriction is the transpose of that.

Reference: Trottenberg, Oosterlee & Schueller (2001), Multigrid, section 2.8.

One multigrid cycle for the pressure: lines along z solved exactly, x and y coarsened.

Lines make the cycle indifferent to how cells are stretched along z. On each grid columns are relaxed in two
colours, (i + j) even and odd, downwards even first and upwards odd first, so that the cycle is a symmetric
operator, as conjugate gradients need. The coarsest grid, whose numbers of columns are odd, is swept to and
fro by one worker a replica.

Reference: Trottenberg, Oosterlee & Schueller (2001), Multigrid, sections 4.7 and 5.1.
"""

from taichi_erosion.air.grid import Grids, around, column_of
from taichi_erosion.core.ti import ti

real = ti.f64


@ti.func
def share(place, coarse, fine_cells, merged, is_round: ti.template()):
    """Weight of a coarse cell in the interpolation to the fine cell at a place [1].

    The fine cell may lie beyond an end: round a period it is another one, else it is none.
    """
    weight = real(1.0)
    if merged == 2:
        inside = place // 2 == coarse
        weight = ti.select(inside, real(0.75), real(0.25))
        if ti.static(not is_round):
            if place < 0 or place >= fine_cells:
                weight = 0.0
            elif inside and (place == 0 or place == fine_cells - 1):
                weight = 1.0
    return weight


@ti.func
def restrict_to_line(grids_out: ti.template(), level, r, i, j):
    """Gather the rest of a grid in one line of the next coarser one."""
    layers = ti.static(grids_out.right.shape[2])
    fine_x, fine_y = grids_out.shape[level, 1], grids_out.shape[level, 2]
    by_x, by_y = grids_out.shape[level, 3], grids_out.shape[level, 4]
    c = column_of(grids_out, level + 1, i, j)
    for k in range(layers):
        grids_out.right[r, c, k] = 0.0
    # a coarse cell reaches the fine cells inside it and one beyond each of its ends
    for a in range(3 * by_x - 2):
        for b in range(3 * by_y - 2):
            x, y = by_x * i + 1 - by_x + a, by_y * j + 1 - by_y + b
            weight = share(x, i, fine_x, by_x, grids_out.round_x)
            weight *= share(y, j, fine_y, by_y, grids_out.round_y)
            fine = column_of(grids_out, level, x, y)
            for k in range(layers):
                more = weight * grids_out.rest[r, fine, k]
                grids_out.right[r, c, k] = grids_out.right[r, c, k] + more


@ti.kernel
def restrict(
    # parameters
    level: ti.i32,
    # out
    grids_out: ti.template(),
):
    """Hand the rest of a grid to the next coarser one."""
    nx, ny = grids_out.shape[level + 1, 1], grids_out.shape[level + 1, 2]
    for r, i, j in ti.ndrange(grids_out.right.shape[0], nx, ny):
        restrict_to_line(grids_out, level, r, i, j)


@ti.func
def partner(place, cells, merged, is_round: ti.template()):
    """The second coarse cell that a fine cell is interpolated from; at a closed end the first again."""
    other = place // merged
    if merged == 2:
        other += 2 * (place % 2) - 1
        if ti.static(is_round):
            other = (other + cells) % cells
        else:
            other = ti.min(ti.max(other, 0), cells - 1)
    return other


@ti.func
def prolong_to_line(grids_out: ti.template(), level, r, i, j):
    """Add to one line of a grid the solution of the next coarser one, interpolated linearly."""
    fine_x, fine_y = grids_out.shape[level, 1], grids_out.shape[level, 2]
    by_x, by_y = grids_out.shape[level, 3], grids_out.shape[level, 4]
    c = column_of(grids_out, level, i, j)
    east = partner(i, fine_x // by_x, by_x, grids_out.round_x)
    north = partner(j, fine_y // by_y, by_y, grids_out.round_y)
    west, south = i // by_x, j // by_y
    own = column_of(grids_out, level + 1, west, south)
    beside = column_of(grids_out, level + 1, east, south)
    ahead = column_of(grids_out, level + 1, west, north)
    corner = column_of(grids_out, level + 1, east, north)
    for k in range(grids_out.right.shape[2]):
        near = 0.75 * grids_out.solution[r, own, k] + 0.25 * grids_out.solution[r, beside, k]
        far = 0.75 * grids_out.solution[r, ahead, k] + 0.25 * grids_out.solution[r, corner, k]
        grids_out.solution[r, c, k] = grids_out.solution[r, c, k] + 0.75 * near + 0.25 * far


@ti.kernel
def prolong(
    # parameters
    level: ti.i32,
    # out
    grids_out: ti.template(),
):
    """Add to a grid the solution of the next coarser one, interpolated linearly."""
    for r, i, j in ti.ndrange(grids_out.right.shape[0], grids_out.shape[level, 1], grids_out.shape[level, 2]):
        prolong_to_line(grids_out, level, r, i, j)


SHIFT = 2.0**-24  # of the diagonal of a line: a closed box fixes pressure up to a constant only [1]
SWEEPS_PER_COLUMN = 2  # to-and-fro sweeps on the coarsest grid, over the longer side of it
SWEEPS_MOST = 12


@ti.func
def pull_beside(grids: ti.template(), values: ti.template(), r, c, beside, k):
    """Sum of conductance times value over the four neighbours beside a cell."""
    pulled = grids.across_x[r, c, k] * values[r, beside[0], k]
    pulled += grids.across_x[r, beside[1], k] * values[r, beside[1], k]
    pulled += grids.across_y[r, c, k] * values[r, beside[2], k]
    return pulled + grids.across_y[r, beside[3], k] * values[r, beside[3], k]


@ti.func
def diagonal(grids: ti.template(), r, c, beside, k):
    """Sum of all conductances of a cell, its drain included [m]."""
    across = grids.across_x[r, c, k] + grids.across_x[r, beside[1], k]
    across += grids.across_y[r, c, k] + grids.across_y[r, beside[3], k]
    return across + grids.across_z[r, c, k] + grids.across_z[r, c, k + 1] + grids.drain[r, c, k]


@ti.func
def applied(grids: ti.template(), values: ti.template(), r, c, beside, k):
    """Minus the left-hand side of the pressure equation: positive definite."""
    total = diagonal(grids, r, c, beside, k) * values[r, c, k] - pull_beside(grids, values, r, c, beside, k)
    if k > 0:
        total -= grids.across_z[r, c, k] * values[r, c, k - 1]
    if k < values.shape[2] - 1:
        total -= grids.across_z[r, c, k + 1] * values[r, c, k + 1]
    return total


@ti.func
def relax_line(grids_out: ti.template(), r, c, beside):
    """Solve one line exactly with its neighbours as they stand."""
    n = ti.static(grids_out.right.shape[2])
    below = real(0.0)
    for k in range(n):
        right = grids_out.right[r, c, k] + pull_beside(grids_out, grids_out.solution, r, c, beside, k)
        below = (right + grids_out.across_z[r, c, k] * below) * grids_out.pivot[r, c, k]
        grids_out.solution[r, c, k] = below
    above = real(0.0)
    for upside in range(n):
        k = n - 1 - upside
        back = grids_out.across_z[r, c, k + 1] * grids_out.pivot[r, c, k] * above
        above = grids_out.solution[r, c, k] + back
        grids_out.solution[r, c, k] = above


@ti.func
def factor_line(grids_out: ti.template(), level, r, i, j):
    """Inverse pivots of one line."""
    c, beside = column_of(grids_out, level, i, j), around(grids_out, level, i, j)
    below = real(0.0)
    for k in range(grids_out.right.shape[2]):
        here = diagonal(grids_out, r, c, beside, k)
        here += SHIFT * here  # not times 1 + SHIFT, which single precision rounds to 1
        lower = grids_out.across_z[r, c, k]
        below = 1.0 / (here - lower * lower * below)
        grids_out.pivot[r, c, k] = below


@ti.kernel
def factor_lines(
    # parameters
    level: ti.i32,
    # out
    grids_out: ti.template(),
):
    """Inverse pivots of all lines of one grid."""
    for r, i, j in ti.ndrange(grids_out.right.shape[0], grids_out.shape[level, 1], grids_out.shape[level, 2]):
        factor_line(grids_out, level, r, i, j)


@ti.func
def clear_line(grids_out: ti.template(), level, r, i, j):
    """Start one line from zero."""
    c = column_of(grids_out, level, i, j)
    for k in range(grids_out.right.shape[2]):
        grids_out.solution[r, c, k] = 0.0


@ti.kernel
def clear_solution(
    # parameters
    level: ti.i32,
    # out
    grids_out: ti.template(),
):
    """Start a grid from zero."""
    for r, i, j in ti.ndrange(grids_out.right.shape[0], grids_out.shape[level, 1], grids_out.shape[level, 2]):
        clear_line(grids_out, level, r, i, j)


@ti.func
def relax_colour(grids_out: ti.template(), level, colour, r, i, j):
    """Relax one line where it has this colour."""
    if (i + j) % 2 == colour:
        relax_line(grids_out, r, column_of(grids_out, level, i, j), around(grids_out, level, i, j))


@ti.kernel
def relax(
    # parameters
    level: ti.i32,
    first: ti.i32,
    # out
    grids_out: ti.template(),
):
    """Relax the columns of both colours, `first` (0 or 1) before the other."""
    replicas, nx, ny = grids_out.right.shape[0], grids_out.shape[level, 1], grids_out.shape[level, 2]
    for r, i, j in ti.ndrange(replicas, nx, ny):
        relax_colour(grids_out, level, first, r, i, j)
    for r, i, j in ti.ndrange(replicas, nx, ny):
        relax_colour(grids_out, level, 1 - first, r, i, j)


@ti.func
def sweep_to_and_fro(grids_out: ti.template(), level, sweeps, r):
    """Relax all columns of one replica in order, then in reverse order, so many times."""
    nx, ny = grids_out.shape[level, 1], grids_out.shape[level, 2]
    for turn in range(sweeps * 2 * nx * ny):
        column = turn % (2 * nx * ny)
        if column >= nx * ny:
            column = 2 * nx * ny - 1 - column
        i, j = column // ny, column % ny
        relax_line(grids_out, r, column_of(grids_out, level, i, j), around(grids_out, level, i, j))


@ti.kernel
def sweep_coarsest(
    # parameters
    level: ti.i32,
    sweeps: ti.i32,
    # out
    grids_out: ti.template(),
):
    """Relax all columns in order, then in reverse order, so many times."""
    for r in range(grids_out.right.shape[0]):
        sweep_to_and_fro(grids_out, level, sweeps, r)


@ti.func
def rest_of_line(grids_out: ti.template(), level, r, i, j):
    """What the solution leaves of the right-hand side in one line."""
    c, beside = column_of(grids_out, level, i, j), around(grids_out, level, i, j)
    for k in range(grids_out.right.shape[2]):
        left = applied(grids_out, grids_out.solution, r, c, beside, k)
        grids_out.rest[r, c, k] = grids_out.right[r, c, k] - left


@ti.kernel
def find_rest(
    # parameters
    level: ti.i32,
    # out
    grids_out: ti.template(),
):
    """What the solution leaves of the right-hand side."""
    for r, i, j in ti.ndrange(grids_out.right.shape[0], grids_out.shape[level, 1], grids_out.shape[level, 2]):
        rest_of_line(grids_out, level, r, i, j)


def coarsest_sweeps(grids: Grids) -> int:
    """To-and-fro sweeps over the coarsest grid."""
    longer = grids.columns[-1]
    return 1 if longer == 1 else min(SWEEPS_PER_COLUMN * longer, SWEEPS_MOST)


def cycle(grids: Grids, level: int = 0) -> None:
    """Improve the solution of a grid from 0, given its right-hand side."""
    clear_solution(level, grids)
    if level == grids.number - 1:
        sweep_coarsest(level, coarsest_sweeps(grids), grids)
        return
    relax(level, 0, grids)
    find_rest(level, grids)
    restrict(level, grids)
    cycle(grids, level + 1)
    prolong(level, grids)
    relax(level, 1, grids)
