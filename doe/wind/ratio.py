"""Impact over fluid threshold, measured and simulated: tables of README.md.

Simulated are nearly uniform beds of quartz: their fluid thresholds (../fluid_threshold/, all forces, gusts
of 20 ms, 1.5 s) and the winds in which the stress of the grains of saturated transport would vanish. Measured
are the impact thresholds of four laboratories, and the curve that Iversen & White (1982) fitted to fluid
thresholds; A = u* / sqrt((s - 1) g d) is interpolated in ln d between sands, measured or simulated.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import exp, hypot, log, nan, sqrt
from pathlib import Path

import numpy as np
from scipy.stats import t as student

from doe.common.beds import found_in as beds_in
from doe.common.beds import pooled, read_beds
from doe.common.tables import lines_of
from doe.fluid_threshold.cases import DIAMETERS, HOLD, LONGER, SIDE, TABLE
from doe.fluid_threshold.page import FLOOR, SHARE, TUNNEL, iversen_white
from doe.wind.answers import FREEDOM, PRIOR_FREEDOM, Sands, sands_of, scale
from doe.wind.blown_sand import (
    AIR,
    ALL_FORCES,
    BARE,
    IN_EVERY_CONTACT,
    MILLI,
    OVER_BED,
    QUARTZ,
    STICKY,
    STRESS_LINE,
    Found,
    Table,
    density_of,
    found_in,
    predicted,
    simulated_thresholds,
)
from doe.wind.extremes import Watch, criterion_threshold
from doe.wind.flux_law import vanishing_wind
from doe.wind.saturated_sand import saturated_thresholds, winds_of
from taichi_erosion.measures.result import Measurement
from taichi_erosion.measures.threshold import CONFIDENCE, Bracket
from taichi_erosion.report.markdown import markdown_table

UNIFORM = "Bagnold 1937"  # of quartz, as the simulated sands
CLASSES = "Chepil 1945"  # classes of sieves, whose largest grains are known
NEAR = 0.05  # of ln d, up to which a simulated sand stands for a diameter [1]
NEEDED = 2  # grains of the criterion of a bed
FIELD = {"fluid": "fluid_threshold_stress", "impact": "impact_threshold_stress"}

Sand = tuple[np.ndarray, np.ndarray]  # diameters [m] and thresholds [m s-1], in order
Variant = Callable[[dict[str, str]], float]  # of a measured sand: its simulated threshold [m s-1]


@dataclass(frozen=True)
class Estimate:
    """A number and its interval."""

    value: float
    low: float
    high: float

    def over(self, other: "Estimate") -> "Estimate":
        """Ratio of two independent numbers, their intervals added as squares of logarithms."""
        value = self.value / other.value
        below = hypot(log(self.value / self.low), log(other.high / other.value))
        above = hypot(log(self.high / self.value), log(other.value / other.low))
        return Estimate(value, value * exp(-below), value * exp(above))

    def __str__(self) -> str:
        return f"{self.value:.3g} ({self.low:.3g} to {self.high:.3g})"


@dataclass(frozen=True)
class Data:
    """Tables from which all else follows."""

    alone: Found  # winds over sands under the drag of a grain alone
    hindered: Found  # and under that of grains among others
    measured: Table
    classes: Table  # largest grains of measured classes
    hopping: Table
    field: Table


def read_data(doe: Path) -> Data:
    """The tables of the studies."""
    return Data(
        found_in(doe / "wind" / "saturated.csv"),
        found_in(doe / "wind" / "drag_laws.csv"),
        lines_of(doe / "measured" / "impact_threshold.csv"),
        lines_of(doe / "wind" / "chepil1945_classes.csv"),
        lines_of(doe / "wind" / "hopping.csv"),
        lines_of(doe / "measured" / "martin_kok2018.csv"),
    )


def tables(doe: Path) -> dict[str, str]:
    """Tables of the page by name."""
    data = read_data(doe)
    return {
        "sands": sand_table(data),
        "ratio": ratio_table(data),
        "ratio_criteria": criteria_table(data),
        "ratio_measured": measured_table(data),
    }


def sand_table(data: Data) -> str:
    """Difference of every simulated sand from the measured one, by what acts and by how the sand is read."""
    ways = variants(data)
    lines = [
        line
        for line in sorted(data.measured, key=lambda line: float(line["diameter [mm]"]))
        if np.isfinite(next(iter(ways.values()))(line))
    ]
    gaps = np.array([[log(way(line) / float(line["value"])) for way in ways.values()] for line in lines])
    rows = [
        (
            line["source"],
            f"{float(line['diameter [mm]']):g}",
            f"{density_of(line):.0f}",
            f"{float(line['value']):.3f}",
            *(f"{100.0 * (exp(gap) - 1.0):+.0f} %" for gap in row),
            f"{100.0 * row[0] ** 2 / np.sum(gaps[:, 0] ** 2):.0f} %",
        )
        for line, row in zip(lines, gaps, strict=True)
    ]
    quartz = np.array([not line["grain_density [g/cm3]"] for line in lines])
    groups = {"all": np.ones_like(quartz), "quartz": quartz, CLASSES: ~quartz}
    for name, kept in groups.items():
        errors = np.sqrt(np.mean(gaps[kept] ** 2, axis=0))
        rows.append((f"rms of ln, {name}", f"{kept.sum()} sands", "", "", *(f"{e:.3f}" for e in errors), ""))
    header = ("source", "d [mm]", "density [kg/m3]", "measured u* [m/s]", *ways)
    return markdown_table((*header, "share of the sum of squares, bare"), rows)


def variants(data: Data) -> dict[str, Variant]:
    """Ways to simulate or to read a measured sand."""
    alone, hindered = saturated_thresholds(data.alone), saturated_thresholds(data.hindered)
    bare = simulated_thresholds(alone, STRESS_LINE)
    largest = {line["diameter [mm]"]: line["largest [mm]"] for line in data.classes}

    def as_stated(sand: Sand) -> Variant:
        return lambda line: predicted(MILLI * float(line["diameter [mm]"]), density_of(line), sand)

    def of_quartz(line: dict[str, str]) -> float:
        return predicted(MILLI * float(line["diameter [mm]"]), QUARTZ, bare)

    def of_largest(line: dict[str, str]) -> float:
        size = line["diameter [mm]"]
        if line["source"] == CLASSES:
            size = largest[size]
        return predicted(MILLI * float(size), density_of(line), bare)

    return {
        "bare": as_stated(bare),
        "drag among others": as_stated(simulated_thresholds(hindered, STRESS_LINE)),
        "adhesion": as_stated(fine_with(alone, STICKY)),
        "adhesion in every contact": as_stated(fine_with(alone, IN_EVERY_CONTACT)),
        "bare, all of quartz": of_quartz,
        "bare, largest grains of a class": of_largest,
    }


def fine_with(thresholds: Found, group: str) -> Sand:
    """Thresholds of the sands that were simulated with an effect, and of coarser ones without."""
    sizes, values = simulated_thresholds(thresholds, STRESS_LINE, group)
    coarse, others = simulated_thresholds(thresholds, STRESS_LINE)
    beyond = coarse > (sizes[-1] if sizes.size else 0.0) * 1.01
    return np.concatenate([sizes, coarse[beyond]]), np.concatenate([values, others[beyond]])


def ratio_table(data: Data) -> str:
    """Impact over fluid threshold against diameter, and how far each is off what is measured."""
    header = (
        *("d [mm]", "measured impact u* [m/s]", "curve of fluid thresholds u* [m/s]", "measured ratio"),
        *("simulated impact u* [m/s]", "impact over measured"),
        *("simulated fluid u* [m/s]", "fluid over the curve"),
        *("simulated ratio", "simulated over measured ratio", "ratio with all forces in the transport"),
    )
    rows = []
    for size in sorted(DIAMETERS):
        theirs, curve = measured_impact(data, size), iversen_white(MILLI * size)
        ours, fluid = simulated_impact(data.hindered, BARE, size), fluid_threshold(size)
        assert ours is not None
        ratio, forced = ours.over(fluid), simulated_impact(data.hindered, ALL_FORCES, size)
        rows.append(
            (
                *(f"{size:g}", f"{theirs:.3f}", f"{curve:.3f}", f"{theirs / curve:.2f}"),
                *(str(ours), f"{ours.value / theirs:.2f}", str(fluid), f"{fluid.value / curve:.2f}"),
                *(str(ratio), f"{ratio.value / (theirs / curve):.2f}"),
                str(forced.over(fluid)) if forced else "",
            )
        )
    return markdown_table(header, rows)


def measured_impact(data: Data, size: float) -> float:
    """Impact threshold of Bagnold's uniform quartz [m s-1], between its diameters."""
    return at_diameter([line for line in data.measured if line["source"] == UNIFORM], "value", size)


