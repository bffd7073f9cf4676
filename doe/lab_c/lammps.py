"""Laboratory C in the code it was made with (LAMMPS, optional): the starts of our seeds, our measures.

python -m doe.lab_c.lammps             24 runs of half a minute each, added to results.csv
python -m doe.lab_c.lammps GROUP...    those of some groups

LAMMPS receives the laboratory's restitution of 0.5; then 0.3667, with which its grains part at half the
speed; then 0.5 again, but without a rolling damper; then also with a rolling spring between grains as soft as
ours.
"""

import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from math import pi
from pathlib import Path

import numpy as np

from doe.common.cases import ROOT, Row, read_rows, write_rows
from doe.common.command import words
from taichi_erosion.core.setup import Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures import heap
from taichi_erosion.measures.result import Measurement
from taichi_erosion.run.checks import read_scene
from taichi_erosion.scene import Scene, build_setup, scene_hash
from taichi_erosion.scene.preparation.limits import grain_rayleigh_time

HERE = Path(__file__).parent
SEEDS = range(1, 7)
DENSITY = 2500.0  # kg m-3
DUMP_HEAD = 9  # lines of a LAMMPS dump before the grains
TIME_STEP = 1.5e-5  # s, of the laboratory: 0.01 s/m d
SPRING = 37.5  # N m-1, rolling spring of the laboratory: 0.005 E d
SOFT_SPRING = SPRING / 8.0  # N m-1, what 2.25 k_n mu_r^2 is under the force of five weights
DAMPER = 6.75e-3  # kg s-1, rolling damper of the laboratory: 3000 kg s-1 m-2 d^2
HEAD = """rain

{count} atoms
1 atom types

-0.08 0.08 xlo xhi
-0.08 0.08 ylo yhi
-0.001 0.03 zlo zhi
"""


@dataclass(frozen=True)
class Inputs:
    """Inputs of LAMMPS."""

    restitution: float  # [1]
    damper: float  # kg s-1
    spring: float = SPRING  # N m-1, between grains


GROUPS = {
    "LAMMPS, restitution 0.5": Inputs(0.5, DAMPER),
    "LAMMPS, restitution 0.3667": Inputs(0.3666513615687184, DAMPER),
    "LAMMPS, restitution 0.5, no rolling damper": Inputs(0.5, 0.0),
    "LAMMPS, restitution 0.5, no rolling damper, soft rolling spring": Inputs(0.5, 0.0, SOFT_SPRING),
}


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


def simulate(setup: Setup, inputs: Inputs) -> list[Measurement]:
    """One run of LAMMPS, measured."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "rain.data").write_text(rain(setup), encoding="utf-8")
        variables = {
            "restitution": inputs.restitution,
            "damper": inputs.damper,
            "spring": inputs.spring,
            "step": TIME_STEP,
            "folder": name,
        }
        told_words = [word for key, value in variables.items() for word in ("-var", key, str(value))]
        silent = ["-log", "none", "-screen", "none"]
        subprocess.run(["lmp", "-in", str(HERE / "collapse.lmp"), *told_words, *silent], check=True)
        return list(measures(folder, float(setup.grains.radius[0])))


def rows(group: str, inputs: Inputs, scene: Scene) -> list[Row]:
    """Rows of all seeds; the hash is that of our scene, whose starts they share."""
    started = time.perf_counter()
    setups = [build_setup(scene, seed) for seed in SEEDS]
    runs = [simulate(setup, inputs) for setup in setups]
    seconds = round(time.perf_counter() - started, 1)
    return [
        Row(
            group=group,
            label="1.5 mm",
            observable=same[0].name,
            value=float(np.mean([measured.value for measured in same])),
            sd=float(np.std([measured.value for measured in same], ddof=1)),
            n=len(same),
            unit=same[0].unit,
            hash=scene_hash(scene),
            seed=SEEDS[0],
            time_step=TIME_STEP,
            time_step_over_rayleigh=TIME_STEP / grain_rayleigh_time(scene),
            grains=len(setups[0].grains.radius),
            wall_s=seconds,
            command=f"python -m doe.lab_c.lammps '{group}'",
            versions=lammps_version(),
        )
        for same in zip(*runs, strict=True)
    ]


def lammps_version() -> str:
    """First words of LAMMPS about itself."""
    said = subprocess.run(["lmp", "-help"], capture_output=True, text=True, check=True).stdout
    return next(line for line in said.splitlines() if "Simulator" in line).rpartition(" - ")[2]


def main(asked: list[str]) -> None:
    """Run what was asked for and add it to the table."""
    table = HERE / "results.csv"
    scene = read_scene(ROOT / "scenes" / "column_collapse.toml", ())
    for group, inputs in GROUPS.items():
        if not asked or group in asked:
            others = [row for row in read_rows(table) if row.group != group]
            write_rows(table, others + rows(group, inputs, scene))


if __name__ == "__main__":
    main(words(__doc__))
