"""Flux and impact thresholds of blown sand under two laws of drag beside the measured ones."""

from collections.abc import Mapping
from math import hypot, isfinite, nan

import numpy as np

from doe.common.cases import Row
from doe.wind.blown_sand import (
    BARE,
    HOLDS,
    MILLI,
    STRESS_LINE,
    Found,
    Table,
    density_of,
    flux_pairs,
    judged,
    predicted,
    shown,
    simulated_thresholds,
)
from doe.wind.saturated_sand import saturated_thresholds
from taichi_erosion.measures.result import Measurement
from taichi_erosion.report.markdown import markdown_table

FLUID = "threshold_u_star"  # observable of the published soil
FLUX = "flux"  # group of the winds in which the flux was measured
LAWS = ("of a grain alone", "among others")
STRESSES = {
    "bed_stress": "stress of the air at the bed [Pa]",
    "grain_stress": "of the grains [Pa]",
    "flux": "flux [g/(m s)]",
}


def law_table(alone: Found, hindered: Found, measured: Table) -> str:
    """Flux at every wind under both laws, ± the standard error of the mean of the beds."""
    header = ["u* [m/s]", "measured [g/(m s)]"]
    for law in LAWS:
        header += [f"drag {law} [g/(m s)]", "difference", "model"]
    rows = []
    both = (flux_pairs(fluxes_of(found), measured) for found in (alone, hindered))
    for (wind, value, sd, first), (*_, second) in zip(*both, strict=True):
        cells = [f"{wind:g}", f"{value / MILLI:.1f} ± {sd / MILLI:.1f}"]
        for row in (first, second):
            cells += flux_cells(row, value)
        rows.append((*cells, ratio_cell(first, second)))
    return markdown_table((*header, "among others over alone"), rows)


def fluxes_of(found: Found) -> Found:
    """The cases of the winds in which the flux was measured."""
    return {name: case for name, case in found.items() if name[0] == FLUX}


def stress_table(alone: Found, hindered: Found) -> str:
    """Winds of saturated transport that were simulated under both laws: flux, and stress left to the air."""
    header = ["sand", *(f"{what}, drag {law}" for what in STRESSES.values() for law in LAWS)]
    rows = []
    for name in sorted(alone.keys() & hindered.keys()):
        both = (alone[name], hindered[name])
        rows.append(
            (name[1], *(shown(case[what].value / unit_of(what)) for what in STRESSES for case in both))
        )
    return markdown_table(header, rows)


def impact_law_table(alone: Found, hindered: Found, measured: Table) -> str:
    """Thresholds of saturated transport under both laws, and how far they are from the measured sands."""
    found = (saturated_thresholds(alone), saturated_thresholds(hindered))
    header = ("d [mm]", *(f"u* [m/s], drag {law}" for law in LAWS), "among others over alone")
    both = sorted((name for name in found[0].keys() & found[1].keys() if name[0] == BARE), key=sand_size)
    rows = []
    for name in both:
        first, second = (each[name][STRESS_LINE] for each in found)
        values = (shown(row.value, row.standard_error) for row in (first, second))
        rows.append((name[1], *values, ratio_cell(first, second)))
    errors = [shown(impact_error(each, measured)) for each in found]
    return markdown_table(header, [*rows, ("rms of ln simulated / measured", *errors, "")])


def soil_table(alone: Found, hindered: Found, shares: Mapping[str, Measurement]) -> str:
    """Fluid thresholds of the published soil under both laws, ± the standard error of the beds.

    `shares` are those under the drag of a grain alone over the same beds, by the forces beside drag; they count
    before `alone`, which may have other beds.
    """
    header = ("forces", *(f"beds, drag {law}" for law in LAWS), *(f"u* [m/s], drag {law}" for law in LAWS))
    rows = []
    for name, case in hindered.items():
        if FLUID not in case:
            continue
        row = case[FLUID]
        told = shares[name[1]] if name[1] in shares else alone[name][FLUID]
        both = (told.value, told.sd / told.n**0.5), (row.value, row.standard_error)
        ratio = row.value / told.value
        error = ratio * hypot(*(error / value for value, error in both))
        cells = (str(told.n), str(row.n), *(shown(*each) for each in both), shown(ratio, error))
        rows.append((name[1], *cells))
    return markdown_table((*header, "among others over alone"), rows)


def sand_size(name: tuple[str, str]) -> float:
    """Diameter of a sand [mm]."""
    return float(name[1])


def impact_error(thresholds: Found, measured: Table) -> float:
    """Root mean square of ln(simulated / measured) over the measured sands between simulated ones [1]."""
    sand = simulated_thresholds(thresholds, STRESS_LINE)
    ratios = [
        predicted(MILLI * float(line["diameter [mm]"]), density_of(line), sand) / float(line["value"])
        for line in measured
    ]
    known = np.log([ratio for ratio in ratios if isfinite(ratio)])
    return float(np.sqrt(np.mean(known**2))) if known.size else nan


def unit_of(observable: str) -> float:
    """Unit of a column in that of the rows."""
    return MILLI if observable == "flux" else 1.0


def flux_cells(row: Row | None, measured: float) -> list[str]:
    """A simulated flux, how it differs from the measured one [kg m-1 s-1], and whether a model holds so."""
    if row is None:
        return ["", "", "not simulated"]
    value = shown(row.value / MILLI, row.standard_error / MILLI)
    return [value, *judged(row.value, measured, HOLDS["flux"])[1:]]


def ratio_cell(alone: Row | None, hindered: Row | None) -> str:
    """Ratio of two means ± its standard error; empty where one is not simulated."""
    if alone is None or hindered is None:
        return ""
    ratio = hindered.value / alone.value
    return shown(ratio, ratio * hypot(*(row.standard_error / row.value for row in (alone, hindered))))
