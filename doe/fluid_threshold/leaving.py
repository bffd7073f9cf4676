"""Grains that leave their pockets in winds about the threshold of their bed, and what becomes of them.

python -m doe.fluid_threshold.leaving            writes leaving.csv; `doe.fluid_threshold.run --page` shows it
python -m doe.fluid_threshold.leaving OVER...    some winds anew, over the threshold of the bed

The beds of 0.25 mm of the case `longer`, each put back to rest before every wind and watched for as long as
there. A grain has left its pocket where it is half a diameter from its place, and rests again where it moves
by less than a fiftieth of a diameter between samples for 20 ms; its place is then a new one. The criterion
of the scene is that two grains have risen by a diameter; a watch ends with it.
"""

import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import isnan, nan
from pathlib import Path

import numpy as np

from doe.common.cases import ROOT
from doe.common.command import words
from doe.common.tables import read_table, write_table
from doe.fluid_threshold.cases import HOLD, LONGER, MILLI, SCENE, case_of, read_beds
from taichi_erosion.core.setup import Floats, Numerics
from taichi_erosion.effects import load_library
from taichi_erosion.measures.threshold import Bracket
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.run.threshold_search import periodic_displacement
from taichi_erosion.scene import laws, load_scene
from taichi_erosion.simulation import (
    Simulation,
    advance,
    assemble,
    export_bed,
    import_bed,
    prepare,
    snapshot,
    spin_up_wind,
)

TABLE = Path(__file__).with_name("leaving.csv")
SIZE = 0.25  # mm
SETTLE = 0.4  # s, that the scene gives its bed to come to rest
OVER = (0.7, 0.8, 0.9, 1.0, 1.1)  # winds over the threshold of the bed
SAMPLE = 4e-3  # s
LEFT, STILL, QUIET = 0.5, 0.02, 5  # diameters from its place; diameters between samples; samples in a row
RISEN, NEEDED = 1.0, 2  # diameters upwards; grains of the criterion


@dataclass(frozen=True)
class Asked:
    """One bed and one wind."""

    seed: int
    over: float  # wind over the threshold of the bed [1]
    wind: float  # friction velocity [m s-1]


@dataclass(frozen=True)
class Watch:
    """What one bed did in one wind."""

    seed: int
    over: float  # wind over the threshold of the bed [1]
    wind: float  # friction velocity [m s-1]
    watched: float  # s, until the criterion was met or the watch was over
    left: int  # departures from a pocket
    rested: int  # of these, those that had come to rest again
    first: float  # s, first departure; NaN where there is none
    second: float  # s, second departure
    risen: int  # grains that have risen by a diameter
    criterion: float  # s, when the criterion was met; NaN where it was not
    asked: str  # winds on the command line with which it was made
    commit: str


@dataclass
class Follower:
    """What the grains of one bed have done in one wind."""

    start: Floats  # [n, 3] m
    period: Floats  # [2] m
    diameter: float  # m
    departures: list[float] = field(default_factory=list)  # s
    rested: int = 0
    criterion: float = nan  # s

    def __post_init__(self) -> None:
        count = len(self.start)
        self.place, self.last = self.start.copy(), self.start.copy()
        self.away, self.risen = np.zeros(count, bool), np.zeros(count, bool)
        self.quiet = np.zeros(count, int)

    def see(self, position: Floats, time: float) -> None:
        """Update with the positions [n, 3] at a time [s] after the wind has begun."""
        gone = np.linalg.norm(periodic_displacement(position, self.place, self.period), axis=1)
        step = np.linalg.norm(periodic_displacement(position, self.last, self.period), axis=1)
        leaving = ~self.away & (gone > LEFT * self.diameter)
        self.departures += [time] * int(leaving.sum())
        self.away |= leaving
        self.quiet = np.where(step < STILL * self.diameter, self.quiet + 1, 0)
        back = self.away & (self.quiet >= QUIET)
        self.rested += int(back.sum())
        self.away &= ~back
        self.place[back] = position[back]
        self.risen |= position[:, 2] - self.start[:, 2] > RISEN * self.diameter
        self.last = position
        if isnan(self.criterion) and self.risen.sum() >= NEEDED:
            self.criterion = time

    def row(self, asked: Asked, watched: float, made: tuple[str, str]) -> Watch:
        """As a row of the table, with the words and the commit with which it was made."""
        first, second = (*self.departures, nan, nan)[:2]
        return Watch(
            asked.seed,
            asked.over,
            asked.wind,
            watched,
            len(self.departures),
            self.rested,
            first,
            second,
            int(self.risen.sum()),
            self.criterion,
            *made,
        )


