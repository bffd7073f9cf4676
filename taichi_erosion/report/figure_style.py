"""Figures of every page: style, panels, and SVG elements with colours by role and texts to hover.

An artist whose `gid` is `layer:NAME` becomes an element with `data-layer="NAME"`, which a page can switch
off. One whose `gid` is `rows:NAME` is a layer too, and its markers get the texts of the figure, in order.
"""

import io
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from math import ceil
from typing import Any, Literal
from xml.etree import ElementTree as ET

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

Floats = NDArray[np.float64]

DOTS_PER_INCH = 150
INK, SOFT, PAPER = "#1c2227", "#5b6670", "#fdfefe"
BEFORE, AFTER, CONTROL = "#b4553d", "#1f4e79", "#8a93a0"
ROLES = {  # colour of a figure -> variable of the page's style sheet, which has others for a dark page
    **{INK: "--ink", PAPER: "--paper", SOFT: "--soft", "#d9dde1": "--line"},
    **{BEFORE: "--before", AFTER: "--after", CONTROL: "--control"},
}
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "evidence",
    "text.color": INK,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "legend.frameon": False,
}
WIDE, NARROW = 7.4, 3.5  # width of a figure over the whole page, and on a phone [in]
PANEL = (3.6, 2.9)  # in
CURVE = (6.4, 3.6)  # in, of a number over a live session
WIDE_RANGE = 20.0  # largest over smallest value from which an axis is logarithmic
TICKS = 5  # most intervals on an axis
SVG = "http://www.w3.org/2000/svg"
LARGEST_SCALE = 1.65  # px of the page over points of the figure
FONT = re.compile(r"font(?:-family)?: ?(\d+(?:\.\d+)?px)?[^;\"]*DejaVu[^;\"]*")
NAME = re.compile(r'(\bid="|href="#|url\(#)([^":)]+)(?=["\)])')  # identifiers, but those of layers


@dataclass(frozen=True)
class Picture:
    """Figure of a page: an SVG element, or the data address of a picture file, and its description."""

    description: str
    address: str = ""
    svg: str = ""
    narrow: str = ""  # the same for a phone, where it is drawn anew
    name: str = ""
    figure: Figure | None = field(default=None, compare=False)  # source of `svg`; None for a picture file


def page_style() -> AbstractContextManager[None]:
    """Style of the figures of a page."""
    return mpl.rc_context(STYLE)


def picture(
    figure: Figure, description: str, name: str, texts: Mapping[str, Sequence[str]] | None = None
) -> Picture:
    """Figure as SVG element; equal figures give equal texts."""
    svg = inline_svg(figure, name, texts or {})
    plt.close(figure)
    return Picture(description, svg=svg, name=name, figure=figure)


def responsive(
    draw: Callable[[float], Figure],
    description: str,
    name: str,
    texts: Mapping[str, Sequence[str]] | None = None,
) -> Picture:
    """Figure drawn for the whole width of a page and for that of a phone."""
    with page_style():
        wide = picture(draw(WIDE), description, name, texts)
        narrow = picture(draw(NARROW), description, f"{name}-narrow", texts)
    return replace(wide, narrow=narrow.svg)


def with_key(found: Picture) -> Figure:
    """Figure of a picture that stands alone, with the key that a page has beside it."""
    assert found.figure is not None
    handles, labels = found.figure.axes[0].get_legend_handles_labels()
    if labels:
        with page_style():
            found.figure.legend(handles, labels, loc="outside upper left", ncols=len(labels), fontsize=8.0)
    return found.figure


def curve_figure(time: Sequence[float], value: Sequence[float], name: str) -> Figure:
    """Figure of a number over the simulated time [s] of a live session."""
    with page_style():
        figure, frame = single(*CURVE)
        frame.plot(time, value, lw=1.2)
        frame.set(xlabel="simulated time [s]", ylabel=name)
    plt.close(figure)  # no window and no notebook shows it by itself
    return figure


def raster(figure: Figure) -> bytes:
    """Figure as PNG."""
    page = io.BytesIO()
    with page_style():
        figure.savefig(page, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
    return page.getvalue()


def inline_svg(figure: Figure, name: str, texts: Mapping[str, Sequence[str]]) -> str:
    """Figure as an SVG element; `name` keeps its identifiers apart from those of other figures."""
    page = io.StringIO()
    figure.savefig(page, format="svg", transparent=True, metadata={"Date": None})
    text = NAME.sub(rf"\g<1>{name}-\g<2>", FONT.sub(page_font, page.getvalue()))
    for colour, role in ROLES.items():
        text = text.replace(colour, f"var({role})")
    for prefix, space in (("", SVG), ("xlink", "http://www.w3.org/1999/xlink")):
        ET.register_namespace(prefix, space)
    root = ET.fromstring(text)
    for key in ("width", "height"):
        del root.attrib[key]
    for child in list(root):
        if child.tag == f"{{{SVG}}}metadata" or child.find(f"{{{SVG}}}style") is not None:
            root.remove(child)
    for group in list(root.iter(f"{{{SVG}}}g")):
        mark(group, texts)
    root.set("role", "img")
    root.set("style", f"max-width: {LARGEST_SCALE * 72.0 * figure.get_figwidth():.0f}px")
    return ET.tostring(root, encoding="unicode")


def page_font(found: re.Match[str]) -> str:
    """Font of the page in the size of the figure."""
    return f"font: {found[1]} system-ui, sans-serif" if found[1] else "font-family: system-ui, sans-serif"


def mark(group: ET.Element, texts: Mapping[str, Sequence[str]]) -> None:
    """Turn the `gid` of an artist into a layer, and give its points their texts."""
    kind, _, layer = (group.get("id") or "").partition(":")
    if not layer:
        return
    del group.attrib["id"]
    group.set("data-layer", layer.partition("#")[0])
    if kind == "rows":
        for point, text in zip(list(group.iter(f"{{{SVG}}}use")), texts.get(layer, ()), strict=False):
            point.set("class", "row")
            ET.SubElement(point, f"{{{SVG}}}title").text = text


def panels(
    count: int, columns: int, size: tuple[float, float] = PANEL, projection: str | None = None
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


def single(width: float, height: float) -> tuple[Figure, Axes]:
    """Figure of one panel [in]."""
    return plt.subplots(figsize=(width, height), layout="constrained")


def scale_axis(frame: Axes, which: Literal["x", "y"], values: Floats) -> None:
    """Logarithmic axis with plain numbers for values of a wide range, else a linear one."""
    axis = frame.xaxis if which == "x" else frame.yaxis
    known = values[np.isfinite(values)]
    if not (known.size and known.min() > 0.0 and known.max() > WIDE_RANGE * known.min()):
        axis.set_major_locator(MaxNLocator(TICKS))
        return
    frame.set(**{f"{which}scale": "log"})
    decades = np.log10(known.max() / known.min())
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
