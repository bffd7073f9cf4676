"""Photograph of a heap with what was detected: outline, base line, fitted flanks and their angles."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from taichi_erosion.core.files import marked_png, write_atomic
from taichi_erosion.measures.photograph import read_grey
from taichi_erosion.report.figure_style import raster

WIDTH = 1280  # px of the picture
DOTS_PER_INCH = 160
OUTLINE, BASE, FLANK = "#35c0ff", "#ffd23f", "#ff5c39"


def draw_detection(photograph: Path, record: Mapping[str, Any], to: Path) -> Path:
    """Write the photograph with the detection of `measure_photograph` over it. Raises BadInput."""
    grey = read_grey(photograph)
    details = record["details"]
    rows, columns = grey.shape
    width = WIDTH / DOTS_PER_INCH
    figure = Figure(figsize=(width, width * rows / columns))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(grey, cmap="gray", vmin=0.0, vmax=1.0, extent=(0.0, columns, rows, 0.0))
    picture = details["drawing"]
    axes.plot(*np.transpose(picture["outline"]), color=OUTLINE, lw=1.2, label="outline")
    base = f"base line, tilt {details['tilt']:.1f} deg"
    axes.plot(*np.transpose(picture["base"]), color=BASE, lw=1.4, ls="--", label=base)
    for side in ("left", "right"):
        if side in picture:
            label = f"{side} flank, {details[side]:.1f} deg"
            axes.plot(*np.transpose(picture[side]), color=FLANK, lw=2.6, label=label)
    left, top, right, bottom = details["crop"]
    if (left, top, right, bottom) != (0, 0, columns, rows):
        axes.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, ls=":", color="white"))
    axes.set(xlim=(0.0, columns), ylim=(rows, 0.0))
    axes.axis("off")
    sd = "" if record["sd"] is None else f" \N{PLUS-MINUS SIGN} {record['sd']:.1f}"
    title = f"{record['value']:.1f}{sd} deg"
    axes.legend(title=title, loc="upper right", fontsize=8, title_fontsize=10, framealpha=0.85)
    return write_atomic(to, marked_png(to, photograph, raster(figure, DOTS_PER_INCH)))
