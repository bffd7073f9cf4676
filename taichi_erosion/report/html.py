"""Pages in HTML that need nothing beside themselves.

Figures that a page holds within itself: their style, their panels, their addresses.
"""

import base64
import io
from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, isfinite
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
from jinja2 import Environment, PackageLoader, StrictUndefined
from matplotlib.axes import Axes
from matplotlib.figure import Figure


def render(template: str, words: Mapping[str, Any]) -> str:
    """A page from its template; words are escaped, and one that is missing is an error."""
    environment = Environment(
        loader=PackageLoader("taichi_erosion.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
    )
    environment.filters |= {"figure": figure, "share": share}
    return environment.get_template(template).render(**words)


def figure(value: float | None) -> str:
    """A number to three significant digits."""
    return "-" if value is None or not isfinite(value) else f"{value:.3g}"


def share(value: float | None) -> str:
    """A share in percent."""
    if value is None:
        return "-"
    return f"{100.0 * value:.0f} %" if value >= 0.1 else f"{100.0 * value:.1f} %"


mpl.use("Agg")

COLUMNS = 3  # panels side by side
PANEL = (3.0, 2.7)  # in
DOTS_PER_INCH = 150
KINDS = {".png": "image/png", ".gif": "image/gif", ".jpg": "image/jpeg", ".svg": "image/svg+xml"}
STYLE: dict[Any, Any] = {
    "font.size": 8.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "evidence",
}


@dataclass(frozen=True)
class Picture:
    """A drawn figure: its address for an `img`, and what it shows for those who cannot see it."""

    address: str
    description: str
    figure: Figure | None = None  # what it was drawn from


def picture(figure: Figure, description: str) -> Picture:
    """The figure as a data address; equal figures give equal bytes."""
    page = io.BytesIO()
    figure.savefig(page, format="svg", metadata={"Date": None})
    plt.close(figure)
    address = "data:image/svg+xml;base64," + base64.b64encode(page.getvalue()).decode()
    return Picture(address, description, figure)


def raster(drawn: Picture) -> bytes:
    """The figure as PNG, for viewers that do not read SVG."""
    assert drawn.figure is not None
    page = io.BytesIO()
    drawn.figure.savefig(page, format="png", dpi=DOTS_PER_INCH)
    return page.getvalue()


def panels(count: int) -> tuple[Figure, list[Axes]]:
    """A figure of `count` panels."""
    columns = min(count, COLUMNS)
    size = (PANEL[0] * columns, PANEL[1] * ceil(count / columns))
    figure, frames = plt.subplots(
        ceil(count / columns), columns, figsize=size, squeeze=False, layout="constrained"
    )
    for frame in frames.flat[count:]:
        frame.set_visible(False)
    return figure, list(frames.flat[:count])


def address_of(file: Path) -> str:
    """A picture file as a data address, so that the page needs nothing beside itself."""
    return f"data:{KINDS[file.suffix.lower()]};base64," + base64.b64encode(file.read_bytes()).decode()
