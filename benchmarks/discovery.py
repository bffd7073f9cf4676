"""A quick discovery over twelve effects and thirty conditions, by the command, from an empty ledger.

python -m benchmarks.discovery

The model itself makes the table: heaps of a hundred grains whose rolling resistance grows with
angularity. What is timed is `discover --budget quick`, which simulates every run of the model.
"""

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path

from taichi_erosion.core.setup import Numerics
from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.ensemble import ReplicaRequest, run_replicas

SCENE = Path(__file__).parents[1] / "doe" / "t1" / "column.toml"
CONDITIONS = list(product((0.0, 0.005, 0.01, 0.02, 0.03), (0.0, 0.5, 1.0), (1.5e-3, 3e-3)))  # w, a, d
REPEATS = 2
OBSERVABLES = ("centroid_height", "pile_height", "column_height", "radius_90")
HEAD = "observable,value,n,unit,group,moisture,angularity,diameter,source"
STUDY = """
[study]
measurements = "heaps.csv"
{observables}
[conditions]
moisture = "conditions.moisture"
angularity = "conditions.angularity"
diameter = "grains.size.diameter"
[parameters."contact.grain-grain.friction_sliding"]
start = 0.52
low = 0.3
high = 0.8
prior_sd_log = 0.1
[parameters."contact.grain-grain.friction_rolling"]
start = 0.15
low = 0.02
high = 0.6
[candidates]
effects = [
    "liquid_bridge", "dry_adhesion", "rolling_resistance", "restitution_speed", "size_distribution",
    "packing_preparation", "image_charge", "grain_density", "grain_shape", "surface_crust", "electric_field",
    "repose_method",
]
"""


def measured() -> str:
    """Table of measurements, as CSV."""
    rows = [(*at, k) for at in CONDITIONS for k in range(REPEATS)]
    parts = []
    for number, (w, a, d, _) in enumerate(rows):
        words = {"conditions.moisture": w, "conditions.angularity": a, "grains.size.diameter": d}
        orders = [f"{path}={value!r}" for path, value in words.items()]
        scene = read_scene(SCENE, (*orders, "effects.rolling_resistance.strength=1.0"))
        parts.append(ReplicaRequest(scene, 2**30 + number))
    lines: list[str] = []

    def append_rows(index: int, record: dict) -> None:
        w, a, d, _ = rows[index]
        for name in OBSERVABLES:
            value = record["measures"][name]["value"]
            lines.append(f"{name},{value:.6g},1,m,w{w:g} a{a:g} d{d:g},{w:g},{a:g},{d:g},made")

    run_replicas(parts, Numerics("cpu", 1, "f32"), append_rows)
    return "\n".join([HEAD, *lines]) + "\n"


def main() -> None:
    """Make the table, discover, and print what it took."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        entries = "".join(
            f'[observables.{name}]\nscene = "column.toml"\ntransform = "log"\n' for name in OBSERVABLES
        )
        (folder / "heaps.csv").write_text(measured(), encoding="utf-8")
        (folder / "column.toml").write_text(SCENE.read_text("utf-8"), encoding="utf-8")
        (folder / "heaps.toml").write_text(STUDY.format(observables=entries), encoding="utf-8")
        program = [sys.executable, "-m", "taichi_erosion", "discover", str(folder / "heaps.toml")]
        before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run([*program, "--budget", "quick", "--json"], capture_output=True, check=True)
        wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    found = json.loads(done.stdout)
    core = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    cores = len(os.sched_getaffinity(0))
    sys.stdout.write(
        f"{found['runs']} runs over {len(CONDITIONS)} conditions, {found['verdict']} {found['named']}: "
        f"{wall / 60:.1f} min on {cores} cores, {core / 60:.1f} core-min, {found['runs'] / wall:.2f} runs/s\n"
    )


if __name__ == "__main__":
    main()
