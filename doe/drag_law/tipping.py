"""Winds in which beds of the published soil begin to tip, by law of drag and forces; writes tipping.csv here.

python -m doe.drag_law.tipping    five beds, all sets of drag near the wall, torque of the shear and lift

The simulator only lays the beds down. The wind is that of the column of `doe.bed_wind.column` under either
law, the balance of moments that of `doe.fluid_threshold.balance`, in the peak of 0.3 s of gusts; the air does
not lose what drag near the wall adds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import exp, log, sqrt
from pathlib import Path

import numpy as np

from doe.bed_wind.column import VISCOSITY, Blow, Layer, cells_over, wind_over
from doe.common.command import words
from doe.common.tables import read_table, write_table
from doe.drag_law.claims import ALONE, HINDERED, LAWS
from doe.drag_law.loads import scenes
from doe.fluid_threshold.balance import AIR, ROLLING, SHORT, Question, easiest, forces, gust_factor, gust_peak
from doe.fluid_threshold.dropped_bed import Loose, loose_grains
from taichi_erosion.core.setup import Floats
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.simulation import snapshot
from tests.verification.reference.flow import LAWS as DRAGS
from tests.verification.reference.flow import Stream
from tests.verification.small_scenes import run_to_end
from tests.verification.wind.saltation import BEDS

TABLE = Path(__file__).with_name("tipping.csv")
SOIL = "published soil"
WINDS = np.geomspace(0.1, 1.2, 8)  # m s-1
SPAN = 0.19  # diameters beyond a grain, over which its shear is taken
MOVED = 2  # grains that make a start
DEEPEST = 1.0  # diameters below the surface, centre of the deepest grains that can tip
HELD = Question("weight and rolling friction", rolling=ROLLING)
NAMES = ("drag near the wall", "torque of the shear", "lift")
SETS = {
    kind: ", ".join(name for name, acts in zip(NAMES, kind, strict=True) if acts) or "none"
    for kind in product((False, True), repeat=3)
}


@dataclass(frozen=True)
class Tip:
    """One bed under one law and set of forces."""

    seed: int
    law: str
    forces: str  # beside drag and gusts
    wind: float  # m s-1, in which the second grain begins to tip


@dataclass(frozen=True)
class Bed:
    """A bed in diameters of 0.25 mm, and which of its grains nothing lies on."""

    centres: Floats
    radii: Floats
    side: float
    loose: tuple[int, ...]
    grains: tuple[Loose, ...]
    unit: float  # m


def bed_of(centres: Floats, radii: Floats, side: float, unit: float) -> Bed:
    """A bed with the grains that can tip."""
    found = loose_grains(centres, radii, side, DEEPEST)
    return Bed(centres, radii, side, tuple(found), tuple(found.values()), unit)


def air_at(bed: Bed, friction: float, law: str) -> tuple[Floats, Floats, Floats]:
    """Mean wind [m s-1], shear [s-1] and void fraction [1] at the loose grains."""
    pairs = zip(bed.centres[:, 2], bed.radii, strict=True)
    layers = [Layer(float(z), 1.0 / bed.side**2, 2.0 * float(r)) for z, r in pairs]
    heights, speed = wind_over(layers, Blow(friction, bed.unit, law))
    _, shares, void = cells_over(layers)
    at = list(bed.loose)
    low, high = (bed.centres[at, 2] + s * (bed.radii[at] + SPAN) for s in (-1.0, 1.0))
    rise = np.interp(high, heights, speed) - np.interp(low, heights, speed)
    return (shares @ speed)[at], rise / ((high - low) * bed.unit), (shares @ void)[at]


def works(bed: Bed, friction: float, law: str, peak: float) -> dict[tuple[bool, ...], Floats]:
    """Work of the air less that of what holds in the easiest rotation, over the weight, by set of forces."""
    speed, shear, void = air_at(bed, friction, law)
    gust = gust_factor(speed, friction, peak)
    radius = bed.unit * bed.radii[list(bed.loose)]
    gap = np.maximum((bed.unit * np.array([one.height for one in bed.grains]) - radius) / (2.0 * radius), 0.0)
    near, torque, lift = forces(gust * speed, gust * shear, radius, gap)
    stream = Stream(np.maximum(gust * speed, 1e-9), 2.0 * radius, AIR, AIR * VISCOSITY, void)  # pyright: ignore
    drag = np.asarray(DRAGS[law](stream))
    reynolds = 2.0 * radius * gust * speed / VISCOSITY
    free = 6.0 * np.pi * AIR * VISCOSITY * radius * gust * speed * (1.0 + 0.15 * reynolds**0.687)
    found = {}
    for kind in SETS:
        sides = (
            drag * (near / np.maximum(free, 1e-30) if kind[0] else 1.0),
            torque * kind[1],
            lift * kind[2],
        )
        found[kind] = easiest(bed.grains, bed.unit, sides, HELD)
    return found


def tips(bed: Bed, seed: int, law: str) -> Iterator[Tip]:
    """The wind of every set of forces over one bed."""
    peak = gust_peak(SHORT, bed.unit)
    found = [works(bed, float(wind), law, peak) for wind in WINDS]
    for kind, label in SETS.items():
        second = [float(np.sort(one[kind])[-MOVED]) for one in found]
        yield Tip(seed, law, label, exp(float(np.interp(0.0, second, np.log(WINDS)))))


def all_tips() -> Iterator[Tip]:
    """Every bed of the published soil."""
    sim = run_to_end([scenes()[SOIL]] * len(BEDS), BEDS).sim
    for k, seed in enumerate(BEDS):
        state, unit = snapshot(sim, k), 2.5e-4
        side = float(sim.setups[k].period[0]) / unit
        bed = bed_of(state.position / unit, state.radius / unit, side, unit)
        for law in LAWS:
            yield from tips(bed, seed, law)


def tip_table(found: Sequence[Tip]) -> str:
    """Geometric means over beds, and their ratio."""
    header = ("forces beside drag and gusts", *(f"{law}: u* [m/s]" for law in LAWS), "ratio, bed by bed")
    rows = []
    for label in SETS.values():
        winds = [
            [log(one.wind) for one in found if one.law == law and one.forces == label]
            for law in (ALONE, HINDERED)
        ]
        apart = np.subtract(winds[1], winds[0])
        error = apart.std(ddof=1) / sqrt(len(apart))
        means = [f"{exp(float(np.mean(side))):.3f}" for side in winds]
        rows.append((label, *means, f"{exp(float(apart.mean())):.2f} ± {error:.2f}"))
    return markdown_table(header, rows)


def read_tips() -> list[Tip]:
    """Rows of the table."""
    return read_table(TABLE, Tip)


if __name__ == "__main__":
    words(__doc__)
    write_table(TABLE, Tip, list(all_tips()), digits=4)
