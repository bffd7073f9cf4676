"""The device starts without a place for its cache; an unknown processor gets wide instructions."""

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from taichi_erosion.core import device
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import ti

STARTS = """
from taichi_erosion.core.device import start_device
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import ti

start_device(Numerics(threads=1))
total = ti.field(float, shape=())
total[None] = 3.0
print(total[None])
"""
linux_x86 = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64" or ti.__version__ != device.TAICHI,
    reason="the table of processors is that of Taichi 1.7.4 on x86-64 Linux",
)
wide = pytest.mark.skipif(
    sys.platform != "linux" or not set(device.read_cpuinfo().get("flags", "").split()) >= device.WIDE_FLAGS,
    reason="this processor has no 256-bit arithmetic with fused products",
)
SCENE = str(Path(__file__).parents[2] / "scenes" / "incline.toml")
# The row of this processor receives what LLVM knows of an unknown one, and what the remedy gives to it.
RUN = """
import sys
from benchmarks.vector_width import packed_width
from taichi_erosion.core import device
name, rows = device.processor_table_rows()
device.overwrite_processor_row(rows[name], rows[sys.argv[1]])
from taichi_erosion.cli.main import main
code = main(["run", sys.argv[2], "--no-record", "--json", "--threads", "1", "--replicas", "1"])
sys.stderr.write(f"width {packed_width()}")
sys.exit(code)
"""


def run(row: str, folder: Path) -> tuple[int, dict]:
    """Width of the packed roots in the compiled kernels, and the measures of a scene."""
    places = os.environ | {"XDG_CACHE_HOME": str(folder / row), "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", RUN, row, SCENE]
    ended = subprocess.run(command, env=places, capture_output=True, text=True, check=True)
    return int(ended.stderr.rpartition("width ")[2]), json.loads(ended.stdout)["measures"]


@linux_x86
@wide
@pytest.mark.slow
def test_an_unknown_processor_gets_packed_square_roots_and_the_same_bits(tmp_path):
    (narrow, before), (broad, after) = (run(row, tmp_path) for row in (device.UNKNOWN, device.WIDE))
    assert narrow <= 128
    assert broad >= 256
    assert before == after


@pytest.fixture
def written(monkeypatch):
    """Rows that were written, where LLVM does not know the processor and the processor is wide."""
    rows: list[tuple[int, int]] = []
    monkeypatch.setattr(device, "overwrite_processor_row", lambda *pair: rows.append(pair))
    table = device.UNKNOWN, {device.UNKNOWN: 1, device.WIDE: 2}
    monkeypatch.setattr(device, "processor_table_rows", lambda: table)
    monkeypatch.setattr(device, "read_cpuinfo", lambda: {"flags": " ".join(device.WIDE_FLAGS)})
    return rows


@linux_x86
def test_an_unknown_processor_gets_the_wide_row_and_a_known_one_keeps_its_own(written, monkeypatch):
    assert device.widest_processor.__wrapped__() == "generic-as-znver3"
    rows = "skylake", {device.UNKNOWN: 1, device.WIDE: 2}
    monkeypatch.setattr(device, "processor_table_rows", lambda: rows)
    assert device.widest_processor.__wrapped__() == "skylake"
    assert written == [(1, 2)]


@linux_x86
@pytest.mark.parametrize(
    ("name", "value"),
    [("read_cpuinfo", dict), ("processor_table_rows", lambda: int("another table")), ("TAICHI", (1, 7, 5))],
)
def test_nothing_is_changed_where_a_check_fails(name, value, written, monkeypatch):
    monkeypatch.setattr(device, name, value)
    assert device.widest_processor.__wrapped__() in {device.UNKNOWN, platform.machine()}
    assert written == []


@pytest.mark.parametrize("lost", [{}, {"HOME": "file"}, {"XDG_CACHE_HOME": "file"}], ids=str)
def test_without_a_place_for_its_cache_the_device_starts_and_the_program_ends_well(tmp_path, lost):
    (tmp_path / "file").touch()
    usual = {name: value for name, value in os.environ.items() if name not in ("HOME", "XDG_CACHE_HOME")}
    environment = usual | {"PYTHONPATH": os.pathsep.join(sys.path)}
    environment |= {name: str(tmp_path / file) for name, file in lost.items()}
    ended = subprocess.run(
        [sys.executable, "-c", STARTS], env=environment, capture_output=True, text=True, check=False
    )
    assert (ended.returncode, ended.stdout) == (0, "3.0\n"), ended.stderr


@pytest.mark.parametrize("wrong", [{"arch": "gpu"}, {"decomposition": "grain"}])
def test_a_device_that_is_none_is_refused_by_its_name(wrong):
    with pytest.raises(BadInput, match="write one of"):
        Numerics(**wrong)
