"""What a calibration has found, as JSON and CSV can hold it.

A calibration as far as it was asked for, its tables written as soon as each step has ended.
"""

import csv
import io
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from taichi_erosion.campaign import calibration_steps
from taichi_erosion.campaign.calibration_steps import (
    Climb,
    Confirmed,
    ResponseSurface,
    Screening,
    screened_effects,
)
from taichi_erosion.campaign.design_runs import DesignRun, DesignRunner
from taichi_erosion.campaign.execute import SIMULATE, Report
from taichi_erosion.campaign.ledger import close_ledger, open_ledger
from taichi_erosion.campaign.study_file import CalibrationStudy, read_calibration_study
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.experiments.anova import anova, curvature
from taichi_erosion.experiments.design_table import Design, design_text, read_design
from taichi_erosion.experiments.fit import Fit, coded_polynomial, equation, natural_polynomial, quality
from taichi_erosion.experiments.optimise import Optimisation

Document = dict[str, Any]


def screening_document(screening: Screening) -> Document:
    """Effects, largest first, what they are judged by, and which factors go on."""
    found = {name: effect_document(fit) for name, fit in screening.fits.items()}
    return {"responses": found, "kept": [factor.path for factor in screening.kept]}


def effect_document(fit: Fit) -> Document:
    """Effects of one response with their limits, curvature and figures of merit."""
    bent = curvature(fit)
    found, limits = screened_effects(fit)
    ordered = sorted(found, key=lambda effect: -abs(effect.value))
    return {
        "effects": [asdict(effect) for effect in ordered],
        "limits": asdict(limits),
        "curvature": None if bent is None else asdict(bent),
        "quality": asdict(quality(fit)),
    }


def path_document(design: Design, best: int | None = None) -> Document:
    """Settings and responses row by row."""
    rows = [
        {
            "settings": design.settings(row),
            "responses": {name: float(column[row]) for name, column in design.responses.items()},
        }
        for row in range(len(design))
    ]
    return {"rows": rows} if best is None else {"rows": rows, "best": best + 1}


def climb_document(path: Climb) -> Document:
    """The path and its best row."""
    return path_document(path.design, path.best)


def surface_document(surface: ResponseSurface) -> Document:
    """Variance, figures of merit and equations of every response."""
    ranges = {f.path: (f.low, f.high) for f in surface.design.factors}
    found = {
        name: {
            "anova": [asdict(row) for row in anova(full)],
            "quality": asdict(quality(full)),
            "quality_reduced": asdict(quality(surface.fits[name])),
            "coded": equation(full, coded_polynomial(full)),
            "coded_reduced": equation(surface.fits[name], coded_polynomial(surface.fits[name])),
            "natural_reduced": equation(surface.fits[name], natural_polynomial(surface.fits[name])),
        }
        for name, full in surface.full.items()
    }
    return {"ranges": ranges, "responses": found}


def optimum_document(found: Optimisation) -> Document:
    """Optima, reach of the surface, and what must be said."""
    optima = [
        {
            "settings": optimum.settings,
            "desirability": optimum.desirability,
            "predicted": {name: asdict(one) for name, one in optimum.predictions.items()},
        }
        for optimum in found.optima
    ]
    reach = {name: asdict(one) for name, one in found.reach.items()}
    return {"optima": optima, "reach": reach, "met": found.met, "sentences": list(found.sentences)}


def confirmed_document(confirmed: Confirmed) -> Document:
    """Settings, fresh values and tests."""
    tests = {name: asdict(test) for name, test in confirmed.tests.items()}
    values = {name: column.tolist() for name, column in confirmed.design.responses.items()}
    return {"settings": confirmed.optimum.settings, "values": values, "tests": tests}


def write_design_table(folder: Path, name: str, design: Design) -> Path:
    """A design with its responses as a CSV table."""
    return write_atomic(folder / f"{name}.csv", design_text(design).encode())


