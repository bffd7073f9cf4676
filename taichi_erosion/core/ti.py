"""The one import of the engine that compiles kernels: Taichi, or quadrants (`core/engine.py`).

`ti` is the engine, `impl` its state, `core` its library. Both engines have the same words for what is used
here; where they differ, this file says how. `nearest_image` is the one device function of several rooms.
"""

import os
from typing import TYPE_CHECKING, Any

from taichi_erosion.core.engine import engine_name, speed_up_front_end

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("ENABLE_QUADRANTS_HEADER_PRINT", "0")
# both abort the process where HOME is not set, as under cron or in a container; any folder will do
os.environ.setdefault("HOME", os.path.expanduser("~") if os.path.isabs(os.path.expanduser("~")) else os.sep)

if TYPE_CHECKING or engine_name() == "taichi":
    import taichi as ti
    from taichi._lib import core
    from taichi.lang import impl

    CompilationError = ti.TaichiCompilationError
    memfence = ti.simt.grid.memfence  # what a thread of the device wrote before is seen by all threads after
    OPTIONS: dict[str, Any] = {}  # of `ti.init` that only this engine has
    LOCK = "ticache.lock"  # in the folder of the cache, held while its index is read or written
else:
    import quadrants as ti
    from quadrants._lib import core
    from quadrants.lang import impl

    CompilationError = ti.QuadrantsCompilationError
    memfence = ti.simt.grid.mem_fence
    # without it the compiler aborts on a store to a computed index of a vector that is read afterwards
    OPTIONS = {"force_scalarize_matrix": True}
    LOCK = os.path.join("kernel_compilation_manager", "qdcache.lock")

__all__ = ["LOCK", "OPTIONS", "CompilationError", "core", "impl", "memfence", "nearest_image", "ti"]

speed_up_front_end()


@ti.func
def nearest_image(difference, period):
    """Shortest vector between two positions of a periodic box [m]."""
    nearest = difference
    for k in ti.static(range(3)):
        if period[k] > 0.0:
            nearest[k] -= period[k] * ti.round(difference[k] / period[k])
    return nearest
