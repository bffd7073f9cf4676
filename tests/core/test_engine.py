"""The engine that compiles the kernels: the one named, else Taichi where it is installed, else quadrants."""

import pytest

from taichi_erosion.core import engine
from taichi_erosion.core.errors import BadInput

BOTH = ("quadrants", "taichi")


@pytest.fixture
def chosen(monkeypatch):
    """Function that chooses where some engines are installed and one is asked for."""

    def choose(installed: tuple[str, ...], asked: str) -> str:
        monkeypatch.setenv(engine.SWITCH, asked)
        monkeypatch.setattr(engine, "find_spec", lambda name: name if name in installed else None)
        engine.engine_name.cache_clear()
        return engine.engine_name()

    yield choose
    engine.engine_name.cache_clear()


@pytest.mark.parametrize(
    ("installed", "asked", "name"),
    [(BOTH, "", "taichi"), (("quadrants",), "", "quadrants"), (BOTH, "quadrants", "quadrants")],
)
def test_the_engine_that_is_named_is_taken_else_taichi_else_quadrants(chosen, installed, asked, name):
    assert chosen(installed, asked) == name


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
