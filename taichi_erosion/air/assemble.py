"""From AirSetups to air on the device."""

from collections.abc import Sequence

import numpy as np

from taichi_erosion.air.grid import (
    GRIDS,
    VECTORS,
    Air,
    allocate_grids,
    allocate_krylov,
    allocate_numbers,
    inlet_plane,
    layered,
    padded,
)
from taichi_erosion.air.inlet_turbulence import allocate_waves
from taichi_erosion.core.air_setup import SIDES, AirSetup
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import upload, write

CONSTANTS = ("karman", "sublayer", "van_driest", "smagorinsky", "length_most", "length_share")
SCALARS = ("time_step", "density", "viscosity", "friction_velocity", "implicitness", "ground")


def allocate_air(setups: Sequence[AirSetup]) -> Air:
    """Air for an ensemble, as its setups describe it; the device must have been started.

    All setups share the numbers of cells, the kinds of sides and the model. Raises BadInput otherwise.
    """
    first, count = setups[0], len(setups)
    kinds = {name: first.sides[name].kind for name in SIDES}
    for setup in setups:
        refuse_mixture(first, setup)
    blocks = {name: padded(first.cells, count) for name in GRIDS}
    columns = {name: layered(count, first.cells[2]) for name in ("face", "centre", "height", "inlet_shape")}
    air = Air(
        count=count,
        cells=first.cells,
        model=first.model,
        kinds=kinds,
        numbers=allocate_numbers(count),
        **{name: padded(first.cells, count, vector=True) for name in VECTORS},
        gust=inlet_plane(count, first.cells),
        moving=ti.field(ti.i32, shape=count),
        left=ti.field(ti.f64, shape=count),
        grids=allocate_grids(first, count),
        krylov=allocate_krylov(first, count),
        waves=allocate_waves(setups),
        **columns,
        **blocks,
    )
    write_numbers(air, setups)
    write_grid(air, setups)
    write_start(air, setups)
    return air


def refuse_mixture(first: AirSetup, setup: AirSetup) -> None:
    """Raise BadInput where an ensemble differs in what is compiled in."""
    if (setup.cells, setup.model) != (first.cells, first.model):
        raise BadInput("air: replicas of an ensemble share the numbers of cells and the model")
    if any(setup.sides[name].kind != first.sides[name].kind for name in SIDES):
        raise BadInput("air: replicas of an ensemble share the kinds of sides")


def write_numbers(air: Air, setups: Sequence[AirSetup]) -> None:
    """Put what is one number a replica on the device."""
    numbers = air.numbers
    pairs = [(getattr(numbers, name), [getattr(s, name) for s in setups]) for name in SCALARS]
    pairs += [(getattr(numbers, name), [getattr(s.constants, name) for s in setups]) for name in CONSTANTS]
    widths = [[(high - low) / n for low, high, n in zip(s.low, s.high, s.cells, strict=True)] for s in setups]
    pairs += [(numbers.width, widths), (numbers.low, [s.low for s in setups])]
    upload([*pairs, (numbers.driving_gradient, [s.driving_gradient for s in setups])])
    velocities = [[s.sides[name].velocity for name in SIDES] for s in setups]
    roughness = [[s.sides[name].roughness for name in SIDES] for s in setups]
    write(numbers.side_velocity, np.array(velocities, np.float64))
    write(numbers.side_roughness, np.array(roughness, np.float64))


def write_grid(air: Air, setups: Sequence[AirSetup]) -> None:
    """Put heights of faces, centres and cells on the device, ghosts included."""
    faces = np.stack([np.asarray(s.faces_z, np.float64) for s in setups])
    height = np.diff(faces, axis=1)
    centre = 0.5 * (faces[:, 1:] + faces[:, :-1])
    ends = faces[:, :1], faces[:, -1:]
    write(air.face, np.concatenate([ends[0], faces], axis=1))
    write(air.centre, np.concatenate([ends[0], centre, ends[1]], axis=1))
    write(air.height, np.concatenate([height[:, :1], height, height[:, -1:]], axis=1))
    ones = np.ones(air.cells[2])
    shapes = [ones if s.inlet_shape is None else s.inlet_shape for s in setups]
    write(air.inlet_shape, np.pad(np.stack(shapes), ((0, 0), (1, 1)), mode="edge"))


def write_start(air: Air, setups: Sequence[AirSetup]) -> None:
    """Put the first velocities on the device; all cells are air."""
    starts = np.stack([start_of(setup) for setup in setups])
    around = ((0, 0), (1, 1), (1, 1), (1, 1))
    for axis, velocity in enumerate((air.velocity_x, air.velocity_y, air.velocity_z)):
        write(velocity, np.pad(starts[:, axis], around, mode="edge"))
    for full in (air.void_fraction, air.void_before):
        write(full, 1.0)


def start_of(setup: AirSetup) -> Floats:
    """First velocities [3, nx, ny, nz] in m s-1."""
    whole = np.zeros((3, *setup.cells))
    if setup.start is None:
        return whole
    start = np.asarray(setup.start, np.float64)
    if start.ndim == 1:
        whole[0] = start
        return whole
    return start
