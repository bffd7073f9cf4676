"""What every test relies on: quiet libraries, a device started afresh, random cases that repeat."""

import os
from collections.abc import Callable, Iterator

os.environ.setdefault("CI", "true")  # the recording viewer then sends no usage statistics
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("RERUN_STRICT", "1")  # a wrong argument raises instead of logging

import pytest
from hypothesis import settings

from taichi_erosion.core.setup import Numerics

# no deadline: the cores are shared; the same cases each time: a red test can be repeated
settings.register_profile("repeatable", deadline=None, derandomize=True, print_blob=False)
settings.load_profile("repeatable")


@pytest.fixture
def start_device() -> Iterator[Callable[[Numerics], int]]:
    """Function that starts Taichi; the device and its fields are released when the test ends."""
    from taichi_erosion.core import device

    yield device.start_device
    device.stop_device()
