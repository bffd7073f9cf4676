"""Drag on the device against the same laws written a second time."""

from itertools import product
from typing import get_args

import numpy as np
import pytest

from taichi_erosion.core.setup import DragLaw, Numerics
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling import drag
from tests.verification.reference.flow import LAWS, Stream

DENSITY, VISCOSITY = 1.225, 1.789e-5  # kg m-3, Pa s
MASS = 2e-8  # kg
# slips [m s-1], diameters [m] and void fractions
CASES = np.array(list(product((1e-4, 0.03, 0.9, 12.0), (2e-5, 2.5e-4, 3e-3), (0.4, 0.79, 0.81, 1.0))))


@pytest.mark.parametrize("law", get_args(DragLaw))
def test_drag_is_that_of_its_published_law(start_device, law: str):
    start_device(Numerics("cpu", 1, "f64"))
    rate = drag.drag_law(law)

    @ti.kernel
    def evaluate(
        table: ti.types.ndarray(dtype=ti.f64, ndim=2), force_out: ti.types.ndarray(dtype=ti.f64, ndim=1)
    ):
        for i in range(table.shape[0]):
            slip, radius, void = table[i, 0], 0.5 * table[i, 1], table[i, 2]
            force_out[i] = rate(slip, radius, MASS, DENSITY, VISCOSITY / DENSITY, void) * MASS * slip

    found = np.zeros(len(CASES))
    evaluate(CASES, found)
    want = [LAWS[law](Stream(slip, d, DENSITY, VISCOSITY, void)) for slip, d, void in CASES]
    # the same formula in double precision: only the order of operations differs
    assert found == pytest.approx(want, rel=1e-9)
