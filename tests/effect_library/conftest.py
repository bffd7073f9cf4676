"""A device for the numbers of single effects, started once for the tests of a file."""

from collections.abc import Iterator

import pytest

from taichi_erosion.core.device import start_device, stop_device
from taichi_erosion.core.effect_probe import Bench, allocate_bench
from taichi_erosion.core.setup import Numerics


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    start_device(Numerics("cpu", 1))
    yield allocate_bench()
    stop_device()
