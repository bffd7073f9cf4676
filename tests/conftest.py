"""What every test relies on: quiet libraries, a device started afresh, random cases that repeat."""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

os.environ.setdefault("CI", "true")  # the recording viewer then sends no usage statistics
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("RERUN_STRICT", "1")  # a wrong argument raises instead of logging

import pytest
from hypothesis import settings

from taichi_erosion.core.engine import ENGINES, SWITCH
from taichi_erosion.core.setup import Laws, Numerics, Setup

# no deadline: the cores are shared; the same cases each time: a red test can be repeated
settings.register_profile("repeatable", deadline=None, derandomize=True, print_blob=False)
settings.load_profile("repeatable")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--engine", choices=ENGINES, help="engine that compiles the kernels")


def pytest_configure(config: pytest.Config) -> None:
    """Name the engine before anything imports it; commands that tests start inherit it."""
    if config.getoption("--engine"):
        os.environ[SWITCH] = config.getoption("--engine")


@pytest.fixture
def mounted(tmp_path: Path) -> Iterator[Callable[[str], Path]]:
    """Function that makes a folder a disk of its own with some options; skips where nobody may mount."""
    folder = tmp_path / "mounted"

    def mount(options: str) -> Path:
        folder.mkdir()
        order = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
        if shutil.which("mount") is None or subprocess.call(order, stderr=subprocess.DEVNULL) != 0:
            pytest.skip("only an administrator can mount a disk")
        return folder

    yield mount
    if os.path.ismount(folder):
        subprocess.check_call(["umount", "-l", str(folder)])


@pytest.fixture
def unwritable(tmp_path: Path, mounted: Callable[[str], Path]) -> Path:
    """A folder in which nobody can write; an administrator, for whom modes mean nothing, mounts one."""
    if os.geteuid() == 0:
        return mounted("ro")
    folder = tmp_path / "unwritable"
    folder.mkdir(mode=0o500)
    return folder


@pytest.fixture
def start_device() -> Iterator[Callable[[Numerics], int]]:
    """Function that starts Taichi; the device and its fields are released when the test ends."""
    from taichi_erosion.core import device

    yield device.start_device
    device.stop_device()


@pytest.fixture
def same_in_teams(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Function that asserts that `run(simulation)` gives the same by one worker, two, and an uneven team.

    The uneven team shrinks and grows from one short launch to the next; every third ends at the first wait.
    """
    from taichi_erosion import simulation
    from taichi_erosion.core.device import stop_device
    from taichi_erosion.simulation import capacities

    launches = import_module("taichi_erosion.simulation.advance")
    sizes: list[int] = []

    def uneven(team: object, most: int) -> int:
        sizes.append(1 + len(sizes) % most)
        return sizes[-1]

    def ends(setup: Setup, laws: Laws, run: Callable[[Any], Any]) -> None:
        monkeypatch.setattr(capacities, "PARTITION_GRAINS", len(setup.grains.radius) // 2)
        sim = simulation.assemble([setup], laws, Numerics("cpu", 2))
        start, found = simulation.export_state(sim), []
        for size in (lambda team, most: 1, lambda team, most: most, uneven):
            monkeypatch.setattr(launches, "team_size", size)
            if size is uneven:
                monkeypatch.setattr(
                    launches, "most_barrier_spins", lambda pace: 0 if not len(sizes) % 3 else 1 << 30
                )
                monkeypatch.setattr(launches, "steps_of_one_launch", lambda _: 7 + len(sizes) % 30)
            simulation.import_state(sim, start)
            found.append(run(sim))
        stop_device()
        assert set(sizes) == {1, 2}
        assert found[0] == found[1] == found[2]

    return ends
