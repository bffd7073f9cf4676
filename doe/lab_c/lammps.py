"""Laboratory C in the code it was made with (LAMMPS, optional): the starts of our seeds, our measures.

python -m doe.lab_c.lammps             24 runs of half a minute each, added to results.csv
python -m doe.lab_c.lammps GROUP...    those of some groups

LAMMPS receives the laboratory's restitution of 0.5; then 0.3667, with which its grains part at half the
speed; then 0.5 again, but without a rolling damper; then also with a rolling spring between grains as soft as
ours.
"""

import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from doe.common.cases import ROOT, Row
from doe.common.command import words
from doe.common.lammps import data_file, measured_heap
from doe.common.tables import update_table
from doe.trials.lammps import DECK, WHOLE, Grains, told
from taichi_erosion.core.setup import Setup
from taichi_erosion.measures.result import Measurement
from taichi_erosion.run.checks import read_scene
from taichi_erosion.scene import Scene, build_setup, scene_hash
from taichi_erosion.scene.build.limits import grain_rayleigh_time

HERE = Path(__file__).parent
SEEDS = range(1, 7)
DIAMETER, TIME_STEP = 1.5e-3, WHOLE.step_d * 1.5e-3  # m, s, of the laboratory
GRAINS = Grains(sliding=0.55, rolling=0.12)  # at angularity 0, as its truth.json states
SOFTER = 8.0  # spring of the laboratory over 2.25 k_n mu_r^2 under the force of five weights [1]
BOX = {"low": -0.08, "high": 0.08, "floor": -0.001, "top": 0.03}  # m


@dataclass(frozen=True)
class Inputs:
    """Inputs of LAMMPS."""

    restitution: float  # [1]
    damper: float = 1.0  # of rolling, over the laboratory's [1]
    spring: float = 1.0  # of rolling between grains, over the laboratory's [1]


GROUPS = {
    "LAMMPS, restitution 0.5": Inputs(0.5),
    "LAMMPS, restitution 0.3667": Inputs(0.3666513615687184),
    "LAMMPS, restitution 0.5, no rolling damper": Inputs(0.5, 0.0),
    "LAMMPS, restitution 0.5, no rolling damper, soft rolling spring": Inputs(0.5, 0.0, 1.0 / SOFTER),
}


def simulate(setup: Setup, inputs: Inputs) -> list[Measurement]:
    """One run of LAMMPS, measured."""
    values = told(WHOLE, GRAINS, DIAMETER, inputs.restitution)
    values["damper"] *= inputs.damper
    values["spring"] *= inputs.spring
    grains = setup.grains
    return measured_heap(DECK, data_file(grains.position, grains.velocity, 2.0 * grains.radius, BOX), values)


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
            update_table(table, Row, rows(group, inputs, scene), lambda row: row.group)


if __name__ == "__main__":
    main(words(__doc__))
