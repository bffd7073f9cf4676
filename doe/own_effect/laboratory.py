"""Makes the table of falling porous aggregates, as a laboratory whose world the study does not know.

    python -m doe.own_effect.laboratory [TABLE]

It has a law of pores of its own (laboratory_pores.py), another time step and grain density, and reads
velocities with a scatter. TABLE is pores.csv beside this file where left out.
"""

import random
import sys
from pathlib import Path

from taichi_erosion.core.effect_file import read_effect_files
from taichi_erosion.core.setup import Numerics
from taichi_erosion.execution.checks import read_scene
from taichi_erosion.execution.ensemble import ReplicaRequest, run_replicas

HERE = Path(__file__).parent
VOLUMES = (0.0, 0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.14)  # cm3/g
REPEATS = 3
SEED = 7
SCATTER = 0.01  # of a reading, over its value [1]
WORLD = ("run.time_step=7e-5", "materials.quartz.density=2680")
HEADING = "observable,value,n,unit,group,pore_volume [mm3/g],source"


def table() -> str:
    """Table of single readings at every volume of pores."""
    files = read_effect_files([HERE / "laboratory_pores.py"])
    acting = "effects.laboratory_pores.strength=1.0"
    requests = [
        ReplicaRequest(
            read_scene(HERE / "fall.toml", (*WORLD, f"conditions.pore_volume={pores}", acting), files), 1
        )
        for pores in VOLUMES
    ]
    falls: dict[int, dict] = {}
    run_replicas(requests, Numerics("cpu", 1, "f64"), falls.__setitem__)
    drawn, lines = random.Random(SEED), [HEADING]
    for place, pores in enumerate(VOLUMES):
        value = falls[place]["measures"]["settling_velocity"]["value"]
        for _ in range(REPEATS):
            read = value * drawn.gauss(1.0, SCATTER)
            lines.append(f"settling_velocity,{read:.5g},1,m/s,pores {pores:g},{1e3 * pores:g},laboratory.py")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the table."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pores.csv"
    path.write_text(table(), encoding="utf-8")


if __name__ == "__main__":
    main()
