"""The 17 runs of a Box-Behnken design: as ensembles of one process, and as a process each.

python -m benchmarks.ensemble [GRAINS]

One core does all runs of either kind, one after the other or as replicas. CPU time counts, for the cores of a
machine may have other work; the wall time is printed beside it. Seeds and settings are the same for both.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from taichi_erosion.campaign.execute import execute
from taichi_erosion.campaign.ledger import close_ledger, open_ledger
from taichi_erosion.campaign.request import scene_request
from taichi_erosion.experiments.design import Design, Factor, box_behnken

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "scenes" / "funnel_repose.toml"
GRAINS = 3000
FACTORS = (
    Factor("contact.soil-soil.friction_sliding", 0.5, 0.7),
    Factor("contact.soil-soil.friction_rolling", 0.5, 0.9),
    Factor("contact.soil-steel.friction_sliding", 0.3, 0.5),
)


@dataclass(frozen=True)
class Cost:
    """What a way of running the design took."""

    cpu_s: float
    wall_s: float
    angles: tuple[float | None, ...]


def orders(design: Design, row: int, grains: int) -> list[str]:
    """PATH=VALUE of one row."""
    return [f"grains.count={grains}", *(f"{path}={value!r}" for path, value in design.settings(row).items())]


def together(design: Design, grains: int) -> tuple[float | None, ...]:
    """All rows as a campaign of one worker."""
    requests = [scene_request(SCENE, orders(design, row, grains), row) for row in range(len(design))]
    with tempfile.TemporaryDirectory() as folder:
        store = open_ledger(Path(folder))
        results = execute(requests, store, workers=1)
        close_ledger(store)
    return tuple(result.record["measures"]["repose_angle"]["value"] for result in results)


def apart(design: Design, grains: int) -> tuple[float | None, ...]:
    """Every row in a process of its own."""
    program = [sys.executable, "-m", "taichi_erosion", "run", str(SCENE), "--no-record", "--json"]
    angles = []
    for row in range(len(design)):
        words = [word for order in orders(design, row, grains) for word in ("--set", order)]
        plain = ["--threads", "1", "--replicas", "1", "--seed", str(row)]
        done = subprocess.run([*program, *plain, *words], capture_output=True, check=True, cwd=ROOT)
        angles.append(json.loads(done.stdout)["measures"]["repose_angle"]["value"])
    return tuple(angles)


def timed(way: Callable[[Design, int], tuple[float | None, ...]], design: Design, grains: int) -> Cost:
    """CPU time of all child processes of one way, and its wall time."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    angles = way(design, grains)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Cost(used, time.perf_counter() - start, angles)


def main(words: list[str]) -> None:
    """Time both ways and print one line of a table."""
    grains = int(words[0]) if words else GRAINS
    design = box_behnken(FACTORS)
    ensemble, processes = timed(together, design, grains), timed(apart, design, grains)
    same = "yes" if ensemble.angles == processes.angles else "NO"
    cells = (
        f"{grains}",
        f"{ensemble.cpu_s:.0f} s",
        f"{processes.cpu_s:.0f} s",
        f"{processes.cpu_s / ensemble.cpu_s:.2f}",
        f"{ensemble.wall_s:.0f} s",
        f"{processes.wall_s:.0f} s",
        same,
    )
    sys.stdout.write("| " + " | ".join(cells) + " |\n")


if __name__ == "__main__":
    main(sys.argv[1:])
