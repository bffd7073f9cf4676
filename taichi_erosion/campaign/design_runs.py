"""Runs of a designed experiment: from rows of a design to requests, from results to columns of responses."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.campaign.execute import SIMULATE, execute
from taichi_erosion.campaign.ledger import Ledger
from taichi_erosion.campaign.request import Report, RunRequest, RunResult, run_device, scene_request
from taichi_erosion.campaign.study_file import CalibrationStudy, WorkersEntry
from taichi_erosion.experiments.design_table import Design

SEEDS_APART = 1000  # seeds reserved for one stage: no two runs of a study share their noise
STAGES = ("screen", "climb", "surface", "confirm")


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
    """How the runs of a study are made, and all that were requested so far."""

    file: CalibrationStudy
    ledger: Ledger
    where: WorkersEntry = field(default_factory=WorkersEntry)
    progress: Report | None = None
    function: str = SIMULATE
    runs: list[DesignRun] = field(default_factory=list)


def run_design(runner: DesignRunner, stage: str, design: Design) -> Design:
    """The design with the values of all targets; NaN where a run gave none."""
    file, observables = runner.file, list(runner.file.study.targets)
    first = file.study.study.seed + SEEDS_APART * STAGES.index(stage)
    scenes = list(dict.fromkeys(file.scene(name) for name in observables))
    plan = [(int(row), scene) for row in design.by_turn for scene in scenes]
    settings = {row: complete_settings(file, design.settings(row)) for row, _ in plan}
    requests = [design_request(runner, scene, settings[row], stage, row, first + row) for row, scene in plan]
    report = runner.progress
    results = execute(
        requests,
        runner.ledger,
        workers=runner.where.workers,
        scheduler=runner.where.scheduler,
        progress=report and (lambda share, words: report(share, f"{stage}: {words}")),
        function=runner.function,
    )
    found = dict(zip(plan, results, strict=True))
    runner.runs += [
        DesignRun(stage, row + 1, first + row, settings[row], result)
        for (row, _), result in sorted(found.items(), key=lambda entry: entry[0][0])
    ]
    columns = {
        name: np.array([found[row, file.scene(name)].value(file.measure(name)) for row in range(len(design))])
        for name in observables
    }
    return design.with_responses(**columns)


def complete_settings(file: CalibrationStudy, settings: dict[str, float]) -> dict[str, float]:
    """Value of every parameter of the study; one that a design does not vary stays at its centre."""
    centres = {path: 0.5 * (entry.low + entry.high) for path, entry in file.study.parameters.items()}
    return centres | settings


def design_request(
    runner: DesignRunner, scene: Path, settings: dict[str, float], stage: str, row: int, seed: int
) -> RunRequest:
    """Request of one row of a design at one scene."""
    file, study = runner.file, runner.file.study
    linked = {path: value for main, value in settings.items() for path in study.parameters[main].also}
    overrides = [f"{path}={value!r}" for path, value in (settings | linked).items()]
    extra: dict[str, Any] = {"device": run_device(runner.where)}
    if study.design.record in (stage, "all"):
        columns = {path.replace(".", "_").replace("-", "_"): value for path, value in settings.items()}
        extra |= {
            "record": file.folder / "recordings" / f"{stage}-{row + 1}-{seed}.rrd",
            "properties": {"doe": {"stage": stage, "row": row + 1} | columns},
        }
    return scene_request(scene, [*study.study.settings, *overrides], seed, file.effect_files, **extra)
