"""Soil wind erosion: grains, air, and the effects between them.

The names of the Python interface (`taichi_erosion.api`) are found here too: `import taichi_erosion as te`,
then `te.run`, `te.study`, `te.effects`, `te.live`. They are loaded when used; no room bears their names.
"""

from importlib import import_module
from typing import Any

__version__ = "0.2.0"

INTERFACE = "taichi_erosion.api"


def __getattr__(name: str) -> Any:
    if name.startswith("_") or name not in import_module(INTERFACE).__all__:
        raise AttributeError(f"module 'taichi_erosion' has no attribute '{name}'")
    return getattr(import_module(INTERFACE), name)


def __dir__() -> list[str]:
    return sorted([*import_module(INTERFACE).__all__, "__version__"])
