"""Device state of the air of all replicas: a staggered grid with one layer of ghost cells.

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

from taichi_erosion.air.gusts import Waves
from taichi_erosion.air.levels import Grids, Krylov
from taichi_erosion.core.air_setup import SIDES, AirModel
from taichi_erosion.core.ti import ti

real = ti.f64

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
