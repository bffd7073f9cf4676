"""Fields of the grids on which the pressure is solved, all grids in one set of fields.

The pressure equation is  sum over faces of c (psi_neighbour - psi) - drain psi = right,  with conductances c
[m], area over distance times the share of the face that is air, and a drain [m] beside outlets. Coarser grids
have half as many cells along x, y or both and all layers along z, where lines are solved exactly. The columns
of cells of all grids are numbered on, finest grid first, so that one kernel serves every grid.

Device state of the air of all replicas: a staggered grid with one layer of ghost cells.

Cell (i, j, k) of replica r counts from 0; places -1 and n are ghosts, which `ghosts.py` fills. Pressure,
void fraction and exchange live in cells, each velocity component on the faces that it is normal to:
`velocity_x[r, i, j, k]` on the face towards low x of cell (i, j, k), likewise y and z. The air keeps double
precision whatever the grains do: in a step of theirs it may change by a millionth of itself.

Who couples grains to the air fills, in cells 0 ... n - 1 and before each step:

    void_fraction         eps, share of the cell that is air                     [1]
    exchange_force        explicit part f of the force on the air, a volume      [N m-3]
    exchange_coefficient  implicit part beta: the air also feels  - beta u       [N s m-4]

so that grains of velocity v with drag  beta (u - v)  give  f = beta v.  All are over the whole volume.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_erosion.air.inlet_turbulence import Waves
from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import write

real = ti.f64

EVEN = 1.5  # cells along the other axis may be so much wider and still be merged with these [1]


@dataclass(frozen=True, eq=False)
class Grids:
    """Conductances, right-hand sides and solutions by replica, column and layer; `across_*` of low faces."""

    number: int  # of grids
    columns: tuple[int, ...]  # cells along the longer of x and y of every grid
    round_x: bool  # whether x is periodic
    round_y: bool  # whether y is periodic
    shape: Any  # i32 by grid: first column, cells along x and y, cells that merge in the next along x and y
    across_x: Any  # [m]
    across_y: Any  # [m]
    across_z: Any  # [m], one layer more than the cells
    drain: Any  # [m]
    pivot: Any  # inverse pivots of the lines along z [m-1]
    right: Any  # [m3 s-1]
    solution: Any  # [m2 s-1]
    rest: Any  # what the solution leaves of the right-hand side [m3 s-1]


@dataclass(frozen=True, eq=False)
class Krylov:
    """Fields of the conjugate gradients on the finest grid, by replica, column and layer."""

    found: Any  # psi [m2 s-1]
    search: Any  # direction
    image: Any  # of the direction
    partial: Any  # sums over single columns, by replica and column
    worst: Any  # air that appears in a cell in one step over its volume [1], largest by replica and column
    product: Any  # rest times preconditioned rest, by replica
    step: Any  # length of the last step, by replica
    ratio: Any  # new product over old one, by replica


@ti.func
def column_of(grids: ti.template(), level, i, j):
    """Number of a column of a grid; beyond an end that of the opposite one, where conductances are zero."""
    nx, ny = grids.shape[level, 1], grids.shape[level, 2]
    return grids.shape[level, 0] + ((i + nx) % nx) * ny + (j + ny) % ny


@ti.func
def around(grids: ti.template(), level, i, j):
    """Columns to the west, east, south and north."""
    west, east = column_of(grids, level, i - 1, j), column_of(grids, level, i + 1, j)
    return ti.Vector([west, east, column_of(grids, level, i, j - 1), column_of(grids, level, i, j + 1)])


def grid_shapes(setup: AirSetup) -> list[tuple[int, int, int, int]]:
    """Cells along x and y of every grid, and how many merge along x and y in the next; the last: 1, 1."""
    nx, ny, _ = setup.cells
    width_x, width_y = ((setup.high[axis] - setup.low[axis]) / setup.cells[axis] for axis in range(2))
    round_x, round_y = (setup.sides[name].kind == "periodic" for name in ("x_low", "y_low"))
    shapes = []
    while True:
        by_x, by_y = merging(nx, ny, width_x, width_y)
        if (round_x and nx > 1 and nx % 2) or (round_y and ny > 1 and ny % 2):
            by_x, by_y = 1, 1  # two colours do not go round an odd number of columns
        shapes.append((nx, ny, by_x, by_y))
        if by_x == by_y == 1:
            return shapes
        nx, ny, width_x, width_y = nx // by_x, ny // by_y, width_x * by_x, width_y * by_y


def merging(nx: int, ny: int, width_x: float, width_y: float) -> tuple[int, int]:
    """Cells that merge along x and y: two where their number is even and they are not already the wider."""
    can_x, can_y = nx % 2 == 0, ny % 2 == 0
    by_x = can_x and (width_x <= EVEN * width_y or ny == 1)
    by_y = can_y and (width_y <= EVEN * width_x or nx == 1)
    if not (by_x or by_y):
        by_x, by_y = can_x, can_y
    return (2 if by_x else 1), (2 if by_y else 1)


def allocate_grids(setup: AirSetup, replicas: int) -> Grids:
    """Fields of all grids, and where each begins."""
    shapes = np.array(grid_shapes(setup))
    sizes = shapes[:, 0] * shapes[:, 1]
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    layers = setup.cells[2]
    names = ("across_x", "across_y", "drain", "pivot", "right", "solution", "rest")
    grids = Grids(
        number=len(shapes),
        columns=tuple(int(n) for n in shapes[:, :2].max(axis=1)),
        round_x=setup.sides["x_low"].kind == "periodic",
        round_y=setup.sides["y_low"].kind == "periodic",
        shape=ti.field(ti.i32, shape=(len(shapes), 5)),
        across_z=ti.field(real, shape=(replicas, int(sizes.sum()), layers + 1)),
        **{name: ti.field(real, shape=(replicas, int(sizes.sum()), layers)) for name in names},
    )
    write(grids.shape, np.column_stack([first, shapes]))
    return grids


def allocate_krylov(setup: AirSetup, replicas: int) -> Krylov:
    """Fields of the conjugate gradients."""
    columns = setup.cells[0] * setup.cells[1]
    cells = (replicas, columns, setup.cells[2])
    blocks = {name: ti.field(real, shape=cells) for name in ("found", "search", "image")}
    sums = {name: ti.field(real, shape=(replicas, columns)) for name in ("partial", "worst")}
    scalars = {name: ti.field(real, shape=replicas) for name in ("product", "step", "ratio")}
    return Krylov(**blocks, **sums, **scalars)


GRIDS = (
    *("velocity_x", "velocity_y", "velocity_z", "pressure", "void_fraction", "void_before"),
    *("exchange_coefficient", "eddy_cell", "eddy_face", "length", "elimination"),
    *("rate_x", "rate_y", "rate_z", "past_x", "past_y", "past_z"),
)
VECTORS = ("exchange_force", "impulse", "gradient")


@dataclass(frozen=True, eq=False)
class AirNumbers:
    """One row a replica: clock, box, fluid and closure constants."""

    time: Any  # [s]
    time_step: Any  # [s]
    density: Any  # [kg m-3]
    viscosity: Any  # kinematic [m2 s-1]
    friction_velocity: Any  # u* of a side under stress [m s-1]
    implicitness: Any  # of diffusion along z [1]
    karman: Any  # [1]
    sublayer: Any  # R_c [1]
    van_driest: Any  # A+ [1]
    smagorinsky: Any  # C_s [1]
    length_most: Any  # [m]
    length_share: Any  # [1]
    ground: Any  # height from which distances over a bed count [m]
    low: Any  # vec3 [m]
    width: Any  # vec3 [m], of a cell along x and y; along z see Air.height
    driving_gradient: Any  # vec3 [Pa m-1]
    side_velocity: Any  # vec3 [m s-1] by replica and side
    side_roughness: Any  # z0 [m] by replica and side


@dataclass(frozen=True, eq=False)
class Air:
    """Fields of the air of all replicas, and the choices compiled into its kernels."""

    count: int
    cells: tuple[int, int, int]
    model: AirModel
    kinds: dict[str, str]  # kind of each side
    numbers: AirNumbers
    face: Any  # z of the lower face of cell k, and of the lid [m] by replica and k = 0 ... nz
    centre: Any  # z of the centre of cell k [m], k = -1 ... nz; ghosts lie on the outer faces
    height: Any  # thickness of cell k [m], k = -1 ... nz; ghosts have the thickness of their neighbour
    inlet_shape: Any  # speed at an inlet along x over that of the side [1] by replica and k
    gust: Any  # fluctuation at an inlet along x [m s-1], vec3 by replica, j and k
    velocity_x: Any  # [m s-1]
    velocity_y: Any  # [m s-1]
    velocity_z: Any  # [m s-1]
    pressure: Any  # [Pa], without its mean gradient
    void_fraction: Any  # [1]
    void_before: Any  # [1], of the step before
    exchange_force: Any  # vec3 [N m-3]
    exchange_coefficient: Any  # [N s m-4]
    impulse: Any  # vec3, momentum that grains have given in the last step, a volume [N s m-3]
    gradient: Any  # vec3, mean gradient of the pressure in the last step, its driving part included [Pa m-1]
    eddy_cell: Any  # eddy viscosity in cells [m2 s-1]
    eddy_face: Any  # eddy viscosity on the lower faces of cells [m2 s-1]
    length: Any  # mixing length on the lower faces of cells [m]
    rate_x: Any  # explicit rate of change [m s-2]
    rate_y: Any
    rate_z: Any
    past_x: Any  # explicit rate of the stage before [m s-2]
    past_y: Any
    past_z: Any
    elimination: Any  # upper factors of a sweep along z [1]
    moving: Any  # i32 by replica: whether it takes part in the coming step of `replica.py`
    left: Any  # air that appeared in the worst cell in that step over its volume [1], by replica
    grids: Grids  # of the pressure solve
    krylov: Krylov
    waves: Waves

    @property
    def is_column(self) -> bool:
        """Whether the whole grid is one column of cells a replica."""
        return self.cells[:2] == (1, 1)

    @property
    def cell_count(self) -> int:
        """Cells of one replica."""
        return self.cells[0] * self.cells[1] * self.cells[2]

    @property
    def sharers(self) -> int:
        """Columns of cells that share a grain: those whose middles enclose it."""
        return 1 if self.is_column else 4

    @property
    def velocities(self) -> tuple[Any, Any, Any]:
        """The three components of the velocity."""
        return self.velocity_x, self.velocity_y, self.velocity_z

    @property
    def rates(self) -> tuple[Any, Any, Any]:
        """Explicit rates of the three components."""
        return self.rate_x, self.rate_y, self.rate_z

    @property
    def pasts(self) -> tuple[Any, Any, Any]:
        """Explicit rates of the stage before."""
        return self.past_x, self.past_y, self.past_z


def padded(cells: tuple[int, int, int], replicas: int, vector: bool = False) -> Any:
    """Field over cells and ghosts, by replica."""
    made = ti.Vector.field(3, real) if vector else ti.field(real)
    shape = (replicas, *(n + 2 for n in cells))
    ti.root.dense(ti.ijkl, shape).place(made, offset=(0, -1, -1, -1))
    return made


def layered(replicas: int, layers: int) -> Any:
    """Field over cells along z and ghosts, by replica."""
    made = ti.field(real)
    ti.root.dense(ti.ij, (replicas, layers + 2)).place(made, offset=(0, -1))
    return made


def inlet_plane(replicas: int, cells: tuple[int, int, int]) -> Any:
    """Field of vectors over cells along y and z and ghosts, by replica."""
    made = ti.Vector.field(3, real)
    ti.root.dense(ti.ijk, (replicas, cells[1] + 2, cells[2] + 2)).place(made, offset=(0, -1, -1))
    return made


def allocate_numbers(replicas: int) -> AirNumbers:
    """Fields of clocks and constants."""
    scalars = (
        "time",
        "time_step",
        "density",
        "viscosity",
        "friction_velocity",
        "implicitness",
        "karman",
        "ground",
    )
    closures = ("sublayer", "van_driest", "smagorinsky", "length_most", "length_share")
    table: dict[str, Any] = {name: ti.field(real, shape=replicas) for name in scalars + closures}
    vectors = ("low", "width", "driving_gradient")
    table |= {name: ti.Vector.field(3, real, shape=replicas) for name in vectors}
    table["side_velocity"] = ti.Vector.field(3, real, shape=(replicas, len(SIDES)))
    table["side_roughness"] = ti.field(real, shape=(replicas, len(SIDES)))
    return AirNumbers(**table)
