"""Blown sand under the drag of grains among others, beside that of grains alone; writes drag_laws.csv here.

python -m doe.wind.drag_laws          every case that has no rows yet
python -m doe.wind.drag_laws NAME...  some anew: flux/0.4123 (u* in m/s), sand/0.24 (diameter in mm), ...

`flux` are the winds of Creyssels et al. (2009) as in `run.py`, `sand` the steady winds of `saturated.py`,
both with `two_limits_hindered` in place of the `two_limits` of the scene, with which flux.csv and
saturated.csv were simulated. `python -m doe.wind.run --page` then fills the tables of docs/threshold.md.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import hypot
from pathlib import Path

from doe.common.cases import Case, Row, perform, read_rows, settings
from doe.common.command import words
from doe.wind.blown_sand import AIR, BARE, HOLDS, MILLI, STRESS_LINE, Found, Table, flux_pairs, judged, shown
from doe.wind.run import SALTATION, flux_cases
from doe.wind.saturated import Blown
from doe.wind.saturated import cases as saturated_cases
from doe.wind.saturated_sand import saturated_thresholds, wind_of, winds_of
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.verification.reference.hopping import Sand

TABLE = Path(__file__).with_name("drag_laws.csv")
LAW = 'wind.drag="two_limits_hindered"'
FLUX, SAND = "flux", "sand"  # groups
WINDS = ("0.4123", "0.6898", "0.2415", "0.3269", "0.5748", "0.4928")  # m s-1, middle and ends first
SANDS = ("0.24", "1", "0.5")  # mm


def cases() -> dict[str, list[Case]]:
    """All cases by name, in the order in which they are simulated."""
    plain = {case.label: case for case in flux_cases()}
    found = {
        f"{FLUX}/{wind}": [replace(plain[wind], order=plain[wind].order + settings(LAW))] for wind in WINDS
    }
    for size in SANDS:
        blown = Blown(SAND, Sand(MILLI * float(size)), (LAW,))
        found[blown.name] = list(saturated_cases(blown))
    return found


def flux_law_table(alone: Found, hindered: Found, measured: Table) -> str:
    """Flux at every wind under both laws, ± the standard error of the mean of the beds."""
    header = ["u* [m/s]", "measured [g/(m s)]"]
    for words_of in ("of a grain alone", "among others"):
        header += [f"drag {words_of} [g/(m s)]", "difference", "model"]
    rows = []
    pairs = zip(flux_pairs(alone, measured), flux_pairs(fluxes(hindered), measured), strict=True)
    for (wind, value, sd, first), (*_, second) in pairs:
        cells = [f"{wind:g}", f"{value / MILLI:.1f} ± {sd / MILLI:.1f}"]
        for row in (first, second):
            cells += flux_cells(row, value)
        rows.append((*cells, ratio_cell(first, second)))
    return markdown_table((*header, "among others over alone"), rows)


def fluxes(found: Found) -> Found:
    """The cases of the winds alone."""
    return {name: case for name, case in found.items() if name[0] == FLUX}


def flux_cells(row: Row | None, measured: float) -> list[str]:
    """A simulated flux, how it differs from the measured one [kg m-1 s-1], and whether a model holds so."""
    if row is None:
        return ["", "", "not simulated"]
    return [
        shown(row.value / MILLI, row.standard_error / MILLI),
        *judged(row.value, measured, HOLDS["flux"])[1:],
    ]


def ratio_cell(alone: Row | None, hindered: Row | None) -> str:
    """Ratio of two means ± its standard error; empty where one is not simulated."""
    if alone is None or hindered is None:
        return ""
    ratio = hindered.value / alone.value
    error = hypot(*(row.standard_error / row.value for row in (alone, hindered)))
    return shown(ratio, ratio * error)


def sand_law_table(alone: Found, hindered: Found) -> str:
    """Saturated transport of the sands that were simulated under both laws."""
    header = (
        "d [mm]",
        "drag",
        "threshold u* [m/s]",
        "stress of the air over that of the threshold, wind by wind",
    )
    rows = []
    for name, found, group in (("of a grain alone", alone, BARE), ("among others", hindered, SAND)):
        sands, ends = winds_of(found), saturated_thresholds(found)
        for size in SANDS:
            if (group, size) in ends:
                end = ends[group, size][STRESS_LINE]
                winds = sorted(sands[group, size].items(), key=lambda item: wind_of(item[0][1]))
                left = (case["bed_stress"].value / (AIR * end.value**2) for _, case in winds)
                cells = ", ".join(f"{share:.2f}" for share in left)
                rows.append((size, name, shown(end.value, end.standard_error), cells))
    return markdown_table(header, sorted(rows, key=lambda row: float(row[0])))


def main(asked: Sequence[str]) -> None:
    """Simulate what was asked for."""
    done = {(row.group, row.label) for row in read_rows(TABLE)} if TABLE.exists() else set()
    for name, group in cases().items():
        if asked and name not in asked:
            continue
        fresh = group if asked else [case for case in group if (case.group, case.label) not in done]
        perform(SALTATION, fresh, TABLE)


if __name__ == "__main__":
    main(words(__doc__))
