"""Soil wind erosion: grains, air, and the effects between them.

The names of the Python interface (`taichi_erosion.api`) are found here too: `import taichi_erosion as te`,
then `te.run`, `te.study`, `te.effects`, `te.live`. They are loaded when they are used. Two of them are also
names of rooms: a room that has been imported stands at its name, and calls the interface when it is called.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.2.0"

INTERFACE = "taichi_erosion.api"
CALLED = ("run", "effects")  # rooms that are called like the function of the same name


class Room(ModuleType):
    """A room whose name is also that of a function of the interface."""

    def __call__(self, *args: Any, **entries: Any) -> Any:
        function = getattr(import_module(INTERFACE), self.__name__.rpartition(".")[2])
        return function(*args, **entries)


class Package(ModuleType):
    """The package, which makes such rooms of them as they are imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        if name in CALLED and isinstance(value, ModuleType):
            value.__class__ = Room
        super().__setattr__(name, value)


def __getattr__(name: str) -> Any:
    if name.startswith("_") or name not in import_module(INTERFACE).__all__:
        raise AttributeError(f"module 'taichi_erosion' has no attribute '{name}'")
    return getattr(import_module(INTERFACE), name)


def __dir__() -> list[str]:
    return sorted([*import_module(INTERFACE).__all__, "__version__"])


sys.modules[__name__].__class__ = Package
