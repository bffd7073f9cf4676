"""Figures of an answer, each drawn from its record alone, for the width of a page and for that of a phone.

rows        measured beside predicted, and measured less predicted, along a condition
posterior   probabilities of explanations
strengths   strengths of candidates, and what could act unseen
numbers     calibrated numbers, each on its own axis
doses       doses of a mechanism with their law
curves      what something not in the list does, along a condition
ladder      misfit per row of fitted and held-out rows
"""

from collections.abc import Iterator
from textwrap import fill
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.path import Path as Outline

from taichi_erosion.core.setup import Floats
from taichi_erosion.evidence.answers.summary import ONE_SIDED
from taichi_erosion.evidence.record import CurvePart, Interval, MechanismPart, Record
from taichi_erosion.evidence.words import page_words
from taichi_erosion.evidence.words.part_words import LIKELY, sure_and_group, worst_places
from taichi_erosion.evidence.words.vocabulary import EXPLANATIONS, Vocabulary, in_words, interval
from taichi_erosion.report import figure_style
from taichi_erosion.report.figure_style import AFTER, BEFORE, CONTROL, INK, PANEL, PAPER, SOFT, WIDE, Picture
from taichi_erosion.tables.number_words import heading

MODELS = {"before": BEFORE, "after": AFTER}
ARROW = 22.0  # size of the mark of a limit [pt]; its length is half of that
MIDDLE = 3.0  # size of the dot in the middle of an interval [pt]
CAP = 5.0  # half length of the ends of an interval [pt]
ARROW_POINTS = [(-0.7, 0), (0.7, 0), (0, 0), (0, -1.5), (-0.5, -1.4), (0.5, -1.4), (0, -2.2), (-0.5, -1.4)]
BELOW = Outline(np.array(ARROW_POINTS), [1, 2, 1, 2, 1, 2, 2, 2])
ABOVE = Outline(-np.asarray(BELOW.vertices), BELOW.codes)
MARKS = {"marker": "o", "ms": 5.0, "ls": "", "mew": 1.1, "zorder": 5, "color": INK, "mfc": INK}
LETTERS = 6.0  # of a label per inch of the figure
LINE, MARGIN = 0.2, 0.55  # heights of a line of a chart, and of its axis [in]


def rank_failing_places(record: Record) -> list[tuple[str, str]]:
    """Every observable along the conditions where it fails, else along its worst one; the worst first."""
    conditions = record.rows.conditions
    ranked = sorted((place for place in record.where if place.axis in conditions), key=lambda place: place.p)
    fails = worst_places(record)
    pairs = []
    for place in ranked:
        if place in fails or place.observable not in {name for name, _ in pairs}:
            pairs.append((place.observable, place.axis))
    most = max(conditions, key=lambda name: np.unique(conditions[name]).size, default="")
    rest = [name for name in dict.fromkeys(record.rows.observable) if name not in {name for name, _ in pairs}]
    return [*pairs, *((name, most) for name in rest)]


def observable_points(record: Record, voc: Vocabulary, observable: str, axis: str) -> pd.DataFrame:
    """Rows of an observable in order of a condition, in the units of the table; without one in their own."""
    rows, scale = record.rows, voc.scale(observable)
    columns = {key: getattr(rows, key) for key in ("measured", "low", "high", "sd", *MODELS)}
    columns |= {f"gap_{key}": rows.residuals(columns[key]) for key in MODELS}
    table = pd.DataFrame({name: scale * column for name, column in columns.items()})
    table["limit"] = list(map(side_of_limit, rows.low, rows.high))
    x = rows.conditions.get(axis, np.arange(1.0, len(table) + 1.0))
    table["x"] = [voc.units.condition(axis, float(each)) for each in x]
    table["text"] = [row_text(record, voc, place) for place in range(len(table))]
    mask = table["x"].notna() & table["measured"].notna() & (np.array(rows.observable) == observable)
    return table.loc[mask].sort_values("x", kind="stable")


def model_labels(record: Record) -> tuple[str, str, str]:
    """What is drawn beside each other: measured, the model before and after; empty where nothing is added."""
    return page_words.MEASURED, page_words.BARE, page_words.added_effects_text(record)


def side_of_limit(low: float, high: float) -> str:
    """On which side of a measured value what was measured lies; empty for an ordinary value."""
    return "below" if low == -np.inf else "above" if high == np.inf else "between" if low < high else ""


