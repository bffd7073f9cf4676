"""Table of the thresholds of beds of sand against diameter, from beds.csv."""

from collections.abc import Mapping, Sequence
from math import exp, log, sqrt
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import scipy
import scipy.stats

from doe.common.beds import found_in, paired_ratio, read_beds, shown
from doe.common.beds import pooled as pool
from doe.common.cases import ROOT
from doe.common.pages import write_pages
from doe.common.tables import read_table
from doe.fluid_threshold import cases
from doe.fluid_threshold.balance import QUESTIONS, SHARES, SIZES, TABLE, Start
from doe.fluid_threshold.cases import BARE, FOLDER, LONGER, MILLI, SLOW, WALL, WALL_ALONE
from doe.wind.blown_sand import OURS, THEIRS
from taichi_erosion.measures.result import Measurement
from taichi_erosion.measures.threshold import Bracket
from taichi_erosion.report.markdown import markdown_table
from tests.verification.reference.hopping import GRAVITY

PAGE = FOLDER / "README.md"
PICTURE = ROOT / "docs" / "pictures" / "fluid_threshold.png"
GUSTS = {  # kinds of cases that differ in gusts and in the law of drag
    LONGER: "gusts of 20 ms in every wind",
    WALL: "gusts as short as near a wall",
    SLOW: "three times as long",
    WALL_ALONE: "as short as near a wall, drag of a grain alone",
}
DRAWN = {  # kind: form and way of its marks, whether they are filled
    WALL: ("o", 1.0, True),
    WALL_ALONE: ("s", 1.025, False),
    LONGER: ("^", 0.975, False),
}
VISCOSITY = 1.46e-5  # m2 s-1, of the scene's air
COHESION = 6e-7  # kg m^0.5 s-2, of Iversen & White
SHARE, TUNNEL = 0.01, 5.0  # share of the surface grains; s of a tunnel's watch
FLOOR = 1.0  # m2

Found = Mapping[str, Mapping[int, Bracket]]  # brackets by case and seed


def iversen_white(
    diameter: float, density: float = 2650.0, air: float = 1.225, cohesion: float = COHESION
) -> float:
    """Fluid threshold [m s-1] of Iversen & White (1982), fitted to tunnels; diameter in m, densities kg m-3.

    u* = A sqrt(s g d), A by ranges of Re* = u* d / nu and with K = 0.006 g cm^0.5 s-2 for cohesion

        A = 0.2 f / sqrt(1 + 2.5 Re*)                          Re* < 0.3
        A = 0.129 f / sqrt(1.928 Re*^0.092 - 1)                Re* < 10
        A = 0.12 f (1 - 0.0858 exp(-0.0617 (Re* - 10)))        else,     f = sqrt(1 + K / (rho_s g d^2.5))
    """
    factor = sqrt(1.0 + cohesion / (density * GRAVITY * diameter**2.5))

    def excess(wind: float) -> float:
        reynolds = wind * diameter / VISCOSITY
        if reynolds < 0.3:
            number = 0.2 / sqrt(1.0 + 2.5 * reynolds)
        elif reynolds < 10.0:
            number = 0.129 / sqrt(1.928 * reynolds**0.092 - 1.0)
        else:
            number = 0.12 * (1.0 - 0.0858 * exp(-0.0617 * (reynolds - 10.0)))
        return wind - factor * number * sqrt(density / air * GRAVITY * diameter)

    return scipy.optimize.root_scalar(excess, bracket=(0.01, 5.0)).root


def pooled(found: Found, case: str) -> Measurement | None:
    """Threshold of the beds of a case; None where it has no beds."""
    return pool(found[case]) if case in found else None


def diameters(found: Found) -> list[float]:
    """Diameters that were simulated with all forces [mm]."""
    return sorted({float(case.split("/")[1]) for case in found if not case.startswith(f"{BARE}/")})


def kind_cells(found: Found, case: str, curve: float) -> list[str]:
    """Threshold of a case, and its difference from the curve [m s-1]."""
    if (whole := pooled(found, case)) is None:
        return ["", ""]
    return [shown(whole), f"{100.0 * (whole.value / curve - 1.0):+.0f} %"]


def gust_table(found: Found) -> str:
    """Threshold of every diameter by the law of gusts, beside the curve; then how far a law is off it."""
    header = ["d [mm]", "Iversen & White: u* [m/s]"]
    for law in GUSTS.values():
        header += [f"{law}: u* [m/s]", "difference"]
    header.append("near a wall over 20 ms, bed by bed")
    rows = []
    for size in diameters(found):
        curve = iversen_white(MILLI * size)
        cells = [f"{size:g}", f"{curve:.3f}"]
        for kind in GUSTS:
            cells += kind_cells(found, f"{kind}/{size:g}", curve)
        rows.append([*cells, gust_ratio(found, [size])])
    below = [("rms of ln(simulated / curve)", rms_cell), ("power of d in simulated / curve", trend_cell)]
    for label, cell in below:
        ends = [part for kind in GUSTS for part in (cell(found, kind), "")]
        rows.append([label, "", *ends, gust_ratio(found, diameters(found)) if cell is rms_cell else ""])
    return markdown_table(header, rows)


def gust_ratio(found: Found, sizes: Sequence[float]) -> str:
    """Threshold under gusts as short as near a wall over that under gusts of 20 ms, beds of both."""
    return ratio_of(*(beds_of_sizes(found, kind, sizes) for kind in (WALL, LONGER)))


