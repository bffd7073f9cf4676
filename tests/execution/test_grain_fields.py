"""Fields of a bed that has come to rest: they hold its mass, and their stress carries its weight."""

from pathlib import Path

import numpy as np
import pytest

import taichi_erosion as te
from taichi_erosion.core.device import stop_device

SCENE = Path(__file__).parents[2] / "scenes" / "column_collapse.toml"
SIDE, GRAVITY = 0.03, 9.81  # m, m s-2


@pytest.fixture(scope="module")
def session():
    changes = {"grains.count": 150, "measure.solid_fraction.plate": "plate", "geometry.tube.radius": 5e-3}
    changes |= {"measure.lateral_stress_ratio.plate": "plate", "fill.radius_d": 2.0}
    yield te.live(SCENE, changes).run_until_rest()
    stop_device()


def test_mass_and_balance_of_momentum_of_a_bed_at_rest(session):
    z = np.arange(-0.008, 0.05, 1e-4)
    found = session.fields(width=1e-3, extent={"x": SIDE, "y": SIDE}, z=z)
    assert found.density.sum() * 1e-4 * SIDE**2 == pytest.approx(float(session.grains.mass.sum()), rel=1e-5)
    stress = (found.contact_stress + found.kinetic_stress).sel(axis="z", along="z").values
    weight, walls = GRAVITY * found.density.values, found.wall_force.sel(axis="z").values
    assert np.abs(np.gradient(stress, z) - walls + weight).max() < 0.02 * weight.max()
    top = z > 0.006
    above = np.cumsum(weight[::-1])[::-1] * 1e-4
    np.testing.assert_array_less(stress[top], above[top] + 0.01 * above.max())  # the tube carries a share


def test_measures_of_the_profile_lie_where_packings_of_spheres_do(session):
    table = session.table
    assert 0.3 < table.loc["solid_fraction", "value"] < 0.64
    assert 0.2 < table.loc["lateral_stress_ratio", "value"] < 1.2
    line = session.fields()
    assert line.solid_fraction.dims == ("z",)
    assert float(line.solid_fraction.max()) < 0.7


def test_open_axes_and_unknown_ones_are_refused(session):
    with pytest.raises(te.BadInput, match="x is open"):
        session.fields(z=0.0)
    with pytest.raises(te.BadInput, match="no axis"):
        session.fields(r=0.0)
