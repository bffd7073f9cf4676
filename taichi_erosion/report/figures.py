"""Figures of pages: SVG pictures of an evidence study, and the panels and style of every page's figures."""

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil, isfinite, nan
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

Record = Mapping[str, Any]
Floats = NDArray[np.float64]

COLUMNS = 3  # panels side by side
PANEL = (3.0, 2.7)  # in
DOTS_PER_INCH = 150
STYLE: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "evidence",
}
BEFORE, AFTER, CONTROL, FINE = "#b4553d", "#1f4e79", "#9aa3ab", "#d9dde1"
WIDE_RANGE = 20.0  # largest over smallest value from which an axis is logarithmic
TICKS = 4  # most intervals on the axis of a condition


@dataclass(frozen=True)
class Picture:
    """Figure of a page: data address for an `img`, and a description for its caption and `alt` text."""

    address: str
    description: str
    figure: Figure | None = None  # source of `address`; None for a picture file


def picture(figure: Figure, description: str) -> Picture:
    """Figure as SVG data address; equal figures give equal bytes."""
    page = io.BytesIO()
    figure.savefig(page, format="svg", metadata={"Date": None})
    plt.close(figure)
    address = "data:image/svg+xml;base64," + base64.b64encode(page.getvalue()).decode()
    return Picture(address, description, figure)


def raster(drawn: Picture) -> bytes:
    """Figure as PNG."""
    assert drawn.figure is not None
    page = io.BytesIO()
    drawn.figure.savefig(page, format="png", dpi=DOTS_PER_INCH)
    return page.getvalue()


def panels(
    count: int, columns: int = COLUMNS, size: tuple[float, float] = PANEL, projection: str | None = None
) -> tuple[Figure, list[Any]]:
    """Figure of `count` panels of a size [in], `columns` in a row."""
    across, down = min(count, columns), ceil(count / columns)
    figure, frames = plt.subplots(
        down,
        across,
        figsize=(size[0] * across, size[1] * down),
        squeeze=False,
        layout="constrained",
        subplot_kw={"projection": projection},
    )
    for frame in frames.flat[count:]:
        frame.set_visible(False)
    return figure, list(frames.flat[:count])


def numbers(values: Sequence[float | None]) -> Floats:
    """Array of a document's numbers; NaN for None."""
    return np.array([nan if value is None else value for value in values], dtype=np.float64)


def of_observable(rows: Record, name: str, key: str) -> Floats:
    """Column `key` of one observable."""
    chosen = [place for place, observable in enumerate(rows["observable"]) if observable == name]
    return numbers(rows[key])[chosen]


def draw_agreement(rows: Record, units: Mapping[str, str]) -> Picture:
    """Measured against predicted values, both with their standard errors."""
    names = list(dict.fromkeys(rows["observable"]))
    with mpl.rc_context(STYLE):
        figure, frames = panels(len(names))
        for frame, name in zip(frames, names, strict=True):
            x, y = of_observable(rows, name, "predicted"), of_observable(rows, name, "measured")
            errors = of_observable(rows, name, "predicted_sd"), of_observable(rows, name, "measured_sd")
            dx, dy = (np.nan_to_num(error) for error in errors)
            frame.errorbar(x, y, dy, dx, fmt="o", ms=3.0, lw=0.8, color=AFTER)
            limits = [np.nanmin([x, y]), np.nanmax([x, y])]
            frame.plot(limits, limits, color=CONTROL, lw=0.8, zorder=0)
            frame.set(title=f"{name} [{units.get(name, '1')}]", xlabel="model", ylabel="measurement")
        return picture(
            figure, "Measured against predicted values with standard errors; the line marks agreement."
        )


def draw_residuals(before: Record, after: Record | None) -> Picture:
    """Residuals in standard deviations against every condition that varies."""
    axes = [name for name, column in before["conditions"].items() if len(set(column)) > 1]
    names = list(dict.fromkeys(before["observable"]))
    pairs = [(name, axis) for name in names for axis in axes if varies(before, name, axis)]
    with mpl.rc_context(STYLE):
        figure, frames = panels(max(len(pairs), 1))
        for frame, (name, axis) in zip(frames, pairs, strict=False):
            frame.axhspan(-2.0, 2.0, color=FINE, lw=0.0)
            draw_against(frame, before, name, axis, BEFORE)
            if after is not None:
                draw_against(frame, after, name, axis, AFTER)
            frame.set(title=name, xlabel=axis, ylabel="residual [standard deviations]")
        drawn = "before (red) and after (blue) the effect" if after is not None else "of the calibrated model"
        return picture(
            figure, f"Residuals {drawn} against every condition; the band is two standard deviations."
        )