def row_text(record: Record, voc: Vocabulary, place: int) -> str:
    """Everything about one row: `measured below 0.3 m/s`, predicted, conditions."""
    rows, units = record.rows, voc.units
    name = rows.observable[place]
    value, low, high = (float(column[place]) for column in (rows.measured, rows.low, rows.high))
    side = side_of_limit(low, high)
    error = ONE_SIDED * float(np.nan_to_num(rows.sd[place]))
    ends = Interval(value, value - error, value + error)
    value_text = interval(ends, 3, voc.scale(name), units.value_unit(name))
    if side == "between":
        value_text = f"between {' and '.join(units.value_text(name, end) for end in (low, high))}"
    elif side:
        value_text = f"{side} {units.value_text(name, value)}"
    models = {page_words.BARE: rows.before, page_words.added_effects_text(record): rows.after}
    words = [f"{key}: {units.value_text(name, float(of[place]))}" for key, of in models.items() if key]
    at = {axis: float(column[place]) for axis, column in rows.conditions.items()}
    return "\n".join([f"{page_words.MEASURED} {value_text}", *words, *units.conditions_text(at).split(", ")])


def observable_picture(record: Record, voc: Vocabulary, observable: str, axis: str, number: int) -> Picture:
    """Measured values with both models, and what they leave, along one condition."""
    points = observable_points(record, voc, observable, axis)
    labels = {name: label for name, label in zip(MODELS, model_labels(record)[1:], strict=True) if label}
    x, y, sd = (points[name].to_numpy() for name in ("x", "measured", "sd"))
    error = np.where(points["limit"] == "", ONE_SIDED * np.nan_to_num(sd), 0.0)
    plotted = points[["measured", *labels]].to_numpy().ravel()
    texts = {f"measured#{kind}": list(rows_of["text"]) for kind, rows_of in rows_by_mark(points)}
    texts |= {key: list(points["text"]) for key in labels}

    def draw(width: float) -> Figure:
        columns, share = (2, 1.0) if width == WIDE else (1, 0.7)  # lower on a phone: one above the other
        figure, (values, residuals) = figure_style.panels(2, columns, (width / columns, share * PANEL[1]))
        values.errorbar(x, y, error, fmt="none", ecolor=INK, elinewidth=0.9)
        draw_points(values, points)
        residuals.axhline(0.0, color=SOFT, lw=0.8)
        for name, label in labels.items():
            values.plot(x, points[name], "_", ms=9.0, mew=1.8, color=MODELS[name], label=label)
            residuals.plot(x, points[f"gap_{name}"], "o", ms=4.0, color=MODELS[name], gid=f"rows:{name}")
        for frame, title in ((values, in_words(observable)), (residuals, page_words.RESIDUAL)):
            figure_style.set_axis_scale(frame, "x", x)
            frame.set_xlabel(heading(in_words(axis or "row"), voc.units.condition_unit(axis)))
            frame.set_title(heading(title, voc.units.value_unit(observable)), loc="left")
        figure_style.set_axis_scale(values, "y", plotted)
        return figure

    words = {"observable": in_words(observable), "axis": in_words(axis or "rows")}
    caption = page_words.CAPTIONS["rows"].format(**words)
    caption += page_words.CAPTIONS["limits"] * bool((points["limit"] != "").any())
    return figure_style.responsive_picture(draw, caption, f"rows{number}", texts)