def off_curve(found: Found, kind: str) -> tuple[list[float], list[float]]:
    """Ln diameter [mm] and ln threshold over the curve of every bed of a kind."""
    beds = beds_of_sizes(found, kind, diameters(found))
    sizes = [log(size) for size, _ in beds]
    values = [
        0.5 * log(one.low * one.high) - log(iversen_white(MILLI * size)) for (size, _), one in beds.items()
    ]
    return sizes, values


def rms_cell(found: Found, kind: str) -> str:
    """Root mean square over the diameters of a kind; empty where some were not simulated."""
    sizes, values = off_curve(found, kind)
    means = [np.mean([v for s, v in zip(sizes, values, strict=True) if s == size]) for size in set(sizes)]
    return f"{np.sqrt(np.mean(np.square(means))):.2f}" if len(means) == len(diameters(found)) else ""


def trend_cell(found: Found, kind: str) -> str:
    """Slope of ln threshold over the curve along ln diameter, with its standard error over beds; likewise."""
    sizes, values = off_curve(found, kind)
    if len(set(sizes)) < len(diameters(found)):
        return ""
    slope, _, _, _, error = scipy.stats.linregress(sizes, values)
    return f"{slope:+.2f} ± {error:.2f}"


def balance_table(starts: Sequence[Start]) -> str:
    """Winds in which shares of the surface grains can tip, and over the curve without its cohesion."""
    known = {(one.question, one.diameter, one.share): one.wind for one in starts}
    header = ["what acts", "share of the surface grains", *(f"{size:g} mm: u* [m/s]" for size in SIZES)]
    plain = [iversen_white(MILLI * size, cohesion=0.0) for size in SIZES]
    rows = [["Iversen & White", "", *(f"{iversen_white(MILLI * size):.3f}" for size in SIZES)]]
    rows.append(["the same without cohesion", "", *(f"{wind:.3f}" for wind in plain)])
    for asked in QUESTIONS if starts else ():
        for share in SHARES:
            winds = [known[asked.name, size, share] for size in SIZES]
            rows.append([asked.name, f"{100.0 * share:g} %", *(f"{wind:.3f}" for wind in winds)])
            if asked.name == QUESTIONS[0].name:
                ratios = [f"{wind / bare:.2f}" for wind, bare in zip(winds, plain, strict=True)]
                rows.append(["over the curve without cohesion", "", *ratios])
            if asked.wall:
                ratios = [f"{w / iversen_white(MILLI * d):.2f}" for w, d in zip(winds, SIZES, strict=True)]
                rows.append(["over the curve", "", *ratios])
    return markdown_table(header, rows)


def ratio_of(above: Mapping[tuple[float, int], Bracket], below: Mapping[tuple[float, int], Bracket]) -> str:
    """Ratio of thresholds of the same beds with its interval; empty for fewer than two beds."""
    ratio, factor, count = paired_ratio(above, below)
    return f"{ratio:.2f} ({ratio / factor:.2f} to {ratio * factor:.2f})" if count > 1 else ""


def beds_of_sizes(found: Found, kind: str, sizes: Sequence[float]) -> dict[tuple[float, int], Bracket]:
    """Brackets of one kind of cases by diameter [mm] and seed."""
    return {(size, seed): one for size in sizes for seed, one in found.get(f"{kind}/{size:g}", {}).items()}


def draw(found: Found, file: Path) -> None:
    """Thresholds against diameter beside the curve, with their intervals."""
    figure, frame = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
    grid = np.geomspace(0.05, 1.5, 100)
    curve = [iversen_white(MILLI * size) for size in grid]
    frame.plot(grid, curve, "-", color=THEIRS, label="Iversen & White (1982)")
    frame.fill_between(
        grid, 0.8 * np.array(curve), 1.2 * np.array(curve), color=THEIRS, alpha=0.12, label="± 20 %"
    )
    for kind, (marker, shift, filled) in DRAWN.items():
        points = [(size, one) for size in diameters(found) if (one := pooled(found, f"{kind}/{size:g}"))]
        if points:
            sizes, values = np.array([size for size, _ in points]), np.array([one.value for _, one in points])
            ends = np.array([[one.details["interval"][end] for _, one in points] for end in ("low", "high")])
            frame.errorbar(
                shift * sizes, values, np.abs(ends - values), fmt=f"{marker}-" if filled else marker,
                color=OURS, mfc=OURS if filled else "none", lw=1.0, alpha=1.0 if filled else 0.6,
                label=f"beds, {GUSTS[kind]}",
            )  # fmt: skip
    frame.set(xscale="log", yscale="log", xlabel="diameter [mm]", ylabel="fluid threshold u* [m/s]")
    for axis in (frame.xaxis, frame.yaxis):
        axis.set_major_formatter("{x:g}")
    frame.yaxis.set_minor_formatter("{x:g}")
    frame.legend(frameon=False, fontsize=8)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def tables(found: Found) -> dict[str, str]:
    """Tables of the page by name."""
    return {"gusts": gust_table(found), "balance": balance_table(read_table(TABLE, Start))}


def publish() -> None:
    """Fill the tables of the page and draw the figure."""
    found = found_in(read_beds(cases.TABLE))
    write_pages([PAGE], tables(found))
    draw(found, PICTURE)
