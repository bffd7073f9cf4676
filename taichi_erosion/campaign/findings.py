"""What a calibration has found, as JSON and CSV can hold it."""

import csv
import io
from dataclasses import asdict
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.calibrate import Climb, Confirmed, Screening, Surface
from taichi_erosion.campaign.laboratory import Asked
from taichi_erosion.campaign.screening import screened_effects
from taichi_erosion.campaign.study import StudyFile
from taichi_erosion.experiments.anova import anova, curvature
from taichi_erosion.experiments.design_file import design_text
from taichi_erosion.experiments.equation import coded_polynomial, equation, natural_polynomial
from taichi_erosion.experiments.fit import Fit
from taichi_erosion.experiments.optimise import Optimisation
from taichi_erosion.experiments.quality import quality
from taichi_erosion.experiments.table import Design
from taichi_erosion.recording.whole_file import write_whole

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


def surface_document(surface: Surface) -> Document:
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
    return write_whole(folder / f"{name}.csv", design_text(design).encode())


def write_runs(file: StudyFile, asked: list[Asked]) -> Path:
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
    return write_whole(file.folder / "runs.csv", text.getvalue().encode())
