"""Start of the device, the only place that calls `ti.init`; and the processor that kernels are compiled for.

Taichi 1.7.4 compiles with LLVM 15, which looks its processor up by name in a table of features and tuning. A
newer processor is `generic` there (AMD Zen 5, Hygon, Zhaoxin) and gets no wide packed arithmetic; neither
`ti.init` nor the environment changes it. The table `llvm::X86SubTypeKV` is data, rows of 80 bytes {address of
the name, 32 bytes of features, 32 of tuning, address of the instruction schedule}. Before the first `ti.init`
the row `generic` receives what follows the name in that of `znver3`, 256 bits wide. No formula changes and
fast-math stays off: results keep their bits. Where the system, the version of Taichi, the size of the table
or the features of the processor are others, nothing is changed. quadrants compiles with LLVM 22, which knows
these processors.
"""

import contextlib
import ctypes
import io
import mmap
import os
import platform
import struct
import sys
import time
from functools import cache
from pathlib import Path

import numpy as np

from taichi_erosion.core.engine import engine_mark, engine_name, engine_version
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import require_writable
from taichi_erosion.core.setup import Numerics, usable_cores
from taichi_erosion.core.ti import LOCK, OPTIONS, core, impl, ti
from taichi_erosion.core.transfer import is_host_memory

LOCK_SECONDS = 30.0  # age from which the lock of a cache counts as left behind
SERIAL_LINES = 1024  # two blocks of 512 iterations, of which Taichi gives one to a thread
CACHE_BYTES = 1 << 30  # of compiled kernels, 2 MB a kind of run; beyond it the oldest are dropped
TAICHI = (1, 7, 4)
UNKNOWN = "generic"  # name that LLVM gives to a processor that it does not know
NAME_FUNCTION = b"_ZN4llvm3sys14getHostCPUNameEv"
TABLE = b"_ZN4llvm12X86SubTypeKVE"
ROW, FEATURES = 80, 8  # bytes of a row, and where what follows its name begins
TABLE_BYTES = 86 * ROW  # LLVM 15.0.4
SYMBOL = np.dtype([("name", "<u4"), ("kind", "<u4"), ("value", "<u8"), ("size", "<u8")])
MULTIPROCESSORS = 16  # of the attributes of a CUDA device
WIDE = "znver3"  # row that suits 256 bits
WIDE_FLAGS = {"avx2", "fma", "bmi1", "bmi2", "f16c", "abm", "movbe", "adx"}  # as /proc/cpuinfo names them


class StringRef(ctypes.Structure):
    """LLVM's pair of address and length of a text."""

    _fields_ = (("data", ctypes.c_void_p), ("length", ctypes.c_size_t))


def llvm_symbol_addresses(file: Path) -> tuple[int, int]:
    """Addresses within an ELF file of the function that names the processor and of the table; ValueError."""
    with file.open("rb") as opened, mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as image:
        (start,) = struct.unpack_from("<Q", image, 0x28)
        size, count, names = struct.unpack_from("<HHH", image, 0x3A)
        heads = [struct.unpack_from("<IIQQQQ", image, start + k * size) for k in range(count)]
        text = heads[names][4]
        parts = {image[text + h[0] : image.find(b"\0", text + h[0])]: (h[4], h[5]) for h in heads}
        texts, length = parts[b".strtab"]
        places = [image.find(b"\0" + name + b"\0", texts, texts + length) for name in (NAME_FUNCTION, TABLE)]
        start, length = parts[b".symtab"]
        symbols = np.frombuffer(image[start : start + length], SYMBOL)
    function, table = (symbols[symbols["name"] == place + 1 - texts] for place in places)
    if table["size"].tolist() != [TABLE_BYTES] or len(function) != 1:
        raise ValueError("another table of processors")
    return int(function["value"][0]), int(table["value"][0])


def processor_table_rows() -> tuple[str, dict[str, int]]:
    """What LLVM calls this processor, and the addresses of the rows of its table by name; ValueError."""
    maps = map(str.split, Path("/proc/self/maps").read_text(encoding="utf-8").splitlines())
    libraries = (words for words in maps if len(words) == 6 and "/taichi_python." in words[5])
    first = next((words for words in libraries if int(words[2], 16) == 0), None)
    if first is None:
        raise ValueError("Taichi's library is not loaded")
    base = int(first[0].partition("-")[0], 16)
    function, table = llvm_symbol_addresses(Path(first[5]))
    named = ctypes.CFUNCTYPE(StringRef)(base + function)()
    addresses = range(base + table, base + table + TABLE_BYTES, ROW)
    rows = {ctypes.string_at(ctypes.c_uint64.from_address(at).value).decode(): at for at in addresses}
    return ctypes.string_at(named.data, named.length).decode(), rows


