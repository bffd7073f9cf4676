"""Tables and figure of the thresholds of beds of five diameters, from beds.csv."""

import csv
from collections.abc import Mapping, Sequence
from math import exp, isfinite, nan, sqrt
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import scipy

from doe.common.cases import ROOT
from doe.fluid_threshold.cases import BARE, FOLDER, FORCES, MILLI, SHARED, SIDE, WITH, WITHOUT, Bed
from doe.wind.shares import paired_ratio, shown
from taichi_erosion.measures.extremes import Watch, criterion_threshold
from taichi_erosion.measures.result import Measurement
from taichi_erosion.measures.threshold import Bracket, bracketed, pool_beds
from taichi_erosion.report.markdown import fill_tables, markdown_table
from taichi_erosion.verification.reference.hopping import GRAVITY

PAGE, PICTURE = FOLDER / "README.md", ROOT / "docs" / "pictures" / "fluid_threshold.png"
MEASURED = ROOT / "doe" / "measured" / "fluid_threshold.csv"
VISCOSITY = 1.46e-5  # m2 s-1, of the scene's air
COHESION = 6e-7  # kg m^0.5 s-2, of Iversen & White
HOLD, SHARE, LONGER = 0.3, 0.01, 5.0  # s; share of the surface grains; s of a tunnel's watch
FLOOR = 1.0  # m2
OURS, BARES, THEIRS = "#1f4e79", "#888888", "#c0392b"

Found = Mapping[str, Mapping[int, Bracket]]  # brackets by case and seed


def iversen_white(diameter: float, density: float = 2650.0, air: float = 1.225) -> float:
    """Fluid threshold [m s-1] of Iversen & White (1982), fitted to tunnels; diameter in m, densities kg m-3.

    u* = A sqrt(s g d), A by ranges of Re* = u* d / nu and with K = 0.006 g cm^0.5 s-2 for cohesion

        A = 0.2 f / sqrt(1 + 2.5 Re*)                          Re* < 0.3
        A = 0.129 f / sqrt(1.928 Re*^0.092 - 1)                Re* < 10
        A = 0.12 f (1 - 0.0858 exp(-0.0617 (Re* - 10)))        else,     f = sqrt(1 + K / (rho_s g d^2.5))
    """
    factor = sqrt(1.0 + COHESION / (density * GRAVITY * diameter**2.5))

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


def found_in(beds: Sequence[Bed]) -> Found:
    """Brackets by case and seed."""
    cases: dict[str, dict[int, Bracket]] = {}
    for bed in beds:
        cases.setdefault(bed.case, {})[bed.seed] = Bracket(bed.low, bed.high)
    return cases


def pooled(found: Found, case: str) -> Measurement | None:
    """Threshold of the beds of a case; None where it has no beds."""
    if case not in found:
        return None
    return pool_beds([bracketed("threshold_u_star", each) for each in found[case].values()])


def diameters(found: Found) -> list[float]:
    """Diameters that were simulated with all forces [mm]."""
    return sorted(float(case.split("/")[1]) for case in found if case.startswith(f"{WITH}/"))


def longer_watch(found: Found, size: float) -> str:
    """Threshold of one percent of the surface grains of a square metre in five seconds, Weibull's law."""
    diameter = MILLI * size
    area = (SIDE * diameter) ** 2
    patch = Watch(area, HOLD, max(1, int(np.ceil(SHARE * SIDE**2))))
    asked = Watch(FLOOR, LONGER, round(SHARE * FLOOR / diameter**2))
    return shown(criterion_threshold("threshold", list(found[f"{WITH}/{size:g}"].values()), patch, asked))


