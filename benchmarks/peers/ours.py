"""Timed runs of taichi_erosion in a process of its own.

`python -m benchmarks.peers.ours DECK CASE STEPS THREADS PRECISION [SEEDS]`

A bed or a pile is made ready, then timed anew from the same state at every line that comes in. An ensemble is
started and run once. What is found is written as lines of JSON.
"""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.peers.cases import SURFACE_ENERGY, frictions


def answer(figures: dict[str, float], since: float) -> float:
    """Write one line; returns the processor time [s] spent by this process until then."""
    spent = time.process_time()
    sys.stdout.write(json.dumps(figures | {"spent": spent - since}) + "\n")
    sys.stdout.flush()
    return spent


def repeat(windows: dict[str, Callable[..., Any]], deck: str, steps: int, case: Path, numbers: Any) -> None:
    """Time a window as often as asked."""
    from taichi_erosion.benchmark import window_rate

    window, since = windows[deck](case, numbers), 0.0
    for _ in sys.stdin:
        since = answer(window_rate(window, steps), since)


def ensemble(steps: int, case: Path, numbers: Any, count: int) -> None:
    """One bed under as many frictions, as replicas."""
    import numpy as np

    from taichi_erosion.benchmark import LAWS, bed_setup, touching_pairs
    from taichi_erosion.simulation import advance, assemble, ledger

    with np.load(case) as arrays:
        setups = [bed_setup({**arrays, "friction": mu}) for mu in frictions(count)]
    sim = assemble(setups, LAWS, numbers)
    advance(sim, [steps * setup.time_step for setup in setups])
    grains = sum(len(setup.grains.radius) for setup in setups)
    touching = sum(touching_pairs(sim, replica) for replica in range(count))
    found = {
        "grain_steps": grains * steps,
        "contacts_per_grain": 2.0 * touching / grains,
        "rebuilds": sum(ledger(sim, replica).rebuilds for replica in range(count)),
    }
    sys.stdout.write(json.dumps(found) + "\n")


def main(deck: str, case: str, steps: str, threads: str, precision: str, count: str = "1") -> None:
    """Run one deck; the import stays inside, since a comparison of peers alone needs no simulator."""
    from taichi_erosion.benchmark import bed_window, funnel_window, numerics

    def sticky(case: Path, numbers: Any) -> Any:
        return bed_window(case, numbers, SURFACE_ENERGY)

    numbers = numerics(int(threads), "f64" if precision == "f64" else "f32")
    if deck == "ensemble":
        ensemble(int(steps), Path(case), numbers, int(count))
    else:
        windows = {"bed": bed_window, "bed_jkr": sticky, "pile": funnel_window}
        repeat(windows, deck, int(steps), Path(case), numbers)


if __name__ == "__main__":
    main(*sys.argv[1:])