def at_diameter(lines: Table, column: str, size: float) -> float:
    """A wind of quartz [m s-1] between the diameters of a table, interpolated as simulated sands are."""
    pairs = sorted((float(line["diameter [mm]"]), float(line[column])) for line in lines)
    sizes, winds = np.array(pairs).T
    return predicted(MILLI * size, QUARTZ, (MILLI * sizes, winds))


def simulated_impact(found: Found, group: str, size: float) -> Estimate | None:
    """Impact threshold of simulated quartz [m s-1]; None beyond the simulated sands."""
    thresholds = saturated_thresholds(found)
    if group not in {name[0] for name in thresholds}:
        return None
    sands = sands_of(thresholds, group)
    return impact_at(sands, MILLI * size)


def impact_at(sands: Sands, diameter: float) -> Estimate | None:
    """Threshold between simulated sands [m s-1] with the interval that their lines leave."""
    gaps = np.abs(sands.log_diameter - log(diameter))
    outside = not sands.log_diameter[0] <= log(diameter) <= sands.log_diameter[-1]
    if outside and gaps.min() > NEAR:
        return None
    weights = sands.weights(np.array([log(diameter)]))[0]
    middle = exp(float(weights @ sands.log_number)) * float(scale(np.array(diameter), QUARTZ))
    quantile = float(student.ppf(0.5 + 0.5 * CONFIDENCE, PRIOR_FREEDOM + FREEDOM))
    half = exp(quantile * sqrt(float(weights**2 @ sands.variance)))
    return Estimate(middle, middle / half, middle * half)


