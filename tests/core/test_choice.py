"""The engine that compiles the kernels: the one named, else Taichi where it is installed, else quadrants."""

import pytest

from taichi_erosion.core.engine import choice
from taichi_erosion.core.errors import BadInput

BOTH = ("quadrants", "taichi")


@pytest.fixture
def chosen(monkeypatch):
    """Function that chooses where some engines are installed and one is asked for."""

    def choose(installed: tuple[str, ...], asked: str) -> str:
        monkeypatch.setenv(choice.SWITCH, asked)
        monkeypatch.setattr(choice, "find_spec", lambda name: name if name in installed else None)
        choice.engine_name.cache_clear()
        return choice.engine_name()

    yield choose
    choice.engine_name.cache_clear()


@pytest.mark.parametrize(
    ("installed", "asked", "engine"),
    [(BOTH, "", "taichi"), (("quadrants",), "", "quadrants"), (BOTH, "quadrants", "quadrants")],
)
def test_the_engine_that_is_named_is_taken_else_taichi_else_quadrants(chosen, installed, asked, engine):
    assert chosen(installed, asked) == engine


@pytest.mark.parametrize(
    ("installed", "asked", "told"),
    [
        (("taichi",), "quadrants", "pip install quadrants"),
        (("taichi",), "fortran", "the engines are taichi and quadrants"),
        ((), "", "pip install taichi"),
    ],
)
def test_an_engine_that_is_not_there_is_refused(chosen, installed, asked, told):
    with pytest.raises(BadInput, match=told):
        chosen(installed, asked)
