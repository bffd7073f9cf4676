"""Contact rows on the device are those that the host fills."""

import numpy as np

from taichi_erosion.core.setup import Numerics, pair_row
from taichi_erosion.core.ti import ti
from taichi_erosion.grains import materials as device

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
        rows_out[i, j] = device.pair_row(materials, REPLICA, i, j)


def test_every_pair_of_materials_has_a_row_of_its_own_which_the_device_finds(start_device):
    start_device(Numerics("cpu", 1))
    materials = device.allocate_materials(REPLICA + 1, MATERIALS)
    rows = np.zeros((MATERIALS, MATERIALS), np.int32)
    write_rows(materials, rows)
    rows -= REPLICA * materials.rows
    assert rows.tolist() == [[pair_row(i, j, MATERIALS) for j in range(MATERIALS)] for i in range(MATERIALS)]
    assert np.array_equal(rows, rows.T)
    assert set(rows.ravel()) == set(range(MATERIALS * (MATERIALS + 1) // 2))
