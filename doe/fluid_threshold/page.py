"""Table of the thresholds of beds of sand against diameter, from beds.csv."""

from collections.abc import Mapping, Sequence
from math import exp, sqrt
from pathlib import Path

import numpy as np
import scipy

from doe.fluid_threshold.cases import BARE, FOLDER, MILLI, SIDE, WITH, Bed
from doe.wind.shares import shown
from taichi_erosion.measures.extremes import Watch, criterion_threshold
from taichi_erosion.measures.result import Measurement
from taichi_erosion.measures.threshold import Bracket, bracketed, pool_beds
from taichi_erosion.report.markdown import fill_tables, markdown_table
from taichi_erosion.verification.reference.hopping import GRAVITY

PAGE = FOLDER / "README.md"
VISCOSITY = 1.46e-5  # m2 s-1, of the scene's air
COHESION = 6e-7  # kg m^0.5 s-2, of Iversen & White
HOLD, SHARE, LONGER = 0.3, 0.01, 5.0  # s; share of the surface grains; s of a tunnel's watch
FLOOR = 1.0  # m2

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


def publish(beds: Sequence[Bed], page: Path = PAGE) -> None:
    """Fill the table of the page."""
    found = found_in(beds)
    tables = {"sizes": size_table(found)}
    page.write_text(fill_tables(page.read_text(encoding="utf-8"), tables), encoding="utf-8")
