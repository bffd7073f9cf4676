"""Python interface: what the commands do, with objects, tables and figures in place of printed lines.

    import taichi_erosion as te

    heap = te.run("scenes/funnel_repose.toml", replicas=1, grains__count=3000)
    heap.table                                  # pandas.DataFrame of the measures, with units
    study = te.study("doe/my_lab.toml")
    study.compare()                             # where the model fails
    study.discover().effects                    # which effect is missing
    study.adopt("dry_adhesion")                 # the error on held-out rows, before and after
    study.next().table                          # experiments that would decide
    study.report()                              # one HTML page

A file is a path as text or `pathlib.Path`; a scene may be a mapping with the sections of a scene file. Wrong
input raises `BadInput`, a run that its guards stop `SimulationStopped`. Results show themselves in notebooks.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from taichi_erosion.api.results import (
    AdoptionResult,
    ComparisonResult,
    DiscoveryResult,
    ExperimentsResult,
    PredictionResult,
)
from taichi_erosion.api.runs import Run, effects, open_run, run, sweep
from taichi_erosion.api.studies import Study, new_study, study
from taichi_erosion.core.errors import BadInput, SimulationStopped

if TYPE_CHECKING:
    from taichi_erosion.api.sessions import LiveSession, live

__all__ = [
    "AdoptionResult",
    "BadInput",
    "ComparisonResult",
    "DiscoveryResult",
    "ExperimentsResult",
    "LiveSession",
    "PredictionResult",
    "Run",
    "SimulationStopped",
    "Study",
    "effects",
    "live",
    "new_study",
    "open_run",
    "run",
    "study",
    "sweep",
]


def __getattr__(name: str) -> Any:
    """Sessions import the simulation, so they are loaded when they are used."""
    if name in ("LiveSession", "live"):
        return getattr(import_module("taichi_erosion.api.sessions"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
