"""How measured values are drawn: dots, arrows for limits, bars with ends for intervals.

Those far outside have marks at the edge of the axis.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.path import Path as Outline
from numpy.typing import NDArray

from taichi_erosion.report.figure_style import INK, PAPER, SOFT, Floats, is_wide

Bools = NDArray[np.bool_]

LEAST_VALUES = 5  # from which a value can be called far outside
FAR = 6.0  # interquartile ranges beyond the quartiles, from which a value is far outside [1]
REACH = 0.5  # of the range of the values, up to which bars and bands widen an axis [1]
TYPICAL = 2.0  # the same in what the bar in the middle of all goes beyond the values [1]
MARGIN = 0.06  # of an axis, free at its ends [1]
ARROW = 22.0  # size of the mark of a limit [pt]; its length is half of that
DOT = 5.0  # size of a dot [pt]
MIDDLE = 3.0  # size of the dot in the middle of an interval [pt]
CAP = 5.0  # half length of the ends of an interval [pt]
BELOW = Outline(
    [(-0.7, 0.0), (0.7, 0.0), (0.0, 0.0), (0.0, -1.5), (-0.5, -1.4), (0.5, -1.4), (0.0, -2.2), (-0.5, -1.4)],
    [1, 2, 1, 2, 1, 2, 2, 2],
)
ABOVE = Outline(-np.asarray(BELOW.vertices), BELOW.codes)
EDGES = {"high": 0.965, "low": 0.035}  # marks beyond the axis, and their place on it [1]
DOTS = {"ms": DOT, "color": INK, "mfc": INK}


@dataclass(frozen=True)
class ValueRange:
    """Visible part of a value axis."""

    low: float
    high: float
    logarithmic: bool = False

    def at(self, share: float) -> float:
        """Value at a share of the length of the axis."""
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** share)
        return self.low + share * (self.high - self.low)


def value_range(values: Floats, ends: Floats) -> ValueRange:
    """Range that shows all values but those far outside; `ends` of bars and bands widen it a little."""
    values = values[np.isfinite(values)]
    logarithmic = is_wide(values) and is_wide(values[~far_outside(np.log(values))])
    scaled = np.log(values) if logarithmic else values
    inside = scaled[~far_outside(scaled)]
    if not inside.size:
        return ValueRange(0.0, 1.0)
    ends = ends[np.isfinite(ends)]
    ends = np.log(ends[ends > 0.0]) if logarithmic else ends
    low, high = float(inside.min()), float(inside.max())
    beyond = np.maximum(np.maximum(low - ends, ends - high), 0.0)
    reach = max(REACH * (high - low), TYPICAL * float(np.median(beyond)) if ends.size else 0.0)
    near = ends[(ends > low - reach) & (ends < high + reach)]
    low, high = float(np.min(near, initial=low)), float(np.max(near, initial=high))
    free = MARGIN * (high - low) or 0.5 * abs(high) or 1.0
    low, high = low - free, high + free
    return ValueRange(float(np.exp(low)), float(np.exp(high)), True) if logarithmic else ValueRange(low, high)


def far_outside(values: Floats) -> Bools:
    """Values more than `FAR` interquartile ranges beyond the quartiles; none of few or equal ones."""
    if values.size < LEAST_VALUES:
        return np.zeros(values.size, dtype=np.bool_)
    first, third = np.quantile(values, [0.25, 0.75])
    reach = FAR * (third - first)
    return (values < first - reach) | (values > third + reach) if reach > 0.0 else values != values


def draw_marks(frame: Axes, x: Floats, y: Floats, kind: str, style: Mapping[str, object], gid: str) -> None:
    """Marks of one kind at their places; `style` is that of dots."""
    if kind in ("below", "above"):
        style = {**style, "marker": BELOW if kind == "below" else ABOVE, "ms": ARROW, "mfc": PAPER}
    elif kind == "between":
        style = {**style, "ms": MIDDLE}
    elif kind:
        style = {**style, "marker": "^" if kind == "high" else "v", "ms": 1.4 * DOT}
    (line,) = frame.plot(x, y, ls="", mew=1.1, zorder=5, **style)  # type: ignore[arg-type]
    line.set_gid(gid)


def draw_intervals(frame: Axes, x: Floats, low: Floats, high: Floats, colour: str, gid: str) -> None:
    """Bars from end to end of intervals in which values lie; their ends tell them from error bars."""
    middle = 0.5 * (low + high)
    bars = frame.errorbar(
        x,
        middle,
        high - middle,
        fmt="none",
        ecolor=colour,
        elinewidth=1.4,
        capsize=CAP,
        capthick=1.4,
        gid=gid,
    )
    for cap in bars[1]:
        cap.set_gid(gid)


def draw_edge_texts(frame: Axes, x: Floats, texts: Sequence[str], kind: str) -> None:
    """Values of marks at an edge of the axis, beside them."""
    middle = float(np.mean(frame.get_xlim()))
    for place, text in zip(x, texts, strict=True):
        to_left = place > middle
        frame.annotate(
            text,
            (place, EDGES[kind]),
            xycoords=("data", "axes fraction"),
            xytext=(-6.0 if to_left else 6.0, 0.0),
            textcoords="offset points",
            ha="right" if to_left else "left",
            va="center",
            color=SOFT,
            fontsize=8.0,
        )


def edge_of(shown: ValueRange, kind: str, values: Floats) -> Floats:
    """Places of marks on the value axis: at the edge for values beyond it."""
    return np.full(values.size, shown.at(EDGES[kind])) if kind in EDGES else values
