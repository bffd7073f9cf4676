"""Flux of blown sand under two laws of drag beside the measured one."""

from math import hypot

from doe.common.cases import Row
from doe.wind.blown_sand import HOLDS, MILLI, Found, Table, flux_pairs, judged, shown
from taichi_erosion.report.markdown import markdown_table

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
