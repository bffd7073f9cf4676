"""Sand under wind against measurements: impact thresholds of many diameters, flux at many winds."""

from collections.abc import Sequence
from math import isfinite, nan, sqrt
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from doe.common.cases import Found, Row, by_case, read_rows
from doe.wind.flux_law import CUBIC, LINEAR, flux_power
from taichi_erosion.measures.threshold import Bracket, flux_intercept
from taichi_erosion.report.markdown import magnitude, markdown_table

STRESS_LINE = "impact_threshold_stress"  # of steady winds
IMPACT = {
    "impact_threshold": "flux below 1 %",
    "impact_threshold_linear": "line to no flux",
    STRESS_LINE: "stress of the grains to none",
}
HOPPING = "one grain that hops"
OVER_BED = "u_star over a bed [m/s]"  # its column of hopping.csv
SPLASH = {
    "rebound_share": "landings that rebound",
    "rebound_speed": "speed after a rebound over that before",
    "ejecta_share": "grains ejected per landing",
}
BARE = "impact"  # group of the cases without any effect
STICKY = "adhesion"  # of those with dry adhesion, which the contacts of a grain share
ALL_FORCES = "all_forces"  # of those with all forces of a fluid threshold
IN_EVERY_CONTACT = "adhesion_in_every_contact"  # of those with the pull of a whole grain in every contact
ADHESIONS = {
    "without adhesion": BARE,
    "with adhesion": STICKY,
    "with adhesion in every contact": IN_EVERY_CONTACT,
}
# relative differences up to which a model holds: those between laboratories
HOLDS = {"impact": 0.10, "flux": 0.20}
QUARTZ, AIR = 2650.0, 1.225  # kg m-3, of the simulated grains and their air
GRAVITY = 9.81  # m s-2
CUBE = 1e3  # kg m-3 of g cm-3
MILLI = 1e-3  # of a metre, a kilogram
OURS, THEIRS = "#1f4e79", "#c0392b"
MARKERS = "osv^D"

Table = Sequence[dict[str, str]]


def found_in(table: Path) -> Found:
    """Rows of a table; none where it has not been made yet."""
    return by_case(read_rows(table))


def shown(value: float, half: float = nan, digits: int = 3) -> str:
    """A number, cut at the second figure of half of its interval where that is known."""
    if not isfinite(value):
        return "none"
    if not isfinite(half) or half <= 0.0:
        return f"{value:.{digits}g}"
    places = max(0, 1 - magnitude(half))
    return f"{value:.{places}f} ± {half:.{places}f}"


def simulated_thresholds(found: Found, name: str, group: str = BARE) -> tuple[np.ndarray, np.ndarray]:
    """Diameters [m] and thresholds [m s-1] of one way to read them, in order."""
    pairs = sorted(
        (MILLI * float(label), case[name].value)
        for (which, label), case in found.items()
        if which == group and name in case and isfinite(case[name].value)
    )
    table = np.array(pairs).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def predicted(diameter: float, density: float, sand: tuple[np.ndarray, np.ndarray]) -> float:
    """Threshold of a measured sand [m s-1]: between simulated diameters, with the root of the density.

    u* / sqrt((s - 1) g d) is interpolated in ln d; NaN outside the simulated diameters.
    """
    simulated, thresholds = sand
    if len(simulated) < 2 or not simulated[0] * 0.99 <= diameter <= simulated[-1] * 1.01:
        return nan
    scale = np.sqrt((QUARTZ / AIR - 1.0) * GRAVITY * simulated)
    ratio = float(np.interp(np.log(diameter), np.log(simulated), thresholds / scale))
    return ratio * sqrt((density / AIR - 1.0) * GRAVITY * diameter)


def density_of(line: dict[str, str]) -> float:
    """Density of a measured sand [kg m-3]; quartz where none is stated."""
    stated = line["grain_density [g/cm3]"]
    return CUBE * float(stated) if stated else QUARTZ


def impact_table(found: Found, measured: Table, ways: Sequence[str] = tuple(IMPACT)) -> str:
    """Every measured impact threshold beside the simulated ones, read in some ways."""
    header = ["source", "d [mm]", "density [kg/m3]", "measured u* [m/s]"]
    for name in ways:
        header += [f"simulated, {IMPACT[name]}", "difference", "model"]
    sands = [simulated_thresholds(found, name) for name in ways]
    rows = []
    for line in sorted(measured, key=lambda line: float(line["diameter [mm]"])):
        size, density, value = float(line["diameter [mm]"]), density_of(line), float(line["value"])
        cells = [line["source"], f"{size:g}", f"{density:.0f}", f"{value:.3f} ± {float(line['sd']):.3f}"]
        for sand in sands:
            cells += judged(predicted(MILLI * size, density, sand), value, HOLDS["impact"])
        rows.append(cells)
    return markdown_table(header, rows)


def judged(simulated: float, measured: float, limit: float) -> list[str]:
    """A simulated number, how it differs, and whether a model holds that differs so."""
    error = simulated / measured - 1.0
    if not isfinite(error):
        return ["", "", "not simulated"]
    return [shown(simulated), f"{100.0 * error:+.0f} %", "holds" if abs(error) <= limit else "**fails**"]


