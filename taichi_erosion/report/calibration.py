"""The page of a calibration: what was run, what matters, where the target is met, what fresh runs say."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from taichi_erosion.campaign.calibration import Calibration
from taichi_erosion.recording.whole_file import write_whole
from taichi_erosion.report import calibration_figures as figures
from taichi_erosion.report.design_figures import (
    contours,
    perturbation,
    predicted_against_actual,
    residuals,
    response_surfaces,
)
from taichi_erosion.report.page import markdown_table, with_spread

PAGE = "README.md"
TEMPLATE = "calibration.md"
PICTURES = "pictures"
LINES = 5  # optima that the page lists
VARIANCE = ("sum_of_squares", "df", "mean_square", "f", "p")


def publish(found: Calibration) -> Path:
    """Write page and pictures into the study's folder; all steps must have been taken."""
    draw(found)
    pages = Environment(loader=PackageLoader("taichi_erosion.report"), undefined=StrictUndefined)
    document, targets = found.document, found.file.study.targets
    text = pages.get_template(TEMPLATE).render(
        file=found.file,
        study=found.file.study,
        document=document,
        leading=next(iter(targets)),
        kept=", ".join(labels(found)[path] for path in document["analyse"]["kept"]),
        effects={name: effect_table(found, name) for name in targets},
        climb=climb_table(found),
        variance={name: variance_table(document["surface"]["responses"][name]) for name in targets},
        equations={name: equation(found, name) for name in targets},
        optima=optimum_table(found),
        samples={name: samples(document["confirm"]["tests"][name]) for name in targets},
    )
    return write_whole(found.file.folder / PAGE, (text.rstrip() + "\n").encode())


def draw(found: Calibration) -> None:
    """All figures of the page."""
    assert found.climb is not None
    for name in found.file.study.targets:
        for kind, figure in figures_of(found, name).items():
            figures.save(figure, found.file.folder / PICTURES / f"{kind}_{name}.png")
    name, target = next(iter(found.file.study.targets.items()))
    curve = figures.climb_curve(found.climb.design, name, found.climb.best, target)
    figures.save(curve, found.file.folder / PICTURES / f"climb_{name}.png")


def figures_of(found: Calibration, name: str) -> dict[str, Any]:
    """Figures of one response, by kind."""
    assert found.surface is not None
    document, names, target = found.document, labels(found), found.file.study.targets[name]
    analysed, fit = document["analyse"], found.surface.fits[name]
    best, values = document["optimise"]["optima"][0], document["confirm"]["values"][name]
    at = np.array([(best["settings"][f.path] - f.centre) / f.half for f in fit.factors])
    return {
        "effects": figures.effect_bars(analysed["responses"][name], names, analysed["kept"], target.unit),
        "surface": contours(fit, names, target.unit, at, target.value),
        "hills": response_surfaces(fit, names, target.unit, at),
        "perturbation": perturbation(fit, names, target.unit, at),
        "fit": predicted_against_actual(fit, target.unit),
        "residuals": residuals(fit, found.surface.design.run_order),
        "confirm": figures.fresh_runs(values, name, target, best["predicted"][name]),
    }


def labels(found: Calibration) -> dict[str, str]:
    """Names for people, by path."""
    return {path: entry.label or path for path, entry in found.file.study.parameters.items()}


def effect_table(found: Calibration, name: str) -> str:
    """Effects, largest first, beside what was published."""
    rows = []
    for effect in found.document["analyse"]["responses"][name]["effects"]:
        entry = found.file.study.parameters[effect["name"]]
        numbers = (f"{effect['value']:+.2f}", f"{effect['p']:.2g}")
        names = f"{labels(found)[effect['name']]} {entry.symbol}".strip()
        span = f"{entry.low:g} to {entry.high:g} {'' if entry.unit == '1' else entry.unit}".rstrip()
        rows.append((names, span, *numbers, entry.published))
    unit = found.file.study.targets[name].unit
    return markdown_table(("parameter", "range", f"effect [{unit}]", "p", "published"), rows)


def climb_table(found: Calibration) -> str:
    """The path, step by step."""
    document = found.document["climb"]
    paths, names = (list(document["rows"][0][key]) for key in ("settings", "responses"))
    rows = []
    for step, row in enumerate(document["rows"]):
        mark = " (nearest)" if step == document["best"] - 1 else ""
        values = [row["settings"][path] for path in paths] + [row["responses"][name] for name in names]
        rows.append((f"{step}{mark}", *(number(value) for value in values)))
    return markdown_table(("step", *(labels(found)[path] for path in paths), *names), rows)


def number(value: float) -> str:
    """A number in four digits, or that there is none."""
    return "none" if value != value else f"{value:.4g}"


def variance_table(document: Mapping[str, Any]) -> str:
    """Analysis of variance."""
    rows = [(row["source"], *(number(row[key]) for key in VARIANCE)) for row in document["anova"]]
    return markdown_table(("source", "sum of squares", "df", "mean square", "F", "p"), rows)


def equation(found: Calibration, name: str) -> str:
    """The equation in natural units, with the symbols of the publication where the study names them."""
    text = found.document["surface"]["responses"][name]["natural_reduced"]
    for path, entry in found.file.study.parameters.items():
        text = text.replace(path, entry.symbol or path)
    return text


def optimum_table(found: Calibration) -> str:
    """Settings that meet the target, the most certain prediction first."""
    optima, targets = found.document["optimise"]["optima"][:LINES], list(found.file.study.targets)
    paths = list(optima[0]["settings"])
    rows = []
    for one in optima:
        predicted = (one["predicted"][name] for name in targets)
        intervals = (f"{p['value']:.4g} ({p['low']:.4g} to {p['high']:.4g})" for p in predicted)
        rows.append((*(number(one["settings"][path]) for path in paths), *intervals))
    header = (*(labels(found)[path] for path in paths), *(f"{name}, predicted" for name in targets))
    return markdown_table(header, rows)


def samples(test: Mapping[str, Any]) -> dict[str, str]:
    """Mean, spread and number of the fresh runs and of the measurement."""
    return {
        kind: with_spread(test[kind]["mean"], test[kind]["sd"], int(test[kind]["n"]))
        for kind in ("runs", "wanted")
    }