def rows_by_mark(points: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """Rows by their marks: limits and intervals, and last, above the others, ordinary values."""
    groups = sorted(points.groupby("limit"), key=lambda each: str(each[0]), reverse=True)
    yield from ((str(kind), rows_of) for kind, rows_of in groups)


def draw_points(frame: Axes, points: pd.DataFrame) -> None:
    """Measured values: dots, arrows for limits, bars with ends for intervals."""
    for kind, marked in rows_by_mark(points):
        x, y, low, high = (marked[name].to_numpy() for name in ("x", "measured", "low", "high"))
        style: dict[str, Any] = MARKS | {"label": "" if kind else page_words.MEASURED}
        if kind in ("below", "above"):
            style |= {"marker": BELOW if kind == "below" else ABOVE, "ms": ARROW, "mfc": PAPER}
        elif kind == "between":
            style |= {"ms": MIDDLE}
            ends: dict[str, Any] = {"elinewidth": 1.4, "capsize": CAP, "capthick": 1.4}
            frame.errorbar(x, 0.5 * (low + high), 0.5 * (high - low), fmt="none", ecolor=INK, **ends)
        frame.plot(x, y, gid=f"rows:measured#{kind}", **style)


def labelled_chart(width: float, labels: list[str]) -> tuple[Figure, Axes, Floats]:
    """Frame with a line for every label, the first on top, and their heights."""
    names = [fill(label, int(LETTERS * width)) for label in labels]
    lines = sum(name.count("\n") + 1 for name in names)
    figure, frame = figure_style.single_panel_figure(width, MARGIN + LINE * lines)
    at = np.arange(len(names), dtype=np.float64)[::-1]
    frame.set_yticks(at, names)
    frame.set_ylim(-0.6, len(names) - 0.4)
    return figure, frame, at


def draw_interval(frame: Axes, at: float, size: Interval, colour: str) -> None:
    ends = [[size.value - size.low], [size.high - size.value]]
    frame.errorbar(size.value, at, xerr=np.maximum(ends, 0.0), fmt="o", color=colour, ms=4.5, elinewidth=1.4)


def posterior_picture(record: Record) -> Picture:
    bars = list(page_words.explanations_by_probability(record))

    def draw(width: float) -> Figure:
        figure, frame, at = labelled_chart(width, [label for label, *_ in bars])
        colours = [CONTROL if label in EXPLANATIONS.values() else AFTER for label, *_ in bars]
        frame.barh(at, [p for _, p, _ in bars], 0.62, color=colours)
        for y, (_, p, text) in zip(at, bars, strict=True):
            frame.text(p + 0.01, y, text, va="center", fontsize=8.0)
        frame.set(xlim=(0.0, 1.15), xticks=[0.0, 0.5, 1.0], xlabel="probability")
        return figure

    return figure_style.responsive_picture(draw, page_words.CAPTIONS["posterior"], "posterior")


def strength_picture(record: Record) -> Picture:
    """Strengths of what acts, and of the others as far as these measurements see them."""
    acting_names = {name for names in sure_and_group(record) for name in names}
    parts = sorted(record.effects.items(), key=lambda item: -item[1].probability)

    def draw(width: float) -> Figure:
        figure, frame, at = labelled_chart(width, [name for name, _ in parts])
        frame.axvline(1.0, color=SOFT, lw=0.8, ls=":")
        for y, (name, part) in zip(at, parts, strict=True):
            if name in acting_names or part.probability > LIKELY:
                draw_interval(frame, y, part.strength_range, AFTER)
                continue
            is_excluded = part.status == "excluded"
            unseen = np.nan_to_num(part.limit if is_excluded else part.unseen_below, nan=part.most)
            end = min(float(unseen), part.most)
            frame.barh(y, end, 0.3, color=CONTROL, alpha=0.45)
            if is_excluded:
                frame.plot([end, end], [y - 0.3, y + 0.3], color=CONTROL, lw=1.8)
        frame.set_xlim(left=0.0)
        frame.set_xlabel("strength")
        return figure

    return figure_style.responsive_picture(draw, page_words.CAPTIONS["strengths"], "strengths")


def calibrated_number_picture(record: Record) -> Picture:
    """Calibrated numbers if nothing is missing, and with what is told."""
    is_told = bool(page_words.added_effects_text(record))

    def draw(width: float) -> Figure:
        figure, frames = figure_style.panels(len(record.parameters), 1, (width, 0.75))
        for frame, (path, part) in zip(frames, record.parameters.items(), strict=True):
            frame.axvline(part.start, color=SOFT, lw=0.8, ls=":")
            draw_interval(frame, 1.0, part.before, BEFORE)
            if is_told:
                draw_interval(frame, 0.0, part, AFTER)
            frame.set(ylim=(-0.7, 1.7) if is_told else (0.3, 1.7), yticks=[])
            frame.locator_params(axis="x", nbins=int(width))  # a label needs about an inch
            frame.spines["left"].set_visible(False)
            frame.set_title(path, loc="left")
        return figure

    return figure_style.responsive_picture(draw, page_words.CAPTIONS["numbers"], "numbers")


def draw_intervals(frame: Axes, x: Floats, sizes: Floats, zero: float, name: str, line: bool = True) -> None:
    """Medians with 90 % intervals, rows of `sizes`, along a condition; a `line` with its band joins them."""
    value, low, high = sizes
    frame.axhline(zero, color=SOFT, lw=0.8)
    if line:
        frame.plot(x, value, color=AFTER, lw=1.7)
        frame.fill_between(x, low, high, color=AFTER, alpha=0.16, lw=0.0)
    ends = np.maximum([value - low, high - value], 0.0)
    frame.errorbar(x, value, ends, fmt="none", ecolor=AFTER, elinewidth=0.9)
    style: dict[str, Any] = MARKS | {"color": AFTER, "mfc": AFTER}
    frame.plot(x, value, gid=f"rows:{name}", **style)
    figure_style.set_axis_scale(frame, "x", x)


def dose_pictures(mechanism: MechanismPart, voc: Vocabulary) -> Iterator[Picture]:
    """Doses of a law along each of its conditions, in the order of the first of them."""
    law, doses = mechanism.law, sorted(mechanism.doses, key=lambda dose: tuple(dose.conditions.values()))
    assert law is not None
    sizes = np.array([(dose.dose, dose.low, dose.high) for dose in doses]).T
    places = (voc.units.conditions_text(dose.conditions).split(", ") for dose in doses)
    words = (interval(Interval(*size)) for size in sizes.T.tolist())
    texts = {"doses": ["\n".join([size, *place]) for size, place in zip(words, places, strict=True)]}
    for number, axis in enumerate(law.conditions):
        x = np.array([voc.units.condition(axis, dose.conditions[axis]) for dose in doses])

        def draw(width: float, axis: str = axis, x: Floats = x) -> Figure:
            figure, frame = figure_style.single_panel_figure(width, PANEL[1])
            draw_intervals(frame, x, sizes, 0.0, "doses", len(law.conditions) == 1)
            frame.set_xlabel(heading(axis, voc.units.condition_unit(axis)))
            counts = voc.doses.get(law.mechanism.partition(":")[0], "strength")
            frame.set_title(f"{law.mechanism}: {counts}", loc="left")
            return figure

        caption = page_words.CAPTIONS["doses"].format(mechanism=law.mechanism, axis=axis)
        yield figure_style.responsive_picture(draw, caption, f"doses{number}", texts)


def curve_picture(curve: CurvePart, voc: Vocabulary, number: int) -> Picture:
    """What something not in the list does to an observable along a condition, in the units of the table."""
    name, axis, is_offset = curve.observable, curve.condition, curve.kind == "offset"
    change = "change" if is_offset else "factor"
    scale, unit = (voc.scale(name), voc.units.value_unit(name)) if is_offset else (1.0, "")
    x = np.array([voc.units.condition(axis, each.at) for each in curve.points])
    sizes = scale * np.array([(each.value, each.low, each.high) for each in curve.points]).T
    texts = [
        f"{interval(each, 2, scale, unit)}\n{voc.units.conditions_text({axis: each.at})}"
        for each in curve.points
    ]

    def draw(width: float) -> Figure:
        figure, frame = figure_style.single_panel_figure(width, PANEL[1])
        draw_intervals(frame, x, sizes, 0.0 if is_offset else 1.0, "curves")
        frame.set_xlabel(heading(in_words(axis), voc.units.condition_unit(axis)))
        frame.set_title(heading(f"{change} of the {in_words(name)}", unit), loc="left")
        return figure

    caption = page_words.CAPTIONS["curves"].format(observable=in_words(name), axis=in_words(axis))
    return figure_style.responsive_picture(draw, caption, f"curves{number}", {"curves": texts})


def misfit_before_after_picture(record: Record) -> Picture:
    """Misfit per row before and after, of rows that were fitted and of those that no fit has seen."""
    vault = record.vault
    before, after = (vault.chi2_per_row_before, vault.chi2_per_row_after) if vault else (np.nan, np.nan)
    steps = {page_words.BARE: (record.chi2_per_row_before, before)}
    steps[page_words.added_effects_text(record)] = record.chi2_per_row_after, after
    if vault and np.isfinite(vault.chi2_per_row_wrong_effect):
        steps[f"control: {vault.wrong_effect}"] = np.nan, vault.chi2_per_row_wrong_effect

    def draw(width: float) -> Figure:
        figure, frame, at = labelled_chart(width, list(steps))
        fitted, unseen = np.array(list(steps.values())).T
        frame.axvline(1.0, color=SOFT, lw=0.8, ls=":")
        for values, face in ((fitted, INK), (unseen, PAPER)):
            frame.plot(values, at, "o", color=INK, mfc=face, ms=6.0)
        figure_style.set_axis_scale(frame, "x", np.append(np.concatenate([fitted, unseen]), 1.0))
        frame.set_xlabel("misfit per row")
        return figure

    return figure_style.responsive_picture(draw, page_words.CAPTIONS["ladder"], "ladder")
