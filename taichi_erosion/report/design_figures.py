"""Figures of a designed experiment: effects, response surfaces, and what the residuals say.

Lines differ by dash as well as by colour and maps by lightness, so that a print without colour can be read.
Every function takes names for the axes by factor path; a factor without one keeps its path.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from itertools import combinations
from math import ceil, isfinite
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy import stats

from taichi_erosion.experiments.design_table import to_natural
from taichi_erosion.experiments.effects import effect_limits, effects, half_normal_scores
from taichi_erosion.experiments.fit import Fit
from taichi_erosion.experiments.quality import diagnostics

Floats = NDArray[np.float64]
Names = Mapping[str, str]

LINE, POINT, IDLE = "#1f4e79", "#c0392b", "#7f8c8d"
DASHES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)))
MAP = "cividis"  # its lightness rises evenly: a grey copy shows the same hills
TICKS = 41  # points along an edge of a surface
LEVELS = 9  # contour lines
STYLE: dict[Any, Any] = {"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False}
PAPER: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}  # behind words on lines
AWAY: dict[str, Any] = {"textcoords": "offset points"}
WIDTH = 3.3  # of one panel [inch]


@contextmanager
def panels(count: int, columns: int, solid: bool = False) -> Iterator[tuple[Figure, list[Any]]]:
    """A figure with so many panels, in the style of all of them."""
    across = min(count, columns)
    down = ceil(count / across)
    with plt.rc_context(STYLE):
        figure, frames = plt.subplots(
            down,
            across,
            figsize=(WIDTH * across, 0.9 * WIDTH * down),
            layout="constrained",
            squeeze=False,
            subplot_kw={"projection": "3d"} if solid else None,
        )
        for spare in frames.flat[count:]:
            spare.set_visible(False)
        yield figure, list(frames.flat[:count])


def label(term: str, names: Names) -> str:
    """Name of a factor, of a power or of a product of factors on an axis."""
    words = (factor.partition("^") for factor in term.split("*"))
    return " \N{MULTIPLICATION SIGN} ".join(names.get(path, path) + hat + power for path, hat, power in words)


def half_normal(fit: Fit, names: Names, unit: str) -> Figure:
    """Sizes of the effects against what noise alone would give; those that leave the line are named."""
    ordered = sorted(effects(fit), key=lambda effect: abs(effect.value))
    sizes = np.array([abs(effect.value) for effect in ordered])
    scores = half_normal_scores(len(sizes))
    believed = effect_limits(fit).single if fit.df_error else effect_limits(fit).lenth_margin
    with panels(1, 1) as (figure, (axes,)):
        small = sizes <= float(np.median(sizes))
        slope = float(scores[small] @ sizes[small] / (scores[small] @ scores[small]))
        axes.plot([0.0, slope * scores[-1]], [0.0, scores[-1]], color=IDLE, lw=1.0)
        axes.plot(sizes, scores, "o", color=LINE)
        for effect, size, score in zip(ordered, sizes, scores, strict=True):
            if size > believed:
                sign = "+" if effect.value > 0.0 else "\N{MINUS SIGN}"
                text = f"{label(effect.name, names)} ({sign}) "
                axes.annotate(text, (size, score), (-6, 3), ha="right", fontsize=8, bbox=PAPER, **AWAY)
        mark_limits(axes, fit, axes.axvline)
        axes.set(xlabel=f"size of the effect [{unit}]", ylabel="half-normal score [1]", xlim=(0.0, None))
        axes.set_ylim(0.0, 1.15 * scores[-1])
        axes.legend(fontsize=7.5, loc="lower right", edgecolor="none")
    return figure


def pareto(fit: Fit, names: Names, unit: str) -> Figure:
    """Effects by size with the limits beyond which they are believed; hollow bars are negative."""
    ordered = sorted(effects(fit), key=lambda effect: abs(effect.value))
    with panels(1, 1) as (figure, (axes,)):
        for place, effect in enumerate(ordered):
            fill = LINE if effect.value > 0.0 else "white"
            axes.barh(place, abs(effect.value), color=fill, edgecolor=LINE)
        axes.set_yticks(range(len(ordered)), [label(effect.name, names) for effect in ordered])
        mark_limits(axes, fit, axes.axvline)
        axes.set_xlabel(f"size of the effect [{unit}]\nhollow: lowers")
        axes.legend(fontsize=7.5, loc="lower right", edgecolor="none", framealpha=1.0)
    return figure


def mark_limits(axes: Axes, fit: Fit, line: Callable[..., Any]) -> None:
    """Limits of a single effect and of all at once; Lenth's where the design leaves no error."""
    known = effect_limits(fit)
    drawn = (
        [(known.single, "--", "t limit, 95 %"), (known.bonferroni, ":", "Bonferroni limit")]
        if fit.df_error
        else [(known.lenth_margin, "--", "Lenth, one effect"), (known.lenth_simultaneous, ":", "Lenth, all")]
    )
    for value, dash, text in drawn:
        if isfinite(value):
            line(value, color=POINT, linestyle=dash, lw=1.1, label=text)


