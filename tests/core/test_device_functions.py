"""Elementary functions of 64-bit floats as series, for Vulkan, against those of NumPy."""

import numpy as np

from taichi_erosion.core import device_functions
from taichi_erosion.core.device_functions import cosine, exponential, logarithm, sine
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import ti

LAST_PLACE = 2.0**-52
FEW = 4.0  # units of the last place: three or four roundings of the sum and of the reduction


@ti.kernel
def evaluate(
    # in
    numbers: ti.types.ndarray(dtype=ti.f64, ndim=1),
    # out
    found_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    for n in range(numbers.shape[0]):
        found_out[n, 0], found_out[n, 1] = sine(numbers[n]), cosine(numbers[n])
        found_out[n, 2] = exponential(numbers[n])
        found_out[n, 3] = logarithm(ti.abs(numbers[n]))


def test_series_are_right_to_a_few_units_of_the_last_place(start_device, monkeypatch):
    monkeypatch.setattr(device_functions, "has_wide_functions", lambda: False)
    start_device(Numerics("cpu", 1, "f64"))
    rng = np.random.default_rng(1)
    x = np.concatenate([rng.uniform(-50.0, 50.0, 2000), rng.normal(0.0, 1.0, 2000), [1e-9, 1.0, -1.0, 700.0]])
    found = np.zeros((len(x), 4))
    evaluate(x, found)
    for column, want in enumerate((np.sin(x), np.cos(x))):
        assert np.abs(found[:, column] - want).max() < FEW * LAST_PLACE
    assert np.abs(found[:, 2] / np.exp(x) - 1.0).max() < FEW * LAST_PLACE
    logarithms = np.log(np.abs(x))
    assert np.abs(found[:, 3] - logarithms).max() < FEW * LAST_PLACE * np.abs(logarithms).max()
