"""Make the cases of the comparison: `python -m benchmarks.peers.make_cases`.

Writes into benchmarks/peers/cases/: bed2k, bed10k, bed100k, pile2000 and pile10000 as .npz (for us and YADE)
and .data (for LAMMPS and LIGGGHTS), the funnels as .stl and .inc, the soil as soil.inc. LAMMPS settles the
beds in two or three minutes of one core; everything repeats bit for bit with the same LAMMPS.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from benchmarks.peers.cases import (
    BED_COUNT,
    LATTICE_ROW,
    MILLIMETRE,
    SMALL_COUNT,
    SMALL_ROW,
    SOIL,
    SURFACE_ENERGY,
    Bed,
    Floats,
    Pile,
    Soil,
    funnel_pile,
    funnel_triangles,
    loose_lattice,
    shuffled,
    tiled,
)

DECKS = Path(__file__).parent
CASES = DECKS / "cases"
HEADROOM = 3 * MILLIMETRE  # free height above grains that fall from rest
LATTICE_HEADROOM = (
    30 * MILLIMETRE
)  # a grain thrown up at 0.5 m/s, five sd of the lattice's speed, rises 13 mm
FLOOR_MARGIN = 0.5 * MILLIMETRE  # the box reaches below the floor, since grains press into it
PILE_COUNTS = (2000, 10_000)


def write_include(path: Path, numbers: Mapping[str, object]) -> None:
    """Numbers as variables that decks of LAMMPS and LIGGGHTS include."""
    path.write_text("".join(f"variable {name} index {number!r}\n" for name, number in numbers.items()))


def write_grains(
    path: Path, position: Floats, low: Floats, high: Floats, velocity: Floats | None = None, soil: Soil = SOIL
) -> None:
    """Grains as a data file that LAMMPS (sphere) and LIGGGHTS (granular) read alike; type 2 is for walls."""
    sides = "".join(f"{a:.9g} {b:.9g} {c}lo {c}hi\n" for a, b, c in zip(low, high, "xyz", strict=True))
    grain = f"1 {soil.diameter!r} {soil.density!r}"
    with path.open("w") as out:
        out.write(f"{path.stem}\n\n{len(position)} atoms\n2 atom types\n\n{sides}\nAtoms\n\n")
        out.writelines(f"{k} {grain} {x:.12e} {y:.12e} {z:.12e}\n" for k, (x, y, z) in enumerate(position, 1))
        if velocity is not None:
            out.write("\nVelocities\n\n")
            out.writelines(f"{k} {u:.9e} {v:.9e} {w:.9e} 0 0 0\n" for k, (u, v, w) in enumerate(velocity, 1))


def write_bed_grains(
    path: Path, bed: Bed, headroom: float = HEADROOM, velocity: Floats | None = None
) -> None:
    """Data file of a bed, its box open above the grains."""
    low = np.array([0.0, 0.0, -FLOOR_MARGIN])
    high = np.array([*bed.period, bed.position[:, 2].max() + headroom])
    write_grains(path, bed.position, low, high, velocity)


def write_stl(path: Path, triangles: Floats) -> None:
    """Triangles as an ASCII STL file."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    with path.open("w") as out:
        out.write("solid funnel\n")
        for normal, corners in zip(normals, triangles, strict=True):
            out.write("facet normal {:.9g} {:.9g} {:.9g}\nouter loop\n".format(*normal))
            out.writelines("vertex {:.9g} {:.9g} {:.9g}\n".format(*corner) for corner in corners)
            out.write("endloop\nendfacet\n")
        out.write("endsolid funnel\n")


def settled_bed(count: int, rows: int) -> Bed:
    """The loose lattice after LAMMPS let it fall and come to rest."""
    lattice, velocity = loose_lattice(count, rows)
    write_bed_grains(CASES / "lattice.data", lattice, LATTICE_HEADROOM, velocity)
    command = ["lmp", "-in", str(DECKS / "settle.lmp"), "-log", "settle.log", "-screen", "none"]
    subprocess.run(command, cwd=CASES, env=os.environ | {"OMP_NUM_THREADS": "1"}, check=True)
    dump = np.loadtxt(CASES / "settled.dump", skiprows=9)
    return shuffled(Bed(dump[:, 1:4], lattice.period))


def write_bed(name: str, bed: Bed) -> None:
    """A bed for all codes."""
    write_bed_grains(CASES / f"{name}.data", bed)
    np.savez(CASES / f"{name}.npz", position=bed.position, period=np.array(bed.period), **asdict(SOIL))


def write_pile(name: str, pile: Pile) -> None:
    """A funnel and its grains for all codes."""
    geometry = {key: value for key, value in asdict(pile).items() if key != "position"}
    top = pile.funnel_bottom + pile.funnel_height
    side = pile.half_width
    write_include(
        CASES / f"{name}.inc",
        geometry | {"funnel_top": top, "upper_radius": pile.orifice_radius + pile.funnel_height},
    )
    low, high = np.array([-side, -side, -FLOOR_MARGIN]), np.array([side, side, top + HEADROOM])
    write_grains(CASES / f"{name}.data", pile.position, low, high)
    write_stl(CASES / f"{name}.stl", funnel_triangles(pile))
    np.savez(CASES / f"{name}.npz", position=pile.position, **geometry, **asdict(SOIL))


def main() -> int:
    """Write all cases; 2 when LAMMPS is missing."""
    CASES.mkdir(exist_ok=True)
    write_include(CASES / "soil.inc", asdict(SOIL) | {"surface_energy": SURFACE_ENERGY})
    for count in PILE_COUNTS:
        write_pile(f"pile{count}", funnel_pile(count))
    if shutil.which("lmp") is None:
        sys.stderr.write(
            "lmp not found: the beds need LAMMPS to settle (Debian package lammps); piles are written\n"
        )
        return 2
    write_bed("bed2k", settled_bed(SMALL_COUNT, SMALL_ROW))
    bed = settled_bed(BED_COUNT, LATTICE_ROW)
    write_bed("bed10k", bed)
    write_bed("bed100k", shuffled(tiled(bed)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
