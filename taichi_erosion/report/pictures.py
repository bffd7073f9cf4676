"""Pictures of commands: thresholds and flux of a survey of sand; a photograph with its heap detected."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from taichi_erosion.core.files import mark_png, write_atomic
from taichi_erosion.measures.photograph import read_grey_picture
from taichi_erosion.measures.wind_formulas import FLUID, FLUX, IMPACT, Sand, flux_by
from taichi_erosion.report.figure_style import AFTER, BEFORE, INK, as_png, page_style, panels, set_axis_scale

Document = Mapping[str, Any]

DIAMETERS = np.geomspace(5e-5, 2e-3, 80)  # m
LINES = ("-", "--", ":", "-.")  # of formulas
WIDTH = 1280  # px of the picture
DOTS_PER_INCH = 160
OUTLINE, BASE, FLANK = "#35c0ff", "#ffd23f", "#ff5c39"


@page_style()
def survey_picture(document: Document) -> bytes:
    """PNG of a survey: thresholds over the diameter, flux over the stress of the wind."""
    figure, (left, right) = panels(2, 2, (4.6, 3.6))
    draw_thresholds(left, document)
    draw_flux(right, document)
    for frame in (left, right):
        frame.set(ylim=(0.0, None))
        frame.legend(fontsize=7.0)
    return as_png(figure)


def draw_thresholds(frame: Axes, document: Document) -> None:
    """Formulas over the diameter of grains of this density, and what was simulated with its interval."""
    sand, measures = document["sand"], document["runs"].get("thresholds", {}).get("measures", {})
    for (name, law), line in zip((FLUID | IMPACT).items(), LINES, strict=True):
        values = [law(Sand(float(d), sand["density"])) for d in DIAMETERS]
        frame.plot(1e3 * DIAMETERS, values, line, color=INK, lw=1.0, label=name)
    for name, colour in (("fluid_threshold", BEFORE), ("impact_threshold", AFTER)):
        value, *reach = np.reshape(value_and_reaches(measures.get(name, {})), (3, 1))
        label = f"simulated, {name.partition('_')[0]}"
        frame.errorbar([1e3 * sand["diameter"]], value, reach, fmt="o", color=colour, label=label)
    set_axis_scale(frame, "x", 1e3 * DIAMETERS)
    frame.set(xlabel="grain diameter [mm]", ylabel="threshold u* [m/s]")


def draw_flux(frame: Axes, document: Document) -> None:
    """Formulas over rho u*^2, simulated fluxes with their intervals, and measured ones with their scatter."""
    sand, winds = Sand(document["sand"]["diameter"], document["sand"]["density"]), document["winds"]
    line_winds = np.linspace(0.1, 1.05 * max(winds), 80)
    for name, line in zip(FLUX, LINES, strict=False):
        flux = [1e3 * flux_by(name, sand, float(wind)) for wind in line_winds]
        frame.plot(sand.air_density * line_winds**2, flux, line, color=INK, lw=1.0, label=name)
    runs = [document["runs"].get(f"flux_{wind:g}", {}).get("measures", {}).get("flux", {}) for wind in winds]
    measured = [("measured", document["measured"], "s", BEFORE)] * any(document["measured"])
    for label, rows, mark, color in (*measured, ("simulated", runs, "o", AFTER)):
        value, *reach = 1e3 * np.array(list(map(value_and_reaches, rows))).T
        frame.errorbar(sand.air_density * np.square(winds), value, reach, fmt=mark, color=color, label=label)
    frame.set(xlabel="stress of the wind [Pa]", ylabel="flux [g/(m s)]")


def value_and_reaches(measure: Document) -> tuple[float, float, float]:
    """Value, and how far its 95 % interval over beds, else its deviation, reaches below and above."""
    value, sd = measure.get("value") or np.nan, measure.get("sd") or 0.0
    bounds = measure.get("details", {}).get("interval") or {"low": value - sd, "high": value + sd}
    return value, value - bounds["low"], bounds["high"] - value


def draw_detection(photograph: Path, record: Mapping[str, Any], to: Path) -> Path:
    """Write the photograph with the detection of `measure_photograph` over it. Raises BadInput."""
    grey = read_grey_picture(photograph)
    details = record["details"]
    rows, columns = grey.shape
    width = WIDTH / DOTS_PER_INCH
    figure = Figure(figsize=(width, width * rows / columns))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.imshow(grey, cmap="gray", vmin=0.0, vmax=1.0, extent=(0.0, columns, rows, 0.0))
    picture = details["drawing"]
    axes.plot(*np.transpose(picture["outline"]), color=OUTLINE, lw=1.2, label="outline")
    base = f"base line, tilt {details['tilt']:.1f} deg"
    axes.plot(*np.transpose(picture["base"]), color=BASE, lw=1.4, ls="--", label=base)
    for side in ("left", "right"):
        if side in picture:
            label = f"{side} flank, {details[side]:.1f} deg"
            axes.plot(*np.transpose(picture[side]), color=FLANK, lw=2.6, label=label)
    left, top, right, bottom = details["crop"]
    if (left, top, right, bottom) != (0, 0, columns, rows):
        axes.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, ls=":", color="white"))
    axes.set(xlim=(0.0, columns), ylim=(rows, 0.0))
    axes.axis("off")
    sd = "" if record["sd"] is None else f" \N{PLUS-MINUS SIGN} {record['sd']:.1f}"
    title = f"{record['value']:.1f}{sd} deg"
    axes.legend(title=title, loc="upper right", fontsize=8, title_fontsize=10, framealpha=0.85)
    return write_atomic(to, mark_png(to, photograph, as_png(figure, DOTS_PER_INCH)))
