"""What the engine is told about the source of device functions: read once, named where something is wrong."""

import inspect

import pytest

from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import CompilationError, ti

CALLS = 20
pytestmark = pytest.mark.engine


@ti.func
def next_number(number):
    return number + 1


@ti.func
def unknown_number(number):
    return number + nowhere_said  # noqa: F821


@ti.kernel
def count_up() -> ti.i32:
    number = 0
    for _ in ti.static(range(CALLS)):
        number = next_number(number)
    return number


@ti.kernel
def fail() -> ti.i32:
    return unknown_number(1)


def test_a_function_that_is_inlined_many_times_is_read_once(start_device, monkeypatch):
    start_device(Numerics("cpu", 1))
    read = []
    source_lines = inspect.getsourcelines

    def counted(function):
        read.append(function.__name__)
        return source_lines(function)

    monkeypatch.setattr(inspect, "getsourcelines", counted)
    assert count_up() == CALLS
    assert read.count("next_number") <= 1


def test_an_error_in_a_device_function_is_told_with_its_place_and_source(start_device):
    start_device(Numerics("cpu", 1))
    with pytest.raises(CompilationError) as told:
        fail()
    line = inspect.getsourcelines(unknown_number)[1] + 2
    assert f'{__file__}", line {line}, in unknown_number' in str(told.value)
    assert "number + nowhere_said" in str(told.value)