def varies(rows: Record, name: str, axis: str) -> bool:
    """Whether a condition varies between the rows of an observable."""
    values = condition(rows, name, axis)
    return len({value for value in values if isfinite(value)}) > 1


def condition(rows: Record, name: str, axis: str) -> Floats:
    """One condition of the rows of an observable."""
    return of_observable({**rows, axis: rows["conditions"][axis]}, name, axis)


def draw_against(frame: Axes, rows: Record, name: str, axis: str, colour: str) -> None:
    """Residuals of one observable along one condition."""
    x = condition(rows, name, axis)
    known = x[np.isfinite(x)]
    if known.size and known.min() > 0.0 and known.max() > WIDE_RANGE * known.min():
        frame.set_xscale("log")
    else:
        frame.xaxis.set_major_locator(MaxNLocator(TICKS))
    frame.plot(x, of_observable(rows, name, "residual"), "o", ms=3.0, color=colour)


def draw_adoptions(adoptions: Sequence[Record]) -> Picture:
    """Misfit per row of fitted and held-out rows after each adopted effect."""
    with mpl.rc_context(STYLE):
        figure, frame = plt.subplots(figsize=(6.2, 2.8), layout="constrained")
        labels = [" + ".join(step["effects"]) or "without effects" for step in adoptions]
        for key, colour, label in (
            ("chi2_fitted", CONTROL, "fitted rows"),
            ("chi2_held_out", AFTER, "held-out rows"),
        ):
            frame.plot(labels, numbers([step[key] for step in adoptions]), "o-", color=colour, label=label)
        frame.axhline(1.0, color=FINE, lw=1.0, zorder=0)
        frame.set(ylabel="chi2 per row", yscale="log")
        frame.legend(frameon=False)
        return picture(figure, "Misfit per row after each adopted effect; noise alone gives 1.")


def draw_posterior(probabilities: Mapping[str, float | None], most: int = 12) -> Picture:
    """Posterior probabilities of the answers, in order."""
    ranked = sorted(probabilities.items(), key=lambda item: -(item[1] or 0.0))[:most]
    with mpl.rc_context(STYLE):
        figure, frame = plt.subplots(figsize=(6.2, 0.4 + 0.26 * len(ranked)), layout="constrained")
        colours = [CONTROL if name in ("none", "outside_library") else AFTER for name, _ in ranked]
        answers = {"none": "no missing effect", "outside_library": "missing effect, not in the list"}
        labels = [answers.get(name, name) for name, _ in ranked]
        frame.barh(labels[::-1], numbers([p for _, p in ranked])[::-1], color=colours[::-1])
        frame.set(xlim=(0.0, 1.0), xlabel="probability")
        return picture(
            figure,
            "Posterior probability of each answer; some are 'no missing effect' and 'not in the list'.",
        )


def draw_vault(adoption: Record) -> Picture:
    """Misfit of the held-out rows before and after adoption, with two control effects."""
    labels = {
        "base": "before",
        "added": f"with {adoption['effect']}",
        "best_wrong": "control: best other",
        "random_wrong": "control: at random",
    }
    there = {key: label for key, label in labels.items() if adoption[key] is not None}
    with mpl.rc_context(STYLE):
        figure, frame = plt.subplots(figsize=(6.2, 2.6), layout="constrained")
        values = numbers([adoption[key]["vault_chi2"] for key in there])
        colours = {"base": BEFORE, "added": AFTER}
        frame.bar(list(there.values()), values, color=[colours.get(key, CONTROL) for key in there])
        frame.axhline(1.0, color="black", lw=0.6)
        wide = np.nanmin(values) > 0.0 and np.nanmax(values) > WIDE_RANGE * np.nanmin(values)
        frame.set(ylabel="chi2 per held-out row", yscale="log" if wide else "linear")
        return picture(figure, "Misfit per held-out row before and after adoption, with two control effects.")
