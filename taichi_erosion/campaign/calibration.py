"""A calibration as far as it was asked for, its tables written as soon as each step has ended."""

import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from taichi_erosion.campaign import calibrate, findings
from taichi_erosion.campaign.execute import SIMULATE, Report
from taichi_erosion.campaign.laboratory import Laboratory
from taichi_erosion.campaign.store import close_store, open_store
from taichi_erosion.campaign.study import StudyFile, read_study
from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.design_file import read_design
from taichi_erosion.experiments.optimise import Optimisation
from taichi_erosion.experiments.table import Design

Step = Literal["design", "run", "analyse", "climb", "surface", "optimise", "confirm"]
STEPS: tuple[Step, ...] = get_args(Step)


@dataclass
class Calibration:
    """What is known so far; `document` is what --json prints."""

    file: StudyFile
    document: dict[str, Any] = field(default_factory=dict)
    screening: calibrate.Screening | None = None
    climb: calibrate.Climb | None = None
    surface: calibrate.Surface | None = None
    optimum: Optimisation | None = None
    confirmed: calibrate.Confirmed | None = None


def calibrated(
    path: Path,
    until: Step = "confirm",
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Report | None = None,
    function: str = SIMULATE,
) -> Calibration:
    """Carry a study out up to a step. Raises BadInput for what cannot be done; what was run is kept."""
    started = time.perf_counter()
    file = read_study(path)
    found = Calibration(file)
    planned = calibrate.screening_design(file)
    found.document = {"study": str(path), "until": until, "design": findings.path_document(planned)}
    if not stands_already(file.folder / "screen.csv", planned):
        findings.write_design_table(file.folder, "screen", planned)
    if until != "design":
        store = open_store(file.folder)
        place = file.study.campaign
        laboratory = Laboratory(
            file, store, workers or place.workers, scheduler or place.scheduler, progress, function
        )
        try:
            take_steps(found, laboratory, STEPS[2 : STEPS.index(until) + 1])
        finally:
            close_store(store)
        findings.write_runs(file, laboratory.asked)
        found.document["runs"] = len(laboratory.asked)
        found.document["cpu_s"] = sum(one.result.record.get("cpu_s", 0.0) for one in laboratory.asked)
    found.document["wall_s"] = time.perf_counter() - started
    return found


def stands_already(table: Path, planned: Design) -> bool:
    """Whether a table holds this very design: then its responses are kept."""
    if not table.is_file():
        return False
    try:
        found = read_design(table)
    except BadInput:
        return False
    return found.factors == planned.factors and np.array_equal(found.coded, planned.coded)


def take_steps(found: Calibration, laboratory: Laboratory, steps: tuple[Step, ...]) -> None:
    """Screen, then every further step that was asked for."""
    folder = found.file.folder
    screening = found.screening = calibrate.screen(laboratory)
    findings.write_design_table(folder, "screen", screening.design)
    found.document["screen"] = findings.path_document(screening.design)
    if "analyse" in steps:
        found.document["analyse"] = findings.screening_document(screening)
    if "climb" in steps:
        path = found.climb = calibrate.climb(laboratory, screening)
        findings.write_design_table(folder, "climb", path.design)
        found.document["climb"] = findings.climb_document(path)
        if "surface" in steps:
            take_last_steps(found, laboratory, calibrate.surface_factors(laboratory, screening, path), steps)


def take_last_steps(
    found: Calibration, laboratory: Laboratory, factors: list[Any], steps: tuple[Step, ...]
) -> None:
    """Surface, optimum, confirmation."""
    surface = found.surface = calibrate.fit_surface(laboratory, factors)
    findings.write_design_table(found.file.folder, "surface", surface.design)
    found.document["surface"] = findings.surface_document(surface)
    if "optimise" in steps:
        optimum = found.optimum = calibrate.find_optimum(laboratory, surface)
        found.document["optimise"] = findings.optimum_document(optimum)
        if "confirm" in steps:
            confirmed = found.confirmed = calibrate.confirm_optimum(laboratory, surface, optimum)
            findings.write_design_table(found.file.folder, "confirm", confirmed.design)
            found.document["confirm"] = findings.confirmed_document(confirmed)