def write_runs(file: CalibrationStudy, asked: list[DesignRun]) -> Path:
    """The table of every run: settings, all measures, reason of a failure, cost."""
    paths = list(file.study.parameters)
    measures = dict.fromkeys(name for one in asked for name in one.result.record.get("measures", {}))
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["stage", "row", "seed", "key", *paths, *measures, "failure", "cpu_s"])
    for one in asked:
        values = (one.result.value(name) for name in measures)
        settings = (f"{one.settings[path]:.6g}" for path in paths)
        cells = ("" if value != value else f"{value:.7g}" for value in values)
        ends = (one.result.failure or "", f"{one.result.record.get('cpu_s', 0.0):.1f}")
        writer.writerow([one.stage, one.row, one.seed, one.result.key, *settings, *cells, *ends])
    return write_atomic(file.folder / "runs.csv", text.getvalue().encode())


Step = Literal["design", "run", "analyse", "climb", "surface", "optimise", "confirm"]
STEPS: tuple[Step, ...] = get_args(Step)


@dataclass
class Calibration:
    """What is known so far; `document` is what --json prints."""

    file: CalibrationStudy
    document: dict[str, Any] = field(default_factory=dict)
    screening: calibration_steps.Screening | None = None
    climb: calibration_steps.Climb | None = None
    surface: calibration_steps.ResponseSurface | None = None
    optimum: Optimisation | None = None
    confirmed: calibration_steps.Confirmed | None = None


def calibrate(
    path: Path,
    until: Step = "confirm",
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Report | None = None,
    function: str = SIMULATE,
) -> Calibration:
    """Carry a study out up to a step. Raises BadInput for what cannot be done; what was run is kept."""
    started = time.perf_counter()
    file = read_calibration_study(path)
    found = Calibration(file)
    planned = calibration_steps.screening_design(file)
    found.document = {"study": str(path), "until": until, "design": path_document(planned)}
    if not stands_already(file.folder / "screen.csv", planned):
        write_design_table(file.folder, "screen", planned)
    if until != "design":
        store = open_ledger(file.folder)
        place = file.study.campaign
        runner = DesignRunner(
            file, store, workers or place.workers, scheduler or place.scheduler, progress, function
        )
        try:
            take_steps(found, runner, STEPS[2 : STEPS.index(until) + 1])
        finally:
            close_ledger(store)
        write_runs(file, runner.asked)
        found.document["runs"] = len(runner.asked)
        found.document["cpu_s"] = sum(one.result.record.get("cpu_s", 0.0) for one in runner.asked)
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


def take_steps(found: Calibration, runner: DesignRunner, steps: tuple[Step, ...]) -> None:
    """Screen, then every further step that was asked for."""
    folder = found.file.folder
    screening = found.screening = calibration_steps.screen(runner)
    write_design_table(folder, "screen", screening.design)
    found.document["screen"] = path_document(screening.design)
    if "analyse" in steps:
        found.document["analyse"] = screening_document(screening)
    if "climb" in steps:
        path = found.climb = calibration_steps.climb(runner, screening)
        write_design_table(folder, "climb", path.design)
        found.document["climb"] = climb_document(path)
        if "surface" in steps:
            take_last_steps(found, runner, calibration_steps.surface_factors(runner, screening, path), steps)


def take_last_steps(
    found: Calibration, runner: DesignRunner, factors: list[Any], steps: tuple[Step, ...]
) -> None:
    """Surface, optimum, confirmation."""
    surface = found.surface = calibration_steps.fit_response_surface(runner, factors)
    write_design_table(found.file.folder, "surface", surface.design)
    found.document["surface"] = surface_document(surface)
    if "optimise" in steps:
        optimum = found.optimum = calibration_steps.find_optimum(runner, surface)
        found.document["optimise"] = optimum_document(optimum)
        if "confirm" in steps:
            confirmed = found.confirmed = calibration_steps.confirm_optimum(runner, surface, optimum)
            write_design_table(found.file.folder, "confirm", confirmed.design)
            found.document["confirm"] = confirmed_document(confirmed)