def scaling_table(found: Found, hopping: Table) -> str:
    """Simulated thresholds against the root of the diameter, beside one grain that hops in the same wind."""
    alone = {line["diameter [mm]"]: float(line[OVER_BED]) for line in hopping}
    ways = (*IMPACT.values(), HOPPING)
    header = ("d [mm]", "seeds", *(f"u* [m/s], {way}" for way in ways), *(f"A, {way}" for way in ways))
    rows = []
    plain = {label: case for (group, label), case in found.items() if group == BARE}
    for label in sorted({*plain, *alone}, key=float):
        case = plain.get(label, {})
        values = [case[name].value if name in case else nan for name in IMPACT]
        values.append(alone.get(label, nan))
        scale = sqrt((QUARTZ / AIR - 1.0) * GRAVITY * MILLI * float(label))
        cells = [threshold_cell(case, name) for name in IMPACT] + [known(values[-1])]
        seeds = str(next(iter(case.values())).n) if case else "not run"
        rows.append((label, seeds, *cells, *(known(value / scale) for value in values)))
    return markdown_table(header, rows)


def known(value: float) -> str:
    """A number, nothing where there is none."""
    return shown(value) if isfinite(value) else ""


def adhesion_table(found: Found, measured: Table) -> str:
    """Fine sands without and with dry adhesion, and how far all are from what was measured of them."""
    ways = [(n, g) for n in IMPACT for g in ADHESIONS.values() if simulated_thresholds(found, n, g)[0].size]
    words = {group: which for which, group in ADHESIONS.items()}
    header = ("d [mm]", *(f"u* [m/s] {words[group]}, {IMPACT[name]}" for name, group in ways))
    labels = sorted({label for group, label in found if group in (STICKY, IN_EVERY_CONTACT)}, key=float)
    if not labels:
        return "Not simulated yet.\n"
    rows = [[label, *(threshold_cell(found.get((g, label), {}), n) for n, g in ways)] for label in labels]
    errors = [shown(rms_error(found, measured, *way)) for way in ways]
    return markdown_table(header, [*rows, ["rms of ln simulated / measured", *errors]])


def threshold_cell(case: dict[str, Row], name: str) -> str:
    """A threshold with its standard error."""
    return shown(case[name].value, case[name].standard_error) if name in case else ""


def rms_error(found: Found, measured: Table, name: str, group: str) -> float:
    """Root mean square of ln(simulated / measured) [1] over the measured sands between simulated ones.

    Only diameters count that were simulated with each adhesion that was, and without.
    """
    sizes, values = simulated_thresholds(found, name, group)
    each = [set(simulated_thresholds(found, name, which)[0]) for which in ADHESIONS.values()]
    kept = np.isin(sizes, list(set.intersection(*filter(None, each))))
    sand = (sizes[kept], values[kept])
    gaps = [
        np.log(predicted(MILLI * float(line["diameter [mm]"]), density_of(line), sand) / float(line["value"]))
        for line in measured
    ]
    within = [gap for gap in gaps if isfinite(gap)]
    return float(np.sqrt(np.mean(np.square(within)))) if within else nan


def flux_pairs(found: Found, measured: Table) -> list[tuple[float, float, float, Row | None]]:
    """Friction velocity [m s-1], measured flux and its sd [kg m-1 s-1], simulated row."""
    by_wind = {float(label): case.get("flux") for (_, label), case in found.items()}
    return [
        (wind, MILLI * float(line["value"]), MILLI * float(line["sd"]), by_wind.get(wind))
        for line in measured
        if (wind := float(line["u_star [m/s]"])) > 0.0
    ]


def flux_table(found: Found, measured: Table) -> str:
    """Measured and simulated flux at every wind, and how far the transient has gone."""
    header = (
        *("u* [m/s]", "measured [g/(m s)]", "simulated [g/(m s)]", "difference", "model"),
        *("height of the flux [mm]", "stress of the air over the bed [Pa]", "of the grains [Pa]"),
        *("both over that of the wind", "remark"),
    )
    rows = []
    for wind, value, sd, row in flux_pairs(found, measured):
        cells = [f"{wind:g}", f"{value / MILLI:.1f} ± {sd / MILLI:.1f}"]
        if row is not None:
            cells += [shown(row.value / MILLI), *judged(row.value, value, HOLDS["flux"])[1:]]
            cells += [*stress_cells(found["flux", f"{wind:g}"], AIR * wind**2), row.note]
        else:
            cells.append("not run")
        rows.append(cells + [""] * (len(header) - len(cells)))
    return markdown_table(header, rows)


def stress_cells(case: dict[str, Row], stress: float) -> list[str]:
    """Height of the flux, the stresses of air and grains, and their sum over that of the wind [Pa]."""
    parts = [case[name].value for name in ("bed_stress", "grain_stress")]
    height = case["flux_height"].value / MILLI
    return [shown(height), *map(shown, parts), f"{sum(parts) / stress:.2f}"]


