"""Doses of a mechanism that every set of conditions asks for, with the law through them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from taichi_erosion.evidence.data.number_words import heading, short
from taichi_erosion.report.figure_style import (
    AFTER,
    INK,
    PAPER,
    SOFT,
    Floats,
    Picture,
    numbers,
    responsive,
    scale_axis,
    single,
)
from taichi_erosion.report.measured_table import Condition, MeasuredTable
from taichi_erosion.report.study_figures import HALF_WIDTH

Record = Mapping[str, Any]

HEIGHT = 3.1  # in
DOTS = {"marker": "o", "ms": 5.0, "color": INK, "ls": "none"}
BEYOND = 1.5  # of the span of doses and law that error bars may add to the axis to either side [1]


def draw_doses(discovery: Record | None, adoption: Record | None, table: MeasuredTable) -> list[Picture]:
    """One picture for each condition of the law; along the axis of the doses where there is no law."""
    beyond = (discovery or {}).get("beyond")
    if not beyond or not beyond["doses"]:
        return []
    held = (adoption or {}).get("doses") or []
    found = []
    for number, name in enumerate(shown_conditions(beyond)):
        condition = table.condition(name)
        words = description(beyond, condition, bool(held))

        def draw(width: float, condition: Condition = condition) -> Figure:
            return draw_panel(beyond, held, condition, width)

        texts = {"doses": dose_texts(beyond["doses"], table), "held": dose_texts(held, table, " (held out)")}
        found.append(responsive(draw, words, f"doses{number}", texts))
    return found


def shown_conditions(beyond: Record) -> list[str]:
    """Conditions of the law, else the one along which the doses vary, else the first that varies."""
    law, axis = beyond["law"], beyond["mechanisms"][0]["axis"]
    if law and law["conditions"]:
        return list(law["conditions"])
    columns = {
        name: {dose["conditions"][name] for dose in beyond["doses"]}
        for name in beyond["doses"][0]["conditions"]
    }
    varying = [name for name, values in columns.items() if len(values) > 1]
    return [axis] if axis in varying else varying[:1]


def description(beyond: Record, condition: Condition, opened: bool) -> str:
    """Caption in words."""
    best = beyond["mechanisms"][0]
    words = (
        f"How much of {best['title']} the measurements ask for ({best['meaning']}), against "
        f"{condition.label}: dots with 90 % intervals, one for every set of conditions"
    )
    if beyond["law"]:
        words += "; line: the law that they follow"
        words += ", with its 90 % interval" if beyond["law"]["curve"] else ""
    words += "; open dots: held-out measurements, which no fit has seen" if opened else ""
    return f"{words}. At 0 nothing is missing."


def draw_panel(beyond: Record, held: Sequence[Record], condition: Condition, width: float) -> Figure:
    """Doses with their intervals and the law against one condition."""
    figure, frame = single(width, HEIGHT)
    frame.axhline(0.0, color=SOFT, lw=0.8)
    draw_law(frame, beyond, condition)
    draw_points(frame, beyond["doses"], condition, INK, "doses")
    draw_points(frame, held, condition, PAPER, "held")
    every = [*beyond["doses"], *held]
    scale_axis(frame, "x", places(every, condition))
    frame.set_ylim(*dose_limits(every, beyond["law"]))
    frame.set_xlabel(condition.label)
    best = beyond["mechanisms"][0]
    frame.set_title(f"{best['title'].removeprefix('a ')}:\n{heading(best['meaning'], '')}", loc="left")
    return figure


def places(doses: Sequence[Record], condition: Condition) -> Floats:
    """Values of the condition in the unit of the table."""
    return numbers([condition.shown(dose["conditions"][condition.name]) for dose in doses])


def draw_points(frame: Axes, doses: Sequence[Record], condition: Condition, fill: str, kind: str) -> None:
    """Doses with 90 % intervals."""
    if not doses:
        return
    x, y = places(doses, condition), numbers([dose["dose"] for dose in doses])
    error = HALF_WIDTH * numbers([dose["sd"] for dose in doses])
    frame.errorbar(x, y, error, fmt="none", ecolor=INK, elinewidth=0.9, gid=f"layer:{kind}")
    frame.plot(x, y, mfc=fill, gid=f"rows:{kind}", **DOTS)


def draw_law(frame: Axes, beyond: Record, condition: Condition) -> None:
    """The law as a line with its interval, or as a dash at every dose where it has two conditions."""
    law, doses = beyond["law"], beyond["doses"]
    if not law:
        return
    if law["curve"]:
        x, dose, sd = np.array(law["curve"]).T
        x = np.array([condition.shown(float(value)) for value in x])
        frame.plot(x, dose, color=AFTER, lw=1.7)
        frame.fill_between(x, dose - HALF_WIDTH * sd, dose + HALF_WIDTH * sd, color=AFTER, alpha=0.16, lw=0.0)
        return
    y = numbers([dose["law"] for dose in doses])
    frame.plot(places(doses, condition), y, "_", ms=9.0, mew=1.8, color=AFTER)


def dose_limits(doses: Sequence[Record], law: Record | None) -> tuple[float, float]:
    """Visible doses: all of them and the law, and error bars as far as they do not hide these."""
    values = numbers([dose["dose"] for dose in doses])
    told = np.append(values, 0.0)
    if law:
        told = np.concatenate([told, numbers([dose["law"] for dose in doses])])
        told = np.append(told, [entry[1] for entry in law["curve"]])
    low, high = float(np.nanmin(told)), float(np.nanmax(told))
    error = HALF_WIDTH * numbers([dose["sd"] for dose in doses])
    room = BEYOND * max(high - low, 1e-6)
    ends = (
        max(low - room, float(np.nanmin(values - error))),
        min(high + room, float(np.nanmax(values + error))),
    )
    low, high = min(low, ends[0]), max(high, ends[1])
    edge = 0.05 * (high - low)
    return low - edge, high + edge


def dose_texts(doses: Sequence[Record], table: MeasuredTable, kind: str = "") -> list[str]:
    """Texts of the dots: dose, law and conditions."""
    return [dose_text(dose, table, kind) for dose in doses]


def dose_text(dose: Record, table: MeasuredTable, kind: str) -> str:
    """What one set of conditions asks for."""
    error = f", 90 % interval ± {short(HALF_WIDTH * dose['sd'])}" if dose["sd"] else ""
    lines = [f"asked for: {short(dose['dose'], 3)}{error}{kind}"]
    lines += [f"law: {short(dose['law'], 3)}"] if dose["law"] is not None else []
    lines += [
        table.condition(name).words(value) for name, value in dose["conditions"].items() if value is not None
    ]
    return "\n".join(lines)
