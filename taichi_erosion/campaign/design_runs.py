"""Runs of a study: from a row of a design to requests, from results to columns of responses."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.campaign.execute import SIMULATE, Report, execute
from taichi_erosion.campaign.ledger import Ledger
from taichi_erosion.campaign.request import RunRequest, RunResult, scene_request
from taichi_erosion.campaign.study_file import CalibrationStudy
from taichi_erosion.experiments.design_table import Design

SEEDS_APART = 1000  # seeds reserved for one stage: no two runs of a study share their noise


@dataclass(frozen=True)
class DesignRun:
    """One run of a stage, as the table of all runs shows it."""

    stage: str
    row: int  # of its design, from 1
    seed: int
    settings: dict[str, float]
    result: RunResult


@dataclass
class DesignRunner:
    """Where a study's runs are carried out, and all that were asked for so far."""

    file: CalibrationStudy
    store: Ledger
    workers: int | None = None
    scheduler: str | None = None
    progress: Report | None = None
    function: str = SIMULATE
    asked: list[DesignRun] = field(default_factory=list)


STAGES = ("screen", "climb", "surface", "confirm")


def run_design(runner: DesignRunner, stage: str, design: Design) -> Design:
    """The design with the values of all targets; NaN where a run gave none."""
    file = runner.file
    rows = [int(row) for row in design.by_turn]
    first = file.study.study.seed + SEEDS_APART * STAGES.index(stage)
    observables = list(file.study.targets)
    scenes = list(dict.fromkeys(file.scene(name) for name in observables))
    plan = [(row, scene) for row in rows for scene in scenes]
    requests = [ask(runner, stage, design, row, scene, first + row) for row, scene in plan]
    results = execute(
        requests,
        runner.store,
        workers=runner.workers,
        scheduler=runner.scheduler,
        progress=staged(runner.progress, stage),
        function=runner.function,
    )
    found = dict(zip(plan, results, strict=True))
    runner.asked += [
        DesignRun(stage, row + 1, first + row, all_settings(file, design.settings(row)), result)
        for (row, _), result in sorted(found.items(), key=lambda entry: entry[0][0])
    ]
    columns = {
        name: np.array([found[row, file.scene(name)].value(file.measure(name)) for row in range(len(design))])
        for name in observables
    }
    return design.with_responses(**columns)


def staged(progress: Report | None, stage: str) -> Report | None:
    """Progress that names the stage."""
    return None if progress is None else lambda share, words: progress(share, f"{stage}: {words}")


def ask(runner: DesignRunner, stage: str, design: Design, row: int, scene: Path, seed: int) -> RunRequest:
    """Request of one row at one scene."""
    study, settings = runner.file.study, all_settings(runner.file, design.settings(row))
    orders = [f"{path}={value!r}" for path, value in spread_out(runner.file, settings).items()]
    extra: dict[str, Any] = {}
    if study.design.record in (stage, "all"):
        name = f"{stage}-{row + 1}-{seed}.rrd"
        columns = {path.replace(".", "_").replace("-", "_"): value for path, value in settings.items()}
        extra = {
            "record": runner.file.folder / "recordings" / name,
            "properties": {"doe": {"stage": stage, "row": row + 1} | columns},
        }
    return scene_request(scene, [*study.study.settings, *orders], seed, **extra)


def all_settings(file: CalibrationStudy, settings: dict[str, float]) -> dict[str, float]:
    """Value of every parameter of the study; one that a design does not vary stays at its centre."""
    centres = {path: 0.5 * (entry.low + entry.high) for path, entry in file.study.parameters.items()}
    return centres | settings


def spread_out(file: CalibrationStudy, settings: dict[str, float]) -> dict[str, float]:
    """The settings with all paths that take the same values."""
    twins = {twin: value for path, value in settings.items() for twin in file.study.parameters[path].also}
    return settings | twins


def values_of(asked: Sequence[DesignRun], observable: str) -> np.ndarray:
    """Values of one observable, those without a value left out."""
    values = np.array([entry.result.value(observable) for entry in asked])
    return values[np.isfinite(values)]
