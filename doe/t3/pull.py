"""Why water of the same force lifts our heaps more than those of LAMMPS: writes results_pull.csv.

    python -m doe.t3.pull        a few minutes of one core

Columns of 100 grains at 1.5 mm with half of a textbook neck, in both codes: with necks that hold until they
rupture, and with so little water that the same force acts at contact only. And the limit of friction of two
grains in LAMMPS that stick and are moved past each other, over the net force and over the elastic force.
"""

import csv
import json
import subprocess
import sys
import tempfile
from io import StringIO
from math import pi, sqrt
from pathlib import Path

import numpy as np

from doe.common.cases import ROOT
from doe.common.command import words
from doe.t3.run import (
    DENSITY,
    DIAMETERS,
    NECK,
    POISSON,
    RESTITUTION,
    ROLLING,
    SLIDING,
    SMALL,
    Grains,
    dry_walls,
)
from doe.t3.run import laboratory_run as theirs_once
from taichi_erosion.core.files import write_atomic

TABLE = Path(__file__).with_name("results_pull.csv")
REPEATS, SEED = 16, 5
STRENGTH = 0.5  # of water
WET, CONTACT_ONLY = 0.015, 1e-7  # moisture: of the laboratories; such that necks rupture at a hundredth of d
OBSERVABLES = ("column_height", "pile_height", "centroid_height", "radius_90")
MILLI = 1e-3  # of a metre
# m s-1, s, of the grain that is moved: 6e-6 m, twice the slip at which it slides
CREEP, STEP, STEPS = 0.01, 3e-6, 200
TWO = """units si
atom_style sphere
atom_modify map array
boundary f f f
newton off
comm_modify vel yes
region box block -0.01 0.01 -0.01 0.01 -0.01 0.01
create_box 1 box
create_atoms 1 single 0 0 0
create_atoms 1 single {apart} 0 0
set type 1 diameter {diameter} density {density}
neighbor 3e-4 bin
pair_style granular
pair_coeff * * dmt {young} {restitution} {poisson} {energy} tangential mindlin NULL 1 {sliding} damping tsuji
velocity all set 0 0 0
group second id 2
fix moved second move linear 0 {creep} 0
timestep {step}
variable normal equal -fx[2]
variable sideways equal -fy[2]
thermo_style custom step v_normal v_sideways
run {steps}
print "force $(v_normal) $(v_sideways)"
"""


def ours(moisture: float, strength: float = STRENGTH) -> dict[str, tuple[float, float]]:
    """Mean and its standard error of every observable [m], by the command."""
    with tempfile.TemporaryDirectory() as name:
        scene = Path(name) / "column.toml"
        scene.write_text(dry_walls(), encoding="utf-8")
        orders = (f"effects.liquid_bridge.strength={strength}", f"conditions.moisture={moisture}")
        words = ["run", str(scene), "--replicas", str(REPEATS), "--threads", "1", "--no-record", "--json"]
        words += [word for order in orders for word in ("--set", order)]
        program = [sys.executable, "-m", "taichi_erosion", *words]
        done = subprocess.run(program, capture_output=True, text=True, check=True, cwd=ROOT)
    found = json.loads(done.stdout)["measures"]
    return {name: (found[name]["value"], found[name]["sd"] / sqrt(REPEATS)) for name in OBSERVABLES}


def theirs(strength: float = STRENGTH) -> dict[str, tuple[float, float]]:
    """The same of LAMMPS."""
    generator = np.random.default_rng(SEED)
    grains = Grains(SLIDING, ROLLING, strength * NECK)
    heaps = [theirs_once(SMALL, grains, DIAMETERS[0], generator) for _ in range(REPEATS)]
    table = {name: [heap[name].value or 0.0 for heap in heaps] for name in OBSERVABLES}
    return {name: (float(np.mean(v)), float(np.std(v, ddof=1)) / sqrt(REPEATS)) for name, v in table.items()}


def sliding_limit() -> tuple[float, float]:
    """Tangential force of two sliding grains at a quarter of their pull, over net and elastic force [1]."""
    diameter, pull = DIAMETERS[0], NECK * DIAMETERS[0]
    stiffness = (4.0 / 3.0) * SMALL.young / (2.0 * (1.0 - POISSON**2)) * sqrt(diameter / 4.0)
    overlap = (0.25 * pull / stiffness) ** (2.0 / 3.0)
    told = {"young": SMALL.young, "restitution": RESTITUTION, "poisson": POISSON, "sliding": SLIDING}
    place = {"apart": diameter - overlap, "diameter": diameter, "density": DENSITY, "energy": NECK / pi}
    text = TWO.format(**told, **place, creep=CREEP, step=STEP, steps=STEPS)
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "deck").write_text(text, encoding="utf-8")
        words = ["lmp", "-in", str(Path(name) / "deck"), "-log", "none"]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
    line = next(line for line in done.stdout.splitlines() if line.startswith("force "))
    net, sideways = (abs(float(word)) for word in line.split()[1:])
    return sideways / net, sideways / (pull - net)


def main() -> None:
    """Make the table."""
    heaps = {
        "LAMMPS, dry": theirs(0.0),
        "ours, dry": ours(0.0, 0.0),
        "LAMMPS, pull at contact": theirs(),
        "ours, pull at contact": ours(CONTACT_ONLY),
        "ours, pull until the neck ruptures": ours(WET),
    }
    page = StringIO(newline="")
    writer = csv.writer(page, lineterminator="\n")
    writer.writerow(("what", "observable", "value", "standard error", "unit"))
    for what, found in heaps.items():
        rows = [(what, name, f"{v / MILLI:.4g}", f"{e / MILLI:.2g}", "mm") for name, (v, e) in found.items()]
        writer.writerows(rows)
    for over, limit in zip(("net", "elastic"), sliding_limit(), strict=True):
        name = f"friction over {over} force"
        writer.writerow(("LAMMPS, two grains that slide", name, f"{limit:.3f}", "", "1"))
    write_atomic(TABLE, page.getvalue().encode())


if __name__ == "__main__":
    words(__doc__)
    main()
