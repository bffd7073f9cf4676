"""The engine that compiles the kernels: the one named, else Taichi where it is installed, else quadrants."""

import pytest

from taichi_erosion.core.engine import choice
from taichi_erosion.core.errors import BadInput


@pytest.fixture
def installed(monkeypatch):
    """Function that says which engines are installed, and which one is asked for."""

    def install(*names: str, asked: str = "") -> None:
        monkeypatch.setenv(choice.SWITCH, asked)
        monkeypatch.setattr(choice, "find_spec", lambda name: name if name in names else None)
        choice.engine_name.cache_clear()

    yield install
    choice.engine_name.cache_clear()


def test_taichi_is_the_default_where_it_is_installed(installed):
    installed("quadrants", "taichi")
    assert choice.engine_name() == "taichi"


def test_quadrants_takes_its_place_where_it_is_not(installed):
    installed("quadrants")
    assert choice.engine_name() == "quadrants"


def test_the_engine_that_is_named_is_taken(installed):
    installed("quadrants", "taichi", asked="quadrants")
    assert choice.engine_name() == "quadrants"


@pytest.mark.parametrize(
    ("names", "asked", "told"),
    [
        (("taichi",), "quadrants", "pip install quadrants"),
        (("taichi",), "fortran", "the engines are taichi and quadrants"),
        ((), "", "pip install taichi"),
    ],
)
def test_an_engine_that_is_not_there_is_refused_in_one_line(installed, names, asked, told):
    installed(*names, asked=asked)
    with pytest.raises(BadInput, match=told) as refused:
        choice.engine_name()
    assert "\n" not in str(refused.value)