def fluid_threshold(size: float) -> Estimate:
    """Fluid threshold of the beds of a diameter [m s-1]."""
    return estimate(pooled(longer_beds(size)))


def longer_watch(size: float) -> Estimate:
    """Fluid threshold by one percent of the surface grains of a square metre in five seconds [m s-1]."""
    diameter = MILLI * size
    patch = Watch((SIDE * diameter) ** 2, HOLD, NEEDED)
    asked = Watch(FLOOR, TUNNEL, round(SHARE * FLOOR / diameter**2))
    beds = list(longer_beds(size).values())
    return estimate(criterion_threshold("threshold", beds, patch, asked))


def longer_beds(size: float) -> dict[int, Bracket]:
    """Brackets of the beds of a diameter that are watched for longer, by seed."""
    return beds_in(read_beds(TABLE))[f"{LONGER}/{size:g}"]


def estimate(found: Measurement) -> Estimate:
    """A threshold with its interval [m s-1]."""
    ends = found.details["interval"]
    return Estimate(found.value, ends["low"], ends["high"])


def criteria_table(data: Data) -> str:
    """The ratio by other definitions of both thresholds."""
    header = (
        *("d [mm]", "impact by the line of the flux u* [m/s]", "one grain that hops u* [m/s]"),
        *("fluid by 1 % in 5 s u* [m/s]", "over the curve", "stress of the grains over it"),
        *("line of the flux over it", "one grain over it"),
    )
    rows = []
    for size in sorted(DIAMETERS):
        longer, line = longer_watch(size), flux_line(data.hindered, size)
        stress, hop = simulated_impact(data.hindered, BARE, size), at_diameter(data.hopping, OVER_BED, size)
        assert stress is not None
        rows.append(
            (
                f"{size:g}",
                str(line) if line else "none",
                f"{hop:.3f}",
                str(longer),
                f"{longer.value / iversen_white(MILLI * size):.2f}",
                str(stress.over(longer)),
                str(line.over(longer)) if line else "",
                f"{hop / longer.value:.2f}",
            )
        )
    return markdown_table(header, rows)


