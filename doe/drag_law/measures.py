"""Measures of sand under wind under both laws of drag: what was simulated, and how far it is off.

A measure holds, by law, the logarithms of the simulated numbers with their errors, and a function from these
to the misfit ln(simulated / wanted) of each of its rows. Errors: of fluid thresholds from the interval of the
beds, of impact thresholds those of `wind.answers`, of a flux the standard error of three beds (weak winds, in
which few grains fly, scatter more), of a stress, of which there is one run, the scatter of single beds.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import log, nan

import numpy as np

from doe.common.cases import ROOT, Row
from doe.drag_law.claims import ALONE, HINDERED
from doe.fluid_threshold import cases as beds
from doe.fluid_threshold.page import found_in as brackets_of
from doe.fluid_threshold.page import iversen_white, pooled
from doe.wind.answers import relative_variance, sands_of
from doe.wind.blown_sand import (
    BARE,
    MILLI,
    QUARTZ,
    STRESS_LINE,
    Found,
    density_of,
    flux_pairs,
    found_in,
    lines_of,
    predicted,
)
from doe.wind.law_table import fluxes_of
from doe.wind.page import FLUID, half_interval
from doe.wind.run import DIAMETERS
from doe.wind.saturated_sand import saturated_thresholds, wind_of, winds_of
from taichi_erosion.core.setup import Floats

DOE = ROOT / "doe"
TABLES = {ALONE: ("flux", "saturated", "fluid"), HINDERED: ("drag_laws",)}  # of doe/wind
KINDS = {ALONE: beds.WITH, HINDERED: beds.HINDERED}  # of beds in doe/fluid_threshold
SIZES = tuple(sorted(beds.DIAMETERS))  # mm
SANDS = tuple(f"{1e3 * size:g}" for size in sorted(DIAMETERS))  # mm
COARSE = ("0.24", "0.5", "0.7", "1")  # mm
SOIL = ("forces", "all forces")
TUNNEL = 6.9  # m s-1, in which the published soil starts
NORMAL = 1.96  # standard deviations in half of a 95 % interval
RATIO, RATIOS = 0.82, (0.7, 0.95)  # impact over fluid threshold, measured and asked for
FIFTH, SEVENTH, TENTH = (0.8, 1.2), (0.85, 1.15), 0.10  # asked for


@dataclass(frozen=True)
class Numbers:
    """Simulated numbers under one law."""

    logs: Floats  # NaN where one was not simulated
    errors: Floats  # of the logarithms


@dataclass(frozen=True)
class Measure:
    """One measure under both laws."""

    name: str
    rows: tuple[str, ...]
    simulated: Mapping[str, Numbers]
    misfits: Callable[[Floats], Floats]  # ln(simulated / wanted) of the rows, from the logarithms
    band: tuple[float, float] | None = None  # of simulated over wanted, asked of every row
    largest: float | None = None  # asked of the root of the mean square


def simulated_under(law: str) -> Found:
    """Cases of a law in doe/wind."""
    found: Found = {}
    for name in TABLES[law]:
        found |= found_in(DOE / "wind" / f"{name}.csv")
    return found


def fluid_numbers(law: str) -> Numbers:
    """Fluid thresholds by diameter."""
    found = brackets_of(beds.read_beds())
    values, errors = [], []
    for size in SIZES:
        whole = pooled(found, f"{KINDS[law]}/{size:g}")
        ends = whole.details["interval"] if whole is not None else {"low": nan, "high": nan}
        values.append(log(whole.value) if whole is not None else nan)
        errors.append(np.log(ends["high"] / ends["low"]) / (2.0 * NORMAL))
    return Numbers(np.array(values), np.array(errors))


def impact_numbers(law: str) -> Numbers:
    """Thresholds of saturated transport by diameter."""
    thresholds = saturated_thresholds(simulated_under(law))
    variance = dict(zip(sands_in(thresholds), sands_of(thresholds, BARE).variance, strict=True))
    values = [row_log(thresholds.get((BARE, sand), {}).get(STRESS_LINE)) for sand in SANDS]
    errors = [float(variance.get(sand, nan)) ** 0.5 for sand in SANDS]
    return Numbers(np.array(values), np.array(errors))


def sands_in(thresholds: Found) -> list[str]:
    """Diameters [mm] of the bare sands, in their order."""
    return sorted((label for group, label in thresholds if group == BARE), key=float)


def row_log(row: Row | None) -> float:
    """Logarithm of a row's value; NaN without one."""
    return nan if row is None else log(row.value)


def both(numbers: Callable[[str], Numbers]) -> dict[str, Numbers]:
    """Numbers under both laws."""
    return {law: numbers(law) for law in TABLES}


def fluid_measure() -> Measure:
    """Fluid threshold against the curve fitted to tunnels."""
    wanted = np.log([iversen_white(MILLI * size) for size in SIZES])
    rows = tuple(f"{size:g} mm" for size in SIZES)
    return Measure("fluid threshold", rows, both(fluid_numbers), lambda logs: logs - wanted, band=FIFTH)


