"""Thresholds of saturated transport: the wind in which the stress of the grains, extrapolated, vanishes."""

from dataclasses import replace
from math import isfinite, nan

import numpy as np

from doe.wind.blown_sand import AIR, BARE, MILLI, STRESS_LINE, Found, known, shown
from doe.wind.flux_law import vanishing_wind
from taichi_erosion.report.markdown import markdown_table

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


def together(found: Found, more: Found) -> Found:
    """Observables of both, case by case."""
    return {
        name: found.get(name, {}) | more.get(name, {}) for name in [*found, *(more.keys() - found.keys())]
    }


def wind_of(label: str) -> float:
    """Friction velocity in the label of a case [m s-1]."""
    return float(label.rsplit(maxsplit=1)[1])


def saturated_table(found: Found) -> str:
    """The winds over every sand: flux, and who carries the stress."""
    header = (
        *("sand", "u* of the wind [m/s]", "flux [g/(m s)]", "stress of the air at the bed [Pa]"),
        *("of the grains [Pa]", "both over that of the wind", "stress of the air over that of the threshold"),
    )
    rows = []
    thresholds = saturated_thresholds(found)
    for name, winds in sorted(winds_of(found).items(), key=lambda item: (item[0][0], float(item[0][1]))):
        end = thresholds[name][STRESS_LINE].value if name in thresholds else nan
        added = "" if name[0] == BARE else f", {name[0].replace('_', ' ')}"
        sand = f"{name[1]} mm{added}"
        for (_, label), case in sorted(winds.items(), key=lambda item: wind_of(item[0][1])):
            wind = wind_of(label)
            left, carried = (case[share].value for share in SHARES)
            rows.append(
                (
                    sand,
                    shown(wind),
                    shown(case["flux"].value / MILLI),
                    shown(left),
                    shown(carried),
                    f"{(left + carried) / (AIR * wind**2):.2f}",
                    known(left / (AIR * end**2)),
                )
            )
    return markdown_table(header, rows) if rows else "Not simulated yet.\n"
