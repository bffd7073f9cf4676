"""The column of air: the same flow as the whole grid, an exact balance, any stiffness of drag."""

import numpy as np
import pytest
from flows import BED, DENSITY, FRICTION, column, put_grains, wind

from taichi_erosion.air.column import advance_columns
from taichi_erosion.air.grid import allocate_air, parallel_columns, store_void_fraction
from taichi_erosion.air.step import advance_air
from taichi_erosion.core.air_setup import AirModel, bed_faces, stretched_faces
from taichi_erosion.core.errors import BadInput
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


def test_an_ensemble_shares_its_cells_and_model(start_device):
    start_device(Numerics(threads=1))
    other = column(model=AirModel("none"))
    with pytest.raises(BadInput, match="share"):
        allocate_air([column(), other])


def test_cells_of_a_bed_are_fine_in_it_and_widen_above():
    faces = bed_faces(0.0, 2e-3, 0.1, 1e-4, 1.2)
    width = np.diff(faces)
    assert faces[0] == 0.0
    assert faces[-1] == pytest.approx(0.1)
    assert width[:20] == pytest.approx(1e-4)
    assert np.all(width[21:] > width[20:-1])
    assert (width[1:] / width[:-1]).max() < 1.2 * (1.0 + 1e-9)


def test_stretched_cells_begin_with_the_finest_and_fill_the_box():
    width = np.diff(stretched_faces(1.0, 3.0, 20, 0.01))
    assert width[0] == pytest.approx(0.01)
    assert width.sum() == pytest.approx(2.0)
    assert width[1:] / width[:-1] == pytest.approx(width[1] / width[0])
