"""Fields of the air as NumPy arrays, and back."""

import numpy as np

from taichi_erosion.air.boundary import fill_velocity_ghosts
from taichi_erosion.air.grid import Air
from taichi_erosion.air.turbulence import floor_friction_velocity
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import AirSnapshot
from taichi_erosion.core.ti import ti
from taichi_erosion.core.transfer import download_field, write_field


@ti.kernel
def copy_air_to_table(r: ti.i32, air: ti.template(), table_out: ti.types.ndarray(dtype=ti.f64, ndim=4)):
    """Velocities on faces, pressure, eddy viscosity and friction velocity of the floor, ghosts included."""
    nx, ny, nz = ti.static(air.cells[0], air.cells[1], air.cells[2])
    for i, j in ti.ndrange(nx + 1, ny + 1):
        for k in range(nz + 1):
            for axis in ti.static(range(3)):
                table_out[axis, i, j, k] = air.velocities[axis][r, i, j, k]
            table_out[3, i, j, k] = air.pressure[r, i, j, k]
            table_out[4, i, j, k] = air.eddy_face[r, i, j, k]
        if i < nx and j < ny:
            table_out[5, i, j, 0] = floor_friction_velocity(air, r, i, j)


def face_velocities(air: Air, replica: int) -> tuple[Floats, Floats, Floats]:
    """Velocities on the faces [m s-1]: [nx + 1, ny, nz], [nx, ny + 1, nz] and [nx, ny, nz + 1]."""
    table = replica_table(air, replica)
    nx, ny, nz = air.cells
    return table[0, :, :ny, :nz], table[1, :nx, :, :nz], table[2, :nx, :ny, :]


def replica_table(air: Air, replica: int) -> Floats:
    """Table [6, nx + 1, ny + 1, nz + 1] of `copy_air_to_table`."""
    fill_velocity_ghosts(air)  # the step of a column does not fill the ghosts beside it
    table = np.zeros((6, *(n + 1 for n in air.cells)))
    copy_air_to_table(replica, air, table)
    return table


def air_snapshot(air: Air, replica: int) -> AirSnapshot:
    table = replica_table(air, replica)
    numbers = air.numbers
    nx, ny, nz = air.cells
    faces = download_field(air.face)[replica, 1:]
    low, width = download_field(numbers.low)[replica], download_field(numbers.width)[replica]
    velocity = [
        0.5 * (table[0, 1:, :ny, :nz] + table[0, :nx, :ny, :nz]),
        0.5 * (table[1, :nx, 1:, :nz] + table[1, :nx, :ny, :nz]),
        0.5 * (table[2, :nx, :ny, 1:] + table[2, :nx, :ny, :nz]),
    ]
    return AirSnapshot(
        time=float(download_field(numbers.time)[replica]),
        x=low[0] + width[0] * (np.arange(nx) + 0.5),
        y=low[1] + width[1] * (np.arange(ny) + 0.5),
        z=0.5 * (faces[1:] + faces[:-1]),
        faces_z=faces,
        velocity=np.stack(velocity, axis=-1),
        pressure=table[3, :nx, :ny, :nz],
        eddy_viscosity=table[4, :nx, :ny, :],
        friction_velocity=table[5, :nx, :ny, 0],
        density=float(download_field(numbers.density)[replica]),
        viscosity=float(download_field(numbers.viscosity)[replica]),
    )


def set_velocities(air: Air, replica: int, velocities: tuple[Floats, Floats, Floats]) -> None:
    """Write velocities on the faces, as `face_velocities` gives them; the sides follow at the next step."""
    for field, values in zip(air.velocities, velocities, strict=True):
        whole = download_field(field)
        nx, ny, nz = values.shape
        whole[replica, 1 : nx + 1, 1 : ny + 1, 1 : nz + 1] = values
        write_field(field, whole)
