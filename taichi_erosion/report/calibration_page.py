"""Figures of a calibration beside those of its designs: what goes on, the climb, what fresh runs say.

The page of a calibration: what was run, what matters, where the target is met, what fresh runs say.

The report of a calibration: its page in HTML, with the pictures inside.
"""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markdown_it import MarkdownIt
from matplotlib.figure import Figure

from taichi_erosion.campaign.calibration import Calibration
from taichi_erosion.campaign.study_file import Target, read_calibration_study
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.experiments.design_table import Design
from taichi_erosion.report.design_figures import (
    contours,
    perturbation,
    predicted_against_actual,
    residuals,
    response_surfaces,
)
from taichi_erosion.report.html import address_of, render
from taichi_erosion.report.markdown import markdown_table, with_spread

mpl.use("Agg")


OURS, THEIRS, IDLE = "#1f4e79", "#c0392b", "#b8c1c9"
STYLE: dict[Any, Any] = {"font.size": 8.5, "axes.spines.top": False, "axes.spines.right": False}
RESOLUTION = 130  # dots per inch
Record = Mapping[str, Any]


def save(figure: Figure, path: Path) -> Path:
    """Write a picture; equal figures give equal bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=RESOLUTION, metadata={"Software": None})
    plt.close(figure)
    return path


def effect_bars(found: Record, names: Mapping[str, str], kept: Sequence[str], unit: str) -> Figure:
    """Effects by size with the limits beyond which they are believed; those that go on are dark."""
    effects = found["effects"][::-1]
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(6.4, 0.32 * len(effects) + 1.0), layout="constrained")
        colours = [OURS if effect["name"] in kept else IDLE for effect in effects]
        axes.barh([names[e["name"]] for e in effects], [e["value"] for e in effects], color=colours)
        for limit, style, label in (
            (found["limits"]["single"], "--", "95 % limit"),
            (found["limits"]["bonferroni"], ":", "the same for all at once"),
        ):
            for sign, text in ((1.0, label), (-1.0, None)):
                axes.axvline(sign * limit, color=THEIRS, linestyle=style, linewidth=1.0, label=text)
        axes.axvline(0.0, color="black", linewidth=0.6)
        axes.set_xlabel(f"mean at high level less mean at low level [{unit}]")
        axes.legend(frameon=False, loc="lower right")
    return figure


def climb_curve(design: Design, name: str, best: int, target: Target) -> Figure:
    """Response along the path with the measured value."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(4.6, 2.8), layout="constrained")
        measured(axes, target)
        steps = np.arange(len(design))
        axes.plot(steps, design.responses[name], "o-", color=OURS)
        axes.plot(best, design.responses[name][best], "o", markersize=11, fillstyle="none", color=OURS)
        axes.set_xticks(steps)
        axes.set_xlabel("step along the steepest path")
        axes.set_ylabel(f"{name} [{target.unit}]")
    return figure


def measured(axes: Any, target: Target) -> None:
    """Band of the laboratory's single repeats."""
    axes.axhspan(target.value - target.sd, target.value + target.sd, color=THEIRS, alpha=0.15, linewidth=0)
    axes.axhline(target.value, color=THEIRS, linewidth=1.0)


def fresh_runs(values: Sequence[float], name: str, target: Target, predicted: Record) -> Figure:
    """Fresh seeds at the optimum beside prediction and measurement."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=(3.6, 2.8), layout="constrained")
        measured(axes, target)
        half = 0.5 * (predicted["high"] - predicted["low"])
        axes.errorbar([0.0], [predicted["value"]], yerr=[half], fmt="s", color=IDLE, capsize=3)
        axes.plot(np.linspace(0.85, 1.15, len(values)), values, "o", color=OURS)
        axes.set_xticks([0.0, 1.0], ["fitted surface", "fresh runs"])
        axes.set_xlim(-0.5, 1.5)
        axes.set_ylabel(f"{name} [{target.unit}]")
    return figure


PAGE = "README.md"
PAGE_TEMPLATE = "calibration.md"
PICTURES = "pictures"
LINES = 5  # optima that the page lists
VARIANCE = ("sum_of_squares", "df", "mean_square", "f", "p")


def publish(found: Calibration) -> Path:
    """Write page and pictures into the study's folder; all steps must have been taken."""
    draw(found)
    pages = Environment(loader=PackageLoader("taichi_erosion.report"), undefined=StrictUndefined)
    document, targets = found.document, found.file.study.targets
    text = pages.get_template(PAGE_TEMPLATE).render(
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
    return write_atomic(found.file.folder / PAGE, (text.rstrip() + "\n").encode())


def draw(found: Calibration) -> None:
    """All figures of the page."""
    assert found.climb is not None
    for name in found.file.study.targets:
        for kind, figure in figures_of(found, name).items():
            save(figure, found.file.folder / PICTURES / f"{kind}_{name}.png")
    name, target = next(iter(found.file.study.targets.items()))
    curve = climb_curve(found.climb.design, name, found.climb.best, target)
    save(curve, found.file.folder / PICTURES / f"climb_{name}.png")


def figures_of(found: Calibration, name: str) -> dict[str, Any]:
    """Figures of one response, by kind."""
    assert found.surface is not None
    document, names, target = found.document, labels(found), found.file.study.targets[name]
    analysed, fit = document["analyse"], found.surface.fits[name]
    best, values = document["optimise"]["optima"][0], document["confirm"]["values"][name]
    at = np.array([(best["settings"][f.path] - f.centre) / f.half for f in fit.factors])
    return {
        "effects": effect_bars(analysed["responses"][name], names, analysed["kept"], target.unit),
        "surface": contours(fit, names, target.unit, at, target.value),
        "hills": response_surfaces(fit, names, target.unit, at),
        "perturbation": perturbation(fit, names, target.unit, at),
        "fit": predicted_against_actual(fit, target.unit),
        "residuals": residuals(fit, found.surface.design.run_order),
        "confirm": fresh_runs(values, name, target, best["predicted"][name]),
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


TEMPLATE = "calibration.html"
PICTURE = re.compile(r'<img src="([^":]+)"')


def write_report(study: Path, to: Path | None = None) -> Path:
    """Write the page of a calibration; raises BadInput where the calibration has not been finished."""
    file = read_calibration_study(study)
    source = file.folder / PAGE
    if not source.is_file():
        raise BadInput(f"{study}: not calibrated yet; run doe calibrate on it first")
    title, _, text = source.read_text(encoding="utf-8").partition("\n")
    words = MarkdownIt("commonmark", {"html": False}).enable("table").render(text)
    body = PICTURE.sub(lambda found: f'<img src="{address_of(file.folder / found[1])}"', words)
    about = f"{study}, calibrated by designed experiments"
    page = render(TEMPLATE, {"title": title.removeprefix("# "), "about": about, "body": body})
    return write_atomic(to or file.folder / f"{study.stem}.report.html", page.encode())
