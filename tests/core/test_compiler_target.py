"""A processor that LLVM does not know gets wide instructions and the same bits; others are left alone."""

import json
import os
import platform
import subprocess
import sys
from pathlib import Path

import pytest

from taichi_erosion.core import compiler_target as target
from taichi_erosion.core.ti import ti

linux_x86 = pytest.mark.skipif(
    sys.platform != "linux" or platform.machine() != "x86_64" or ti.__version__ != target.TAICHI,
    reason="the table of processors is that of Taichi 1.7.4 on x86-64 Linux",
)
wide = pytest.mark.skipif(
    sys.platform != "linux" or not target.processor_flags() >= target.WIDE_FLAGS,
    reason="this processor has no 256-bit arithmetic with fused products",
)
SCENE = str(Path(__file__).parents[2] / "scenes" / "incline.toml")
# The row of this processor receives what LLVM knows of an unknown one, and what the remedy gives to it.
RUN = """
import sys
from benchmarks.vector_width import packed_width
from taichi_erosion.core import compiler_target as target
name, rows = target.compiler_rows()
target.write_row(rows[name], rows[sys.argv[1]])
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
    (narrow, before), (broad, after) = (run(row, tmp_path) for row in (target.UNKNOWN, target.WIDE))
    assert narrow <= 128
    assert broad >= 256
    assert before == after


@pytest.fixture
def written(monkeypatch):
    """Rows that were written, where LLVM does not know the processor and the processor is wide."""
    rows: list[tuple[int, int]] = []
    monkeypatch.delenv(target.KEEP, raising=False)
    monkeypatch.setattr(target, "write_row", lambda *pair: rows.append(pair))
    monkeypatch.setattr(
        target, "compiler_rows", lambda: (target.UNKNOWN, {target.UNKNOWN: 1, target.WIDE: 2})
    )
    monkeypatch.setattr(target, "processor_flags", lambda: target.WIDE_FLAGS)
    return rows


@linux_x86
def test_an_unknown_processor_gets_the_wide_row_and_a_known_one_keeps_its_own(written, monkeypatch):
    assert target.compiler_target.__wrapped__() == "generic-as-znver3"
    monkeypatch.setattr(target, "compiler_rows", lambda: ("skylake", {target.UNKNOWN: 1, target.WIDE: 2}))
    assert target.compiler_target.__wrapped__() == "skylake"
    assert written == [(1, 2)]


def another_table():
    raise ValueError("another table")


@linux_x86
@pytest.mark.parametrize(
    ("name", "value"),
    [("processor_flags", set), ("compiler_rows", another_table), ("TAICHI", (1, 7, 5)), (target.KEEP, "1")],
)
def test_nothing_is_changed_where_a_check_fails(name, value, written, monkeypatch):
    monkeypatch.setenv(name, value) if name == target.KEEP else monkeypatch.setattr(target, name, value)
    assert target.compiler_target.__wrapped__() in {target.UNKNOWN, platform.machine()}
    assert written == []