def size_table(found: Found) -> str:
    """Threshold of every diameter with the forces on and off, beside the curve fitted to tunnels."""
    header = (
        "d [mm]",
        "beds",
        "drag alone: u* [m/s]",
        "with all forces: u* [m/s]",
        "the same, 1 % in 5 s",
        "Iversen & White: u* [m/s]",
        "difference",
    )
    rows = []
    for size in diameters(found):
        whole, bare = pooled(found, f"{WITH}/{size:g}"), pooled(found, f"{BARE}/{size:g}")
        assert whole is not None
        curve = iversen_white(MILLI * size)
        rows.append(
            (
                f"{size:g}",
                str(len(found[f"{WITH}/{size:g}"])),
                "" if bare is None else shown(bare),
                shown(whole),
                longer_watch(found, size),
                f"{curve:.3f}",
                f"{100.0 * (whole.value / curve - 1.0):+.0f} %",
            )
        )
    return markdown_table(header, rows)


def share_table(found: Found) -> str:
    """What switching one force off at one diameter does, bed by bed."""
    whole = found.get(f"{WITH}/{SHARED:g}", {})
    header = ("forces beside drag", "beds", "u* [m/s]", "over that with all forces, bed by bed")
    cases = {WITH: "all", **{WITHOUT + force: f"all but {force.replace('_', ' ')}" for force in FORCES}}
    rows = []
    for kind, label in (cases | {BARE: "none"}).items():
        case = f"{kind}/{SHARED:g}"
        value = pooled(found, case)
        if value is None:
            continue
        ratio, factor, _ = paired_ratio(dict(found[case]), dict(whole))
        known = isfinite(factor) and kind != WITH
        cell = f"{ratio:.2f} ({ratio / factor:.2f} to {ratio * factor:.2f})" if known else "1"
        rows.append((label, str(len(found[case])), shown(value), cell))
    return markdown_table(header, rows)


def draw(found: Found) -> None:
    """Thresholds against diameter, with the curve and the measured points."""
    figure, axes = plt.subplots(figsize=(6.4, 4.2))
    curve = np.geomspace(0.075, 1.2, 80)
    axes.plot(curve, [iversen_white(MILLI * d) for d in curve], color=THEIRS, label="Iversen & White (1982)")
    with MEASURED.open(encoding="utf-8", newline="") as file:
        points = list(csv.DictReader(file))
    axes.errorbar(
        [float(point["diameter [mm]"]) for point in points],
        [float(point["value"]) for point in points],
        [float(point["sd"]) for point in points],
        fmt="s",
        color=THEIRS,
        label="measured: Greeley et al. (1980), Martin & Kok (2018)",
    )
    for kind, colour, label in ((WITH, OURS, "with all forces"), (BARE, BARES, "drag alone")):
        sizes = [size for size in diameters(found) if f"{kind}/{size:g}" in found]
        values = [pooled(found, f"{kind}/{size:g}") for size in sizes]
        middle = np.array([value.value if value else nan for value in values])
        ends = np.array(
            [[value.details["interval"][end] for end in ("low", "high")] for value in values if value]
        )
        if len(sizes):
            axes.errorbar(sizes, middle, np.abs(ends.T - middle), fmt="o", color=colour, label=label)
    axes.set(xscale="log", yscale="log", xlabel="diameter [mm]", ylabel="fluid threshold u* [m/s]")
    axes.set_xticks([0.1, 0.2, 0.5, 1.0], ["0.1", "0.2", "0.5", "1"])
    axes.set_yticks([0.2, 0.3, 0.5, 0.8], ["0.2", "0.3", "0.5", "0.8"])
    axes.minorticks_off()
    axes.legend(frameon=False, fontsize=8)
    figure.tight_layout()
    figure.savefig(PICTURE, dpi=150)
    plt.close(figure)


def publish(beds: Sequence[Bed], page: Path = PAGE) -> None:
    """Fill the tables of the page and draw the figure."""
    found = found_in(beds)
    tables = {"sizes": size_table(found), "forces": share_table(found)}
    page.write_text(fill_tables(page.read_text(encoding="utf-8"), tables), encoding="utf-8")
    draw(found)