def thresholds() -> dict[int, float]:
    """Threshold of every bed [m s-1] by its seed."""
    name = f"{LONGER}/{SIZE:g}"
    return {bed.seed: Bracket(bed.low, bed.high).middle for bed in read_beds() if bed.case == name}


def settled(seeds: Sequence[int]) -> Simulation:
    """The beds at rest in still air."""
    case = case_of(f"{LONGER}/{SIZE:g}")
    scene = load_scene(ROOT / SCENE, case.order[1::2])
    library = load_library()
    sim = assemble([prepare(scene, seed, library) for seed in seeds], laws(scene), Numerics("cpu", 1))
    advance(sim, [SETTLE] * len(seeds))
    return sim


def watch_all(overs: Sequence[float]) -> Iterator[Watch]:
    """All beds in winds over their thresholds."""
    known = thresholds()
    seeds = sorted(known)
    sim = settled(seeds)
    beds = [export_bed(sim, replica) for replica in range(len(seeds))]
    clock = [SETTLE] * len(seeds)
    made = (" ".join(f"{over:g}" for over in overs), commit())
    for over in overs:
        for replica, seed in enumerate(seeds):
            import_bed(sim, replica, beds[replica])
            asked = Asked(seed, over, over * known[seed])
            follower, watched = follow(sim, replica, asked.wind, clock)
            yield follower.row(asked, watched, made)


def follow(sim: Simulation, replica: int, wind: float, clock: list[float]) -> tuple[Follower, float]:
    """One bed from rest in one wind [m s-1], and the time [s] for which; the others wait, `clock` goes on."""
    spin_up_wind(sim, replica, wind, anew=True)
    period = np.array(sim.setups[replica].period[:2])
    follower = Follower(snapshot(sim, replica).position, period, MILLI * SIZE)
    watched = 0.0
    while watched < HOLD - 0.5 * SAMPLE and isnan(follower.criterion):
        clock[replica] += SAMPLE
        watched += SAMPLE
        advance(sim, clock)
        follower.see(snapshot(sim, replica).position, watched)
    return follower, watched


def commit() -> str:
    """That of the checkout."""
    asked = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def leaving_table(watches: Sequence[Watch]) -> str:
    """Winds over the thresholds of the beds: departures, returns, and when the criterion was met."""
    header = (
        "wind over the threshold of the bed",
        "beds that met the criterion",
        "departures per bed and second",
        "of these at rest again",
        "first departure [s]",
        "second [s]",
        "criterion [s]",
    )
    rows = []
    for over in sorted({one.over for one in watches}):
        beds = [one for one in watches if one.over == over]
        left = sum(one.left for one in beds)
        met = [one for one in beds if not isnan(one.criterion)]
        rows.append(
            (
                f"{over:g}",
                f"{len(met)} of {len(beds)}",
                f"{left / sum(one.watched for one in beds):.2g}",
                f"{sum(one.rested for one in beds)} of {left}",
                *(times(getattr(one, name) for one in beds) for name in ("first", "second", "criterion")),
            )
        )
    return markdown_table(header, rows)


def departing(watches: Sequence[Watch]) -> list[Bracket]:
    """Winds between which a bed comes to lose as many grains from their pockets as the criterion asks for."""
    found = []
    for seed in sorted({one.seed for one in watches}):
        winds = sorted((one for one in watches if one.seed == seed), key=lambda one: one.wind)
        first = next(place for place, one in enumerate(winds) if one.left >= NEEDED)
        found.append(Bracket(winds[first - 1].wind, winds[first].wind))
    return found


def times(values: Iterator[float]) -> str:
    """Times of the beds in order, a dash where there is none."""
    return ", ".join("none" if isnan(value) else f"{value:.3f}" for value in values)


def read_watches() -> list[Watch]:
    """All rows; none where the table has not been made yet."""
    return read_table(TABLE, Watch) if TABLE.exists() else []


def main(asked: Sequence[str]) -> None:
    """Simulate the winds that were asked for, and write the table."""
    overs = [float(word) for word in asked] or OVER
    rows = [row for row in read_watches() if row.over not in overs]
    for row in watch_all(overs):
        rows = sorted([*rows, row], key=lambda one: (one.over, one.seed))
        write_table(TABLE, Watch, rows)


if __name__ == "__main__":
    main(words(__doc__))
