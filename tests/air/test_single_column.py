"""The column of air: the same flow as the whole grid, an exact balance, any stiffness of drag."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from taichi_erosion.air.grid import Air, allocate_air, apply_to_all_columns, store_previous_void
from taichi_erosion.air.single_column import advance_columns
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.air_setup import AirModel, AirSetup, AirSide, SideKind, bed_faces, log_profile
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats, Numerics
from tests.verification.small_scenes import centres, sides, still_air

FRICTION = 0.3  # m s-1
DENSITY = 1.2  # kg m-3
BED, LID = 2e-3, 0.05  # m, height of the bed and of the column
FACES = bed_faces(0.0, BED, LID, 1e-4, 1.2)
INSIDE = FACES[1:] <= BED * (1.0 + 1e-9)  # layers of the bed
STEPS = 20


@pytest.fixture(autouse=True)
def device(start_device):
    start_device(Numerics(threads=1))


def column(floor: SideKind = "wall", **words: Any) -> AirSetup:
    usual: dict[str, Any] = {
        "sides": sides(z_low=AirSide(floor, roughness=1e-5), z_high=AirSide("stress")),
        "time_step": 1e-3,
        "model": AirModel("mixing_length", "central", "euler", exchange=True),
        "friction_velocity": FRICTION,
        "start": log_profile(centres(FACES), FRICTION, 1e-5, 0.4),
    }
    return replace(still_air(FACES, (0.01, 0.01), DENSITY, 1.8e-5), **usual | words)


def over_grains(setups: list[AirSetup], coefficient: float, force: float) -> Air:
    """Air over a bed of solid share 0.6 that resists by `coefficient` and pushes by `force`."""
    air = allocate_air(setups)
    for field, value, elsewhere in (
        (air.void_fraction, 0.4, 1.0),
        (air.exchange_coefficient, coefficient, 0.0),
        (air.exchange_force, force, 0.0),
    ):
        values = field.to_numpy()
        layers = (values[..., 0] if values.ndim == 5 else values)[:, 1, 1, 1:-1]
        layers[:] = np.where(INSIDE, value, elsewhere)
        field.from_numpy(values)
    return air


def wind(air: Air, replica: int = 0) -> Floats:
    """Horizontal velocity of the column by layer [m s-1]."""
    return air.velocity_x.to_numpy()[replica, 1, 1, 1:-1]


@pytest.mark.parametrize("floor", ["rough", pytest.param("wall", marks=pytest.mark.slow)])
def test_the_column_is_the_grid_of_one_column(floor):
    setup = column(floor, implicitness=0.7, driving_gradient=(-0.5, 0.0, 0.0))
    grid, alone = (over_grains([setup], coefficient=1e3, force=5.0) for _ in range(2))
    apply_to_all_columns(store_previous_void, grid)
    advance_air(grid, STEPS)
    advance_columns(STEPS, alone)
    # the same sums in another order; explicit halves of stiff layers magnify rounding
    assert np.abs(wind(grid) - wind(alone)).max() < 1e-8 * wind(alone).max()


def test_the_air_gains_what_lid_and_grains_give_less_what_the_floor_takes_beside_a_gale():
    setup = column()
    air = over_grains([column(friction_velocity=2.0), setup], coefficient=200.0, force=3.0)
    advance_columns(5, air)
    before = wind(air, 1)
    advance_columns(1, air)
    after, height = wind(air, 1), np.diff(FACES)
    gained = DENSITY * (height * np.where(INSIDE, 0.4, 1.0) * (after - before)).sum() / setup.time_step
    floor = DENSITY * setup.viscosity * 0.4 * after[0] / (0.5 * height[0])
    grains = (height * INSIDE * (3.0 - 200.0 * after)).sum()
    lid = DENSITY * FRICTION**2
    assert gained == pytest.approx(lid - floor + grains, abs=1e-12 * lid)


def test_grains_that_resist_without_bound_hold_the_air_still():
    air = over_grains([column()], coefficient=1e12, force=1e12 * 0.25)
    advance_columns(STEPS, air)
    # f = beta v with v = 0.25 m/s: the air moves with the grains, and the wind above stays bounded
    assert wind(air)[INSIDE] == pytest.approx(0.25, abs=1e-6)
    assert np.all(np.isfinite(wind(air)))
    assert wind(air)[-1] < 30.0 * FRICTION


def test_an_ensemble_shares_its_cells_and_model():
    with pytest.raises(BadInput, match="share"):
        allocate_air([column(), column(model=AirModel("none"))])
