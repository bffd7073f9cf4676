"""Figure of a survey of one's own sand: thresholds over the diameter, and flux over the wind's stress."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from taichi_erosion.measures.wind_formulas import FLUID, FLUX, IMPACT, Sand, flux_by
from taichi_erosion.report.figure_style import AFTER, BEFORE, INK, page_style, panels, raster, scale_axis

Document = Mapping[str, Any]

DIAMETERS = np.geomspace(5e-5, 2e-3, 80)  # m
LINES = ("-", "--", ":", "-.")  # of formulas


@page_style()
def survey_picture(document: Document) -> bytes:
    """PNG of both panels."""
    figure, (left, right) = panels(2, 2, (4.6, 3.6))
    draw_thresholds(left, document)
    draw_flux(right, document)
    for frame in (left, right):
        frame.set(ylim=(0.0, None))
        frame.legend(fontsize=7.0)
    return raster(figure)


def draw_thresholds(frame: Axes, document: Document) -> None:
    """Formulas over the diameter of grains of this density, and what was simulated with its interval."""
    sand, measures = document["sand"], document["runs"].get("thresholds", {}).get("measures", {})
    for (name, law), line in zip((FLUID | IMPACT).items(), LINES, strict=True):
        values = [law(Sand(float(d), sand["density"])) for d in DIAMETERS]
        frame.plot(1e3 * DIAMETERS, values, line, color=INK, lw=1.0, label=name)
    for name, colour in (("fluid_threshold", BEFORE), ("impact_threshold", AFTER)):
        value, *reach = np.reshape(reaches(measures.get(name, {})), (3, 1))
        label = f"simulated, {name.partition('_')[0]}"
        frame.errorbar([1e3 * sand["diameter"]], value, reach, fmt="o", color=colour, label=label)
    scale_axis(frame, "x", 1e3 * DIAMETERS)
    frame.set(xlabel="grain diameter [mm]", ylabel="threshold u* [m/s]")


def draw_flux(frame: Axes, document: Document) -> None:
    """Formulas over rho u*^2, simulated fluxes with their intervals, and measured ones with their scatter."""
    sand, winds = Sand(document["sand"]["diameter"], document["sand"]["density"]), document["winds"]
    line_winds = np.linspace(0.1, 1.05 * max(winds), 80)
    for name, line in zip(FLUX, LINES, strict=False):
        flux = [1e3 * flux_by(name, sand, float(wind)) for wind in line_winds]
        frame.plot(sand.air_density * line_winds**2, flux, line, color=INK, lw=1.0, label=name)
    runs = [document["runs"].get(f"flux_{wind:g}", {}).get("measures", {}).get("flux", {}) for wind in winds]
    for rows, mark, color in ((document["measured"], "s", BEFORE), (runs, "o", AFTER)):
        value, *reach = 1e3 * np.array(list(map(reaches, rows))).T
        label = "simulated" if mark == "o" else "measured"
        frame.errorbar(sand.air_density * np.square(winds), value, reach, fmt=mark, color=color, label=label)
    frame.set(xlabel="stress of the wind [Pa]", ylabel="flux [g/(m s)]")


def reaches(measure: Document) -> tuple[float, float, float]:
    """Value, and how far its 95 % interval over beds, else its deviation, reaches below and above."""
    value, sd = measure.get("value") or np.nan, measure.get("sd") or 0.0
    bounds = measure.get("details", {}).get("interval") or {"low": value - sd, "high": value + sd}
    return value, value - bounds["low"], bounds["high"] - value
