"""Splash: what happens when flying grains meet the bed, counted from frames of steady transport.

A flight is a run of frames in which a grain is clear of the bed, ended by a landing or by a bounce between
two frames. Its vertical speed where it crosses the height that counts as clear is that of a throw,

    w = sqrt(v_z^2 + 2 g (z - z_c)),

with z_c that height [m]; drag on the vertical motion is left out, so frames must be much closer than a hop is
long. A landing is a rebound where the same grain flies again within the time in which it falls through a
diameter and comes back, else the grain is caught; a flight that no landing of the same grain begins is that
of an ejected grain. In steady transport as many grains are ejected as are caught.

Reference: Beladjine, Ammi, Oger & Valance (2007), Phys. Rev. E 75, 061305 (rebound and ejecta); Kok & Renno
(2009), J. Geophys. Res. 114, D17204, section 2.2 (share of rebounds).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import atan2, degrees, hypot, inf, nan, sqrt

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.measures.wind_bed import Patch

LEAST_LANDINGS = 10  # fewer make no share worth the name
FAST = 0.5  # m s-1, of a landing whose rebound is compared with experiments that shoot grains at a bed


@dataclass(frozen=True)
class Flight:
    """One flight of one grain: its ends in time [s], and forward and vertical speed there [m s-1]."""

    takeoff: float
    landing: float
    start: tuple[float, float]
    end: tuple[float, float]


@dataclass(frozen=True)
class Splash:
    """Landings of all grains."""

    impacts: Floats  # [n, 2] m s-1, forward and downward, of all landings
    bounced: Floats  # [n, 2] m s-1, forward and upward, after each; NaN where the grain was caught
    ejected: int


def count_splash_events(frames: Sequence[Snapshot], patch: Patch, gravity: float) -> Splash:
    """Count landings, rebounds and ejecta; what the ends of the series cut off is left out."""
    times = np.array([frame.time for frame in frames])
    fall = sqrt(2.0 * patch.diameter / gravity) if gravity > 0.0 else inf
    gap = 2.0 * (fall + float(np.diff(times).max(initial=0.0)))
    impacts, bounced, ejected = [], [], 0
    for grain in np.flatnonzero(np.any([f.position[:, 2] > patch.clear for f in frames], axis=0)).tolist():
        flights = list(grain_flights(grain, frames, patch, gravity))
        for before, after in zip([None, *flights], [*flights, None], strict=True):
            follows = before is not None and after is not None and after.takeoff - before.landing <= gap
            if before is not None and before.landing <= times[-1] - gap:
                impacts.append(before.end)
                bounced.append(after.start if after is not None and follows else (nan, nan))
            if after is not None and not follows and after.takeoff >= times[0] + gap:
                ejected += 1
    return Splash(np.array(impacts).reshape(-1, 2), np.array(bounced).reshape(-1, 2), ejected)


def grain_flights(grain: int, frames: Sequence[Snapshot], patch: Patch, gravity: float) -> Iterator[Flight]:
    began: int | None = None
    for k, frame in enumerate(frames):
        flying = frame.position[grain, 2] > patch.clear
        turned = began is not None and frame.velocity[grain, 2] > 0.0 >= frames[k - 1].velocity[grain, 2]
        if began is not None and (not flying or turned):
            yield flight_between(grain, (frames[began], frames[k - 1]), patch, gravity)
            began = None
        if flying and began is None:
            began = k
    if began is not None:
        yield flight_between(grain, (frames[began], frames[-1]), patch, gravity)


def flight_between(grain: int, ends: tuple[Snapshot, Snapshot], patch: Patch, gravity: float) -> Flight:
    speeds = []
    for frame in ends:
        above = frame.position[grain, 2] - patch.clear
        upwards = sqrt(frame.velocity[grain, 2] ** 2 + 2.0 * gravity * above)
        speeds.append((float(frame.velocity[grain, 0]), upwards))
    return Flight(ends[0].time, ends[1].time, *speeds)


def number_per_landing(name: str, record: Splash, number: int) -> Measurement:
    """A number of grains over that of the landings; `sd` is the root of the number, over it [1]."""
    landings = len(record.impacts)
    if landings < LEAST_LANDINGS:
        return no_measurement(name, "1", f"{landings} landings; at least {LEAST_LANDINGS} are needed")
    return Measurement(name, number / landings, sqrt(number) / landings, "1", details={"landings": landings})


def rebound_share(record: Splash) -> Measurement:
    """Share of the landings after which the same grain flies on [1]."""
    return number_per_landing("rebound_share", record, int(np.isfinite(record.bounced[:, 0]).sum()))


def ejecta_share(record: Splash) -> Measurement:
    """Grains ejected from the bed over landings [1]."""
    return number_per_landing("ejecta_share", record, record.ejected)


def rebound_speed_ratio(splash: Splash) -> Measurement:
    """Mean speed after a rebound over the mean speed before, of landings faster than `FAST` [1].

    A mean of ratios would be ruled by slow landings. `sd` is the standard error of the ratio of means,
    that of (after - ratio before) over the mean before; `details` hold mean impact speed and both angles.

    Reference: Cochran (1977), Sampling Techniques, 2.11.
    """
    name = "rebound_speed"
    back = np.isfinite(splash.bounced[:, 0]) & (np.hypot(*splash.impacts.T) >= FAST)
    if (count := np.count_nonzero(back)) < LEAST_LANDINGS:
        words = f"{count} rebounds of landings above {FAST:g} m/s; {LEAST_LANDINGS} are needed"
        return no_measurement(name, "1", words)
    before, after = splash.impacts[back], splash.bounced[back]
    speed, rebound = np.hypot(*before.T), np.hypot(*after.T)
    ratio = float(rebound.mean() / speed.mean())
    details = {
        "impact_speed": hypot(*before.mean(axis=0)),
        "impact_angle": degrees(atan2(*before.mean(axis=0)[::-1])),
        "rebound_angle": degrees(atan2(*after.mean(axis=0)[::-1])),
    }
    error = float((rebound - ratio * speed).std(ddof=1) / (speed.mean() * sqrt(count)))
    return Measurement(name, ratio, error, "1", details=details)
