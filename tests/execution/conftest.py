"""One run of a small scene that went through, which the tests of this folder share."""

from pathlib import Path
from typing import Any

import pytest
from small_scene import write_scene

from taichi_erosion.core.device import stop_device
from taichi_erosion.execution import RunOptions, run_scene


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("runs")


@pytest.fixture(scope="session")
def scene(folder: Path) -> Path:
    return write_scene(folder)


@pytest.fixture(scope="session")
def whole(scene: Path, folder: Path) -> dict[str, Any]:
    """The document of the run on one thread, recorded as whole.rrd."""
    document = run_scene(scene, RunOptions(threads=1, record=folder / "whole.rrd"))
    stop_device()
    return document
