"""Drag over weight of the most exposed grains of beds at rest, by the law of drag; writes loads.csv here.

python -m doe.drag_law.loads    beds of nearly uniform sand and of the published soil

Independent of simulated thresholds: the simulator only lays the beds down, and the column of
`doe.bed_wind.column`, written a second time in NumPy, gives the drag of the mean wind on every grain. No
gust, lift or torque acts.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path

import numpy as np

from doe.bed_wind.column import AIR, Blow, Layer, drags_of
from doe.common.cases import ROOT
from doe.common.command import words
from doe.common.tables import read_table, write_table
from doe.drag_law.claims import ALONE, HINDERED, LAWS
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.scene import Scene, load_scene
from taichi_erosion.simulation import snapshot
from tests.verification.reference.hopping import GRAVITY
from tests.verification.small_scenes import run_to_end
from tests.verification.wind.saltation import BEDS, DENSITY, from_rest

TABLE = Path(__file__).with_name("loads.csv")
SOIL = ROOT / "scenes" / "wind_threshold.toml"
WIND = 0.32  # m s-1, near which such beds start
MOVED = 2  # grains of a patch whose motion is a start: the load counts that this many grains have


@dataclass(frozen=True)
class Load:
    """One bed under one law."""

    bed: str
    seed: int
    law: str
    largest: float  # drag over weight [1]
    second: float  # of the grain with the next largest [1]


def scenes() -> dict[str, Scene]:
    """Beds that come to rest."""
    whole = {"nearly uniform, 0.25 mm": from_rest(), "published soil": load_scene(SOIL)}
    return {name: scene.model_copy(update={"stages": scene.stages[:1]}) for name, scene in whole.items()}


def drag_over_weight(bed: Snapshot, area: float, law: str) -> Floats:
    """Of every grain, in the mean wind over the bed; `area` of the patch in m2."""
    unit = 2.0 * float(np.median(bed.radius))
    sizes, heights = 2.0 * bed.radius / unit, bed.position[:, 2] / unit
    layers = [Layer(float(z), unit**2 / area, float(d)) for z, d in zip(heights, sizes, strict=True)]
    drag = drags_of(layers, Blow(WIND, unit, law)) * AIR * (WIND * unit) ** 2
    return drag / (DENSITY * np.pi / 6.0 * (2.0 * bed.radius) ** 3 * GRAVITY)


def loads() -> Iterator[Load]:
    """Loads of all beds."""
    for name, scene in scenes().items():
        sim = run_to_end([scene] * len(BEDS), BEDS).sim
        for k, seed in enumerate(BEDS):
            area = float(np.prod(sim.setups[k].period[:2]))
            for law in LAWS:
                ordered = np.sort(drag_over_weight(snapshot(sim, k), area, law))[::-1]
                yield Load(name, seed, law, float(ordered[0]), float(ordered[MOVED - 1]))


def load_table(found: Sequence[Load]) -> str:
    """Loads bed by bed, and what they make of a threshold."""
    header = ("bed", "seed", *(f"drag over weight, {law}" for law in LAWS), "root of the ratio")
    rows = []
    for name in dict.fromkeys(load.bed for load in found):
        pairs = [[of(found, name, seed, law).second for law in (ALONE, HINDERED)] for seed in BEDS]
        for seed, (alone, hindered) in zip(BEDS, pairs, strict=True):
            rows.append((name, str(seed), f"{alone:.3f}", f"{hindered:.3f}", f"{sqrt(alone / hindered):.3f}"))
        roots = np.sqrt([alone / hindered for alone, hindered in pairs])
        error = roots.std(ddof=1) / sqrt(len(roots))
        rows.append((name, "all", "", "", f"{roots.mean():.3f} ± {error:.3f}"))
    return markdown_table(header, rows) if rows else "Not computed yet.\n"


def of(found: Sequence[Load], bed: str, seed: int, law: str) -> Load:
    """The load of one bed under one law."""
    return next(one for one in found if (one.bed, one.seed, one.law) == (bed, seed, law))


def read_loads() -> list[Load]:
    """Loads of the table; none where it has not been made yet."""
    return read_table(TABLE, Load) if TABLE.exists() else []


def write_loads(found: Sequence[Load]) -> None:
    """Write the table."""
    write_table(TABLE, Load, found, digits=5)


if __name__ == "__main__":
    words(__doc__)
    write_loads(list(loads()))
