"""Mass flow of grains through a plane, in the part of a stage in which it is steady.

    q_k = sum of the masses that crossed between frames k and k + 1, back less, over the time between them

The flow of a hopper begins, is steady, and dies out. The steady part is the window of frames whose mean m
has the smallest relative error, max(s^2, D) / (n m^2) with n frames of variance s^2, among windows through
which at least `LEAST_SHARE` of all the mass has passed. D is half the mean square of the steps between frames
in the middle of the flow: chance makes no window better than that.

Reference: White (1997), Simulation 69, 323 (the rule, there for the beginning alone).
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from taichi_erosion.core.setup import Floats, Triple
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.measures.wind_bed import LEAST_FRAMES, mean_by_block

LEAST_SHARE = 0.25  # of the mass [1]: between a burst at the beginning and the end of the supply
TINY = 1e-300  # keeps the error of no flow finite [kg2 s-2]
FEW = 200  # grains in the steady part: fewer make an error of more than 1 / sqrt(200) = 7 %


def mass_flow_rate(
    frames: Sequence[Snapshot], point: Triple, normal: Triple, period: Triple = (0.0, 0.0, 0.0)
) -> Measurement:
    """Mass a second that passes a plane along its normal [kg s-1]; `sd` is the standard error of the mean."""
    name, unit = "mass_flow", "kg s-1"
    if len(frames) <= LEAST_FRAMES:
        return no_measurement(name, unit, f"{len(frames)} frames of a stage; over {LEAST_FRAMES} are needed")
    pairs = list(pairwise(frames))
    plane = np.asarray(point), np.asarray(normal), np.asarray(period)
    counted = [net_mass_through_plane(*pair, *plane) for pair in pairs]
    rate = np.array([mass / (b.time - a.time) for (mass, _, _), (a, b) in zip(counted, pairs, strict=True)])
    flowing = np.flatnonzero(rate)
    if not flowing.size:
        return no_measurement(name, unit, "no grain crossed the plane")
    first, last = steady_frame_range(rate[flowing[0] : flowing[-1] + 1])
    first, last = first + flowing[0], last + flowing[0]
    grains = sum(number for _, number, _ in counted[first:last])
    missing = sum(count for _, _, count in counted)
    begin, end = frames[first].time, frames[last].time
    notes = [f"steady from {begin:.4g} to {end:.4g} s, {grains:,} grains crossed"]
    if grains < FEW:
        notes.append(f"few grains: each is {1.0 / max(grains, 1):.1%} of the flow")
    if missing:
        notes.append(f"{missing:,} grains vanished near the plane and are counted by their speed")
    flow = mean_by_block(name, rate[first:last].tolist(), unit)
    details = {"time": [two.time for _, two in pairs], "rate": rate.tolist(), "steady": [begin, end]}
    return replace(flow, notes=(*flow.notes, *notes), details=flow.details | details)


def net_mass_through_plane(
    before: Snapshot, after: Snapshot, point: Floats, normal: Floats, period: Floats
) -> tuple[float, int, int]:
    """Net mass [kg] and number of the grains that crossed between two frames, and how many vanished then.

    Between the frames a grain goes straight, over a period the shorter way. One that is gone in the second
    frame went on at its speed.
    """
    normal = normal / np.linalg.norm(normal)
    place = np.minimum(np.searchsorted(after.ident, before.ident), max(len(after.ident) - 1, 0))
    there = after.ident[place] == before.ident if len(after.ident) else np.zeros(len(before.ident), bool)
    move = before.velocity * (after.time - before.time)
    move[there] = after.position[place[there]] - before.position[there]
    away = before.position - point
    for axis in np.flatnonzero(period > 0.0):
        for vector in (move, away):
            vector[:, axis] -= period[axis] * np.round(vector[:, axis] / period[axis])
    begin = away @ normal
    end = begin + move @ normal
    sign = np.sign((end >= 0.0).astype(float) - (begin >= 0.0))
    return float((sign * before.mass).sum()), int(np.abs(sign).sum()), int((~there & (sign != 0.0)).sum())


def steady_frame_range(rate: Floats) -> tuple[int, int]:
    """First frame of the steady part, and one past its last."""
    count = len(rate)
    sums, squares = np.cumsum([0.0, *rate]), np.cumsum([0.0, *rate**2])
    middle = np.abs(np.abs(sums[1:] / sums[-1]) - 0.5) < 0.25 if sums[-1] else np.ones(count, bool)
    noise = 0.5 * np.mean(np.diff(rate[middle]) ** 2) if middle.sum() > 1 else 0.0
    best, window = np.inf, (0, count)
    for first in range(count - LEAST_FRAMES + 1):
        last = np.arange(first + LEAST_FRAMES, count + 1)
        last = last[np.abs(sums[last] - sums[first]) >= LEAST_SHARE * np.abs(sums[-1])]
        number = last - first
        mean = (sums[last] - sums[first]) / number
        variance = (squares[last] - squares[first]) / number - mean**2
        error = np.maximum(variance, noise) / (number * np.maximum(mean**2, TINY))
        if error.min(initial=np.inf) < best:
            best, window = error.min(), (first, int(last[error.argmin()]))
    return window
