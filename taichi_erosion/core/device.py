"""Starting the device: the only place that calls `ti.init`."""

import contextlib
import io
import os
import tempfile
import time
from pathlib import Path

from taichi_erosion.core.compiler_target import compiler_target
from taichi_erosion.core.engine.choice import engine_mark, engine_version
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import LOCK, OPTIONS, core, impl, ti
from taichi_erosion.core.transfer import is_host

LOCK_SECONDS = 30.0  # age from which the lock of a cache counts as left behind
SERIAL_LINES = 1024  # two blocks of 512 iterations, of which Taichi gives one to a thread
CACHE_BYTES = 1 << 30  # of compiled kernels, 2 MB a kind of run; beyond it the oldest are dropped


def cache_folder() -> Path:
    """Folder of compiled kernels, shared by all runs of this user with one engine on processors of one name.

    The key of a kernel knows no processor, and its loops are laid out for one before it is kept.
    """
    engine = f"{engine_mark()}-{engine_version()}" if engine_mark() else ""
    root = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(root) / "taichi_erosion" / "kernels" / f"{compiler_target()}{engine}"


def is_writable(folder: Path) -> bool:
    """Whether a file can be made there; Taichi crashes at exit when its cache folder refuses."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def remove_stale_lock(folder: Path) -> None:
    """Remove the lock of a killed process, which would keep every later run from the cache."""
    lock = folder / LOCK
    with contextlib.suppress(OSError):
        if time.time() - lock.stat().st_mtime > LOCK_SECONDS:
            lock.unlink()


def usable_cores() -> int:
    """Cores that this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def start_device(numerics: Numerics, pool_least: int = 1) -> int:
    """Start Taichi and return the number of workers that run at the same time.

    The size of Taichi's thread pool is compiled into every kernel. `pool_least` is a lower bound of it, so
    that kernels compiled for one number of workers serve any smaller number.

    Fast-math stays off: IEEE arithmetic gives the same bits in every kernel that holds the same formula, so a
    replica repeats alone, in an ensemble, and on any number of threads. Raises BadInput where Taichi falls
    back to another device.
    """
    threads = numerics.threads or usable_cores()
    cache = cache_folder()
    offline = is_writable(cache)
    remove_stale_lock(cache)
    # Taichi makes this folder at exit even where it keeps nothing there, and crashes where it cannot
    folder = cache if offline else Path(__file__).parent
    with contextlib.redirect_stdout(io.StringIO()):
        ti.init(
            arch=getattr(ti, numerics.arch),
            default_fp=getattr(ti, numerics.precision),
            cpu_max_num_threads=max(threads, pool_least),
            fast_math=False,
            advanced_optimization=False,
            log_level=ti.ERROR,  # a cache that another process holds is no news to the user
            offline_cache=offline,
            offline_cache_file_path=str(folder),
            offline_cache_max_size_of_files=CACHE_BYTES,
            **OPTIONS,
        )
    refuse_fallback(numerics.arch)
    refuse_single_precision(numerics.arch)
    return threads


@ti.kernel
def add_one(
    # out
    number_out: ti.template(),
):
    number_out[0] = number_out[0] + ti.cast(1.0, ti.f64)


def refuse_single_precision(arch: str) -> None:
    """Raise BadInput for a Vulkan device without 64-bit floats, in which positions are kept."""
    if arch != "vulkan":
        return
    try:
        add_one(ti.field(ti.f64, shape=1))
    except RuntimeError:
        stop_device()
        told = "this device has no 64-bit floats, in which positions are kept; use --arch cpu"
        raise BadInput(f"--arch vulkan: {told}") from None


def has_cuda() -> bool:
    """Whether there is an NVIDIA graphics processor that the engine can use."""
    return bool(core.with_cuda())


def refuse_fallback(arch: str) -> None:
    """Raise BadInput where Taichi silently took another device."""
    started = impl.current_cfg().arch
    wanted = {ti.x64, ti.arm64} if arch == "cpu" else {getattr(ti, arch)}
    if started not in wanted:
        raise BadInput(f"--arch {arch}: no such device on this machine; use --arch cpu")


def is_serial(lines: int) -> bool:
    """Whether a loop over so many lines of cells runs on the thread that launches it.

    To wake other threads takes a CPU as long as some hundred lines, and much longer beside other programs.
    """
    return is_host() and lines <= SERIAL_LINES


def stop_device() -> None:
    """Release the device and every field on it."""
    ti.reset()
