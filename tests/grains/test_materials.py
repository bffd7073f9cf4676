"""Contact rows on the device are those that the host fills."""

import numpy as np
import pytest
from grain_worlds import contacts

from taichi_erosion.core import setup
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import ti
from taichi_erosion.grains.materials import allocate_materials, damping_ratio, pair_row

REPLICA = 2
MATERIALS = 4


@ti.kernel
def write_rows(
    # in
    materials: ti.template(),
    # out
    rows_out: ti.types.ndarray(dtype=ti.i32, ndim=2),
):
    for i, j in ti.ndrange(materials.count, materials.count):
        rows_out[i, j] = pair_row(materials, REPLICA, i, j)


def test_the_device_finds_the_row_that_the_host_filled(start_device):
    start_device(Numerics("cpu", 1))
    materials = allocate_materials(REPLICA + 1, MATERIALS)
    rows = np.zeros((MATERIALS, MATERIALS), np.int32)
    write_rows(materials, rows)
    host = [[setup.pair_row(i, j, MATERIALS) for j in range(MATERIALS)] for i in range(MATERIALS)]
    assert (rows - REPLICA * materials.rows).tolist() == host


def test_every_pair_of_materials_has_a_row_of_its_own():
    rows = {setup.pair_row(i, j, MATERIALS) for i in range(MATERIALS) for j in range(i, MATERIALS)}
    assert rows == set(range(MATERIALS * (MATERIALS + 1) // 2))


@pytest.mark.parametrize("restitution", [0.05, 0.3, 0.6, 0.95, 1.0])
def test_the_damping_gives_back_the_restitution_of_a_damped_oscillator(restitution):
    # e = exp(-pi beta / sqrt(1 - beta^2)), which Tsuji's force keeps for a Hertz contact
    beta = damping_ratio(contacts(restitution=restitution).restitution)[0]
    assert np.exp(-np.pi * beta / np.sqrt(1.0 - beta**2)) == pytest.approx(restitution, rel=1e-12)
