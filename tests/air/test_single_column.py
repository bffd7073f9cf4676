"""The column of air: the same flow as the whole grid, an exact balance, any stiffness of drag."""

import numpy as np
import pytest
from flows import BED, DENSITY, FRICTION, column, put_grains, wind

from taichi_erosion.air.grid import allocate_air, parallel_columns, store_void_fraction
from taichi_erosion.air.single_column import advance_columns
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.setup import Numerics

STEPS = 20


@pytest.mark.parametrize("floor", ["rough", pytest.param("wall", marks=pytest.mark.slow)])
def test_the_column_is_the_grid_of_one_column(floor, start_device):
    start_device(Numerics(threads=1))
    setup = column(floor, implicitness=0.7, driving_gradient=(-0.5, 0.0, 0.0))
    grid, alone = allocate_air([setup]), allocate_air([setup])
    for air in (grid, alone):
        put_grains(air, setup, coefficient=1e3, force=5.0)
    parallel_columns(store_void_fraction, grid)
    advance_air(grid, STEPS)
    advance_columns(STEPS, alone)
    # the same sums in another order; explicit halves of stiff layers magnify rounding
    assert np.abs(wind(grid) - wind(alone)).max() < 1e-8 * wind(alone).max()


def test_the_air_gains_what_lid_and_grains_give_less_what_the_floor_takes(start_device):
    start_device(Numerics(threads=1))
    setup = column()
    air = allocate_air([setup])
    put_grains(air, setup, coefficient=200.0, force=3.0)
    advance_columns(5, air)
    before = wind(air)
    advance_columns(1, air)
    after, height = wind(air), np.diff(setup.faces_z)
    void = np.where(setup.faces_z[1:] <= BED * (1.0 + 1e-9), 0.4, 1.0)
    inside = void < 1.0
    gained = DENSITY * (height * void * (after - before)).sum() / setup.time_step
    floor = DENSITY * setup.viscosity * 0.4 * after[0] / (0.5 * height[0])
    grains = (height * inside * (3.0 - 200.0 * after)).sum()
    lid = DENSITY * FRICTION**2
    assert gained == pytest.approx(lid - floor + grains, abs=1e-12 * lid)


def test_grains_that_resist_without_bound_hold_the_air_still(start_device):
    start_device(Numerics(threads=1))
    setup = column()
    air = allocate_air([setup])
    put_grains(air, setup, coefficient=1e12, force=1e12 * 0.25)
    advance_columns(STEPS, air)
    inside = setup.faces_z[1:] <= BED * (1.0 + 1e-9)
    # f = beta v with v = 0.25 m/s: the air moves with the grains, and the wind above stays bounded
    assert wind(air)[inside] == pytest.approx(0.25, abs=1e-6)
    assert np.all(np.isfinite(wind(air)))
    assert wind(air)[-1] < 30.0 * FRICTION


def test_a_replica_does_not_feel_another(start_device):
    start_device(Numerics(threads=1))
    calm, gale = column(exchange=False), column(exchange=False, friction_velocity=2.0)
    alone, both = allocate_air([calm]), allocate_air([gale, calm])
    for air in (alone, both):
        advance_columns(STEPS, air)
    assert np.array_equal(wind(alone), wind(both, 1))
