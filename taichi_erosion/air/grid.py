"""State of the air of all replicas on the device: a staggered grid with one layer of ghost cells.

Cell (i, j, k) of replica r counts from 0; indices -1 and n are ghosts, filled by `boundary.py`. Pressure,
void fraction and exchange live in cells, each velocity component on the faces that it is normal to:
`velocity_x[r, i, j, k]` on the face towards low x of cell (i, j, k), likewise y and z. The air keeps
double precision whatever the grains do: in a step of theirs it may change by a millionth of itself. The
sizes of cells are chosen in `scene/preparation/air.py`.

The coupling to grains sets, in cells 0 ... n - 1 and before each step:

    void_fraction         eps, share of the cell that is air                            [1]
    exchange_force        explicit part f of the force on the air, per volume           [N m-3]
    exchange_coefficient  implicit part beta: the force on the air is  f - beta u       [N s m-4]

so that grains of velocity v with drag  beta (u - v)  give  f = beta v.  All are over the whole volume.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from taichi_erosion.air.inlet_turbulence import InletWaves, allocate_inlet_waves
from taichi_erosion.air.pressure.multigrid import MultigridLevels, allocate_levels
from taichi_erosion.core.air_setup import SIDES, AirModel, AirSetup
from taichi_erosion.core.device import is_serial_loop
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import device_record, is_host_memory, upload, write_field

real = ti.f64

CELL_SCALARS = (
    *("velocity_x", "velocity_y", "velocity_z", "pressure", "void_fraction", "void_before"),
    *("exchange_coefficient", "eddy_cell", "eddy_face", "length", "elimination"),
    *("rate_x", "rate_y", "rate_z", "previous_rate_x", "previous_rate_y", "previous_rate_z"),
)
CELL_VECTORS = ("exchange_force", "impulse", "gradient")
FROM_SETUP = ("time_step", "density", "viscosity", "friction_velocity", "implicitness", "ground")
FROM_CONSTANTS = ("karman", "sublayer", "van_driest", "smagorinsky", "length_most", "length_share")


@device_record
class KrylovFields:
    """Fields of the conjugate gradients on the finest level, by replica, column and layer."""

    psi: Any  # [m2 s-1]
    direction: Any  # search direction
    laplacian: Any  # negative Laplacian of the search direction
    column_sum: Any  # sums over single columns, by replica and column
    column_worst: Any  # largest divergence of a cell times the time step [1], by replica and column
    residual_product: Any  # residual times preconditioned residual, by replica
    step_length: Any  # by replica
    direction_weight: Any  # new residual product over old one, by replica


@device_record
class AirNumbers:
    """Clock, box, fluid and closure constants by replica."""

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


@device_record
class Air:
    """Fields of the air of all replicas, and the choices compiled into its kernels."""

    count: int
    cells: tuple[int, int, int]
    model: AirModel
    kinds: dict[str, str]  # kind of each side
    serial: bool  # whether loops over cells run on the calling thread, see `is_serial_loop`
    serial_replicas: bool  # the same of loops over replicas
    numbers: AirNumbers
    face: Any  # z of the lower face of cell k, and of the lid [m] by replica and k = 0 ... nz
    centre: Any  # z of the centre of cell k [m], k = -1 ... nz; ghosts lie on the outer faces
    height: Any  # thickness of cell k [m], k = -1 ... nz; ghosts have the thickness of their neighbour
    inlet_shape: Any  # speed at an inlet along x over that of the side [1] by replica and k
    inlet_fluctuation: Any  # at an inlet along x [m s-1], vec3 by replica, j and k
    velocity_x: Any  # [m s-1]
    velocity_y: Any  # [m s-1]
    velocity_z: Any  # [m s-1]
    pressure: Any  # [Pa], without its mean gradient
    void_fraction: Any  # [1]
    void_before: Any  # [1], of the step before
    exchange_force: Any  # vec3 [N m-3]
    exchange_coefficient: Any  # [N s m-4]
    impulse: Any  # vec3, momentum from grains in the last step per volume [N s m-3]
    gradient: Any  # vec3, mean pressure gradient in the last step, its driving part included [Pa m-1]
    eddy_cell: Any  # eddy viscosity in cells [m2 s-1]
    eddy_face: Any  # eddy viscosity on the lower faces of cells [m2 s-1]
    length: Any  # mixing length on the lower faces of cells [m]
    rate_x: Any  # explicit rate of change [m s-2]
    rate_y: Any
    rate_z: Any
    previous_rate_x: Any  # explicit rate of the stage before [m s-2]
    previous_rate_y: Any
    previous_rate_z: Any
    elimination: Any  # upper factors of a tridiagonal solve along z [1]
    active: Any  # i32 by replica: whether `advance_active_replicas` advances it
    mass_residual: Any  # largest divergence that this left in a cell, times the time step [1], by replica
    levels: MultigridLevels  # of the pressure solve
    krylov: KrylovFields
    waves: InletWaves

    @property
    def is_column(self) -> bool:
        """Whether the whole grid is one column of cells a replica."""
        return self.cells[:2] == (1, 1)

    @property
    def cell_count(self) -> int:
        return self.cells[0] * self.cells[1] * self.cells[2]

    @property
    def columns_per_grain(self) -> int:
        """Columns of cells among which a grain is divided: those whose centres enclose it."""
        return 1 if self.is_column else 4

    @property
    def velocities(self) -> tuple[Any, Any, Any]:
        return self.velocity_x, self.velocity_y, self.velocity_z

    @property
    def rates(self) -> tuple[Any, Any, Any]:
        return self.rate_x, self.rate_y, self.rate_z

    @property
    def previous_rates(self) -> tuple[Any, Any, Any]:
        return self.previous_rate_x, self.previous_rate_y, self.previous_rate_z


def ghost_field(shape: tuple[int, ...], replicas: int, vector: bool = False) -> Any:
    """Field over cells and one layer of ghosts at each end, by replica."""
    field = ti.Vector.field(3, real) if vector else ti.field(real)
    axes = (ti.i, ti.ij, ti.ijk, ti.ijkl)[len(shape)]
    ti.root.dense(axes, (replicas, *(n + 2 for n in shape))).place(field, offset=(0, *(-1 for _ in shape)))
    return field


def allocate_air(setups: Sequence[AirSetup]) -> Air:
    """Air for an ensemble, as its setups describe it; the device must have been started.

    All setups share the numbers of cells, the kinds of sides and the model. Raises BadInput otherwise.
    """
    first, count = setups[0], len(setups)
    for setup in setups:
        if (setup.cells, setup.model) != (first.cells, first.model):
            raise BadInput("air: replicas of an ensemble share the numbers of cells and the model")
        if any(setup.sides[name].kind != first.sides[name].kind for name in SIDES):
            raise BadInput("air: replicas of an ensemble share the kinds of sides")
    cells, layers = first.cells, first.cells[2:]
    scalars = {name: ti.field(real, shape=count) for name in ("time", *FROM_SETUP, *FROM_CONSTANTS)}
    vectors = {n: ti.Vector.field(3, real, shape=count) for n in ("low", "width", "driving_gradient")}
    numbers = AirNumbers(
        **scalars,
        **vectors,
        side_velocity=ti.Vector.field(3, real, shape=(count, len(SIDES))),
        side_roughness=ti.field(real, shape=(count, len(SIDES))),
    )
    by_cell = (count, cells[0] * cells[1], cells[2])
    krylov = KrylovFields(
        **{name: ti.field(real, shape=by_cell) for name in ("psi", "direction", "laplacian")},
        **{name: ti.field(real, shape=by_cell[:2]) for name in ("column_sum", "column_worst")},
        **{n: ti.field(real, shape=count) for n in ("residual_product", "step_length", "direction_weight")},
    )
    air = Air(
        count=count,
        cells=cells,
        model=first.model,
        kinds={name: first.sides[name].kind for name in SIDES},
        serial=is_serial_loop(count * cells[0] * cells[1]),
        serial_replicas=is_host_memory(),
        numbers=numbers,
        inlet_fluctuation=ghost_field(cells[1:], count, vector=True),
        active=ti.field(ti.i32, shape=count),
        mass_residual=ti.field(real, shape=count),
        levels=allocate_levels(first, count),
        krylov=krylov,
        waves=allocate_inlet_waves(setups),
        **{name: ghost_field(cells, count) for name in CELL_SCALARS},
        **{name: ghost_field(cells, count, vector=True) for name in CELL_VECTORS},
        **{name: ghost_field(layers, count) for name in ("face", "centre", "height", "inlet_shape")},
    )
    upload_constants(air, setups)
    upload_layers(air, setups)
    upload_initial_state(air, setups)
    return air


def upload_constants(air: Air, setups: Sequence[AirSetup]) -> None:
    """Upload clock, box, fluid and closure constants."""
    numbers = air.numbers
    pairs = [(getattr(numbers, name), [getattr(s, name) for s in setups]) for name in FROM_SETUP]
    pairs += [(getattr(numbers, key), [getattr(s.constants, key) for s in setups]) for key in FROM_CONSTANTS]
    widths = [[(high - low) / n for low, high, n in zip(s.low, s.high, s.cells, strict=True)] for s in setups]
    pairs += [(numbers.width, widths), (numbers.low, [s.low for s in setups])]
    upload([*pairs, (numbers.driving_gradient, [s.driving_gradient for s in setups])])
    velocities = [[s.sides[name].velocity for name in SIDES] for s in setups]
    roughness = [[s.sides[name].roughness for name in SIDES] for s in setups]
    write_field(numbers.side_velocity, np.array(velocities, np.float64))
    write_field(numbers.side_roughness, np.array(roughness, np.float64))


def upload_layers(air: Air, setups: Sequence[AirSetup]) -> None:
    """Upload heights of faces, centres and cells, and the shape of the inlet, ghosts included."""
    faces = np.stack([np.asarray(s.faces_z, np.float64) for s in setups])
    height = np.diff(faces, axis=1)
    centre = 0.5 * (faces[:, 1:] + faces[:, :-1])
    low, high = faces[:, :1], faces[:, -1:]
    write_field(air.face, np.concatenate([low, faces], axis=1))
    write_field(air.centre, np.concatenate([low, centre, high], axis=1))
    write_field(air.height, np.pad(height, ((0, 0), (1, 1)), mode="edge"))
    ones = np.ones(air.cells[2])
    shapes = [ones if s.inlet_shape is None else s.inlet_shape for s in setups]
    write_field(air.inlet_shape, np.pad(np.stack(shapes), ((0, 0), (1, 1)), mode="edge"))


def upload_initial_state(air: Air, setups: Sequence[AirSetup]) -> None:
    """Upload the initial velocities; all cells are air."""
    starts = np.zeros((len(setups), 3, *air.cells))
    for whole, setup in zip(starts, setups, strict=True):
        if setup.start is not None:
            start = np.asarray(setup.start, np.float64)
            whole[: 1 if start.ndim == 1 else 3] = start  # a profile is that of the wind along x
    ghosts = ((0, 0), (1, 1), (1, 1), (1, 1))
    for axis, velocity in enumerate(air.velocities):
        write_field(velocity, np.pad(starts[:, axis], ghosts, mode="edge"))
    for full in (air.void_fraction, air.void_before):
        write_field(full, 1.0)


@ti.func
def layer_index(air: ti.template(), r, z):
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
def cell_volume(air: ti.template(), r, k):
    """Volume of a cell of layer k [m3]."""
    width = air.numbers.width[r]
    return width[0] * width[1] * air.height[r, k]


@ti.func
def cell_velocity(air: ti.template(), r, i, j, k):
    """Mean velocity of the air in a cell [m s-1]: of its two faces along each axis."""
    u = air.velocity_x[r, i, j, k] + air.velocity_x[r, i + 1, j, k]
    v = air.velocity_y[r, i, j, k] + air.velocity_y[r, i, j + 1, k]
    w = air.velocity_z[r, i, j, k] + air.velocity_z[r, i, j, k + 1]
    return 0.5 * ti.Vector([u, v, w])


@ti.func
def store_previous_void(air_out: ti.template(), r, i, j):
    """Void fraction of one column as it stands, kept as that of the step before."""
    for k in range(air_out.cells[2]):
        air_out.void_before[r, i, j, k] = air_out.void_fraction[r, i, j, k]


@ti.func
def apply_to_columns(task: ti.template(), air_out: ti.template(), first, last):
    """One device function applied to every column of cells of the replicas from first to last.

    As the outermost loop of a kernel it runs in parallel; inside the loop of a thread it visits column after
    column in order.
    """
    ti.loop_config(serialize=air_out.serial)
    for r, i, j in ti.ndrange((first, last), air_out.cells[0], air_out.cells[1]):
        task(air_out, r, i, j)


@ti.func
def apply_stage_to_columns(task: ti.template(), air_out: ti.template(), first, last, share):
    """Likewise for a stage that takes so large a share of the step."""
    ti.loop_config(serialize=air_out.serial)
    for r, i, j in ti.ndrange((first, last), air_out.cells[0], air_out.cells[1]):
        task(air_out, r, i, j, share)


@ti.kernel
def apply_to_all_columns(task: ti.template(), air_out: ti.template()):
    """One device function applied to every column of cells of all replicas, in parallel."""
    apply_to_columns(task, air_out, 0, air_out.count)


@ti.kernel
def apply_stage_to_all_columns(task: ti.template(), share: ti.f64, air_out: ti.template()):
    """Likewise for a stage that takes so large a share of the step."""
    apply_stage_to_columns(task, air_out, 0, air_out.count, share)
