"""Figures of designed experiments and calibrations: effects, climb, surfaces, residuals, confirmation.

Lines differ by dash as well as by colour and maps by lightness, for prints without colour.
`names` gives the axis label of a factor path; without an entry the path is the label. `at` is the coded point
through which sections go.
"""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import stats
from statsmodels.stats.outliers_influence import OLSInfluence

from taichi_erosion.campaign.study_file import Target
from taichi_erosion.experiments.design import Design, to_natural
from taichi_erosion.experiments.fit import Fit
from taichi_erosion.report.figure_style import Floats, page_style, panels, single_panel_figure

Names = Mapping[str, str]
Record = Mapping[str, Any]

LINE, POINT, NEUTRAL, PALE = "#1f4e79", "#c0392b", "#7f8c8d", "#b8c1c9"
MAP = "cividis"  # even rise of lightness: readable in grey
TICKS = 41  # points along an edge of a surface
LEVELS = 9  # contour lines
PANEL = (3.3, 0.9 * 3.3)  # in


@page_style()
def contour_figure(fit: Fit, names: Names, unit: str, at: Floats, target: float) -> Figure:
    """Contours of the response over every pair of factors, with the runs and, if reached, the target."""
    pairs = list(combinations(range(len(fit.factors)), 2))
    runs, place = to_natural(fit.factors, fit.coded), to_natural(fit.factors, at)
    labels = [names.get(factor.path, factor.path) for factor in fit.factors]
    figure, frames = panels(len(pairs), 3, PANEL)
    for axes, (i, j) in zip(frames, pairs, strict=True):
        across, up, height = response_grid(fit, i, j, at)
        axes.contourf(across, up, height, levels=LEVELS, cmap=MAP, alpha=0.35)
        axes.clabel(axes.contour(across, up, height, levels=LEVELS, colors=LINE, linewidths=0.8), fontsize=7)
        if height.min() < target < height.max():
            axes.contour(across, up, height, levels=[target], colors=POINT, linewidths=2.0)
        axes.plot(runs[:, i], runs[:, j], "o", color="black", ms=3, clip_on=False)
        axes.plot(place[i], place[j], "x", color=POINT, ms=8, mew=2, clip_on=False)
        axes.set(xlabel=labels[i], ylabel=labels[j])
    figure.suptitle(f"{fit.response} [{unit}]", fontsize=9)
    return figure


def response_grid(fit: Fit, i: int, j: int, at: Floats) -> tuple[Floats, Floats, Floats]:
    """Natural values of two factors and the response over them, each [TICKS, TICKS]."""
    ticks = np.linspace(-1.0, 1.0, TICKS)
    points = np.tile(at, (TICKS, TICKS, 1))
    points[..., i], points[..., j] = np.meshgrid(ticks, ticks)
    natural = to_natural(fit.factors, points)
    return natural[..., i], natural[..., j], fit.predict(points.reshape(-1, len(at))).reshape(TICKS, TICKS)


@page_style()
def residual_figure(fit: Fit, run_order: NDArray[np.int64]) -> Figure:
    """Studentized residuals against normal scores, fitted values and run order; Cook's distance.

    Each residual's own run is left out of its error; dashed: the Bonferroni limit at 5 %. `run_order` is the
    position of each design row in the sequence of runs.
    """
    influence = OLSInfluence(fit.results)
    with np.errstate(divide="ignore", invalid="ignore"):  # a run that alone fixes a coefficient
        deleted = np.asarray(influence.resid_studentized_external)
        cook, _ = np.asarray(influence.cooks_distance)
    limit = float(stats.t.isf(0.025 / len(deleted), fit.df_error - 1)) if fit.df_error > 1 else np.nan
    finite = np.isfinite(deleted)
    residual, fitted, when = deleted[finite], fit.fitted[finite], run_order[fit.rows][finite]
    figure, (normal, level, order, distance) = panels(4, 2, PANEL)
    scores = stats.norm.ppf((np.arange(1, len(residual) + 1) - 0.5) / len(residual))
    normal.plot(np.sort(residual), scores, "o", color=LINE)
    normal.plot(scores, scores, color=NEUTRAL, lw=1.0)
    normal.set(xlabel="studentized residual [1]", ylabel="normal score [1]")
    level.plot(fitted, residual, "o", color=LINE)
    level.set(xlabel="fitted value", ylabel="studentized residual [1]")
    order.plot(np.sort(when), residual[np.argsort(when)], "o-", color=LINE, lw=0.7)
    order.set(xlabel="run order", ylabel="studentized residual [1]")
    for axes in (level, order):
        axes.axhline(0.0, color=NEUTRAL, lw=1.0)
        for side in (-limit, limit):
            axes.axhline(side, color=POINT, linestyle="--", lw=1.0)
    distance.stem(run_order[fit.rows], cook, basefmt=" ")
    distance.set(xlabel="run order", ylabel="Cook's distance [1]")
    return figure


@page_style()
def effect_figure(record: Record, factors: Sequence[str], unit: str) -> Figure:
    """Effects by size with their significance limits; dark: factors that the calibration keeps."""
    effects = record["effects"][::-1]
    figure, axes = single_panel_figure(6.4, 0.32 * len(effects) + 1.0)
    colours = [LINE if effect["name"] in factors else PALE for effect in effects]
    axes.barh([e["label"] for e in effects], [e["value"] for e in effects], color=colours)
    for key, style, label in (("single", "--", "t limit, 95 %"), ("bonferroni", ":", "Bonferroni limit")):
        limit = record["limits"][key]
        axes.axvline(limit, color=POINT, linestyle=style, linewidth=1.0, label=label)
        axes.axvline(-limit, color=POINT, linestyle=style, linewidth=1.0)
    axes.axvline(0.0, color="black", linewidth=0.6)
    axes.set_xlabel(f"mean at high level minus mean at low level [{unit}]")
    axes.legend(loc="lower right")
    return figure


@page_style()
def climb_curve(design: Design, name: str, best: int, target: Target) -> Figure:
    """Response along the path of steepest ascent, with the measured value."""
    figure, axes = single_panel_figure(4.6, 2.8)
    draw_measured_band(axes, target)
    steps = np.arange(len(design))
    axes.plot(steps, design.responses[name], "o-", color=LINE)
    axes.plot(best, design.responses[name][best], "o", markersize=11, fillstyle="none", color=LINE)
    axes.set(xticks=steps, xlabel="step along the path of steepest ascent", ylabel=f"{name} [{target.unit}]")
    return figure


def draw_measured_band(axes: Axes, target: Target) -> None:
    """Measured value with one standard deviation of single repeats."""
    axes.axhspan(target.value - target.sd, target.value + target.sd, color=POINT, alpha=0.15, linewidth=0)
    axes.axhline(target.value, color=POINT, linewidth=1.0)


@page_style()
def confirmation_figure(values: Sequence[float], name: str, target: Target, predicted: Record) -> Figure:
    """Confirmation runs at the optimum, with prediction and measurement."""
    figure, axes = single_panel_figure(3.6, 2.8)
    draw_measured_band(axes, target)
    half = 0.5 * (predicted["high"] - predicted["low"])
    axes.errorbar([0.0], [predicted["value"]], yerr=[half], fmt="s", color=PALE, capsize=3)
    axes.plot(np.linspace(0.85, 1.15, len(values)), values, "o", color=LINE)
    axes.set_xticks([0.0, 1.0], ["response surface", "confirmation runs"])
    axes.set(xlim=(-0.5, 1.5), ylabel=f"{name} [{target.unit}]")
    return figure
