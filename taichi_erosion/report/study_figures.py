"""Figures of an evidence study: measured values with the models, and residuals, along every condition.

The rows of a panel are a table with one row of measurements a row, in the units of the study's table:

    x             value of the condition
    series        the other conditions in words
    measured      measured value; error: half of its 90 % interval
    model         the model's value; band: half of its 90 % interval
    limit         "below" or "above" where the measured value is a limit, "between" two limits, else ""
    low, high     ends of the interval in which the value lies; NaN: of no interval
    row           place in the result
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from taichi_erosion.evidence.data.number_words import heading, plain, short, with_unit
from taichi_erosion.evidence.data.table_units import TableUnits
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
from taichi_erosion.report.pictures.measured_marks import (
    DOTS,
    EDGES,
    ValueRange,
    draw_edge_texts,
    draw_intervals,
    draw_marks,
    edge_of,
    value_range,
)
from taichi_erosion.report.results import Condition, Layer, MeasuredTable
from taichi_erosion.report.words import listed, words_of

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
    def sources(self) -> dict[str, Record]:
        """Measured rows, fitted and held out."""
        base = self.layers[0]
        return {"fitted": base.fitted} | ({"held": base.held} if base.held else {})

    @property
    def series(self) -> list[str]:
        """Sets of the other conditions."""
        return list(
            dict.fromkeys(pd.concat([points_of(self, rows) for rows in self.sources.values()])["series"])
        )

    @property
    def shown(self) -> ValueRange:
        """Visible part of the value axis: of measured values and of the models that are drawn at first."""
        values, ends = [], []
        for layer in self.layers:
            points = joined_points(self, layer)
            if layer.shown:
                values += [points["measured"], points["model"]]
                ends += [points["model"] - points["band"], points["model"] + points["band"]]
            known = points[points["limit"] == ""]
            ends += [known["measured"] - known["error"], known["measured"] + known["error"]]
            ends += [points["low"], points["high"]]
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
    table = pd.DataFrame(rows["conditions"], index=range(len(rows["observable"])))
    own = table.loc[np.array(rows["observable"]) == observable]
    counts = {str(name): int(own[name].nunique()) for name in own.columns}
    return [name for name in sorted(counts, key=lambda name: -counts[name]) if counts[name] > 1]


def points_of(panel: Panel, rows: Record) -> pd.DataFrame:
    """Rows of a panel in order of their condition; rows without a value there are left out."""
    count = len(rows["observable"])
    ends = {end: interval_ends(rows, end) for end in ("low", "high")}
    table = pd.DataFrame(
        {
            "series": [series_of(panel, rows, place) for place in range(count)],
            "measured": panel.values(rows["measured"]),
            "error": HALF_WIDTH * np.nan_to_num(panel.values(rows["measured_sd"])),
            "model": panel.values(rows["predicted"]),
            "band": HALF_WIDTH * np.nan_to_num(panel.values(rows.get("model_sd") or rows["predicted_sd"])),
            "limit": [limit_of(rows, place) for place in range(count)],
            **{end: panel.values(column) for end, column in ends.items()},
            "row": range(count),
        }
    )
    if rows.get("shift"):
        table["model"] += np.nan_to_num(panel.values(rows["shift"]))
    table = table[np.array(rows["observable"]) == panel.observable]
    if panel.condition is None:
        return table.assign(x=np.arange(1.0, len(table) + 1.0))
    column = rows["conditions"][panel.condition.name]
    x = [panel.condition.shown(column[place]) for place in table["row"]]
    return table.assign(x=x).dropna(subset="x").sort_values("x", kind="stable")


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


def joined_points(panel: Panel, layer: Layer) -> pd.DataFrame:
    """Fitted and held-out rows of a model in order of their condition."""
    parts = [points_of(panel, rows) for rows in (layer.fitted, layer.held) if rows]
    return pd.concat(parts).sort_values("x", kind="stable")


def draw_first(panel: Panel, width: float) -> Figure:
    """Measured values with their errors, and every model with its band, against one condition."""
    height = 3.5 if width == WIDE else 3.1 if width == NARROW else PANEL[1]
    points = {kind: points_of(panel, rows) for kind, rows in panel.sources.items()}
    names, shown = panel.series, panel.shown
    is_keyed = 1 < len(names) <= MOST_SERIES
    columns = 3 if width == WIDE else 1
    rows = ceil(len(names) / columns) if is_keyed else 0
    figure, frame = single(width, height + KEY_ROW * rows)
    for layer in panel.layers:
        draw_model(frame, panel, layer, names)
    if panel.condition is None:
        frame.set(xlabel="row", xticks=[])
    else:
        scale_axis(frame, "x", np.concatenate([each["x"] for each in points.values()]))
        frame.set_xlabel(panel.condition.label)
    show_values(frame, shown)
    frame.set_title(panel.value_label, loc="left")
    for kind, each in points.items():
        draw_measured(frame, each, shown, names, kind)
    if is_keyed:
        draw_series_key(figure, names, columns)
    return figure


def draw_with_key(panels: Sequence[Panel], width: float) -> Figure:
    """First figure that stands alone, with the key that a page has beside it.

    It is the first panel of its observable whose other conditions are few enough for lines.
    """
    own = [panel for panel in panels if panel.observable == panels[0].observable]
    panel = next((each for each in own if len(each.series) <= MOST_SERIES), own[0])
    figure = draw_first(panel, width)
    dot = {"marker": "o", "ls": "", "ms": 5.0, "color": INK}
    lines = [Line2D([], [], label="measured, fitted", **dot)]
    if panel.layers[0].held:
        lines.append(Line2D([], [], label="measured, held out", mfc=PAPER, **dot))
    lines += [Line2D([], [], lw=2.0, color=COLOURS[each.key], label=KEY[each.key]) for each in panel.layers]
    figure.legend(handles=lines, loc="outside upper left", ncols=3, fontsize=8.0)
    return figure


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


def draw_measured(
    frame: Axes, points: pd.DataFrame, shown: ValueRange, names: Sequence[str], kind: str
) -> None:
    """Measured values with error bars, filled where they were fitted; limits as arrows, intervals as bars."""
    draw_errors(frame, points, shown, INK, f"layer:{kind}")
    for number, mark, own in marks(points, names, shown):
        marker = MARKERS[number] if len(names) <= MOST_SERIES else MARKERS[0]
        style = DOTS | {"marker": marker, "mfc": INK if kind == "fitted" else PAPER}
        x, y = own["x"].to_numpy(), own["measured"].to_numpy()
        draw_marks(frame, x, edge_of(shown, mark, y), mark, style, f"rows:{kind}#{number}{mark}")
        if mark in EDGES:
            draw_edge_texts(frame, x, [plain(each) for each in y], mark)


def draw_errors(frame: Axes, points: pd.DataFrame, shown: ValueRange, colour: str, gid: str) -> None:
    """Error bars of values within the axis, and bars of intervals; a limit has none."""
    inside = points.loc[points["measured"].between(shown.low, shown.high)]
    between, known = (inside.loc[inside["limit"] == limit] for limit in ("between", ""))
    if len(between):
        x, low, high = (between[key].to_numpy() for key in ("x", "low", "high"))
        draw_intervals(frame, x, low, high, colour, gid)
    style: dict[str, Any] = {"fmt": "none", "ecolor": colour, "elinewidth": 0.9, "gid": gid}
    frame.errorbar(known["x"], known["measured"], known["error"], **style)


def marks(
    points: pd.DataFrame, names: Sequence[str], shown: ValueRange
) -> Iterator[tuple[int, str, pd.DataFrame]]:
    """Measured values by set of the other conditions and by kind of mark, in the order of drawing.

    A mark is that of a dot (""), of a limit, of an interval, or of a value beyond an edge of the axis.
    """
    values = points["measured"]
    mark = points["limit"].mask(values > shown.high, "high").mask(values < shown.low, "low")
    for number, name in enumerate(names):
        for kind in ("", "below", "above", "between", *EDGES):
            own = points.loc[(points["series"] == name) & (mark == kind)]
            if len(own):
                yield number, kind, own


def draw_model(frame: Axes, panel: Panel, layer: Layer, names: Sequence[str]) -> None:
    """One model: its values on fitted and held-out rows joined where the other conditions are the same."""
    points = joined_points(panel, layer)
    colour, gid = COLOURS[layer.key], f"layer:{layer.key}"
    if len(names) > MOST_SERIES or panel.condition is None:
        style: dict[str, Any] = {"fmt": "_", "ms": 9.0, "mew": 1.8, "lw": 0.8, "color": colour, "gid": gid}
        frame.errorbar(points["x"], points["model"], points["band"], **style)
        for line in frame.lines[-1:]:
            line.set_gid(gid)
        return
    for number, name in enumerate(names):
        own = points.loc[points["series"] == name].drop_duplicates(subset=["x"])
        if not len(own):
            continue
        marker = "" if len(own) > 1 else "_"
        dash = DASHES[number]
        frame.plot(own["x"], own["model"], marker=marker, ls=dash, lw=1.7, ms=9.0, color=colour, gid=gid)
        low, high = own["model"] - own["band"], own["model"] + own["band"]
        frame.fill_between(own["x"], low, high, color=colour, alpha=0.16, lw=0.0, gid=gid)


def first_pictures(panels: Sequence[Panel]) -> list[tuple[Panel, Picture]]:
    """The figure of the first screen: one picture for every observable and condition."""
    is_wide = len({panel.observable for panel in panels}) == 1
    found = []
    for number, panel in enumerate(panels):
        words = f"{panel.value_label} against {panel.condition.label if panel.condition else 'rows'}"
        name, texts = f"first{number}", hover_texts(panel)
        if is_wide:
            drawn = responsive(lambda width, panel=panel: draw_first(panel, width), words, name, texts)
        else:
            with page_style():
                drawn = picture(draw_first(panel, PANEL[0]), words, name, texts)
        found.append((panel, drawn))
    return found


def hover_texts(panel: Panel) -> dict[str, list[str]]:
    """Texts of the measured points, by layer and set of the other conditions, in the order of drawing."""
    names, shown = panel.series, panel.shown
    return {
        f"{kind}#{number}{mark}": [row_text(panel, kind, rows, place) for place in own["row"]]
        for kind, rows in panel.sources.items()
        for points in [points_of(panel, rows)]
        for number, mark, own in marks(points, names, shown)
    }


def row_text(panel: Panel, kind: str, rows: Record, place: int) -> str:
    """Everything about one measured value: conditions, table row, source, what every model says."""
    lines = [measured_words(panel, rows, place) + (" (held out)" if kind == "held" else "")]
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
    if behind := panel.table.behind(rows, place):
        word = "row" if len(behind) == 1 else "rows"
        repeats = sum(row.n or 1 for row in behind)
        numbered = listed([str(row.line) for row in behind])
        lines.append(f"{word} {numbered} of the table, repeats: {repeats}")
        lines += list(dict.fromkeys(row.source for row in behind if row.source))
    return "\n".join(lines)


def measured_words(panel: Panel, rows: Record, place: int) -> str:
    """`measured 25.3 cm/s, 90 % interval ± 1.2`; a limit and an interval as such."""
    unit, limit = panel.units.value_unit(panel.observable), limit_of(rows, place)
    columns = ("measured", "measured_sd", "low", "high")
    value, sd, low, high = panel.values([(rows.get(key) or {place: None})[place] for key in columns])
    if limit == "between":
        return f"measured: between {short(low, 3)} and {with_unit(short(high, 3), unit)}"
    size = with_unit(short(value, 3), unit)
    error = f", 90 % interval ± {short(HALF_WIDTH * sd)}" if sd > 0.0 else ""
    return f"measured: {limit} {size}" if limit else f"measured {size}{error}"


def residual_pictures(panels: Sequence[Panel]) -> list[Picture]:
    """Measured less model with the errors of both, before and after, against every condition."""
    found = []
    for number, panel in enumerate(panels):
        if panel.condition is None:
            continue
        gaps, shown = residual_points(panel)
        words = f"{panel.value_label}, measured less model, against {panel.condition.label}"
        rows = {layer.key: layer.fitted for layer in panel.layers[:2]}
        texts = {
            f"{key}#{mark}": [row_text(panel, "fitted", rows[key], place) for place in own["row"]]
            for key, points in gaps.items()
            for _, mark, own in marks(points, [""], shown)
        }
        with page_style():
            found.append(picture(draw_residuals(panel, gaps, shown), words, f"residual{number}", texts))
    return found


def draw_residuals(panel: Panel, gaps: Mapping[str, pd.DataFrame], shown: ValueRange) -> Figure:
    """Measured less model along one condition, with the 90 % interval of the difference."""
    figure, frame = single(*PANEL)
    assert panel.condition is not None
    frame.axhline(0.0, color=SOFT, lw=0.8)
    for layer, points in gaps.items():
        colour = COLOURS[layer]
        draw_errors(frame, points, shown, colour, f"layer:{layer}")
        for _, mark, own in marks(points, [""], shown):
            x, y = own["x"].to_numpy(), own["measured"].to_numpy()
            style = DOTS | {"marker": "o", "ms": 4.0, "color": colour, "mfc": colour}
            draw_marks(frame, x, edge_of(shown, mark, y), mark, style, f"rows:{layer}#{mark}")
    scale_axis(frame, "x", next(iter(gaps.values()))["x"].to_numpy())
    show_values(frame, shown)
    frame.set_xlabel(panel.condition.label)
    unit = panel.units.value_unit(panel.observable)
    noun = words_of(panel.observable).noun
    frame.set_title(f"{noun},\n{heading('measured less model', unit)}", loc="left")
    return figure


def residual_points(panel: Panel) -> tuple[dict[str, pd.DataFrame], ValueRange]:
    """Measured less model of the models before and after, and the visible part of the axis.

    A limit less the model is a limit of the residual. Errors are those on which p rests; those of the
    measured means in an answer without them.
    """
    found = {}
    for layer in panel.layers[:2]:
        points = points_of(panel, layer.fitted)
        stated = panel.values(layer.fitted.get("residual_error") or layer.fitted["measured_sd"])
        gaps = {key: points[key] - points["model"] for key in ("measured", "low", "high")}
        error = HALF_WIDTH * np.nan_to_num(stated[points["row"]])
        found[layer.key] = points.assign(**gaps, error=error, series="")
    every = pd.concat(found.values())
    gap, error = every["measured"], every["error"]
    ends = np.concatenate([gap - error, gap + error, every["low"], every["high"]])
    return found, value_range(np.append(gap, 0.0), ends)
