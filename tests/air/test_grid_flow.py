"""Air on a grid: statistics of the fluctuations at an inlet, and projection with grains in the way."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.air.grid import allocate_air, apply_to_all_columns, store_previous_void
from taichi_erosion.air.inlet_turbulence import sample_waves
from taichi_erosion.air.readback import face_velocities
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.air_setup import AirModel, AirSide, InletTurbulence
from taichi_erosion.core.setup import Numerics
from tests.verification.small_scenes import box, sides


def test_inlet_fluctuations_have_the_stated_deviation_and_no_mean():
    turbulence = InletTurbulence((0.5, 0.3, 0.2), length=0.1, seed=3, waves=400)
    vector, amplitude, phase = sample_waves(turbulence)
    blown = np.cos(np.random.default_rng(1).uniform(0.0, 50.0, (4000, 3)) @ vector.T + phase) @ amplitude
    # 400 random directions leave a scatter of a few per cent in each component
    assert blown.std(axis=0) == pytest.approx(turbulence.deviation, rel=0.15)
    assert np.abs(blown.mean(axis=0)).max() < 0.03
    assert not np.array_equal(sample_waves(replace(turbulence, seed=4))[2], phase)


SPEED, DENSITY, COEFFICIENT, VOID = 0.1, 1.2, 500.0, 0.4  # m s-1, kg m-3, N s m-4, 1


@pytest.mark.slow
def test_air_rises_faster_between_grains_and_pays_for_their_drag_with_pressure(start_device):
    start_device(Numerics(threads=1))
    ends = sides(z_low=AirSide("inlet", (0.0, 0.0, SPEED)), z_high=AirSide("outlet"))
    words = {"density": DENSITY, "viscosity": 1.5e-5, "time_step": 1e-3, "implicitness": 1.0}
    upward = box((4, 4, 16), (0.01, 0.01, 0.04), sides=ends, model=AirModel(exchange=True), **words)
    air = allocate_air([upward])
    void, drag = air.void_fraction.to_numpy(), air.exchange_coefficient.to_numpy()
    void[:, :, :, 5:10], drag[:, :, :, 5:10] = VOID, COEFFICIENT  # layers 4 to 8
    air.void_fraction.from_numpy(void)
    air.exchange_coefficient.from_numpy(drag)
    apply_to_all_columns(store_previous_void, air)
    advance_air(air, 60)
    rise = face_velocities(air, 0)[2][1, 1]
    assert rise[0] == pytest.approx(SPEED)
    assert rise[6] == pytest.approx(SPEED / VOID, rel=1e-6)  # inside: eps w is what enters
    assert rise[-1] == pytest.approx(SPEED, rel=1e-6)
    pressure = air.pressure.to_numpy()[0, 1, 1, 1:-1]
    # eps dp/dz = -beta w between two layers inside the bed
    assert ((pressure[7] - pressure[6]) / 0.0025) == pytest.approx(-COEFFICIENT * SPEED / VOID**2, rel=1e-6)
