"""Curve of a number over time, drawn with characters."""

from collections.abc import Sequence

import numpy as np

WIDTH, HEIGHT = 64, 12  # characters of the curve
MARK, EMPTY = "*", " "


def text_plot(time: Sequence[float], value: Sequence[float], name: str) -> str:
    """Curve with its range on the left and the time [s] below; values that are not finite leave gaps."""
    t, y = np.asarray(time, dtype=float), np.asarray(value, dtype=float)
    known = np.isfinite(y)
    if not known.any():
        return f"{name}: no value yet"
    t, y = t[known], y[known]
    low, high = float(y.min()), float(y.max())
    across = np.zeros(t.size) if np.ptp(t) == 0.0 else (t - t[0]) / np.ptp(t)
    up = np.full(t.size, 0.5) if high == low else (y - low) / (high - low)
    cells = [[EMPTY] * WIDTH for _ in range(HEIGHT)]
    for column, row in zip((across * (WIDTH - 1)).round(), (up * (HEIGHT - 1)).round(), strict=True):
        cells[HEIGHT - 1 - int(row)][int(column)] = MARK
    labels = [f"{high:.4g}", *[""] * (HEIGHT - 2), f"{low:.4g}"]
    margin = max(map(len, labels))
    lines = [f"{label:>{margin}} |{''.join(row).rstrip()}" for label, row in zip(labels, cells, strict=True)]
    begin, end = f"{t[0]:.4g}", f"{t[-1]:.4g} s"
    gap = max(WIDTH - len(begin) - len(end), 1)
    axis = f"{'':>{margin}} +{'-' * WIDTH}\n{'':>{margin}}  {begin}{'':>{gap}}{end}"
    return "\n".join([name, *lines, axis])
