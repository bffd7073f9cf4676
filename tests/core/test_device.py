"""The device starts without a place for its cache."""

import os
import subprocess
import sys

import pytest

STARTS = """
from taichi_erosion.core.device import start_device
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.ti import ti

start_device(Numerics(threads=1))
total = ti.field(float, shape=())
total[None] = 3.0
print(total[None])
"""


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
