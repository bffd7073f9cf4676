"""The air at a point: a linear wind is found exactly anywhere, its gradient too."""

import numpy as np
import pytest

from taichi_erosion.air.assemble import allocate_air
from taichi_erosion.air.boundary import close_velocities
from taichi_erosion.air.interpolation import air_velocity_at, pressure_gradient_at, velocity_gradient_at
from taichi_erosion.core.air_setup import SIDES, AirSetup, AirSide, stretched_faces
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import ti

CELLS, HIGH = (4, 6, 8), (2.0, 3.0, 1.0)
SHEAR, DRIVING = 3.0, (-0.5, 0.25, 0.0)  # s-1, Pa m-1


@ti.kernel
def probe(air: ti.template(), x: float, y: float, z: float, found_out: ti.types.ndarray(ti.f64, 2)):
    for r in range(1):
        position = ti.Vector([x, y, z])
        velocity = air_velocity_at(air, r, position)
        gradient = velocity_gradient_at(air, r, position)
        pressure = pressure_gradient_at(air, r, position)
        for i in ti.static(range(3)):
            found_out[0, i] = velocity[i]
            found_out[1, i] = pressure[i]
            for j in ti.static(range(3)):
                found_out[2 + i, j] = gradient[i, j]


@pytest.fixture
def shear(start_device):
    """Wind u = SHEAR z under a lid that moves with it."""
    start_device(Numerics(threads=1, precision="f64"))
    faces = stretched_faces(0.0, HIGH[2], CELLS[2], 0.05)
    ends = {"z_low": AirSide("wall"), "z_high": AirSide("wall", (SHEAR * HIGH[2], 0.0, 0.0))}
    sides = {name: ends.get(name, AirSide()) for name in SIDES}
    start = SHEAR * 0.5 * (faces[1:] + faces[:-1])
    low = (0.0, 0.0, 0.0)
    words = {"driving_gradient": DRIVING, "start": start}
    air = allocate_air([AirSetup(CELLS, low, HIGH, faces, sides, 1.0, 1e-5, 1e-3, **words)])  # type: ignore[arg-type]
    close_velocities(air)
    return air


@pytest.mark.parametrize(
    "place", [(0.3, 0.4, 0.5), (1.99, 2.99, 0.999), (0.01, 0.01, 0.001), (1.0, 1.5, 0.05)]
)
def test_a_linear_wind_is_found_exactly(place, shear):
    found = np.zeros((5, 3))
    probe(shear, *place, found)
    assert found[0] == pytest.approx([SHEAR * place[2], 0.0, 0.0], abs=1e-12)
    assert found[1] == pytest.approx(DRIVING)
    assert found[2:] == pytest.approx(np.array([[0.0, 0.0, SHEAR], [0.0] * 3, [0.0] * 3]), abs=1e-10)
