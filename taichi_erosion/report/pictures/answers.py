"""Figures of answers: probabilities, errors on held-out rows, and after adoptions, doses of mechanisms."""

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from taichi_erosion.evidence.data.number_words import heading, short
from taichi_erosion.report.figure_style import (
    AFTER,
    BEFORE,
    CONTROL,
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
from taichi_erosion.report.html import percent
from taichi_erosion.report.results import Condition, MeasuredTable
from taichi_erosion.report.study_figures import HALF_WIDTH
from taichi_erosion.report.words import effect_words, listed

Record = Mapping[str, Any]

MOST_ANSWERS = 10  # bars of the posterior
LETTERS = 7.0  # of a label per inch of the figure
HEIGHT = 3.1  # in
DOTS = {"marker": "o", "ms": 5.0, "color": INK, "ls": "none"}
BEYOND = 1.5  # of the span of doses and law that error bars may add to the axis to either side [1]


def draw_adoptions(adoptions: Sequence[Record]) -> Picture:
    """Misfit per row of fitted and held-out rows after each adopted effect."""

    def draw(width: float) -> Figure:
        figure, frame = single(width, 2.6)
        labels = [
            "\n+ ".join(effect_words(name) for name in step["effects"]) or "without effects"
            for step in adoptions
        ]
        for key, colour, label in (
            ("chi2_per_row_fitted", CONTROL, "fitted rows"),
            ("chi2_per_row_held_out", AFTER, "held-out rows"),
        ):
            frame.plot(labels, numbers([step[key] for step in adoptions]), "o-", color=colour, label=label)
        frame.axhline(1.0, color=SOFT, lw=0.8, ls=":", zorder=0)
        values = numbers(
            [step[key] for step in adoptions for key in ("chi2_per_row_fitted", "chi2_per_row_held_out")]
        )
        scale_axis(frame, "y", values)
        frame.margins(x=0.15)
        frame.set_title("chi2 per row", loc="left")
        frame.legend()
        return figure

    words = "Misfit per row (chi2) after each adopted effect. Dotted: 1, what noise alone gives."
    return responsive(draw, words, "ladder")


def draw_posterior(probabilities: Mapping[str, float | None]) -> Picture:
    """Posterior probabilities of the answers, in order."""
    ranked = sorted(probabilities.items(), key=lambda item: -(item[1] or 0.0))[:MOST_ANSWERS]
    answers = {"none": "nothing is missing", "outside_library": "missing, not in the list"}
    labels = [answers.get(name, effect_words(name.replace("+", " + "))) for name, _ in ranked][::-1]
    values = numbers([p for _, p in ranked])[::-1]

    def draw(width: float) -> Figure:
        names = [fill(label, int(LETTERS * width)) for label in labels]
        figure, frame = single(
            width, 0.5 + 0.1 * len(names) + 0.14 * sum(name.count("\n") + 1 for name in names)
        )
        frame.barh(names, values, color=[CONTROL if name in answers.values() else AFTER for name in labels])
        for place, value in enumerate(values):
            frame.text(value + 0.01, place, percent(value), va="center", fontsize=8.0)
        frame.set(xlim=(0.0, 1.12), xticks=[0.0, 0.5, 1.0], xlabel="probability")
        return figure

    return responsive(draw, "Probability of every answer after the measurements.", "posterior")


def draw_vault(adoption: Record) -> Picture:
    """Misfit of the held-out rows before and after adoption, with the controls."""
    labels = {
        "base": "before",
        "added": f"with {listed([effect_words(name) for name in adoption['added']['effects']])}",
        "best_wrong": "control: best other",
        "random_wrong": "control: at random",
    }
    there = {key: label for key, label in labels.items() if adoption.get(key)}
    values = numbers([adoption[key]["vault_chi2_per_row"] for key in there])[::-1]
    colours = {"base": BEFORE, "added": AFTER}

    def draw(width: float) -> Figure:
        figure, frame = single(width, 0.6 + 0.34 * len(there))
        frame.barh(
            list(there.values())[::-1], values, color=[colours.get(key, CONTROL) for key in there][::-1]
        )
        frame.axvline(1.0, color=INK, lw=0.8, ls=":")
        scale_axis(frame, "x", np.append(values, 1.0))
        frame.set_xlabel("chi2 per held-out row")
        return figure

    return responsive(
        draw,
        "Misfit per held-out row (chi2) before and after, with the controls. Dotted: what noise alone gives.",
        "vault",
    )


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
