"""Drag on every grain of a settled bed in creeping shear, resolved, beside that of the horizontal mean.

python -m doe.bed_wind.exposure SEED...  beds of the simulator, by seed; writes exposure.csv, grain by grain

`python -m doe.bed_wind.run --page` then fills the table of README.md.
The simulator lays down equal spheres on a patch; the method of `stokes.py` then gives the force
of the flow on each of them, that of `column.py` the drag of the mean wind at its height. Their ratio is what
neighbours do to single grains. Beside it stands the exposure of a grain: the share of its cross-section
across the wind that no sphere close to it hides, upwind, downwind, or the mean of both: creeping flow is the
same backwards, so that spheres on either side shelter alike.

Reference: Ladd (1994), J. Fluid Mech. 271, 285 (momentum exchanged where distributions come back).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.stats import pearsonr

from doe.bed_wind.column import Blow, Layer, drags_of
from doe.bed_wind.stokes import CORNERS, OPPOSITE, SHARES, collided, steady, streamed
from doe.common.command import words
from doe.common.tables import read_table, write_table
from taichi_erosion.core.setup import Floats
from taichi_erosion.measures.threshold import CONFIDENCE
from taichi_erosion.report.markdown import markdown_table
from taichi_erosion.scene.change import with_section
from taichi_erosion.scene.schema.grains import Monodisperse
from taichi_erosion.simulation import snapshot
from tests.verification.small_scenes import run_to_end
from tests.verification.wind.saltation import REST, SMALLEST, Patch, sand

TABLE = Path(__file__).with_name("exposure.csv")
SIDE, CELLS = 8.0, 6  # of the patch in diameters; lattice nodes on a diameter
DEEP, OVER = 3.0, 1.5  # diameters below and above the highest top that are resolved
REACHES = (1.0, 1.5, 2.0, 3.0, 4.0)  # diameters, from where a sphere can hide another
SIDES = {"the wind": 1.0, "the lee": -1.0}
BOTH = "both"
RINGS, SPOKES = 8, 24  # places on a cross-section at which is looked upwind
WIND, CREEPING = 0.3, 3e-4  # m s-1; m2 s-1, of the column: u* d / nu = 0.25
COLUMN_LAWS = ("two_limits", "two_limits_hindered")
UPPER = 0.5  # diameters below the highest top, within which those of the upper spheres lie


@dataclass(frozen=True)
class Spheres:
    """Equal spheres in a periodic box above a plane; lengths in diameters."""

    centre: Floats  # [sphere, 3]
    side: float
    lid: float  # height


@dataclass(frozen=True)
class Loaded:
    """One sphere: forces over the stress of the lid and the square of the diameter."""

    seed: int
    x: float  # along the wind [d]
    y: float  # [d]
    z: float  # over the plane [d]
    resolved: float
    two_limits: float
    two_limits_hindered: float


def laid_down(seed: int) -> Spheres:
    """The upper part of a bed of the simulator."""
    scene = sand(1.0, Patch(0.0, SIDE, SIDE), [REST], {"measure": {}})
    scene = with_section(scene, "grains", size=Monodisperse(law="monodisperse", diameter=SMALLEST))
    sim = run_to_end([scene], [seed]).sim
    centre = snapshot(sim, 0).position / SMALLEST
    centre[:, 2] -= centre[:, 2].max() + 0.5 - DEEP
    return Spheres(centre[centre[:, 2] > 0.0], SIDE, DEEP + OVER)


def owners(bed: Spheres, cells: int) -> np.ndarray:
    """Number of the sphere in which each node lies, -1 in the air."""
    count, high = round(bed.side * cells), round(bed.lid * cells)
    along, up = (np.arange(count) + 0.5) / cells, (np.arange(high) + 0.5) / cells
    nodes = np.stack(np.meshgrid(along, along, up, indexing="ij"), axis=-1)
    found, nearest = np.full(nodes.shape[:3], -1), np.full(nodes.shape[:3], 0.25)
    for k, centre in enumerate(bed.centre):
        apart = nodes - centre
        apart[..., :2] -= bed.side * np.round(apart[..., :2] / bed.side)
        square = (apart**2).sum(axis=-1)
        found = np.where(square < nearest, k, found)
        nearest = np.minimum(square, nearest)
    return found


def resolved_forces(bed: Spheres, cells: int) -> tuple[Floats, float]:
    """Force along x on every sphere, and that on the lid, in one unit."""
    owner = owners(bed, cells)
    solid = owner >= 0
    after, _ = collided(steady(solid))
    force, lid = np.zeros(len(bed.centre)), 0.0
    returned = streamed(after, solid)
    for q, c in enumerate(CORNERS):
        if c[0] == 0:
            continue
        # what flies against c from here meets the sphere one node back, and comes back along c
        behind = np.roll(owner, tuple(c), axis=(0, 1, 2))
        if c[2] > 0:
            behind[:, :, 0] = -1
        if c[2] < 0:
            top = ~solid[:, :, -1]
            sent = after[OPPOSITE[q]][:, :, -1] + returned[q][:, :, -1] - 2.0 * SHARES[q]
            lid += float(c[0] * sent[top].sum())
            behind[:, :, -1] = -1
        meets = ~solid & (behind >= 0)
        given = -c[0] * (after[OPPOSITE[q]] + returned[q] - 2.0 * SHARES[q])
        force += np.bincount(behind[meets], given[meets], len(force))
    return force, lid


def mean_forces(bed: Spheres, law: str) -> Floats:
    """Drag of the mean wind on every sphere over the stress of the lid and d^2, by a law of drag."""
    layers = tuple(Layer(float(z), 1.0 / bed.side**2) for z in bed.centre[:, 2])
    return drags_of(layers, Blow(WIND, SMALLEST, law, turbulent=False, viscosity=CREEPING))


def exposures(bed: Spheres, reach: float, way: float) -> Floats:
    """Share of every cross-section across the wind that no sphere hides that lies upwind within `reach`.

    Downwind where `way` is -1, upwind where it is 1.
    """
    radius = 0.5 * np.sqrt((np.arange(RINGS) + 0.5) / RINGS)
    turn = 2.0 * np.pi * (np.arange(SPOKES) + 0.5) / SPOKES
    spots = np.stack([np.outer(radius, np.cos(turn)), np.outer(radius, np.sin(turn))], axis=-1).reshape(-1, 2)
    found = []
    for centre in bed.centre:
        apart = bed.centre - centre
        apart[:, :2] -= bed.side * np.round(apart[:, :2] / bed.side)
        away = -way * apart[:, 0]
        upwind = apart[(away > 0.0) & (away < reach)]
        hidden = ((upwind[:, None, 1:] - spots) ** 2).sum(axis=-1) < 0.25
        found.append(1.0 - hidden.any(axis=0).mean())
    return np.array(found)


def measured(seed: int) -> list[Loaded]:
    """All spheres of one bed."""
    bed = laid_down(seed)
    force, lid = resolved_forces(bed, CELLS)
    loads = force / lid * bed.side**2
    means = [mean_forces(bed, law) for law in COLUMN_LAWS]
    return [Loaded(seed, *map(float, row)) for row in zip(*bed.centre.T, loads, *means, strict=True)]


def read_spheres() -> list[Loaded]:
    """All spheres of the table; none where it has not been made yet."""
    return read_table(TABLE, Loaded) if TABLE.exists() else []


def write_spheres(spheres: Sequence[Loaded]) -> None:
    """Write all spheres as CSV."""
    write_table(TABLE, Loaded, spheres, digits=5)


def bed_of(spheres: Sequence[Loaded]) -> Spheres:
    """The bed of the spheres of one seed."""
    return Spheres(np.array([(one.x, one.y, one.z) for one in spheres]), SIDE, DEEP + OVER)


@dataclass(frozen=True)
class Upper:
    """The upper spheres of one bed."""

    bed: Spheres
    upper: np.ndarray
    resolved: Floats
    mean: dict[str, Floats]  # by law of drag

    def log_ratio(self, law: str) -> Floats:
        """Ln of the resolved force over that of the mean wind."""
        return np.log(self.resolved / self.mean[law])

    def exposure(self, side: str, reach: float) -> Floats:
        """Exposure to one side, or the mean of both."""
        ways = [way for name, way in SIDES.items() if side in (name, BOTH)]
        return np.mean([exposures(self.bed, reach, way)[self.upper] for way in ways], axis=0)


def upper_spheres(spheres: Sequence[Loaded]) -> dict[int, Upper]:
    """Upper spheres of every bed, by seed."""
    found = {}
    for seed in sorted({one.seed for one in spheres}):
        own = [one for one in spheres if one.seed == seed]
        bed = Spheres(np.array([(one.x, one.y, one.z) for one in own]), SIDE, DEEP + OVER)
        upper = bed.centre[:, 2] > bed.centre[:, 2].max() - UPPER
        resolved, *means = (
            np.array([getattr(one, name) for one in own])[upper] for name in ("resolved", *COLUMN_LAWS)
        )
        found[seed] = Upper(bed, upper, resolved, dict(zip(COLUMN_LAWS, means, strict=True)))
    return found


def load_table(beds: Mapping[int, Upper]) -> str:
    """Forces on the upper spheres of every bed, resolved and of the mean wind by either law."""
    header = (
        *("bed", "drag of the mean wind", "upper spheres", "resolved over it: median", "scatter of its ln"),
        *("largest force, resolved", "of the mean wind"),
    )
    rows = []
    for seed, bed in beds.items():
        for law, mean in bed.mean.items():
            ratio = bed.log_ratio(law)
            numbers = (np.exp(np.median(ratio)), ratio.std(ddof=1), bed.resolved.max(), mean.max())
            rows.append((str(seed), law, str(ratio.size), *(f"{number:.2f}" for number in numbers)))
    return markdown_table(header, rows)


def exposure_table(beds: Mapping[int, Upper]) -> str:
    """Correlation of the ln of that ratio with exposure, by side and reach; means of beds taken off."""
    header = ("drag of the mean wind", "exposed to", *(f"within {reach:g} d" for reach in REACHES))
    rows = []
    for law in COLUMN_LAWS:
        ratio = together([bed.log_ratio(law) for bed in beds.values()])
        for side in (*SIDES, BOTH):
            seen = [together([bed.exposure(side, reach) for bed in beds.values()]) for reach in REACHES]
            rows.append((law, side, *(correlation_cell(ratio, each) for each in seen)))
    return markdown_table(header, rows)


def together(values: Sequence[Floats]) -> Floats:
    """Values of all beds, each less the mean of its bed."""
    return np.concatenate([each - each.mean() for each in values])


def correlation_cell(ratio: Floats, seen: Floats) -> str:
    """Correlation of two samples with its interval."""
    found = pearsonr(ratio, seen)
    low, high = found.confidence_interval(CONFIDENCE)
    return f"{found.statistic:.2f} ({low:.2f} to {high:.2f})"


def main(asked: Sequence[str]) -> None:
    """Simulate the beds that were asked for."""
    for seed in map(int, asked):
        write_spheres([*(sphere for sphere in read_spheres() if sphere.seed != seed), *measured(seed)])


if __name__ == "__main__":
    main(words(__doc__))
