"""Choice of the engine: Taichi, or its fork quadrants. Neither is imported here.

Taichi is the default where it is installed. It has no wheel for Python 3.14 and later, where quadrants is
installed in its place. An environment variable names one of the two; workers inherit it.
"""

import os
from functools import cache
from importlib.metadata import version
from importlib.util import find_spec
from typing import Any

from taichi_erosion.core.errors import BadInput

SWITCH = "TAICHI_EROSION_ENGINE"  # environment variable: name of the engine
ENGINES = ("taichi", "quadrants")  # the first that is installed is the default


@cache
def engine_name() -> str:
    """Name of the engine of this process. Raises BadInput where it is unknown or not installed."""
    asked = os.environ.get(SWITCH)
    if asked and asked not in ENGINES:
        raise BadInput(f"{SWITCH} = {asked}: the engines are {' and '.join(ENGINES)}")
    for name in [asked] if asked else ENGINES:
        if find_spec(name) is not None:
            return name
    raise BadInput(f"the engine {asked or ENGINES[0]} is not installed: pip install {asked or ENGINES[0]}")


def engine_version() -> str:
    """Version of the engine of this process."""
    return version(engine_name())


def engine_mark() -> str:
    """Mark of this engine in keys of results and kernels: its name, empty for the default engine."""
    return "" if engine_name() == ENGINES[0] else f"-{engine_name()}"


def is_device_function(function: Any) -> bool:
    """Whether a function was decorated with ti.func, which leaves the name of the engine on it."""
    return bool(getattr(function, f"_is_{engine_name()}_function", False))
