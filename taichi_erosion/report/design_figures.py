"""Figures of designed experiments and calibrations: effects, climb, surfaces, residuals, confirmation.

Lines differ by dash as well as by colour and maps by lightness, for prints without colour.
`names` gives the axis label of a factor path; without an entry the path is the label.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import combinations
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import stats
from statsmodels.stats.outliers_influence import OLSInfluence

from taichi_erosion.campaign.study_file import Target
from taichi_erosion.experiments.design import Design, to_natural
from taichi_erosion.experiments.fit import Fit
from taichi_erosion.report import figure_style

Floats = NDArray[np.float64]
Names = Mapping[str, str]
Record = Mapping[str, Any]

LINE, POINT, NEUTRAL, PALE = "#1f4e79", "#c0392b", "#7f8c8d", "#b8c1c9"
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
MAP = "cividis"  # even rise of lightness: readable in grey
TICKS = 41  # points along an edge of a surface
LEVELS = 9  # contour lines
PANEL = (3.3, 0.9 * 3.3)  # in


@contextmanager
def panels(count: int, columns: int, projection: str | None = None) -> Iterator[tuple[Figure, list[Any]]]:
    """Figure of `count` panels."""
    with figure_style.page_style():
        yield figure_style.panels(count, columns, PANEL, projection)


def response_surfaces(fit: Fit, names: Names, unit: str, at: Floats | None = None) -> Figure:
    """Fitted surface over every pair of factors, the others at a coded point (default: the centre)."""
    pairs = list(combinations(range(len(fit.factors)), 2))
    with panels(len(pairs), 3, projection="3d") as (figure, frames):
        for axes, (i, j) in zip(frames, pairs, strict=True):
            across, up, height = grid(fit, i, j, at)
            axes.plot_surface(across, up, height, cmap=MAP, rstride=2, cstride=2, edgecolor="black", lw=0.15)
            for side, factor in ((axes.xaxis, fit.factors[i]), (axes.yaxis, fit.factors[j])):
                side.set_label_text(names.get(factor.path, factor.path).replace(", ", ",\n"), fontsize=7.5)
                side.labelpad = 6.0
            axes.tick_params(labelsize=7)
            axes.set_box_aspect(None, zoom=0.8)  # leaves room for the names
            axes.set_title(f"{fit.response} [{unit}]", fontsize=9)
            axes.view_init(elev=28.0, azim=-125.0)
            axes.locator_params(nbins=4)
    return figure


def contours(
    fit: Fit, names: Names, unit: str, at: Floats | None = None, target: float | None = None
) -> Figure:
    """Contours of the response over every pair of factors, with the runs and, if reached, the target."""
    pairs = list(combinations(range(len(fit.factors)), 2))
    place = to_natural(fit.factors, np.zeros(len(fit.factors)) if at is None else at)
    with panels(len(pairs), 3) as (figure, frames):
        for axes, (i, j) in zip(frames, pairs, strict=True):
            across, up, height = grid(fit, i, j, at)
            axes.contourf(across, up, height, levels=LEVELS, cmap=MAP, alpha=0.35)
            axes.clabel(
                axes.contour(across, up, height, levels=LEVELS, colors=LINE, linewidths=0.8), fontsize=7
            )
            if target is not None and height.min() < target < height.max():
                axes.contour(across, up, height, levels=[target], colors=POINT, linewidths=2.0)
            runs = to_natural(fit.factors, fit.coded)
            axes.plot(runs[:, i], runs[:, j], "o", color="black", ms=3, clip_on=False)
            axes.plot(place[i], place[j], "x", color=POINT, ms=8, mew=2, clip_on=False)
            across_name, up_name = (
                names.get(path, path) for path in (fit.factors[i].path, fit.factors[j].path)
            )
            axes.set(xlabel=across_name, ylabel=up_name)
        figure.suptitle(f"{fit.response} [{unit}]", fontsize=9)
    return figure


def grid(fit: Fit, i: int, j: int, at: Floats | None) -> tuple[Floats, Floats, Floats]:
    """Natural values of two factors and the response over them, each [TICKS, TICKS]."""
    ticks = np.linspace(-1.0, 1.0, TICKS)
    across, up = np.meshgrid(ticks, ticks)
    points = np.tile(np.zeros(len(fit.factors)) if at is None else at, (TICKS * TICKS, 1))
    points[:, i], points[:, j] = across.ravel(), up.ravel()
    natural = to_natural(fit.factors, points)
    flat = (natural[:, i], natural[:, j], fit.predict(points))
    first, second, height = (column.reshape(TICKS, TICKS) for column in flat)
    return first, second, height


def perturbation(fit: Fit, names: Names, unit: str, at: Floats | None = None) -> Figure:
    """Response along each factor through a coded point (default: the centre)."""
    ticks = np.linspace(-1.0, 1.0, TICKS)
    with panels(1, 1) as (figure, (axes,)):
        for k, factor in enumerate(fit.factors):
            points = np.tile(np.zeros(len(fit.factors)) if at is None else at, (TICKS, 1))
            points[:, k] = ticks
            name, dash = names.get(factor.path, factor.path), DASHES[k % len(DASHES)]
            axes.plot(ticks, fit.predict(points), linestyle=dash, label=name)
        axes.set(xlabel="coded level of the factor [1]", ylabel=f"{fit.response} [{unit}]")
        axes.legend(frameon=False, fontsize=8)
    return figure


def predicted_against_actual(fit: Fit, unit: str) -> Figure:
    """Fitted against simulated values."""
    with panels(1, 1) as (figure, (axes,)):
        ends = [min(fit.values.min(), fit.fitted.min()), max(fit.values.max(), fit.fitted.max())]
        axes.plot(ends, ends, color=NEUTRAL, lw=1.0)
        axes.plot(fit.values, fit.fitted, "o", color=LINE)
        axes.set(xlabel=f"{fit.response} of the run [{unit}]", ylabel=f"fitted [{unit}]")
    return figure


def residuals(fit: Fit, run_order: NDArray[np.int64]) -> Figure:
    """Studentized residuals against normal scores, fitted values and run order; Cook's distance.

    Each residual's own run is left out of its error; dashed: the Bonferroni limit at 5 %. `run_order` is the
    position of each design row in the sequence of runs.
    """
    influence = OLSInfluence(fit.results)
    with np.errstate(divide="ignore", invalid="ignore"):  # a run that alone fixes a coefficient
        deleted, (cook, _) = (
            np.asarray(each) for each in (influence.resid_studentized_external, influence.cooks_distance)
        )
    limit = float(stats.t.isf(0.025 / len(deleted), fit.df_error - 1)) if fit.df_error > 1 else np.nan
    known = np.isfinite(deleted)
    left, fitted, when = deleted[known], fit.fitted[known], run_order[fit.rows][known]
    with panels(4, 2) as (figure, (normal, level, order, distance)):
        scores = stats.norm.ppf((np.arange(1, len(left) + 1) - 0.5) / len(left))
        normal.plot(np.sort(left), scores, "o", color=LINE)
        normal.plot(scores, scores, color=NEUTRAL, lw=1.0)
        normal.set(xlabel="studentized residual [1]", ylabel="normal score [1]")
        level.plot(fitted, left, "o", color=LINE)
        level.set(xlabel="fitted value", ylabel="studentized residual [1]")
        order.plot(np.sort(when), left[np.argsort(when)], "o-", color=LINE, lw=0.7)
        order.set(xlabel="run order", ylabel="studentized residual [1]")
        for axes in (level, order):
            axes.axhline(0.0, color=NEUTRAL, lw=1.0)
            for side in (-limit, limit):
                axes.axhline(side, color=POINT, linestyle="--", lw=1.0)
        distance.stem(run_order[fit.rows], cook, basefmt=" ")
        distance.set(xlabel="run order", ylabel="Cook's distance [1]")
    return figure


def effect_bars(found: Record, kept: Sequence[str], unit: str) -> Figure:
    """Effects by size with their significance limits; dark: factors that the calibration keeps."""
    effects = found["effects"][::-1]
    with figure_style.page_style():
        figure, axes = figure_style.single(6.4, 0.32 * len(effects) + 1.0)
        colours = [LINE if effect["name"] in kept else PALE for effect in effects]
        axes.barh([e["label"] for e in effects], [e["value"] for e in effects], color=colours)
        for limit, style, label in (
            (found["limits"]["single"], "--", "t limit, 95 %"),
            (found["limits"]["bonferroni"], ":", "Bonferroni limit"),
        ):
            for sign, text in ((1.0, label), (-1.0, None)):
                axes.axvline(sign * limit, color=POINT, linestyle=style, linewidth=1.0, label=text)
        axes.axvline(0.0, color="black", linewidth=0.6)
        axes.set_xlabel(f"mean at high level minus mean at low level [{unit}]")
        axes.legend(frameon=False, loc="lower right")
    return figure


def climb_curve(design: Design, name: str, best: int, target: Target) -> Figure:
    """Response along the path of steepest ascent, with the measured value."""
    with figure_style.page_style():
        figure, axes = figure_style.single(4.6, 2.8)
        measured_band(axes, target)
        steps = np.arange(len(design))
        axes.plot(steps, design.responses[name], "o-", color=LINE)
        axes.plot(best, design.responses[name][best], "o", markersize=11, fillstyle="none", color=LINE)
        axes.set_xticks(steps)
        axes.set_xlabel("step along the path of steepest ascent")
        axes.set_ylabel(f"{name} [{target.unit}]")
    return figure


def measured_band(axes: Any, target: Target) -> None:
    """Measured value with one standard deviation of single repeats."""
    axes.axhspan(target.value - target.sd, target.value + target.sd, color=POINT, alpha=0.15, linewidth=0)
    axes.axhline(target.value, color=POINT, linewidth=1.0)


def confirmation_runs(values: Sequence[float], name: str, target: Target, predicted: Record) -> Figure:
    """Confirmation runs at the optimum, with prediction and measurement."""
    with figure_style.page_style():
        figure, axes = figure_style.single(3.6, 2.8)
        measured_band(axes, target)
        half = 0.5 * (predicted["high"] - predicted["low"])
        axes.errorbar([0.0], [predicted["value"]], yerr=[half], fmt="s", color=PALE, capsize=3)
        axes.plot(np.linspace(0.85, 1.15, len(values)), values, "o", color=LINE)
        axes.set_xticks([0.0, 1.0], ["response surface", "confirmation runs"])
        axes.set_xlim(-0.5, 1.5)
        axes.set_ylabel(f"{name} [{target.unit}]")
    return figure
