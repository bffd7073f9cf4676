"""From the call of `run` to the first step of the funnel, without and with compiled kernels at hand.

python -m benchmarks.start [ROUNDS]

Every round starts the program twice in a process of its own with a cache of its own: empty, then as the first
left it. Wall time ends after the first step; processor time beside it, since the cores may have other work.
Fills the table of `docs/speed.md` with medians over the rounds.
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
SCENE = ROOT / "scenes" / "funnel_repose.toml"
ROUNDS = 3
FIRST = "first-step"  # word that marks a process that stops after its first step
RUN = ("run", str(SCENE), "--no-record", "--threads", "1", "--replicas", "1")


def stop_after_first_step() -> None:
    """Run the program as a user would; print the processor time after its first step, and end."""
    from taichi_erosion.cli.main import main as program
    from taichi_erosion.core.device import stop_device
    from taichi_erosion.execution import ensemble_loop

    advance = ensemble_loop.simulation.advance

    def advance_once(sim: Any, until: Any) -> None:
        advance(sim, [setup.time_step for setup in sim.setups])
        sys.stdout.write("\n" + json.dumps({"wall": time.time(), "cpu": time.process_time()}) + "\n")
        sys.stdout.flush()
        stop_device()  # writes the cache
        os._exit(0)

    setattr(ensemble_loop.simulation, "advance", advance_once)  # noqa: B010
    sys.argv = ["taichi-erosion", *RUN]
    program()


def started(cache: str) -> dict[str, float]:
    """Wall and processor time [s] of one start with a given cache."""
    begin = time.time()
    command = [sys.executable, "-m", "benchmarks.start", FIRST]
    environment = os.environ | {"XDG_CACHE_HOME": cache}
    done = subprocess.run(command, env=environment, cwd=ROOT, capture_output=True, text=True, check=True)
    printed = json.loads(done.stdout.strip().splitlines()[-1])
    return {"wall": printed["wall"] - begin, "cpu": printed["cpu"]}


def starts(rounds: int) -> dict[str, dict[str, float]]:
    """Wall and processor time [s] of a start with an empty cache and with a full one, medians."""
    samples: dict[str, list[dict[str, float]]] = {"empty": [], "full": []}
    for _ in range(rounds):
        with tempfile.TemporaryDirectory() as cache:
            for kind in samples.values():
                kind.append(started(cache))
    return {
        name: {key: statistics.median(row[key] for row in rows) for key in ("wall", "cpu")}
        for name, rows in samples.items()
    }


def main(words: list[str]) -> None:
    """Fill the table of the page on speed, and say where."""
    if words == [FIRST]:
        stop_after_first_step()
    from benchmarks.page import PAGE, fill, start_table

    table = start_table(starts(int(words[0]) if words else ROUNDS))
    sys.stdout.write(f"{fill(PAGE, {'start': table})}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
