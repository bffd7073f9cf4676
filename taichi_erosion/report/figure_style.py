"""Style, panels and pictures of every page's figures."""

import io
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import ceil, nan
from typing import Any, Literal

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter, NullLocator
from numpy.typing import NDArray

from taichi_erosion.report.svg import inline_svg

Floats = NDArray[np.float64]

DOTS_PER_INCH = 150
INK, SOFT, PAPER = "#1c2227", "#5b6670", "#fdfefe"
BEFORE, AFTER, CONTROL, OTHER = "#b4553d", "#1f4e79", "#8a93a0", "#4c8a6a"
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
WIDE_RANGE = 20.0  # largest over smallest value from which an axis is logarithmic
TICKS = 5  # most intervals on an axis


@dataclass(frozen=True)
class Picture:
    """Figure of a page: an SVG element, or the data address of a picture file, and its description."""

    description: str
    address: str = ""
    svg: str = ""
    narrow: str = ""  # the same for a phone, where it is drawn anew
    figure: Figure | None = field(default=None, compare=False)  # source of `svg`; None for a picture file


@contextmanager
def page_style() -> Iterator[None]:
    """Style of the figures of a page."""
    with mpl.rc_context(STYLE):
        yield


def picture(
    figure: Figure, description: str, name: str, texts: Mapping[str, Sequence[str]] | None = None
) -> Picture:
    """Figure as SVG element; equal figures give equal texts."""
    svg = inline_svg(figure, name, texts or {})
    plt.close(figure)
    return Picture(description, svg=svg, figure=figure)


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
    return Picture(description, svg=wide.svg, narrow=narrow.svg, figure=wide.figure)


def detached(draw: Callable[[], Figure]) -> Figure:
    """Figure in the style of a page that no window and no notebook shows by itself."""
    with page_style():
        figure = draw()
    plt.close(figure)
    return figure


def raster(drawn: Picture) -> bytes:
    """Figure as PNG."""
    assert drawn.figure is not None
    page = io.BytesIO()
    drawn.figure.savefig(page, format="png", dpi=DOTS_PER_INCH)
    return page.getvalue()


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


def numbers(values: Sequence[float | None]) -> Floats:
    """Array of a document's numbers; NaN for None."""
    return np.array([nan if value is None else value for value in values], dtype=np.float64)


def is_wide(values: Floats) -> bool:
    """Whether values span so many factors that their axis is logarithmic."""
    known = values[np.isfinite(values)]
    return bool(known.size and known.min() > 0.0 and known.max() > WIDE_RANGE * known.min())


def scale_axis(
    frame: Axes, which: Literal["x", "y"], values: Floats, logarithmic: bool | None = None
) -> None:
    """Logarithmic axis with plain numbers for values of a wide range or where told so, else a linear one."""
    axis = frame.xaxis if which == "x" else frame.yaxis
    if not (is_wide(values) if logarithmic is None else logarithmic):
        axis.set_major_locator(MaxNLocator(TICKS))
        return
    frame.set(**{f"{which}scale": "log"})
    decades = np.log10(np.nanmax(values) / np.nanmin(values))
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