def impact_measure() -> Measure:
    """Impact threshold of saturated transport against measured sands."""
    lines = [line for line in lines_of(DOE / "measured" / "impact_threshold.csv") if inside(line)]
    lines = sorted(lines, key=lambda line: float(line["diameter [mm]"]))
    rows = tuple(f"{line['source']}, {float(line['diameter [mm]']):g} mm" for line in lines)

    def misfits(logs: Floats) -> Floats:
        return np.array([log(over_bed(line, logs) / float(line["value"])) for line in lines])

    return Measure("impact threshold", rows, both(impact_numbers), misfits, largest=TENTH)


def inside(line: dict[str, str]) -> bool:
    """Whether a measured sand lies between simulated ones."""
    return bool(np.isfinite(over_bed(line, np.zeros(len(SANDS)))))


def over_bed(line: dict[str, str], logs: Floats) -> float:
    """Threshold of a measured sand [m s-1]."""
    size, density = MILLI * float(line["diameter [mm]"]), density_of(line)
    return predicted(size, density, (MILLI * np.array(SANDS, dtype=float), np.exp(logs)))


def ratio_measure() -> Measure:
    """Impact over fluid threshold."""

    def numbers(law: str) -> Numbers:
        parts = (fluid_numbers(law), impact_numbers(law))
        return Numbers(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("logs", "errors")))

    def misfits(logs: Floats) -> Floats:
        sand = (MILLI * np.array(SANDS, dtype=float), np.exp(logs[len(SIZES) :]))
        impact = np.log([predicted(MILLI * size, QUARTZ, sand) for size in SIZES])
        return impact - logs[: len(SIZES)] - log(RATIO)

    rows = tuple(f"{size:g} mm" for size in SIZES)
    band = (RATIOS[0] / RATIO, RATIOS[1] / RATIO)
    return Measure("impact over fluid threshold", rows, both(numbers), misfits, band=band)


def flux_measure() -> Measure:
    """Flux against that of Creyssels et al."""
    measured = lines_of(DOE / "measured" / "flux_creyssels2009.csv")
    pairs = {law: flux_pairs(fluxes_of(simulated_under(law)), measured) for law in TABLES}

    def numbers(law: str) -> Numbers:
        found = [row for *_, row in pairs[law]]
        errors = [nan if row is None else relative_variance(row) ** 0.5 for row in found]
        return Numbers(np.array([row_log(row) for row in found]), np.array(errors))

    wanted = np.log([value for _, value, _, _ in pairs[ALONE]])
    rows = tuple(f"{wind:g} m/s" for wind, *_ in pairs[ALONE])
    return Measure("flux", rows, both(numbers), lambda logs: logs - wanted, band=FIFTH)


def bed_scatter() -> float:
    """Scatter of the stress of the air at the bed between single beds, over the mean [1]."""
    rows = [case["bed_stress"] for law in TABLES for case in fluxes_of(simulated_under(law)).values()]
    return float(np.sqrt(np.mean([(row.sd / row.value) ** 2 for row in rows])))


def stress_measure() -> Measure:
    """Stress of the air at the bed against its mean over the winds."""
    winds = {law: {sand: stresses(simulated_under(law), sand) for sand in COARSE} for law in TABLES}

    def numbers(law: str) -> Numbers:
        logs = np.concatenate([np.log(list(winds[law][sand].values()) or [nan] * 4) for sand in COARSE])
        return Numbers(logs, np.full(logs.size, bed_scatter()))

    def misfits(logs: Floats) -> Floats:
        table = logs.reshape(len(COARSE), -1)
        return (table - table.mean(axis=1, keepdims=True)).ravel()

    rows = tuple(f"{sand} mm, {wind:g} m/s" for sand in COARSE for wind in winds[ALONE][sand])
    return Measure("stress of the air at the bed", rows, both(numbers), misfits, band=SEVENTH)


def stresses(found: Found, sand: str) -> dict[float, float]:
    """Stress of the air at the bed [Pa] by friction velocity [m s-1] of one bare sand."""
    winds = winds_of(found).get((BARE, sand), {})
    pairs = {wind_of(label): case["bed_stress"].value for (_, label), case in winds.items()}
    return dict(sorted(pairs.items()))


def soil_measure() -> Measure:
    """Fluid threshold of the published soil against the tunnel's."""
    tunnel = lines_of(DOE / "tunnel_map" / "map.csv")
    speeds, felt = (
        np.array([float(line[name]) for line in tunnel]) for name in ("speed", "friction_velocity")
    )
    wanted = np.log([np.interp(TUNNEL, speeds, felt)])

    def numbers(law: str) -> Numbers:
        row = simulated_under(law).get(SOIL, {}).get(FLUID)
        error = nan if row is None else half_interval(row) / row.value / NORMAL
        return Numbers(np.array([row_log(row)]), np.array([error]))

    return Measure("published soil", (f"tunnel, {TUNNEL:g} m/s",), both(numbers), lambda logs: logs - wanted)


def measures() -> list[Measure]:
    """All measures, in the order of the rule."""
    makers = (fluid_measure, impact_measure, ratio_measure, flux_measure, stress_measure, soil_measure)
    return [make() for make in makers]
