"""Laboratory C in the code it was made with (LAMMPS, optional): the same start as our seed 1, our measures.

python doe/lab_c/lammps.py          two runs of a minute each, added to results.csv

LAMMPS is told the laboratory's restitution of 0.5, then 0.3667, with which its grains
really part at half the speed.
"""

import subprocess
import tempfile
import time
from collections.abc import Iterator
from math import nan, pi
from pathlib import Path

import numpy as np

from taichi_erosion.campaign.cases import ROOT, Row, read_rows, write_rows
from taichi_erosion.core.setup import Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures import heap
from taichi_erosion.measures.result import Measurement
from taichi_erosion.run.check import read_scene
from taichi_erosion.scene import Scene, build_setup, scene_hash
from taichi_erosion.scene.limits import grain_rayleigh_time

HERE = Path(__file__).parent
SEED = 1
DENSITY = 2500.0  # kg m-3
DUMP_HEAD = 9  # lines of a LAMMPS dump before the grains
TOLD = {"LAMMPS, told 0.5": 0.5, "LAMMPS, told 0.3667": 0.3666513615687184}
HEAD = """rain

{count} atoms
1 atom types

-0.08 0.08 xlo xhi
-0.08 0.08 ylo yhi
-0.001 0.03 zlo zhi
"""


def rain(setup: Setup) -> str:
    """LAMMPS data file of the start."""
    grains = setup.grains
    place = [" ".join(f"{c:.17g}" for c in row) for row in grains.position]
    speed = [" ".join(f"{c:.17g}" for c in row) for row in grains.velocity]
    size = [f"{2.0 * r:.17g}" for r in grains.radius]
    spheres = [f"{k} 1 {d} {DENSITY} {x}" for k, (d, x) in enumerate(zip(size, place, strict=True), 1)]
    speeds = [f"{k} {v} 0 0 0" for k, v in enumerate(speed, 1)]
    parts = (HEAD.format(count=len(place)), "Atoms # sphere\n", *spheres, "\nVelocities\n", *speeds)
    return "\n".join(parts) + "\n"


def read_dump(file: Path, radius: float) -> Snapshot:
    """Grains of a LAMMPS dump; only their places are in it."""
    position = np.loadtxt(file, skiprows=DUMP_HEAD)[:, 1:4]
    count = len(position)
    none = np.zeros(count, np.int32)
    return Snapshot(
        time=0.0,
        step=0,
        position=position,
        velocity=np.zeros((count, 3)),
        spin=np.zeros((count, 3)),
        radius=np.full(count, radius),
        mass=np.full(count, DENSITY * 4.0 / 3.0 * pi * radius**3),
        contacts=none,
        ident=none,
        waiting=0,
    )


def measures(folder: Path, radius: float) -> Iterator[Measurement]:
    """All observables of one run."""
    yield heap.column_height(read_dump(folder / "column.dump", radius))
    pile = read_dump(folder / "pile.dump", radius)
    for measure in (heap.angle_of_repose_outline, heap.pile_height, heap.centroid_height, heap.radius_90):
        yield measure(pile)
    yield heap.runout_radius(pile)


def simulate(group: str, restitution: float) -> list[Row]:
    """One run of LAMMPS as rows of the study."""
    scene = read_scene(ROOT / "scenes" / "column_collapse.toml", ())
    setup = build_setup(scene, SEED)
    radius = float(setup.grains.radius[0])
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "rain.data").write_text(rain(setup), encoding="utf-8")
        orders = f"-var restitution {restitution} -var folder {name} -log none -screen none".split()
        subprocess.run(["lmp", "-in", str(HERE / "collapse.lmp"), *orders], check=True)
        found = list(measures(folder, radius))
    return rows(group, scene, setup, found, time.perf_counter() - started)


def rows(group: str, scene: Scene, setup: Setup, found: list[Measurement], seconds: float) -> list[Row]:
    """Rows of one run; the hash is that of our scene, whose start it shares."""
    return [
        Row(
            group=group,
            label="1.5 mm",
            observable=measured.name,
            value=measured.value,
            sd=nan,
            n=1,
            unit=measured.unit,
            hash=scene_hash(scene),
            seed=SEED,
            time_step=setup.time_step,
            time_step_over_rayleigh=setup.time_step / grain_rayleigh_time(scene),
            grains=len(setup.grains.radius),
            wall_s=round(seconds, 1),
            command="python doe/lab_c/lammps.py",
            versions=lammps_version(),
        )
        for measured in found
    ]


def lammps_version() -> str:
    """First words of LAMMPS about itself."""
    said = subprocess.run(["lmp", "-help"], capture_output=True, text=True, check=True).stdout
    return next(line for line in said.splitlines() if "Simulator" in line).rpartition(" - ")[2]


def main() -> None:
    """Run both cases and add them to the table."""
    table = HERE / "results.csv"
    for group, restitution in TOLD.items():
        others = [row for row in read_rows(table) if row.group != group]
        write_rows(table, others + simulate(group, restitution))


if __name__ == "__main__":
    main()