def splash_table(found: Found) -> str:
    """What becomes of grains that land, wind by wind."""
    header = ("u* [m/s]", *(f"{words} [1]" for words in SPLASH.values()))
    rows = []
    for (_, label), case in sorted(found.items(), key=lambda item: float(item[0][1])):
        if SPLASH.keys() <= case.keys():
            rows.append((label, *(shown(case[n].value, case[n].standard_error) for n in SPLASH)))
    return markdown_table(header, rows)


def line_table(found: Found, measured: Table, threshold: Bracket | None = None) -> str:
    """Straight lines of flux against stress: where they start, how steep they are, how straight.

    `threshold` is that of saturated transport [m s-1], with which the power of the wind is told.
    """
    header = (
        *("flux", "u* of no flux [m/s]", "stress there [Pa]", "dQ/dtau [s]", "R^2 of the line"),
        *("power m", "p of m = 0, linear", "p of m = 1, cube of the wind"),
    )
    pairs = flux_pairs(found, measured)
    series = {
        "measured": [(wind, value) for wind, value, _, _ in pairs],
        "simulated": [(wind, row.value) for wind, _, _, row in pairs if row is not None],
    }
    rows = []
    for name, points in series.items():
        if len(points) < 3:
            continue
        stress, flux = AIR * np.array(points)[:, 0] ** 2, np.array(points)[:, 1]
        straight = float(np.corrcoef(stress, flux)[0, 1]) ** 2
        start = flux_intercept(points)
        middle = start.middle if start is not None else nan
        slope = float(np.polyfit(stress, flux, 1)[0])
        line = (name, shown(middle), shown(AIR * middle**2), shown(slope), f"{straight:.3f}")
        rows.append((*line, *power_cells(points, threshold)))
    return markdown_table(header, rows)


def power_cells(points: Sequence[tuple[float, float]], threshold: Bracket | None) -> tuple[str, ...]:
    """Power m of flux against wind, and the chances of both laws; empty where it cannot be told."""
    winds, flux = np.array(points).T
    power = None if threshold is None else flux_power(winds, flux, threshold)
    if power is None:
        return ("", "", "")
    chances = (f"{power.chance(law):.2g}" for law in (LINEAR, CUBIC))
    return (f"{power.value:.2f} ± {power.error:.2f}", *chances)


def draw_impact(found: Found, measured: Table, hopping: Table, file: Path) -> None:
    """Thresholds against diameter, both axes logarithmic."""
    figure, frame = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    sources = list(dict.fromkeys(line["source"] for line in measured))
    for source, marker in zip(sources, MARKERS, strict=False):
        points = [line for line in measured if line["source"] == source]
        frame.errorbar(
            [float(line["diameter [mm]"]) for line in points],
            [float(line["value"]) for line in points],
            [float(line["sd"]) for line in points],
            fmt=marker,
            color=THEIRS,
            mfc="none",
            label=source,
        )
    for name, style in zip(IMPACT, ("o:", "s--", "D-"), strict=True):
        sizes, values = simulated_thresholds(found, name)
        frame.plot(sizes / MILLI, values, style, color=OURS, label=f"simulated, {IMPACT[name]}")
    sizes, values = simulated_thresholds(found, STRESS_LINE, STICKY)
    label = f"simulated, {IMPACT[STRESS_LINE]}, with adhesion"
    frame.plot(sizes / MILLI, values, "D", color=OURS, mfc="none", ms=9, label=label)
    alone = [(float(line["diameter [mm]"]), float(line[OVER_BED])) for line in hopping]
    frame.plot(*zip(*alone, strict=True), "-.", color=OURS, label=HOPPING)
    frame.set(xscale="log", yscale="log", xlabel="diameter [mm]", ylabel="impact threshold u* [m/s]")
    for set_formatter in (frame.xaxis.set_major_formatter, frame.yaxis.set_major_formatter):
        set_formatter("{x:g}")
    frame.yaxis.set_minor_formatter("{x:g}")
    frame.legend(frameon=False, fontsize=8)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def draw_flux(found: Found, measured: Table, file: Path) -> None:
    """Flux against the stress of the wind."""
    figure, frame = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    pairs = flux_pairs(found, measured)
    wind, value, sd = (np.array([pair[k] for pair in pairs]) for k in range(3))
    frame.errorbar(
        AIR * wind**2, value / MILLI, sd / MILLI, fmt="o", color=THEIRS, mfc="none", label="measured"
    )
    ours = [(AIR * u**2, row.value / MILLI, row.sd / MILLI) for u, _, _, row in pairs if row is not None]
    if ours:
        stress, flux, spread = np.array(ours).T
        frame.errorbar(stress, flux, spread, fmt="s", color=OURS, label="simulated")
    frame.set(xlabel="stress of the wind [Pa]", ylabel="flux [g/(m s)]", xlim=(0.0, None), ylim=(0.0, None))
    frame.legend(frameon=False)
    figure.savefig(file, dpi=110)
    plt.close(figure)
