"""What a measure needs of its set-up, as bounds that come from tables of runs or from closed forms.

A heap needs a flank. Between the ends of a fitted line lie

    r = (0.75 H - max(0.15 H, 1.25 d)) / d

rows of grains, with H the height of the heap and d the grain diameter [m]: a number of the heap's geometry,
whatever its soil. With fewer than `LEAST_ROWS` an angle says nothing: poured heaps of 1.3 rows read 5 and 11
deg where those of 10 rows of the same grains read 36, and outlines of collapsed columns of 1.2 rows read 17
instead of 23 deg with a scatter of 3. Beyond, angles of poured heaps go on growing up to the largest that was
simulated: 28, 30 and 36 deg at 5, 7 and 10 rows; those of collapsed columns of three soils fall by 2 to 3 deg
from 3.5 to 7 rows, and by no more than 1.2 deg from 5 rows on.
The grains of a heap of slope t and height H are at most

    N = c (H / d)^3 / tan(t)^2,    c = 2.4,

c the largest of all these heaps, of which a cone without stray grains has pi / 3 (6 / pi) 0.58 = 1.2.

Reference: doe/repose_sensitivity/results.csv and doe/heap_size/results.csv.
"""

from collections.abc import Iterator, Sequence
from math import ceil, isfinite, log10, radians, sqrt, tan

import numpy as np

from taichi_erosion.measures.result import Measurement, Shortfall
from taichi_erosion.measures.silhouette import FOOT_GRAINS, FOOT_SHARE, SHOULDER_SHARE, heights_of_fit_window

LEAST_ROWS = 3.0  # of grains on a flank, below which there is no angle [1]
POURED_LEAST = 5.0  # of a poured heap, from which 3,000 grains read 28 to 30 deg [1]
POURED_ROWS = 10.0  # up to which the angle of a poured heap grows in doe/repose_sensitivity [1]
COLUMN_ROWS = 5.0  # from which the angle of any other heap stays within 1.2 deg in doe/heap_size [1]
COLUMN_TEXT = "angles of such heaps fall by 2 to 3 deg from 3.5 to 7 rows"
POURED_TEXT = "angles of poured heaps grow with their size: 28, 30 and 36 deg at 5, 7 and 10 rows"
HEAP_FACTOR = 2.4  # c above [1]
USUAL_ANGLE = 30.0  # deg, where neither a measured nor a simulated one is known
LEAST_ANGLE = 5.0  # deg, below which the estimate of N would be absurd
LEAST_HOPS = 50  # exponential hops make a flux within sqrt(2 / n) = 20 % [1]
DRIFT = 3.71  # Student's t of a slope through eight means that chance exceeds once in a hundred [1]
TINY = 1e-12  # of a sum of squares, left by rounding
LEAST_BINS = 6  # a surface of n bins, each off by up to half a grain, slopes within 1 / sqrt(n^3 - n) = 4 deg
UNSTEADY = 0.3  # sd of the frames over the mean: a flowing surface keeps within 0.1 of it [1]
LAG_MOST = 0.5  # deg: half the lag of a ball that rolls off, whose path grows with the cube of the time
LEAST_BEDS = 5  # beds scatter by 11 % (doe/wind/fluid.csv): the 95 % interval of five is 14 % to either side


def grain_rows_on_flank(height: float, diameter: float) -> float:
    """Rows of grains between the ends of a fitted flank [1]."""
    low, high = heights_of_fit_window(height, diameter)
    return max(high - low, 0.0) / diameter


def heap_height(rows: float) -> float:
    """Height of a heap with so many rows on its flank [diameters]: the inverse of `grain_rows_on_flank`."""
    return max((rows + FOOT_GRAINS) / SHOULDER_SHARE, rows / (SHOULDER_SHARE - FOOT_SHARE))


def grain_count(rows: float, angle: float) -> int:
    """Grains that suffice for a heap of this angle [deg] with so many rows, to two digits, rounded up."""
    slope = tan(radians(max(angle, LEAST_ANGLE) if isfinite(angle) else USUAL_ANGLE))
    return round_up_two_digits(HEAP_FACTOR * heap_height(rows) ** 3 / slope**2)


def round_up_two_digits(count: float) -> int:
    unit = 10 ** (int(log10(count)) - 1)
    return ceil(count / unit) * unit


def grains_needed_for_rows(rows_needed: float, rows: float, grains: int, angle: float) -> int:
    """Grains for `rows_needed` rows, more than there are in a heap of `rows` rows.

    Those of a heap of this angle [deg]; where the heap has as many and is flatter, those of its own shape.
    """
    estimate = grain_count(rows_needed, angle)
    if estimate > grains:
        return estimate
    return round_up_two_digits(grains * (heap_height(rows_needed) / heap_height(rows)) ** 3)


