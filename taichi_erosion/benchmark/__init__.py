"""Speed: grain-steps per second of standard cases, with the time split by stage.

Times are wall times of one sitting: only ratios taken side by side carry over to another machine.
"""

import os
from collections.abc import Callable
from functools import partial
from typing import Any

from taichi_erosion import __version__
from taichi_erosion.benchmark.grain_cases import grain_case, standard_grain_cases, wide_bed_cases
from taichi_erosion.benchmark.shared_machine import shared_cases
from taichi_erosion.benchmark.wind_cases import air_case, standard_air_cases, threshold_case
from taichi_erosion.core.compiler_target import compiler_target
from taichi_erosion.core.engine.choice import engine_name, engine_version

__all__ = ["run_benchmarks"]


def run_benchmarks(progress: Callable[[float, str], None] | None = None) -> dict[str, Any]:
    """Beds, funnels, a patch that blows and ensembles; air; a threshold; wide beds; a shared machine."""
    cores = len(os.sched_getaffinity(0))
    runs: list[tuple[str, Callable[[], Any]]] = [
        *((str(case), partial(grain_case, case)) for case in standard_grain_cases(cores)),
        *((name, partial(air_case, name, setup, cores)) for name, setup in standard_air_cases()),
        ("fluid threshold", threshold_case),
        ("beds of growing width", wide_bed_cases),
        ("shared machine", partial(shared_cases, cores)),
    ]
    cases: list[dict[str, Any]] = []
    for index, (name, run) in enumerate(runs):
        if progress:
            progress(index / len(runs), name)
        found = run()
        cases.extend(found if isinstance(found, list) else [found])
    versions = {"taichi_erosion": __version__, engine_name(): engine_version()}
    return {"cases": cases, "versions": versions, "cores": cores} | {
        "engine": engine_name(),
        "target": compiler_target(),
    }
