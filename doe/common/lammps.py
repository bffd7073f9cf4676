"""Files of LAMMPS: the start of a packing, and the grains of a dump. The code itself is optional."""

from pathlib import Path

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot

DENSITY = 2500.0  # kg m-3
DUMP_HEAD = 9  # lines of a dump before the grains
HEAD = """rain

{count} atoms
1 atom types

{low} {high} xlo xhi
{low} {high} ylo yhi
{floor} {top} zlo zhi
"""


def data_file(position: Floats, velocity: Floats, diameter: Floats, box: dict[str, float]) -> str:
    """Data file of a start; `box` has `low` and `high` of x and y, `floor` and `top` of z [m]."""
    places, speeds = ([" ".join(f"{c:.17g}" for c in row) for row in table] for table in (position, velocity))
    spheres = [
        f"{k} 1 {d:.17g} {DENSITY} {x}" for k, (d, x) in enumerate(zip(diameter, places, strict=True), 1)
    ]
    moving = [f"{k} {v} 0 0 0" for k, v in enumerate(speeds, 1)]
    head = HEAD.format(count=len(places), **box)
    return "\n".join((head, "Atoms # sphere\n", *spheres, "\nVelocities\n", *moving)) + "\n"


def read_dump(file: Path) -> Snapshot:
    """Grains of a dump; only their places and sizes are in it."""
    table = np.loadtxt(file, skiprows=DUMP_HEAD)
    count, radius = len(table), table[:, 4]
    still, none = np.zeros((count, 3)), np.zeros(count, np.int32)
    mass = DENSITY * 4.0 / 3.0 * np.pi * radius**3
    return Snapshot(0.0, 0, table[:, 1:4], still, still, radius, mass, none, none, 0)
