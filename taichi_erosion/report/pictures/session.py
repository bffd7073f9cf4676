"""Curve of a number over a live session, as a figure and as PNG."""

from collections.abc import Sequence
from io import BytesIO

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from taichi_erosion.report.figure_style import STYLE

SIZE = (6.4, 3.6)  # in
DOTS_PER_INCH = 160


def curve_figure(time: Sequence[float], value: Sequence[float], name: str) -> Figure:
    """Figure of a number over the simulated time [s]."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=SIZE, layout="constrained")
        axes.plot(time, value, lw=1.2)
        axes.set(xlabel="simulated time [s]", ylabel=name)
    plt.close(figure)  # shown by its owner, not by pyplot
    return figure


def curve_png(time: Sequence[float], value: Sequence[float], name: str) -> bytes:
    """PNG of a number over the simulated time [s]."""
    page = BytesIO()
    with plt.rc_context(STYLE):
        curve_figure(time, value, name).savefig(
            page, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None}
        )
    return page.getvalue()
