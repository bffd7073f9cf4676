"""Makes the table of heaps of rooted soil, as a laboratory whose world the study does not know.

    python -m doe.own_effect.laboratory [TABLE]

It has a law of roots of its own (laboratory_roots.py), another time step and rolling friction;
seeds are others too, rows are single repeats. TABLE is roots.csv beside this file where left out.
"""

import sys
from pathlib import Path

from taichi_erosion.core.effect_file import read_effect_files
from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.ensemble import ReplicaRequest, run_replicas

HERE = Path(__file__).parent
DENSITIES = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0)  # kg m-3
REPEATS = 3
FIRST_SEED = 2**30 + 7
WORLD = ("run.time_step_d=2.4e-2", "contact.grain-grain.friction_rolling=0.2")
OBSERVABLES = ("centroid_height", "pile_height")
HEADING = "observable,value,n,unit,group,root_density [g/cm3],source"


def table() -> str:
    """Table of single repeats at every root density."""
    files = read_effect_files([HERE / "laboratory_roots.py"])
    densities = [density for density in DENSITIES for _ in range(REPEATS)]
    requests = [
        ReplicaRequest(
            read_scene(
                HERE / "heap.toml",
                (*WORLD, f"conditions.root_density={density}", "effects.laboratory_roots.strength=1.0"),
                files,
            ),
            FIRST_SEED + place,
        )
        for place, density in enumerate(densities)
    ]
    heaps: dict[int, dict] = {}
    run_replicas(requests, Numerics("cpu", 1), heaps.__setitem__)
    lines = [HEADING]
    for place, density in enumerate(densities):
        measures = heaps[place]["measures"]
        row = f"1,mm,heap {density:g},{1e-3 * density:g},laboratory.py"
        lines += [f"{name},{1e3 * measures[name]['value']:.5g},{row}" for name in OBSERVABLES]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the table."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "roots.csv"
    path.write_text(table(), encoding="utf-8")


if __name__ == "__main__":
    main()