def flux_line(found: Found, size: float) -> Estimate | None:
    """Wind in which the flux of one simulated sand would vanish [m s-1], as tunnels extrapolate it.

    The sand is that within a twentieth of the diameter, its threshold taken along the root of the diameter.
    """
    for (group, label), winds in winds_of(found).items():
        own = MILLI * float(label) if group == BARE else nan
        if not abs(log(own / (MILLI * size))) <= NEAR:
            continue
        left, borne, flux = np.array(
            [[case[name].value for name in ("bed_stress", "grain_stress", "flux")] for case in winds.values()]
        ).T
        line = vanishing_wind(left, borne, flux, AIR)
        if line is None:
            return None
        root = sqrt(MILLI * size / own)
        quantile = float(student.ppf(0.5 + 0.5 * CONFIDENCE, len(winds) - 2))
        half = exp(quantile * 0.5 * (line.high - line.low) / line.middle)
        return Estimate(root * line.middle, root * line.middle / half, root * line.middle * half)
    return None


def measured_table(data: Data) -> str:
    """Measured impact thresholds over the curve of fluid thresholds, by laboratory; ratios of the field."""
    header = (
        *("source", "sands", "d [mm]", "impact over fluid: mean"),
        *("smallest", "largest", "sd of single sands"),
    )
    sizes, _ = simulated_thresholds(saturated_thresholds(data.alone), STRESS_LINE)
    lines = [
        line
        for line in data.measured
        if 0.99 * sizes[0] <= MILLI * float(line["diameter [mm]"]) <= 1.01 * sizes[-1]
    ]
    sources = list(dict.fromkeys(line["source"] for line in lines))
    groups = {source: [line for line in lines if line["source"] == source] for source in sources}
    groups["all, over the curve"] = lines
    rows = [ratio_row(name, group, over_curve(group)) for name, group in groups.items()]
    largest = {line["diameter [mm]"]: line["largest [mm]"] for line in data.classes}
    classes = [line | {"diameter [mm]": largest[line["diameter [mm]"]]} for line in groups[CLASSES]]
    rows.append(ratio_row(f"{CLASSES}, largest grains of a class", classes, over_curve(classes)))
    return markdown_table(header, [*rows, ratio_row("Martin & Kok 2018, field", *field_ratios(data.field))])


def over_curve(lines: Sequence[Mapping[str, str]]) -> list[float]:
    """Measured impact thresholds over the curve of fluid thresholds of the same grains [1]."""
    return [
        float(line["value"]) / iversen_white(MILLI * float(line["diameter [mm]"]), density_of(dict(line)))
        for line in lines
    ]


def field_ratios(lines: Table) -> tuple[list[dict[str, str]], list[float]]:
    """Sites by the first minute-long rows, and their ratios of friction velocities [1]."""
    plain = [line for line in lines if not line["time_of_day [h]"] and line["averaging_interval [s]"] == "60"]
    stresses: dict[str, dict[str, float]] = {}
    for line in plain:
        stresses.setdefault(line["group"], {})[line["observable"]] = float(line["value"])
    ratios = [sqrt(one[FIELD["impact"]] / one[FIELD["fluid"]]) for one in stresses.values()]
    return [line for line in plain if line["observable"] == FIELD["fluid"]], ratios


def ratio_row(name: str, lines: Sequence[Mapping[str, str]], ratios: Sequence[float]) -> tuple[str, ...]:
    """A row of the table of measured ratios."""
    sizes = [float(line["diameter [mm]"]) for line in lines]
    span = f"{min(sizes):g} to {max(sizes):g}" if len(set(sizes)) > 1 else f"{sizes[0]:g}"
    spread = f"{np.std(ratios, ddof=1):.3f}" if len(ratios) > 1 else ""
    cells = (f"{each:.2f}" for each in (np.mean(ratios), min(ratios), max(ratios)))
    return (name, str(len(ratios)), span, *cells, spread)
