"""The figure of the page of effects: one panel a question."""

from collections.abc import Callable, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from taichi_erosion.verification.effect_answers import Answer
from taichi_erosion.verification.effect_cost import Cost

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
SHOWN = 2.0  # largest shift that is drawn, over the bare value [1]


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
    frame.legend(fontsize=7, frameon=False)


def forest(frame: Any, shifts: Sequence[dict[str, str]], observable: str) -> None:
    """Shifts of one observable of a heap, over its bare value."""
    rows = [r for r in shifts if r["observable"] == observable and isfinite(float(r["shift"]))]
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


def draw(
    answers: Sequence[Answer], shifts: Sequence[dict[str, str]], costs: Sequence[Cost], file: Path
) -> None:
    """All panels."""
    panels: list[Callable[[Any], None]] = [
        lambda frame, names=names, log=log: curve(frame, answers, names, log) for names, log in CURVES
    ]
    panels += [lambda frame, name=name: forest(frame, shifts, name) for name in HEAPS]
    panels.append(lambda frame: bars(frame, costs))
    figure, frames = plt.subplots(4, 4, figsize=(14.0, 12.0), layout="constrained")
    for frame in frames.flat[len(panels) :]:
        frame.set_axis_off()
    for panel, frame in zip(panels, frames.flat, strict=False):
        panel(frame)
        frame.tick_params(labelsize=7)
    figure.savefig(file, dpi=DOTS_PER_INCH)
    plt.close(figure)
