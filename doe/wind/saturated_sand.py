"""Thresholds of saturated transport: the wind in which the stress of the grains, extrapolated, vanishes."""

from dataclasses import replace
from math import isfinite

import numpy as np

from doe.common.cases import Found
from doe.wind.flux_law import vanishing_wind

STRESS_LINE = "impact_threshold_stress"  # observable of a threshold from steady winds
BARE = "impact"  # group of the cases without any effect
STICKY = "adhesion"  # of those with dry adhesion, which the contacts of a grain share
ALL_FORCES = "all_forces"  # of those with all forces of a fluid threshold
IN_EVERY_CONTACT = "adhesion_in_every_contact"  # of those with the pull of a whole grain in every contact
QUARTZ, AIR = 2650.0, 1.225  # kg m-3, of the simulated grains and their air
GRAVITY = 9.81  # m s-2
MILLI = 1e-3  # of a metre
APART = " mm, "  # between the diameter and the wind in the label of a case
LIGHT = "light"  # group of the cases with grains lighter than quartz
SHARES = ("bed_stress", "grain_stress")


def winds_of(found: Found) -> dict[tuple[str, str], Found]:
    """Cases of each sand; its name is the group and the diameter [mm]."""
    sands: dict[tuple[str, str], Found] = {}
    for (group, label), case in found.items():
        if set(SHARES) <= case.keys() and all(isfinite(case[name].value) for name in SHARES):
            sands.setdefault((group, label.split(APART)[0]), {})[group, label] = case
    return sands


def saturated_thresholds(found: Found) -> Found:
    """One row a sand: the threshold with `sd` such that the standard error is that of the line."""
    thresholds: Found = {}
    for name, winds in winds_of(found).items():
        left, borne = np.array([[case[share].value for share in SHARES] for case in winds.values()]).T
        line = vanishing_wind(left, borne, borne, AIR)
        if line is None:
            continue
        first = next(iter(winds.values()))["grain_stress"]
        error = 0.5 * (line.high - line.low)
        row = replace(
            first,
            label=name[1],
            observable=STRESS_LINE,
            value=line.middle,
            sd=error * len(winds) ** 0.5,
            n=len(winds),
            unit="m s-1",
        )
        thresholds[name] = {STRESS_LINE: row}
    return thresholds
