"""Heaps of LAMMPS, which is optional: the start of a packing, a run of a deck, and what is measured."""

import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures import heap
from taichi_erosion.measures.result import Measurement

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


def measured_heap(deck: Path, start: str, values: Mapping[str, Any]) -> list[Measurement]:
    """Observables of one heap: a deck with values for what stands in braces, run from a start."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "rain.data").write_text(start, encoding="utf-8")
        text = deck.read_text(encoding="utf-8").format(folder=folder, **values)
        (folder / "deck").write_text(text, encoding="utf-8")
        words = ["lmp", "-in", str(folder / "deck"), "-log", "none", "-screen", "none"]
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode:
            raise BadInput(f"LAMMPS stopped: {done.stderr[-300:]}")
        filled, pile = (read_dump(folder / f"{stage}.dump") for stage in ("column", "pile"))
    of_pile = (heap.angle_of_repose_outline, heap.pile_height, heap.centroid_height, heap.radius_90)
    return [heap.column_height(filled), *(measure(pile) for measure in of_pile), heap.runout_radius(pile)]
