"""Figures of an evidence study: measured values with the models, residuals, probabilities, vault, ladder."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from taichi_erosion.report.evidence_results import Layer
from taichi_erosion.report.figure_style import (
    AFTER,
    BEFORE,
    CONTROL,
    INK,
    NARROW,
    OTHER,
    PANEL,
    PAPER,
    SOFT,
    WIDE,
    Floats,
    Picture,
    numbers,
    page_style,
    picture,
    responsive,
    scale_axis,
    single,
)
from taichi_erosion.report.html import percent
from taichi_erosion.report.measured_table import Condition, MeasuredTable
from taichi_erosion.report.plain_words import effect_words, listed, short, with_unit, words_of

Record = Mapping[str, Any]

COLOURS = {"before": BEFORE, "after": AFTER, "best_wrong": CONTROL, "random_wrong": OTHER}
KEY = {
    "before": "model before",
    "after": "model after",
    "best_wrong": "control: best other effect",
    "random_wrong": "control: drawn at random",
}
HALF_WIDTH = 1.645  # of a normal 90 % interval, in sd
MOST_SERIES = 5  # sets of the other conditions that have lines of their own
DASHES = ("-", "--", ":", "-.", (0, (6, 1, 1, 1, 1, 1)))
MARKERS = ("o", "s", "^", "D", "v")
MOST_ANSWERS = 10  # bars of the posterior


@dataclass(frozen=True)
class Points:
    """Rows of one observable along one condition, in the units of the table."""

    x: Floats
    series: tuple[str, ...]  # the other conditions in words
    measured: Floats
    error: Floats  # half of the 90 % interval of a measured value
    model: Floats
    band: Floats  # half of the 90 % interval of the model's value
    rows: tuple[int, ...]  # places in the result


@dataclass(frozen=True)
class Panel:
    """One observable against one condition, with everything that is drawn there."""

    observable: str
    unit: str
    condition: Condition | None  # None: no condition varies; rows stand side by side
    layers: Sequence[Layer]
    table: MeasuredTable
    others: Sequence[str] = ()  # conditions that vary beside it

    @property
    def value_label(self) -> str:
        """`threshold friction velocity [m/s]`."""
        noun = words_of(self.observable).noun
        return f"{noun} [{self.unit}]" if self.unit not in ("", "1") else noun


def panels_of(
    names: Sequence[str], layers: Sequence[Layer], table: MeasuredTable, units: Record
) -> Iterator[Panel]:
    """Panels of every observable against every condition that varies among its rows."""
    rows = layers[0].fitted
    for name in names:
        varying = varying_conditions(rows, name)
        for axis in varying or [None]:
            condition = None if axis is None else table.condition(axis)
            others = [other for other in varying if other != axis]
            yield Panel(name, units.get(name, "1"), condition, layers, table, others)


def varying_conditions(rows: Record, observable: str) -> list[str]:
    """Conditions with more than one value among the rows of an observable, most values first."""
    chosen = [place for place, name in enumerate(rows["observable"]) if name == observable]
    counts = {
        axis: len({column[place] for place in chosen if column[place] is not None})
        for axis, column in rows["conditions"].items()
    }
    return [axis for axis in sorted(counts, key=lambda axis: -counts[axis]) if counts[axis] > 1]


def points_of(panel: Panel, rows: Record) -> Points:
    """Rows of a panel in order of their condition; rows without a value there are left out."""
    places = [place for place, name in enumerate(rows["observable"]) if name == panel.observable]
    column = numbers(rows["conditions"][panel.condition.name]) if panel.condition else np.arange(1.0, 1e6)
    x = {
        place: panel.condition.shown(column[place]) if panel.condition else float(k + 1)
        for k, place in enumerate(places)
    }
    kept = sorted((place for place in places if isfinite(x[place])), key=lambda place: x[place])
    get = {key: numbers(rows[key])[kept] for key in ("measured", "measured_sd", "predicted")}
    spread = rows.get("model_sd") or rows["predicted_sd"]
    shift = rows.get("shift") or [0.0] * len(spread)
    return Points(
        x=np.array([x[place] for place in kept]),
        series=tuple(series_of(panel, rows, place) for place in kept),
        measured=get["measured"],
        error=HALF_WIDTH * np.nan_to_num(get["measured_sd"]),
        model=get["predicted"] + np.nan_to_num(numbers(shift)[kept]),
        band=HALF_WIDTH * np.nan_to_num(numbers(spread)[kept]),
        rows=tuple(kept),
    )


def series_of(panel: Panel, rows: Record, place: int) -> str:
    """The other conditions of a row in words."""
    return ", ".join(
        value_words(panel.table.condition(name), rows["conditions"][name][place]) for name in panel.others
    )


def value_words(condition: Condition, value: float | None) -> str:
    """`moisture 1.5 %`."""
    plain = condition.name.replace("_", " ")
    if value is None:
        return f"{plain} not stated"
    return f"{plain} {with_unit(f'{condition.shown(value):.3g}', condition.unit)}"


def draw_first(panel: Panel, width: float) -> Figure:
    """Measured values with their errors, and every model with its band, against one condition."""
    height = 3.5 if width == WIDE else 3.1 if width == NARROW else PANEL[1]
    figure, frame = single(width, height)
    base = panel.layers[0]
    fitted = points_of(panel, base.fitted)
    held = points_of(panel, base.held) if base.held else None
    names = list(dict.fromkeys([*fitted.series, *(held.series if held else ())]))
    for layer in panel.layers:
        draw_model(frame, panel, layer, names)
    draw_measured(frame, fitted, names, "fitted", filled=True)
    if held is not None and held.x.size:
        draw_measured(frame, held, names, "held", filled=False)
    every = [points for points in (fitted, held) if points is not None]
    label_axes(
        frame,
        panel,
        np.concatenate([points.x for points in every]),
        np.concatenate([points.measured for points in every]),
    )
    if 1 < len(names) <= MOST_SERIES:
        draw_series_key(frame, names)
    return figure


def draw_with_key(panels: Sequence[Panel], width: float) -> Figure:
    """First figure that stands alone, with the key that a page has beside it.

    It is the first panel of its observable whose other conditions are few enough for lines.
    """
    own = [panel for panel in panels if panel.observable == panels[0].observable]
    panel = next((each for each in own if len(series_names(each)) <= MOST_SERIES), own[0])
    figure = draw_first(panel, width)
    (frame,) = figure.axes
    lines = [frame.plot([], [], "o", ms=5.0, color=INK, label="measured, fitted")]
    if panel.layers[0].held:
        lines.append(frame.plot([], [], "o", ms=5.0, color=INK, mfc=PAPER, label="measured, held out"))
    for layer in panel.layers:
        lines.append(frame.plot([], [], "-", lw=2.0, color=COLOURS[layer.key], label=KEY[layer.key]))
    figure.legend(handles=[line for (line,) in lines], loc="outside lower center", ncols=3, fontsize=8.0)
    return figure


def series_names(panel: Panel) -> list[str]:
    """Sets of the other conditions of a panel."""
    base = panel.layers[0]
    every = [points_of(panel, rows).series for rows in (base.fitted, base.held) if rows]
    return list(dict.fromkeys(name for series in every for name in series))


def label_axes(frame: Axes, panel: Panel, x: Floats, y: Floats) -> None:
    """Scales and names of the axes; the scale follows the measured values."""
    if panel.condition is None:
        frame.set(xlabel="row", xticks=[])
    else:
        scale_axis(frame, "x", x)
        frame.set_xlabel(panel.condition.label)
    scale_axis(frame, "y", y)
    frame.set_title(panel.value_label, loc="left")


def draw_series_key(frame: Axes, names: Sequence[str]) -> None:
    """Which mark and line belongs to which set of the other conditions."""
    for name, marker, dash in zip(names, MARKERS, DASHES, strict=False):
        frame.plot([], [], marker=marker, linestyle=dash, color=SOFT, ms=4.0, lw=1.0, label=name)
    frame.legend(fontsize=8.0)


def draw_measured(frame: Axes, points: Points, names: Sequence[str], kind: str, filled: bool) -> None:
    """Measured values with error bars, filled where they were fitted."""
    frame.errorbar(
        points.x, points.measured, points.error, fmt="none", ecolor=INK, elinewidth=0.9, gid=f"layer:{kind}"
    )
    for number, name in enumerate(names):
        own = np.array([each == name for each in points.series], dtype=bool)
        if own.any():
            marker = MARKERS[number] if len(names) <= MOST_SERIES else MARKERS[0]
            (line,) = frame.plot(
                points.x[own],
                points.measured[own],
                marker,
                ms=5.0,
                color=INK,
                mfc=INK if filled else PAPER,
                mew=1.1,
                zorder=5,
            )
            line.set_gid(f"rows:{kind}#{number}")


def draw_model(frame: Axes, panel: Panel, layer: Layer, names: Sequence[str]) -> None:
    """One model: its values on fitted and held-out rows joined where the other conditions are the same."""
    points = joined_points(panel, layer)
    colour, gid = COLOURS[layer.key], f"layer:{layer.key}"
    if len(names) > MOST_SERIES or panel.condition is None:
        frame.errorbar(
            points.x, points.model, points.band, fmt="_", ms=9.0, mew=1.8, lw=0.8, color=colour, gid=gid
        )
        for line in frame.lines[-1:]:
            line.set_gid(gid)
        return
    for number, name in enumerate(names):
        own = np.array([each == name for each in points.series], dtype=bool)
        x, first = np.unique(points.x[own], return_index=True)
        if not x.size:
            continue
        model, band = points.model[own][first], points.band[own][first]
        marker = "" if x.size > 1 else "_"
        frame.plot(x, model, marker=marker, ls=DASHES[number], lw=1.7, ms=9.0, color=colour, gid=gid)
        frame.fill_between(x, model - band, model + band, color=colour, alpha=0.16, lw=0.0, gid=gid)


def joined_points(panel: Panel, layer: Layer) -> Points:
    """Fitted and held-out rows of a model in order of their condition."""
    parts = [points_of(panel, rows) for rows in (layer.fitted, layer.held) if rows]
    order = np.argsort(np.concatenate([part.x for part in parts]), kind="stable")
    series = [name for part in parts for name in part.series]
    columns = [
        np.concatenate([getattr(part, name) for part in parts])[order]
        for name in ("x", "measured", "error", "model", "band")
    ]
    x, measured, error, model, band = columns
    return Points(x, tuple(series[k] for k in order), measured, error, model, band, ())


def first_pictures(panels: Sequence[Panel]) -> list[tuple[Panel, Picture]]:
    """The figure of the first screen: one picture for every observable and condition."""
    observables = {panel.observable for panel in panels}
    found = []
    for number, panel in enumerate(panels):
        texts = hover_texts(panel)
        description = f"{panel.value_label} against {panel.condition.label if panel.condition else 'rows'}"
        name = f"first{number}"
        if len(observables) == 1:
            drawn = responsive(lambda width, panel=panel: draw_first(panel, width), description, name, texts)
        else:
            with page_style():
                drawn = picture(draw_first(panel, PANEL[0]), description, name, texts)
        found.append((panel, drawn))
    return found


def hover_texts(panel: Panel) -> dict[str, list[str]]:
    """Texts of the measured points, by layer and set of the other conditions, in the order of drawing."""
    base, texts = panel.layers[0], {}
    sources = {"fitted": base.fitted, "held": base.held}
    names = list(
        dict.fromkeys(name for rows in sources.values() if rows for name in points_of(panel, rows).series)
    )
    for kind, rows in sources.items():
        if rows is None:
            continue
        points = points_of(panel, rows)
        for number, name in enumerate(names):
            own = [place for place, each in zip(points.rows, points.series, strict=True) if each == name]
            texts[f"{kind}#{number}"] = [row_text(panel, kind, rows, place) for place in own]
    return texts


def row_text(panel: Panel, kind: str, rows: Record, place: int) -> str:
    """Everything about one measured value: conditions, table row, source, what every model says."""
    value, sd = rows["measured"][place], rows["measured_sd"][place]
    behind = panel.table.behind(rows, place)
    lines = [
        f"measured {with_unit(short(value, 3), panel.unit)}"
        + (f", 90 % interval ± {short(HALF_WIDTH * sd)}" if sd else "")
        + (" (held out)" if kind == "held" else "")
    ]
    lines += [
        value_words(panel.table.condition(name), column[place])
        for name, column in rows["conditions"].items()
        if column[place] is not None
    ]
    for layer in panel.layers:
        table = layer.held if kind == "held" else layer.fitted
        if table and place < len(table["predicted"]) and table["predicted"][place] is not None:
            shift = (table.get("shift") or {place: 0.0})[place] or 0.0
            lines.append(f"{layer.label}: {short(table['predicted'][place] + shift, 3)}")
    if behind:
        word = "row" if len(behind) == 1 else "rows"
        repeats = sum(row.n or 1 for row in behind)
        numbered = listed([str(row.line) for row in behind])
        lines.append(f"{word} {numbered} of the table, repeats: {repeats}")
        lines += list(dict.fromkeys(row.source for row in behind if row.source))
    return "\n".join(lines)


def residual_pictures(panels: Sequence[Panel]) -> list[Picture]:
    """Measured less model with the errors of both, before and after, against every condition."""
    found = []
    for number, panel in enumerate(panels):
        if panel.condition is None:
            continue
        with page_style():
            figure = draw_residuals(panel)
            words = f"{panel.value_label}, measured less model, against {panel.condition.label}"
            found.append(picture(figure, words, f"residual{number}", residual_texts(panel)))
    return found


def draw_residuals(panel: Panel) -> Figure:
    """Measured less model along one condition, with the 90 % interval of the difference."""
    figure, frame = single(*PANEL)
    assert panel.condition is not None
    frame.axhline(0.0, color=SOFT, lw=0.8)
    x = np.zeros(0)
    for layer in panel.layers[:2]:
        points = points_of(panel, layer.fitted)
        x, gap = points.x, points.measured - points.model
        simulated = np.nan_to_num(numbers(layer.fitted["predicted_sd"])[list(points.rows)])
        error = np.hypot(points.error, HALF_WIDTH * simulated)  # the errors on which p rests
        frame.errorbar(
            x, gap, error, fmt="none", ecolor=COLOURS[layer.key], elinewidth=0.8, gid=f"layer:{layer.key}"
        )
        (line,) = frame.plot(x, gap, "o", ms=4.0, color=COLOURS[layer.key])
        line.set_gid(f"rows:{layer.key}")
    scale_axis(frame, "x", x)
    unit = "" if panel.unit in ("", "1") else f" [{panel.unit}]"
    frame.set_xlabel(panel.condition.label)
    frame.set_title(f"{words_of(panel.observable).noun},\nmeasured less model{unit}", loc="left")
    return figure


def residual_texts(panel: Panel) -> dict[str, list[str]]:
    """Texts of the points of a residual figure."""
    rows = {layer.key: layer.fitted for layer in panel.layers[:2]}
    return {
        key: [row_text(panel, "fitted", table, place) for place in points_of(panel, table).rows]
        for key, table in rows.items()
    }


def draw_adoptions(adoptions: Sequence[Record]) -> Picture:
    """Misfit per row of fitted and held-out rows after each adopted effect."""

    def draw(width: float) -> Figure:
        figure, frame = single(width, 2.6)
        labels = [
            "\n+ ".join(effect_words(name) for name in step["effects"]) or "without effects"
            for step in adoptions
        ]
        for key, colour, label in (
            ("chi2_fitted", CONTROL, "fitted rows"),
            ("chi2_held_out", AFTER, "held-out rows"),
        ):
            frame.plot(labels, numbers([step[key] for step in adoptions]), "o-", color=colour, label=label)
        frame.axhline(1.0, color=SOFT, lw=0.8, ls=":", zorder=0)
        values = numbers([step[key] for step in adoptions for key in ("chi2_fitted", "chi2_held_out")])
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
        figure, frame = single(width, 0.5 + 0.24 * len(ranked))
        frame.barh(labels, values, color=[CONTROL if name in answers.values() else AFTER for name in labels])
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
    values = numbers([adoption[key]["vault_chi2"] for key in there])[::-1]
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
