"""Figures of every page: style, panels, and SVG elements with colours by role and texts to hover.

The markers of an artist whose `gid` is `rows:NAME` get the texts of this name, in order.
"""

import io
import re
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import ceil
from typing import Any, Literal
from xml.etree import ElementTree as ET

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator

from taichi_erosion.core.setup import Floats

DOTS_PER_INCH = 150
INK, SOFT, PAPER = "#1c2227", "#5b6670", "#fdfefe"
BEFORE, AFTER, CONTROL = "#b4553d", "#1f4e79", "#8a93a0"
ROLES = {  # colour of a figure -> variable of the page's style sheet, which has others for a dark page
    **{INK: "--ink", PAPER: "--paper", SOFT: "--soft", "#d9dde1": "--line"},
    **{BEFORE: "--before", AFTER: "--after", CONTROL: "--control"},
}
STYLE: dict[Any, Any] = {
    **dict.fromkeys(("font.size", "axes.titlesize"), 9.0),
    **dict.fromkeys(("axes.spines.top", "axes.spines.right", "legend.frameon"), False),
    **{"svg.fonttype": "none", "svg.hashsalt": "evidence"},
    **dict.fromkeys(("text.color", "axes.labelcolor", "xtick.labelcolor", "ytick.labelcolor"), INK),
    **dict.fromkeys(("axes.edgecolor", "xtick.color", "ytick.color"), SOFT),
}
WIDE, NARROW = 7.4, 3.5  # width of a figure over the whole page, and on a phone [in]
PANEL = (3.6, 2.9)  # in
CURVE = (6.4, 3.6)  # in, of a number over a live session
WIDE_RANGE = 20.0  # largest over smallest value from which an axis is logarithmic
TICKS = 5  # most intervals on an axis
SVG = "http://www.w3.org/2000/svg"
LARGEST_SCALE = 1.65  # px of the page over points of the figure
UNDATED = dict.fromkeys(("Creator", "Date", "Format", "Type"))  # metadata of an SVG, of which none is written
NAME = re.compile(r'(\bid="|href="#|url\(#)([^":)]+)(?=["\)])')  # identifiers, but those of rows

page_style = partial(mpl.rc_context, STYLE)  # context and decorator: the style of the figures of a page


@dataclass(frozen=True)
class Picture:
    """Figure of a page: an SVG element, or the data address of a picture file, and its description."""

    description: str
    address: str = ""
    svg: str = ""
    narrow: str = ""  # the same for a phone, where it is drawn anew
    name: str = ""
    figure: Figure | None = field(default=None, compare=False)  # source of `svg`; None for a picture file


@page_style()
def responsive_picture(
    draw: Callable[[float], Figure],
    description: str,
    name: str,
    texts: Mapping[str, Sequence[str]] | None = None,
) -> Picture:
    """Figure drawn for the whole width of a page and for that of a phone; equal figures give equal texts."""
    figure = draw(WIDE)
    narrow = inline_svg(draw(NARROW), f"{name}-narrow", texts or {})
    return Picture(description, "", inline_svg(figure, name, texts or {}), narrow, name, figure)


@page_style()
def figure_with_key(picture: Picture) -> Figure:
    """Figure of a picture that stands alone, with the key that a page has beside it."""
    assert picture.figure is not None
    handles, labels = picture.figure.axes[0].get_legend_handles_labels()
    if labels:
        picture.figure.legend(handles, labels, loc="outside upper left", ncols=len(labels), fontsize=8.0)
    return picture.figure


@page_style()
def curve_figure(time: Sequence[float], value: Sequence[float], name: str) -> Figure:
    """Figure of a number over the simulated time [s] of a live session."""
    figure, frame = single_panel_figure(*CURVE)
    frame.plot(time, value, lw=1.2)
    frame.set(xlabel="simulated time [s]", ylabel=name)
    return figure


@page_style()
def sweep_figure(path: str, curves: Mapping[str, Sequence[tuple[str, float, float]]]) -> Figure:
    """Curves of measures over an entry, one panel each: (entry, mean, sd); words stand evenly spaced."""
    figure, frames = panels(len(curves), 2)
    for frame, (name, points) in zip(frames, curves.items(), strict=True):
        entries, value, sd = zip(*points, strict=True)
        try:
            at = [float(entry) for entry in entries]
        except ValueError:
            at = list(entries)
        frame.errorbar(at, value, yerr=np.nan_to_num(sd), marker="o", ms=4, lw=1.2, capsize=3)
        frame.set(xlabel=path, ylabel=name)
    return figure


@page_style()
def as_png(figure: Figure, dots_per_inch: int = DOTS_PER_INCH) -> bytes:
    """Figure as PNG; equal figures give equal bytes."""
    page = io.BytesIO()
    figure.savefig(page, format="png", dpi=dots_per_inch, metadata={"Software": None})
    return page.getvalue()


def inline_svg(figure: Figure, name: str, texts: Mapping[str, Sequence[str]]) -> str:
    """Figure as an SVG element; `name` keeps its identifiers apart from those of other figures."""
    page = io.StringIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # the reader's browser draws the letters
        figure.savefig(page, format="svg", transparent=True, metadata=UNDATED)
    text = NAME.sub(rf"\g<1>{name}-\g<2>", page.getvalue())
    for colour, role in ROLES.items():
        text = text.replace(colour, f"var({role})")
    for prefix, space in (("", SVG), ("xlink", "http://www.w3.org/1999/xlink")):
        ET.register_namespace(prefix, space)
    root = ET.fromstring(text)
    for child in root.findall(f"{{{SVG}}}defs"):  # a style of the figure is one of the whole page
        if child.find(f"{{{SVG}}}style") is not None:
            root.remove(child)
    for group in list(root.iter(f"{{{SVG}}}g")):
        rows = texts.get(group.get("id", "").removeprefix("rows:"), ())
        for point, row in zip(list(group.iter(f"{{{SVG}}}use")), rows, strict=False):
            point.set("class", "row")
            ET.SubElement(point, f"{{{SVG}}}title").text = row
    root.set("role", "img")
    root.set("style", f"max-width: {LARGEST_SCALE * 72.0 * figure.get_figwidth():.0f}px")
    return ET.tostring(root, encoding="unicode")


def panels(count: int, columns: int, size: tuple[float, float] = PANEL) -> tuple[Figure, list[Any]]:
    """Figure of `count` panels of a size [in], `columns` in a row."""
    across, down = min(count, columns), ceil(count / columns)
    figure = Figure(figsize=(size[0] * across, size[1] * down), layout="constrained")
    return figure, [figure.add_subplot(down, across, k + 1) for k in range(count)]


def single_panel_figure(width: float, height: float) -> tuple[Figure, Axes]:
    """Figure of one panel [in]."""
    figure, (frame,) = panels(1, 1, (width, height))
    return figure, frame


def set_axis_scale(frame: Axes, which: Literal["x", "y"], values: Floats) -> None:
    """Logarithmic axis with plain numbers for values of a wide range, else a linear one."""
    axis = frame.xaxis if which == "x" else frame.yaxis
    finite = values[np.isfinite(values)]
    if not (finite.size and finite.min() > 0.0 and finite.max() > WIDE_RANGE * finite.min()):
        axis.set_major_locator(MaxNLocator(TICKS))
        return
    frame.set(**{f"{which}scale": "log"})
    decades = np.log10(finite.max() / finite.min())
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
