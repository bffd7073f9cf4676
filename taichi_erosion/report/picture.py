"""Figures that a page holds within itself: their style, their panels, their addresses."""

import base64
import io
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure

COLUMNS = 3  # panels side by side
PANEL = (3.0, 2.7)  # in
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


def picture(figure: Figure, description: str) -> Picture:
    """The figure as a data address; equal figures give equal bytes."""
    page = io.BytesIO()
    figure.savefig(page, format="svg", metadata={"Date": None})
    plt.close(figure)
    return Picture("data:image/svg+xml;base64," + base64.b64encode(page.getvalue()).decode(), description)


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