def heap_shortfalls(
    rows: float, grains: int, poured: bool, angle: float, simulated: float
) -> Iterator[Shortfall]:
    """Shortfalls of an angle of repose; `angle` [deg] is the one to be reached, NaN where it is unknown."""
    goal = next((each for each in (angle, simulated) if isfinite(each)), USUAL_ANGLE)
    settled = POURED_ROWS if poured else COLUMN_ROWS  # rows up to which an angle changes with its size
    if rows < LEAST_ROWS:
        enough = grains_needed_for_rows(LEAST_ROWS, rows, grains, goal)
        have = f"{rows:.1f} of {LEAST_ROWS:g} rows of grains on its flank"
        need = f"use at least {enough:,} grains ({grains:,} now)"
        words = f"the heap is too small for an angle: {have}; {need}"
        yield Shortfall("small_heap", words, rows, LEAST_ROWS, True, enough)
    elif rows < settled:
        enough = grains_needed_for_rows(settled, rows, grains, goal)
        have = f"{rows:.1f} rows of grains on its flank, and {POURED_TEXT if poured else COLUMN_TEXT}"
        words = f"the angle has not converged: {have}; use at least {enough:,} grains ({grains:,} now)"
        yield Shortfall("growing_angle", words, rows, settled, False, enough)


def hop_shortfalls(hops: int) -> Iterator[Shortfall]:
    """Shortfall of a measure of transport that rests on few hops; without any hop nothing moves at all."""
    if 0 < hops < LEAST_HOPS:
        off = 100.0 * sqrt(2.0 / hops)
        words = f"{hops} hops carry it, so that chance moves it by {off:.0f} %; {LEAST_HOPS} are needed: a "
        yield Shortfall("few_hops", f"{words}longer stage or a larger patch", hops, LEAST_HOPS, False)


def surface_shortfalls(bins: float, mean: float, sd: float) -> Iterator[Shortfall]:
    """Shortfalls of the slope of a surface that is few grains wide, or another one in each frame."""
    if bins < LEAST_BINS:
        words = f"the surface is {bins:.0f} grains wide, {LEAST_BINS} are needed: larger drum or finer grains"
        yield Shortfall("narrow_surface", words, bins, LEAST_BINS, True)
    if sd > UNSTEADY * mean:
        words = f"frames scatter by {sd:.2g} deg, no steady surface: a drum that turns too fast, or empties"
        yield Shortfall("unsteady_surface", words, sd, UNSTEADY * mean, True)


def tilt_shortfalls(lag: float) -> Iterator[Shortfall]:
    """Shortfall of a sliding angle whose plate turns by `lag` [deg] while the grains set off."""
    if lag > LAG_MOST:
        words = f"the plate turns by {lag:.2g} deg while grains set off, and the angle is too large by about "
        yield Shortfall("fast_tilt", f"{words}twice that: tilt more slowly", lag, LAG_MOST, False)


def drift_shortfalls(means: Sequence[float]) -> Iterator[Shortfall]:
    """Shortfall of a mean over a window in which the state still changes: means of its blocks have a slope.

    t = r sqrt((n - 2) / (1 - r^2)),   r the correlation of n block means with their order
    """
    order, series = np.arange(len(means)) - 0.5 * (len(means) - 1), np.asarray(means) - np.mean(means)
    along = (order @ series) ** 2 / (order @ order)  # of the sum of squares, what a line takes
    residual = series @ series - along
    if along > 0.0 and (t := sqrt((len(means) - 2) * along / max(residual, TINY * along))) > DRIFT:
        words = "the mean drifts over the window by more than its scatter: a later or longer window"
        yield Shortfall("drift", words, t, DRIFT, False)


def unsteady_shortfalls(lasted: float, length: float, departure: float, most: float) -> Iterator[Shortfall]:
    """Shortfall of transport whose air still gains or loses momentum, or of a stage too short to tell."""
    if lasted < length:
        words = f"transport was watched for {lasted:.2g} s, {length:.2g} s are needed: a longer last stage"
        yield Shortfall("unsteady", words, lasted, length, True)
    elif departure > most:
        carried = f"air and grains carry up to {departure:.0%} more or less than the stress of the wind"
        words = f"transport never became steady: {carried} ({most:.0%} is allowed): a longer last stage, "
        words += "repeats, or steady_air"
        yield Shortfall("unsteady", words, departure, most, True)


def touching_shortfalls(share: float) -> Iterator[Shortfall]:
    """Shortfall of a settling velocity where grains rest on each other."""
    if share > 0.5:
        words = f"{share:.0%} of the grains touch others or a wall: they do not settle; end the stage earlier"
        yield Shortfall("touching", words, share, 0.5, True)


def few_beds_shortfall(pooled: Measurement) -> Iterator[Shortfall]:
    if 0 < pooled.n < LEAST_BEDS:
        beds = "one bed" if pooled.n == 1 else f"{pooled.n} beds"
        words = f"it rests on {beds}, and single beds scatter by 11 %; use at least --replicas {LEAST_BEDS}"
        yield Shortfall("few_beds", words, pooled.n, LEAST_BEDS, False)