def overwrite_processor_row(target: int, source: int) -> None:
    """Give a row the features, tuning and schedule of another, by their addresses."""
    library = ctypes.CDLL(None, use_errno=True)
    content = ctypes.string_at(source + FEATURES, ROW - FEATURES)
    first = (target + FEATURES) & ~(mmap.PAGESIZE - 1)
    length = target + ROW - first
    for access in (mmap.PROT_READ | mmap.PROT_WRITE, mmap.PROT_READ):
        if library.mprotect(ctypes.c_void_p(first), ctypes.c_size_t(length), access) != 0:
            raise OSError(ctypes.get_errno(), "mprotect")
        if access & mmap.PROT_WRITE:
            ctypes.memmove(target + FEATURES, content, len(content))


@cache
def read_cpuinfo() -> dict[str, str]:
    """Entries of /proc/cpuinfo for the first processor; none on another system."""
    if sys.platform != "linux":
        return {}
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8").partition("\n\n")[0]
    rows = (line.partition(":") for line in text.splitlines())
    return {name.strip(): value.strip() for name, _, value in rows}


@cache
def widest_processor() -> str:
    """Name of the processor that kernels are compiled for, once it is the widest that can be had."""
    if engine_name() != "taichi":
        keys = ("vendor_id", "cpu family", "model")
        return "-".join([platform.machine(), *(read_cpuinfo()[key] for key in keys if key in read_cpuinfo())])
    if sys.platform != "linux" or platform.machine() != "x86_64" or ti.__version__ != TAICHI:
        return platform.machine()
    try:
        name, rows = processor_table_rows()
        if name == UNKNOWN and set(read_cpuinfo().get("flags", "").split()) >= WIDE_FLAGS:
            overwrite_processor_row(rows[UNKNOWN], rows[WIDE])
            name = f"{UNKNOWN}-as-{WIDE}"
    except (OSError, ValueError, KeyError, AttributeError, struct.error):
        return platform.machine()
    return name


def start_device(numerics: Numerics, pool_least: int = 1) -> int:
    """Start Taichi and return the number of workers that run at the same time.

    The size of Taichi's thread pool is compiled into every kernel. `pool_least` is a lower bound of it, so
    that kernels compiled for one number of workers serve any smaller number.

    Fast-math stays off: IEEE arithmetic gives the same bits in every kernel that holds the same formula, so a
    replica repeats alone, in an ensemble, and on any number of threads. Raises BadInput where Taichi falls
    back to another device.
    """
    threads = numerics.threads or usable_cores()
    engine = f"{engine_mark()}-{engine_version()}" if engine_mark() else ""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    # the key of a kernel knows no processor, and its loops are laid out for one before it is kept
    folder, offline = root / "taichi_erosion" / "kernels" / f"{widest_processor()}{engine}", True
    try:
        require_writable(folder / "any")
    except BadInput:  # Taichi makes its folder at exit even where it keeps nothing there, or crashes
        folder, offline = Path(__file__).parent, False
    lock = folder / LOCK
    with contextlib.suppress(OSError):  # of a killed process: it would keep every later run from the cache
        if time.time() - lock.stat().st_mtime > LOCK_SECONDS:
            lock.unlink()
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
    archs = {ti.x64, ti.arm64} if numerics.arch == "cpu" else {getattr(ti, numerics.arch)}
    if impl.current_cfg().arch not in archs:  # Taichi took another device
        raise BadInput(f"--arch {numerics.arch}: no such device on this machine; use --arch cpu")
    return threads


def has_cuda() -> bool:
    """Whether there is an NVIDIA graphics processor that the engine can use."""
    return bool(core.with_cuda())


def multiprocessor_count() -> int:
    """Multiprocessors of the first NVIDIA graphics processor.

    Reference: CUDA driver API, cuDeviceGetAttribute, CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT.
    """
    count = ctypes.c_int()
    driver = ctypes.CDLL("libcuda.so.1")
    if driver.cuDeviceGetAttribute(ctypes.byref(count), MULTIPROCESSORS, 0) != 0:
        raise BadInput("--arch cuda: the driver does not say how many multiprocessors there are")
    return count.value


def is_serial_loop(lines: int) -> bool:
    """Whether a loop over so many lines of cells runs on the thread that launches it.

    To wake other threads takes a CPU as long as some hundred lines, and much longer beside other programs.
    """
    return is_host_memory() and lines <= SERIAL_LINES


def stop_device() -> None:
    """Release the device and every field on it."""
    ti.reset()
