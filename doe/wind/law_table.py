"""Flux of blown sand under two laws of drag beside the measured one."""

from math import hypot

from doe.common.cases import Row
from doe.wind.blown_sand import HOLDS, MILLI, Found, Table, flux_pairs, judged, shown
from taichi_erosion.report.markdown import markdown_table

LAWS = ("of a grain alone", "among others")


def law_table(alone: Found, hindered: Found, measured: Table) -> str:
    """Flux at every wind under both laws, ± the standard error of the mean of the beds."""
    header = ["u* [m/s]", "measured [g/(m s)]"]
    for law in LAWS:
        header += [f"drag {law} [g/(m s)]", "difference", "model"]
    rows = []
    both = (flux_pairs(found, measured) for found in (alone, hindered))
    for (wind, value, sd, first), (*_, second) in zip(*both, strict=True):
        cells = [f"{wind:g}", f"{value / MILLI:.1f} ± {sd / MILLI:.1f}"]
        for row in (first, second):
            cells += flux_cells(row, value)
        rows.append((*cells, ratio_cell(first, second)))
    return markdown_table((*header, "among others over alone"), rows)


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
