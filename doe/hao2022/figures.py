"""Figures of the effects in a screening design: half-normal plot and Pareto chart."""

from collections.abc import Callable
from math import isfinite
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments.anova import effect_limits, effects
from taichi_erosion.experiments.fit import Fit
from taichi_erosion.experiments.terms import term_label
from taichi_erosion.report.design_figures import LINE, NEUTRAL, POINT, Names, panels

LABEL_BOX: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "pad": 0.8}
OFFSET: dict[str, Any] = {"textcoords": "offset points"}


def half_normal_scores(count: int) -> Floats:
    """Expected sizes of `count` sorted pure-noise effects, in standard errors: (i - 1/2) / n quantiles."""
    return np.asarray(stats.norm.ppf(0.5 + 0.5 * (np.arange(1, count + 1) - 0.5) / count))


def half_normal(fit: Fit, names: Names, unit: str) -> Figure:
    """Half-normal plot of the sizes of effects; significant effects have a label."""
    ordered = sorted(effects(fit), key=lambda effect: abs(effect.value))
    sizes = np.array([abs(effect.value) for effect in ordered])
    scores = half_normal_scores(len(sizes))
    limit = effect_limits(fit).single if fit.df_error else effect_limits(fit).lenth_margin
    with panels(1, 1) as (figure, (axes,)):
        small = sizes <= float(np.median(sizes))
        slope = float(scores[small] @ sizes[small] / (scores[small] @ scores[small]))
        axes.plot([0.0, slope * scores[-1]], [0.0, scores[-1]], color=NEUTRAL, lw=1.0)
        axes.plot(sizes, scores, "o", color=LINE)
        for effect, size, score in zip(ordered, sizes, scores, strict=True):
            if size > limit:
                sign = "+" if effect.value > 0.0 else "\N{MINUS SIGN}"
                text = f"{term_label(effect.name, names)} ({sign}) "
                axes.annotate(text, (size, score), (-6, 3), ha="right", fontsize=8, bbox=LABEL_BOX, **OFFSET)
        mark_limits(axes, fit, axes.axvline)
        axes.set(xlabel=f"size of the effect [{unit}]", ylabel="half-normal score [1]", xlim=(0.0, None))
        axes.set_ylim(0.0, 1.15 * scores[-1])
        axes.legend(fontsize=7.5, loc="lower right", edgecolor="none")
    return figure


def pareto(fit: Fit, names: Names, unit: str) -> Figure:
    """Pareto chart of effects with their significance limits; hollow bars are negative."""
    ordered = sorted(effects(fit), key=lambda effect: abs(effect.value))
    with panels(1, 1) as (figure, (axes,)):
        for place, effect in enumerate(ordered):
            fill = LINE if effect.value > 0.0 else "white"
            axes.barh(place, abs(effect.value), color=fill, edgecolor=LINE)
        axes.set_yticks(range(len(ordered)), [term_label(effect.name, names) for effect in ordered])
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
