"""Plain NumPy state of the air that measures and recordings read."""

from dataclasses import dataclass

from taichi_erosion.core.setup import Floats


@dataclass(frozen=True)
class AirSnapshot:
    """Air of one replica at one moment; arrays run over cells along x, y and z unless stated otherwise."""

    time: float  # s
    x: Floats  # [nx] m, centres of cells
    y: Floats  # [ny] m
    z: Floats  # [nz] m
    faces_z: Floats  # [nz + 1] m
    velocity: Floats  # [nx, ny, nz, 3] m s-1, at centres
    pressure: Floats  # [nx, ny, nz] Pa
    eddy_viscosity: Floats  # [nx, ny, nz + 1] m2 s-1, on the lower faces of cells and the lid
    friction_velocity: Floats  # [nx, ny] m s-1, of the floor
    density: float  # kg m-3
    viscosity: float  # m2 s-1
