"""Figures of a calibration beside those of its designs: what goes on, the climb, what fresh runs say."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from taichi_erosion.campaign.study import Target
from taichi_erosion.experiments.table import Design

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
