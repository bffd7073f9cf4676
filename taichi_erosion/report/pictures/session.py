"""Curve of a number over a live session, as PNG."""

from collections.abc import Sequence
from io import BytesIO

import matplotlib.pyplot as plt

from taichi_erosion.report.figure_style import STYLE

SIZE = (6.4, 3.6)  # in
DOTS_PER_INCH = 160


def curve_png(time: Sequence[float], value: Sequence[float], name: str) -> bytes:
    """PNG of a number over the simulated time [s]."""
    with plt.rc_context(STYLE):
        figure, axes = plt.subplots(figsize=SIZE, layout="constrained")
        axes.plot(time, value, lw=1.2)
        axes.set(xlabel="simulated time [s]", ylabel=name)
        page = BytesIO()
        figure.savefig(page, format="png", dpi=DOTS_PER_INCH, metadata={"Software": None})
        plt.close(figure)
    return page.getvalue()
