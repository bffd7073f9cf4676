"""Figures of an evidence study: measured values with the models, residuals, probabilities, vault, ladder."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil, isfinite
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from taichi_erosion.evidence.data.number_words import heading, plain, short, with_unit
from taichi_erosion.evidence.data.table_units import TableUnits
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
from taichi_erosion.report.measured_table import Condition, MeasuredTable
from taichi_erosion.report.pictures.measured_marks import (
    DOTS,
    EDGES,
    Bools,
    ValueRange,
    draw_edge_texts,
    draw_intervals,
    draw_marks,
    edge_of,
    kinds,
    value_range,
)
from taichi_erosion.report.plain_words import listed, words_of

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
KEY_ROW = 0.18  # height of a row of the key below a panel [in]


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
    limit: tuple[str, ...]  # "below" or "above" where the measured value is a limit, "between" two limits
    low: Floats  # lower end of the interval in which a measured value lies; NaN: of no interval
    high: Floats  # upper end


@dataclass(frozen=True)
class Panel:
    """One observable against one condition, with everything that is drawn there."""

    observable: str
    units: TableUnits
    condition: Condition | None  # None: no condition varies; rows stand side by side
    layers: Sequence[Layer]
    table: MeasuredTable
    others: Sequence[str] = ()  # conditions that vary beside it

    @property
    def value_label(self) -> str:
        """`threshold friction velocity [m/s]`."""
        return heading(words_of(self.observable).noun, self.units.value_unit(self.observable))

    def values(self, column: Sequence[float | None]) -> Floats:
        """Values of its observable in the unit of the table."""
        return numbers([self.units.value(self.observable, each) for each in column])

    @property
    def shown(self) -> ValueRange:
        """Visible part of the value axis: of measured values and of the models that are drawn at first."""
        values, ends = [], []
        for layer in self.layers:
            points = joined_points(self, layer)
            values += [points.measured, points.model] if layer.shown else []
            ends += [points.model - points.band, points.model + points.band] if layer.shown else []
            known = np.array(points.limit) == ""
            ends += [(points.measured + sign * points.error)[known] for sign in (-1.0, 1.0)]
            ends += [points.low, points.high]
        return value_range(np.concatenate(values), np.concatenate(ends))


def panels_of(
    names: Sequence[str], layers: Sequence[Layer], table: MeasuredTable, units: TableUnits
) -> Iterator[Panel]:
    """Panels of every observable against every condition that varies among its rows."""
    rows = layers[0].fitted
    for name in names:
        varying = varying_conditions(rows, name)
        for axis in varying or [None]:
            condition = None if axis is None else table.condition(axis)
            others = [other for other in varying if other != axis]
            yield Panel(name, units, condition, layers, table, others)


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
    get = {key: panel.values(rows[key])[kept] for key in ("measured", "measured_sd", "predicted")}
    spread = rows.get("model_sd") or rows["predicted_sd"]
    shift = rows.get("shift") or [0.0] * len(spread)
    return Points(
        x=np.array([x[place] for place in kept]),
        series=tuple(series_of(panel, rows, place) for place in kept),
        measured=get["measured"],
        error=HALF_WIDTH * np.nan_to_num(get["measured_sd"]),
        model=get["predicted"] + np.nan_to_num(panel.values(shift)[kept]),
        band=HALF_WIDTH * np.nan_to_num(panel.values(spread)[kept]),
        rows=tuple(kept),
        limit=tuple(limit_of(rows, place) for place in kept),
        low=panel.values(interval_ends(rows, "low"))[kept],
        high=panel.values(interval_ends(rows, "high"))[kept],
    )


def limit_of(rows: Record, place: int) -> str:
    """On which side of a stated limit the value of a row lies, or between two; empty for a value."""
    limits = rows.get("limit") or ()
    side = limits[place] if place < len(limits) else ""
    is_interval = side != "between" or interval_ends(rows, "low")[place] is not None
    return side if is_interval else ""


def interval_ends(rows: Record, end: str) -> Sequence[float | None]:
    """One end of the interval in which the value of every row lies; None: of no interval."""
    return rows.get(end) or [None] * len(rows["observable"])


def series_of(panel: Panel, rows: Record, place: int) -> str:
    """The other conditions of a row in words."""
    return ", ".join(
        panel.table.condition(name).words(rows["conditions"][name][place]) for name in panel.others
    )


def draw_first(panel: Panel, width: float) -> Figure:
    """Measured values with their errors, and every model with its band, against one condition."""
    height = 3.5 if width == WIDE else 3.1 if width == NARROW else PANEL[1]
    base = panel.layers[0]
    fitted = points_of(panel, base.fitted)
    held = points_of(panel, base.held) if base.held else None
    names = list(dict.fromkeys([*fitted.series, *(held.series if held else ())]))
    is_keyed = 1 < len(names) <= MOST_SERIES
    columns = 3 if width == WIDE else 1
    rows = ceil(len(names) / columns) if is_keyed else 0
    figure, frame = single(width, height + KEY_ROW * rows)
    for layer in panel.layers:
        draw_model(frame, panel, layer, names)
    every = [points for points in (fitted, held) if points is not None]
    label_axes(frame, panel, np.concatenate([points.x for points in every]), panel.shown)
    draw_measured(frame, panel, fitted, names, "fitted")
    if held is not None and held.x.size:
        draw_measured(frame, panel, held, names, "held")
    if is_keyed:
        draw_series_key(figure, names, columns)
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
    figure.legend(handles=[line for (line,) in lines], loc="outside upper left", ncols=3, fontsize=8.0)
    return figure


def series_names(panel: Panel) -> list[str]:
    """Sets of the other conditions of a panel."""
    base = panel.layers[0]
    every = [points_of(panel, rows).series for rows in (base.fitted, base.held) if rows]
    return list(dict.fromkeys(name for series in every for name in series))


def label_axes(frame: Axes, panel: Panel, x: Floats, shown: ValueRange) -> None:
    """Scales and names of the axes."""
    if panel.condition is None:
        frame.set(xlabel="row", xticks=[])
    else:
        scale_axis(frame, "x", x)
        frame.set_xlabel(panel.condition.label)
    show_values(frame, shown)
    frame.set_title(panel.value_label, loc="left")


def show_values(frame: Axes, shown: ValueRange) -> None:
    """Scale and limits of the value axis."""
    scale_axis(frame, "y", np.array([shown.low, shown.high]), shown.logarithmic)
    frame.set_ylim(shown.low, shown.high)


def draw_series_key(figure: Figure, names: Sequence[str], columns: int) -> None:
    """Which mark and line belongs to which set of the other conditions, below the panel."""
    lines = [
        Line2D([], [], marker=marker, linestyle=dash, color=SOFT, ms=4.0, lw=1.0, label=name)
        for name, marker, dash in zip(names, MARKERS, DASHES, strict=False)
    ]
    figure.legend(handles=lines, fontsize=8.0, loc="outside lower left", ncols=min(columns, len(names)))


def draw_measured(frame: Axes, panel: Panel, points: Points, names: Sequence[str], kind: str) -> None:
    """Measured values with error bars, filled where they were fitted; limits as arrows, intervals as bars."""
    draw_errors(frame, points, panel.shown, INK, f"layer:{kind}")
    for number, mark, own in marks(points, names, panel.shown):
        marker = MARKERS[number] if len(names) <= MOST_SERIES else MARKERS[0]
        style = DOTS | {"marker": marker, "mfc": INK if kind == "fitted" else PAPER}
        y = edge_of(panel.shown, mark, points.measured[own])
        draw_marks(frame, points.x[own], y, mark, style, f"rows:{kind}#{number}{mark}")
        if mark in EDGES:
            draw_edge_texts(frame, points.x[own], [plain(each) for each in points.measured[own]], mark)


def draw_errors(frame: Axes, points: Points, shown: ValueRange, colour: str, gid: str) -> None:
    """Error bars of values within the axis, and bars of intervals; a limit has none."""
    above, below = shown.beyond(points.measured)
    known = (np.array(points.limit) == "") & ~(above | below)
    between = (np.array(points.limit) == "between") & ~(above | below)
    if between.any():
        draw_intervals(frame, points.x[between], points.low[between], points.high[between], colour, gid)
    frame.errorbar(
        points.x[known],
        points.measured[known],
        points.error[known],
        fmt="none",
        ecolor=colour,
        elinewidth=0.9,
        gid=gid,
    )


def marks(points: Points, names: Sequence[str], shown: ValueRange) -> Iterator[tuple[int, str, Bools]]:
    """Measured values by set of the other conditions and by kind of mark, in the order of drawing."""
    for number, name in enumerate(names):
        own = np.array([each == name for each in points.series], dtype=np.bool_)
        for mark, chosen in kinds(points.measured, points.limit, shown):
            if (own & chosen).any():
                yield number, mark, own & chosen


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
        for name in ("x", "measured", "error", "model", "band", "low", "high")
    ]
    x, measured, error, model, band, low, high = columns
    limit = [each for part in parts for each in part.limit]
    ordered = (tuple(column[k] for k in order) for column in (series, limit))
    names, limits = ordered
    return Points(x, names, measured, error, model, band, (), limits, low, high)


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
        for number, mark, own in marks(points, names, panel.shown):
            places = np.array(points.rows)[own].tolist()
            texts[f"{kind}#{number}{mark}"] = [row_text(panel, kind, rows, place) for place in places]
    return texts


def row_text(panel: Panel, kind: str, rows: Record, place: int) -> str:
    """Everything about one measured value: conditions, table row, source, what every model says."""
    value, sd = rows["measured"][place], rows["measured_sd"][place]
    behind = panel.table.behind(rows, place)
    unit, limit = panel.units.value_unit(panel.observable), limit_of(rows, place)
    size = with_unit(short(float(panel.values([value])[0]), 3), unit)
    error = f", 90 % interval ± {short(HALF_WIDTH * float(panel.values([sd])[0]))}" if sd else ""
    words = f"measured: {limit} {size}" if limit else f"measured {size}{error}"
    if limit == "between":
        low, high = (panel.values(interval_ends(rows, end))[place] for end in ("low", "high"))
        words = f"measured: between {short(float(low), 3)} and {with_unit(short(float(high), 3), unit)}"
    lines = [words + (" (held out)" if kind == "held" else "")]
    lines += [
        panel.table.condition(name).words(column[place])
        for name, column in rows["conditions"].items()
        if column[place] is not None
    ]
    for layer in panel.layers:
        table = layer.held if kind == "held" else layer.fitted
        if table and place < len(table["predicted"]) and table["predicted"][place] is not None:
            shift = (table.get("shift") or {place: 0.0})[place] or 0.0
            modelled = float(panel.values([table["predicted"][place] + shift])[0])
            lines.append(f"{layer.label}: {short(modelled, 3)}")
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
    gaps, shown = residual_points(panel)
    for layer in gaps:
        colour, points = COLOURS[layer], gaps[layer]
        draw_errors(frame, points, shown, colour, f"layer:{layer}")
        for _, mark, own in marks(points, [""], shown):
            y = edge_of(shown, mark, points.measured[own])
            style = DOTS | {"marker": "o", "ms": 4.0, "color": colour, "mfc": colour}
            draw_marks(frame, points.x[own], y, mark, style, f"rows:{layer}#{mark}")
    scale_axis(frame, "x", next(iter(gaps.values())).x)
    show_values(frame, shown)
    frame.set_xlabel(panel.condition.label)
    unit = panel.units.value_unit(panel.observable)
    noun = words_of(panel.observable).noun
    frame.set_title(f"{noun},\n{heading('measured less model', unit)}", loc="left")
    return figure


def residual_points(panel: Panel) -> tuple[dict[str, Points], ValueRange]:
    """Measured less model of the models before and after, and the visible part of the axis.

    A limit less the model is a limit of the residual. Errors are those on which p rests.
    """
    found = {}
    for layer in panel.layers[:2]:
        points = points_of(panel, layer.fitted)
        error = HALF_WIDTH * np.nan_to_num(panel.values(errors_of(layer.fitted))[list(points.rows)])
        gap = points.measured - points.model
        ends = {"low": points.low - points.model, "high": points.high - points.model}
        found[layer.key] = replace(points, measured=gap, error=error, series=("",) * gap.size, **ends)
    gap, error, low, high = (
        np.concatenate([getattr(points, name) for points in found.values()])
        for name in ("measured", "error", "low", "high")
    )
    return found, value_range(np.append(gap, 0.0), np.concatenate([gap - error, gap + error, low, high]))


def errors_of(rows: Record) -> Sequence[float | None]:
    """Standard deviations of measured less model; those of the measured means in an answer without them."""
    found: Sequence[float | None] = rows.get("residual_error") or rows["measured_sd"]
    return found


def residual_texts(panel: Panel) -> dict[str, list[str]]:
    """Texts of the points of a residual figure."""
    rows = {layer.key: layer.fitted for layer in panel.layers[:2]}
    gaps, shown = residual_points(panel)
    return {
        f"{key}#{mark}": [
            row_text(panel, "fitted", table, place) for place in np.array(gaps[key].rows)[own].tolist()
        ]
        for key, table in rows.items()
        for _, mark, own in marks(gaps[key], [""], shown)
    }