def response_surfaces(fit: Fit, names: Names, unit: str, at: Floats | None = None) -> Figure:
    """The fitted surface over all pairs of factors, the others at a coded point (the centre if left out)."""
    pairs = list(combinations(range(len(fit.factors)), 2))
    with panels(len(pairs), 3, solid=True) as (figure, frames):
        for axes, (i, j) in zip(frames, pairs, strict=True):
            across, up, height = grid(fit, i, j, at)
            axes.plot_surface(across, up, height, cmap=MAP, rstride=2, cstride=2, edgecolor="black", lw=0.15)
            for side, factor in ((axes.xaxis, fit.factors[i]), (axes.yaxis, fit.factors[j])):
                side.set_label_text(label(factor.path, names).replace(", ", ",\n"), fontsize=7.5)
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
    """Lines of equal response over all pairs of factors, with the runs and, where it is met, the target."""
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
            axes.set(xlabel=label(fit.factors[i].path, names), ylabel=label(fit.factors[j].path, names))
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
    """Response as one factor after the other leaves a coded point (the centre if left out)."""
    ticks = np.linspace(-1.0, 1.0, TICKS)
    with panels(1, 1) as (figure, (axes,)):
        for k, factor in enumerate(fit.factors):
            points = np.tile(np.zeros(len(fit.factors)) if at is None else at, (TICKS, 1))
            points[:, k] = ticks
            name, dash = label(factor.path, names), DASHES[k % len(DASHES)]
            axes.plot(ticks, fit.predict(points), linestyle=dash, label=name)
        axes.set(xlabel="coded level of the factor [1]", ylabel=f"{fit.response} [{unit}]")
        axes.legend(frameon=False, fontsize=8)
    return figure


def predicted_against_actual(fit: Fit, unit: str) -> Figure:
    """Fitted value of every run against its result."""
    with panels(1, 1) as (figure, (axes,)):
        ends = [min(fit.values.min(), fit.fitted.min()), max(fit.values.max(), fit.fitted.max())]
        axes.plot(ends, ends, color=IDLE, lw=1.0)
        axes.plot(fit.values, fit.fitted, "o", color=LINE)
        axes.set(xlabel=f"{fit.response} of the run [{unit}]", ylabel=f"fitted [{unit}]")
    return figure


def residuals(fit: Fit, turns: NDArray[np.int64]) -> Figure:
    """Studentized residuals: against a normal distribution, the fitted value and the turn; Cook's distance.

    `turns` says when each row of the design was carried out.
    """
    found = diagnostics(fit)
    known = np.isfinite(found.deleted)
    left, fitted, when = found.deleted[known], fit.fitted[known], turns[fit.rows][known]
    with panels(4, 2) as (figure, (normal, level, order, influence)):
        scores = stats.norm.ppf((np.arange(1, len(left) + 1) - 0.5) / len(left))
        normal.plot(np.sort(left), scores, "o", color=LINE)
        normal.plot(scores, scores, color=IDLE, lw=1.0)
        normal.set(xlabel="studentized residual [1]", ylabel="normal score [1]")
        level.plot(fitted, left, "o", color=LINE)
        level.set(xlabel="fitted value", ylabel="studentized residual [1]")
        order.plot(np.sort(when), left[np.argsort(when)], "o-", color=LINE, lw=0.7)
        order.set(xlabel="turn of the run", ylabel="studentized residual [1]")
        for axes in (level, order):
            axes.axhline(0.0, color=IDLE, lw=1.0)
            for side in (-found.limit, found.limit):
                axes.axhline(side, color=POINT, linestyle="--", lw=1.0)
        influence.stem(turns[fit.rows], found.cook, basefmt=" ")
        influence.set(xlabel="turn of the run", ylabel="Cook's distance [1]")
    return figure
