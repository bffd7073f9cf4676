"""The figures of the page of effects."""

from collections.abc import Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from doe.effects.answers import Answer
from doe.effects.cost import Cost

OURS, ANSWER, LAW = "#1f4e79", "#c0392b", "#7f8c8d"
DOTS_PER_INCH = 110
RATIO = "u*_t over bare"
CURVES = (  # effects of one panel, and whether its axis is logarithmic
    (("dry_adhesion",), True),
    (("shear_lift",), True),
    (("liquid_bridge",), True),
    (("bed_slope",), False),
    (("drag_partition", "surface_roughness"), False),
    (("air_density",), False),
    (("grain_density",), False),
    (("turbulent_gusts",), True),
    (("restitution_speed",), True),
    (("rolling_resistance",), False),
)
MARKS = "os"
HEAPS = ("angle_of_repose", "pile_height")  # observables of the panels of shifts


def curve(frame: Any, answers: Sequence[Answer], names: Sequence[str], logarithmic: bool) -> None:
    """Values along an axis, with what was expected and the law of beds."""
    for mark, name in zip(MARKS, names, strict=False):
        rows = sorted((a for a in answers if a.effect == name and a.axis), key=lambda a: a.place)
        if not rows:
            continue
        places = [row.place for row in rows]
        frame.errorbar(
            places, [r.value for r in rows], [r.error for r in rows], fmt=mark, color=OURS, ms=4, label=name
        )
        for values, colour, style in (
            ([row.expected for row in rows], ANSWER, "-"),
            ([row.law for row in rows], LAW, "--"),
        ):
            if any(map(isfinite, values)):
                frame.plot(places, values, style, color=colour, lw=1)
        frame.set_xlabel(rows[0].axis, fontsize=8)
        frame.set_ylabel(rows[0].quantity, fontsize=8)
    if logarithmic:
        frame.set_xscale("log")
        frame.xaxis.set_minor_formatter("")
    frame.legend(fontsize=7, frameon=False)


def forest(frame: Any, shifts: Sequence[dict[str, str]], observable: str) -> None:
    """Shifts of one observable of a heap, over its bare value."""
    rows = [r for r in shifts if r["observable"] == observable and isfinite(float(r["shift"]))]
    rows.sort(key=lambda row: (row["effect"], row["label"]))
    names = [f"{r['effect']} {r['label']}".strip() for r in rows]
    sizes = [float(r["shift"]) / float(r["bare"]) for r in rows]
    errors = [float(r["standard_error"]) / float(r["bare"]) for r in rows]
    frame.errorbar(sizes, range(len(rows)), xerr=errors, fmt="o", color=OURS, ms=3, lw=1)
    frame.axvline(0.0, color=LAW, lw=0.8)
    frame.set_yticks(range(len(rows)), names, fontsize=6)
    frame.invert_yaxis()
    frame.set_xlabel(f"shift of {observable} over bare", fontsize=8)


def bars(frame: Any, costs: Sequence[Cost]) -> None:
    """Cost of each effect; the grey band is the scatter of the bare model."""
    rows = sorted((cost for cost in costs if cost.effect), key=lambda cost: cost.ratio)
    bare = [cost.ratio for cost in costs if not cost.effect]
    frame.axvspan(min(bare), max(bare), color=LAW, alpha=0.4, lw=0)
    frame.barh(range(len(rows)), [cost.ratio for cost in rows], color=OURS, height=0.6)
    frame.set_yticks(range(len(rows)), [cost.effect for cost in rows], fontsize=6)
    frame.set_xlabel("time of a step over bare", fontsize=8)


def draw_curves(answers: Sequence[Answer], file: Path) -> None:
    """Effects whose answer is known along an axis."""
    figure, frames = plt.subplots(2, 5, figsize=(15.0, 6.0), layout="constrained")
    for (names, logarithmic), frame in zip(CURVES, frames.flat, strict=True):
        curve(frame, answers, names, logarithmic)
        frame.tick_params(labelsize=7)
    figure.savefig(file, dpi=DOTS_PER_INCH)
    plt.close(figure)


def draw_bars(shifts: Sequence[dict[str, str]], costs: Sequence[Cost], file: Path) -> None:
    """What effects do to a heap, and what they cost."""
    count = len(HEAPS) + bool(costs)
    figure, frames = plt.subplots(1, count, figsize=(5.0 * count, 4.5), layout="constrained")
    for observable, frame in zip(HEAPS, frames, strict=False):
        forest(frame, shifts, observable)
    if costs:
        bars(frames[-1], costs)
    figure.savefig(file, dpi=DOTS_PER_INCH)
    plt.close(figure)
