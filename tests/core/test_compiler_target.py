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

widest = pytest.mark.skipif(
    sys.platform != "linux" or not target.processor_flags() >= target.WIDEST_FLAGS,
    reason="this processor has no 512-bit arithmetic",
)

UNKNOWN = (target.UNKNOWN, {target.UNKNOWN: 1, target.WIDE: 2, target.WIDEST: 3})  # LLVM's name, and rows


SCENE = """
[scene]
kind = "repose"
title = "grains that collide"
[run]
time_step_fraction = 0.2
[grains]
count = 40
material = "soil"
size = { law = "monodisperse", diameter = 2e-3 }
[materials.soil]
density = 2130.0
shear_modulus = 1e7
poisson_ratio = 0.29
[contact.soil-soil]
restitution = 0.6
friction_sliding = 0.6
friction_rolling = 0.1
[geometry.plate]
shape = "plane"
material = "soil"
[fill]
law = "pour"
centre = [0.0, 0.0, 0.01]
radius = 0.006
speed = 0.5
rate = 4000.0
[[stages]]
name = "pour"
until = "time"
duration_max = 0.03
[measure.centroid_height]
plate = "plate"
"""
# The row of this processor stands in for `generic`, with what LLVM knows of an unknown one and with remedies.
RUN = """
import sys
from taichi_erosion.core import compiler_target as target
name, rows = target.compiler_rows()
rows_of = {"unknown": ("generic", "generic"), "256 bits": (target.WIDE, target.WIDE)}
rows_of["512 bits"] = (target.WIDEST, target.WIDE)
target.write_row(rows[name], *(rows[one] for one in rows_of[sys.argv[1]]))
from taichi_erosion.cli.main import main
code = main(["run", sys.argv[2], "--no-record", "--json", "--threads", "1"])
sys.stderr.write(f"width {target.packed_width()}")
sys.exit(code)
"""


def run(kind: str, folder: Path) -> tuple[int, dict]:
    """Width of the packed roots in the compiled kernels, and the result document."""
    scene = folder / "heap.toml"
    scene.write_text(SCENE, encoding="utf-8")
    places = os.environ | {"XDG_CACHE_HOME": str(folder / kind), "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", RUN, kind, str(scene)]
    ended = subprocess.run(command, env=places, capture_output=True, text=True, check=True)
    return int(ended.stderr.rpartition("width ")[2]), json.loads(ended.stdout)


@pytest.fixture(scope="module")
def of_256_bits(tmp_path_factory) -> tuple[int, dict]:
    return run("256 bits", tmp_path_factory.mktemp("wide"))


@linux_x86
@wide
@pytest.mark.slow
def test_an_unknown_processor_gets_packed_square_roots_and_the_same_bits(tmp_path, of_256_bits):
    narrow, before = run("unknown", tmp_path)
    broad, after = of_256_bits
    assert narrow <= 128
    assert broad >= 256
    assert before["measures"] == after["measures"]


@linux_x86
@widest
@pytest.mark.slow
def test_512_bits_give_the_bits_of_256(tmp_path, of_256_bits):
    broad, before = of_256_bits
    broader, after = run("512 bits", tmp_path)
    assert (broad, broader) == (256, 512)
    assert before["measures"] == after["measures"]


@linux_x86
def test_a_known_processor_keeps_its_row(monkeypatch):
    name, _ = target.compiler_rows()
    if name == target.UNKNOWN:
        pytest.skip("this processor is unknown to LLVM")
    monkeypatch.setattr(target, "write_row", lambda *_: pytest.fail("a row was changed"))
    assert target.compiler_target.__wrapped__() == name


@linux_x86
@pytest.mark.parametrize("fault", ["switch", "flags", "table", "version"])
def test_nothing_is_changed_where_a_check_fails(fault, monkeypatch):
    monkeypatch.setattr(target, "write_row", lambda *_: pytest.fail("a row was changed"))
    monkeypatch.setattr(
        target, "compiler_rows", lambda: (target.UNKNOWN, dict.fromkeys((target.UNKNOWN, target.WIDE), 0))
    )
    if fault == "switch":
        monkeypatch.setenv(target.KEEP, "1")
    elif fault == "flags":
        monkeypatch.setattr(target, "processor_flags", set)
    elif fault == "table":
        monkeypatch.setattr(
            target, "compiler_rows", lambda: (_ for _ in ()).throw(ValueError("another table"))
        )
    else:
        monkeypatch.setattr(target, "TAICHI", (1, 7, 5))
    assert target.compiler_target.__wrapped__() in {target.UNKNOWN, platform.machine()}


def entries(maker: str, family: int, model: int, flags: set[str]) -> dict[str, str]:
    """What Linux says of a processor."""
    numbers = {"vendor_id": maker, "cpu family": str(family), "model": str(model)}
    return numbers | {"flags": " ".join(flags)}


@linux_x86
@pytest.mark.parametrize(
    ("processor", "rows"),
    [
        (entries("AuthenticAMD", 26, 2, target.WIDEST_FLAGS), (1, 3, 2)),  # EPYC 9005
        (entries("AuthenticAMD", 26, 68, target.WIDEST_FLAGS), (1, 3, 2)),  # Ryzen 9000
        (
            entries("AuthenticAMD", 26, 36, target.WIDEST_FLAGS),
            (1, 2, 2),
        ),  # Ryzen AI 300: 512 bits in two halves
        (entries("AuthenticAMD", 26, 2, target.WIDE_FLAGS), (1, 2, 2)),  # 512 bits hidden by a hypervisor
        (entries("HygonGenuine", 24, 4, target.WIDE_FLAGS), (1, 2, 2)),
    ],
)
def test_an_unknown_processor_gets_the_widest_row_that_it_carries_out_at_once(processor, rows, monkeypatch):
    written = []
    monkeypatch.delenv(target.KEEP, raising=False)
    monkeypatch.setattr(target, "write_row", lambda *rows: written.append(rows))
    monkeypatch.setattr(target, "compiler_rows", lambda: UNKNOWN)
    monkeypatch.setattr(target, "processor_entries", lambda: processor)
    name = target.compiler_target.__wrapped__()
    assert written == [rows]
    assert name.startswith("generic-as-")
    assert (target.WIDEST in name) == (rows[1] == 3)


def test_a_processor_that_linux_does_not_describe_has_no_full_width():
    assert not target.is_full_width({})
    assert not target.is_full_width({"vendor_id": "AuthenticAMD", "cpu family": "?", "model": "2"})
