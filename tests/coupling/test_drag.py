"""Drag on the device against the same laws written a second time, and their limits."""

import numpy as np
import pytest

from taichi_erosion.core.device import start_device, stop_device
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import ti
from taichi_erosion.coupling import drag
from tests.verification.reference.flow import LAWS, Stream

DENSITY, VISCOSITY = 1.225, 1.789e-5  # kg m-3, Pa s
MASS = 2e-8  # kg
SLIPS, DIAMETERS = (1e-4, 0.03, 0.9, 12.0), (2e-5, 2.5e-4, 3e-3)  # m s-1, m
VOIDS = (0.4, 0.79, 0.81, 1.0)


def forces(law: str, cases: np.ndarray) -> np.ndarray:
    rate = drag.drag_law(law)

    @ti.kernel
    def evaluate(
        # in
        table: ti.types.ndarray(dtype=ti.f64, ndim=2),
        # out
        force_out: ti.types.ndarray(dtype=ti.f64, ndim=1),
    ):
        for i in range(table.shape[0]):
            slip, radius, void = table[i, 0], 0.5 * table[i, 1], table[i, 2]
            force_out[i] = rate(slip, radius, MASS, DENSITY, VISCOSITY / DENSITY, void) * MASS * slip

    found = np.zeros(len(cases))
    evaluate(cases, found)
    return found


@pytest.fixture(scope="module")
def drags():
    start_device(Numerics("cpu", 1, "f64"))
    cases = np.array([(s, d, e) for s in SLIPS for d in DIAMETERS for e in VOIDS])
    found = {law: forces(law, cases) for law in drag.LAWS}
    stop_device()
    return cases, found


@pytest.mark.parametrize("law", drag.LAWS)
def test_drag_is_that_of_its_published_law(drags, law: str):
    cases, found = drags
    want = [LAWS[law](Stream(slip, d, DENSITY, VISCOSITY, void)) for slip, d, void in cases]
    # the same formula in double precision: only the order of operations differs
    assert found[law] == pytest.approx(want, rel=1e-9)


@pytest.mark.parametrize("law", ["schiller_naumann", "two_limits"])
def test_a_slow_small_sphere_feels_stokes_drag(drags, law: str):
    cases, found = drags
    slow = (cases[:, 0] == 1e-4) & (cases[:, 1] == 2e-5)
    stokes = 3.0 * np.pi * VISCOSITY * 2e-5 * 1e-4
    # Re = 1.4e-4: the next term of either law is sqrt(Re / 48) or smaller, 0.4 %
    assert found[law][slow] == pytest.approx(stokes, rel=5e-3)
