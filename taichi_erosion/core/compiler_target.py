"""Processor that Taichi's compiler generates code for, and a remedy where it does not know the processor.

Taichi 1.7.4 compiles with LLVM 15, which looks its processor up by name in a table of features and tuning.
A processor newer than the table is `generic` there (AMD Zen 5, Hygon, Zhaoxin): loops are laid out for
SSE2, and the contact law is compiled without packed arithmetic. Neither `ti.init` nor the environment
changes it.

The table `llvm::X86SubTypeKV` is data, rows of 80 bytes {address of the name, 32 bytes of features, 32 of
tuning, address of the instruction schedule}. Before the first `ti.init` the row `generic` receives
features, tuning and schedule of `znver3`, 256 bits wide, where the processor has its features. No formula
changes and fast-math stays off: results keep their bits.

All of it is checked first: Linux on x86-64, this version of Taichi, the size of the table, the name that
LLVM itself gives to the processor, and the processor's features. Where a check fails, nothing is changed.
The environment variable TAICHI_EROSION_KEEP_TARGET switches the remedy off.

quadrants compiles with LLVM 22, which knows these processors; nothing is changed there.
"""

import ctypes
import mmap
import os
import platform
import struct
import sys
from functools import cache
from pathlib import Path

import numpy as np

from taichi_erosion.core.engine.choice import engine_name
from taichi_erosion.core.ti import ti

KEEP = "TAICHI_EROSION_KEEP_TARGET"
TAICHI = (1, 7, 4)
UNKNOWN = "generic"  # name that LLVM gives to a processor that it does not know
NAME_FUNCTION = b"_ZN4llvm3sys14getHostCPUNameEv"
TABLE = b"_ZN4llvm12X86SubTypeKVE"
ROW, FEATURES = 80, 8  # bytes of a row, and where what follows its name begins
TABLE_BYTES = 86 * ROW  # LLVM 15.0.4
SYMBOL = np.dtype([("name", "<u4"), ("kind", "<u4"), ("value", "<u8"), ("size", "<u8")])
WIDE = "znver3"  # row that suits 256 bits
WIDE_FLAGS = {"avx2", "fma", "bmi1", "bmi2", "f16c", "abm", "movbe", "adx"}  # as /proc/cpuinfo names them


class StringRef(ctypes.Structure):
    """LLVM's pair of address and length of a text."""

    _fields_ = (("data", ctypes.c_void_p), ("length", ctypes.c_size_t))


def loaded_library() -> tuple[int, Path]:
    """Address and file of the library in which Taichi brings LLVM; ValueError where it is not loaded."""
    for line in Path("/proc/self/maps").read_text(encoding="utf-8").splitlines():
        words = line.split()
        if len(words) == 6 and "/taichi_python." in words[5] and int(words[2], 16) == 0:
            return int(words[0].partition("-")[0], 16), Path(words[5])
    raise ValueError("Taichi's library is not loaded")


def sections(image: mmap.mmap) -> dict[str, tuple[int, int]]:
    """Place and bytes of every section of an ELF file by name."""
    (start,) = struct.unpack_from("<Q", image, 0x28)
    size, count, names = struct.unpack_from("<HHH", image, 0x3A)
    heads = [struct.unpack_from("<IIQQQQ", image, start + k * size) for k in range(count)]
    text = heads[names][4]
    return {image[text + h[0] : image.find(b"\0", text + h[0])].decode(): (h[4], h[5]) for h in heads}


def symbol(image: mmap.mmap, name: bytes) -> tuple[int, int]:
    """Address within the library and bytes of a symbol; ValueError where there is not exactly one."""
    parts = sections(image)
    texts, length = parts[".strtab"]
    place = image.find(b"\0" + name + b"\0", texts, texts + length) + 1 - texts
    start, length = parts[".symtab"]
    found = np.frombuffer(image, SYMBOL, length // SYMBOL.itemsize, start)
    found = found[found["name"] == place]
    if place <= 0 or len(found) != 1:
        raise ValueError(f"no single symbol {name.decode()}")
    return int(found["value"][0]), int(found["size"][0])


def search_symbols(file: Path) -> tuple[int, int]:
    """Addresses within the library of the function that names the processor and of the table."""
    with file.open("rb") as opened, mmap.mmap(opened.fileno(), 0, access=mmap.ACCESS_READ) as image:
        function, _ = symbol(image, NAME_FUNCTION)
        table, size = symbol(image, TABLE)
    if size != TABLE_BYTES:
        raise ValueError("another table of processors")
    return function, table


def compiler_rows() -> tuple[str, dict[str, int]]:
    """What LLVM calls this processor, and the addresses of the rows of its table by name."""
    base, file = loaded_library()
    function, table = search_symbols(file)
    named = ctypes.CFUNCTYPE(StringRef)(base + function)()
    first = base + table
    texts = [ctypes.c_uint64.from_address(first + k * ROW).value for k in range(TABLE_BYTES // ROW)]
    rows = {ctypes.string_at(text).decode(): first + k * ROW for k, text in enumerate(texts)}
    return ctypes.string_at(named.data, named.length).decode(), rows


def write_row(target: int, source: int) -> None:
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
def processor_entries() -> dict[str, str]:
    """Entries of /proc/cpuinfo for the first processor."""
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8").partition("\n\n")[0]
    rows = (line.partition(":") for line in text.splitlines())
    return {name.strip(): value.strip() for name, _, value in rows}


def processor_name() -> str:
    """Kind of processor by maker, family and model, where the compiler's own name for it is not to be had."""
    entries = processor_entries() if sys.platform == "linux" else {}
    parts = [entries[key] for key in ("vendor_id", "cpu family", "model") if key in entries]
    return "-".join([platform.machine(), *parts])


def processor_flags() -> set[str]:
    """Features of this processor as Linux names them."""
    return set(processor_entries().get("flags", "").split())


@cache
def compiler_target() -> str:
    """Name of the processor that kernels are compiled for, once it is the widest that can be had."""
    if engine_name() != "taichi":
        return processor_name()
    if sys.platform != "linux" or platform.machine() != "x86_64" or ti.__version__ != TAICHI:
        return platform.machine()
    try:
        name, rows = compiler_rows()
        if name == UNKNOWN and KEEP not in os.environ and processor_flags() >= WIDE_FLAGS:
            write_row(rows[UNKNOWN], rows[WIDE])
            name = f"{UNKNOWN}-as-{WIDE}"
    except (OSError, ValueError, KeyError, AttributeError, struct.error):
        return platform.machine()
    return name
