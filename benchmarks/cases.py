"""The timed cases of `./erosion bench`: grain-steps per second, with the time split by stage.

Times are wall times of one sitting: only ratios taken side by side carry over to another machine.
"""

import os
from collections.abc import Callable
from functools import partial
from typing import Any

from benchmarks.grain_cases import Size, device_grain_cases, grain_case, standard_grain_cases, wide_bed_cases
from benchmarks.shared_machine import shared_cases
from benchmarks.wind_cases import air_case, standard_air_cases, threshold_case
from taichi_erosion import __version__
from taichi_erosion.core.device import widest_processor
from taichi_erosion.core.engine import engine_name, engine_version
from taichi_erosion.core.setup import Arch

__all__ = ["run_benchmarks"]


def cpu_runs(cores: int) -> list[tuple[str, Callable[[], Any]]]:
    """Beds, funnels, a patch that blows and ensembles; air; a threshold; wide beds; a shared machine."""
    return [
        *((str(case), partial(grain_case, case)) for case in standard_grain_cases(cores)),
        *((name, partial(air_case, name, setup, cores)) for name, setup in standard_air_cases()),
        ("fluid threshold", threshold_case),
        ("beds of growing width", wide_bed_cases),
        ("shared machine", partial(shared_cases, cores)),
    ]


def run_benchmarks(
    progress: Callable[[float, str], None] | None = None, arch: Arch = "cpu", size: Size = "usual"
) -> dict[str, Any]:
    """All cases of a CPU, or those of grains on a graphics processor in one of three sizes."""
    cores = len(os.sched_getaffinity(0))
    on_device = [(str(case), partial(grain_case, case)) for case in device_grain_cases(arch, size)]
    runs = cpu_runs(cores) if arch == "cpu" else on_device
    cases: list[dict[str, Any]] = []
    for index, (name, run) in enumerate(runs):
        if progress:
            progress(index / len(runs), name)
        found = run()
        cases.extend(found if isinstance(found, list) else [found])
    versions = {"taichi_erosion": __version__, engine_name(): engine_version()}
    return {"cases": cases, "versions": versions, "cores": cores} | {
        "engine": engine_name(),
        "target": widest_processor(),
    }
