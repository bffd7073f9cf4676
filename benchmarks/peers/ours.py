"""Timed runs of taichi_erosion in a process of its own.

`python -m benchmarks.peers.ours DECK CASE STEPS THREADS PRECISION [SEEDS]`

A bed or a pile is made ready, then timed anew from the same state at every line that comes in. An ensemble is
started and run once. What is found is written as lines of JSON.
"""

import json
import sys
import time
from pathlib import Path
from typing import Any

from benchmarks.peers.cases import SURFACE_ENERGY, frictions

BED_UNTIMED = 200  # steps before the clock starts: contacts that engage


def write_line(figures: dict[str, float], since: float) -> float:
    """Write one line; returns the processor time [s] spent by this process until then."""
    spent = time.process_time()
    sys.stdout.write(json.dumps(figures | {"spent": spent - since}) + "\n")
    sys.stdout.flush()
    return spent


def case_setup(deck: str, case: Path) -> tuple[Any, Any, int]:
    """Setup and laws of a deck, and the steps before its clock starts; grains of `bed_jkr` stick by JKR."""
    from dataclasses import replace

    import numpy as np

    from benchmarks.setups import LAWS, bed_setup, funnel_setup

    with np.load(case) as arrays:
        setup = funnel_setup(arrays) if deck == "pile" else bed_setup(arrays)
    if deck != "bed_jkr":
        return setup, LAWS, 0 if deck == "pile" else BED_UNTIMED
    energy = SURFACE_ENERGY * (np.arange(len(setup.contacts.surface_energy)) == 0)  # not to the floor
    sticky = replace(setup, contacts=replace(setup.contacts, surface_energy=energy))
    return sticky, replace(LAWS, normal="jkr"), BED_UNTIMED


def repeat(deck: str, steps: int, case: Path, numerics: Any) -> None:
    """Time the first steps from one state, kernels compiled, once for every line that comes in."""
    from benchmarks.grain_cases import rate
    from taichi_erosion.simulation import advance, assemble, export_state, import_state

    setup, laws, untimed = case_setup(deck, case)
    sim, since = assemble([setup], laws, numerics), 0.0
    start = export_state(sim)
    advance(sim, [max(untimed, 1) * setup.time_step])
    start = export_state(sim) if untimed else start
    for _ in sys.stdin:
        import_state(sim, start)
        since = write_line(rate(sim, steps, untimed), since)


def ensemble(steps: int, case: Path, numerics: Any, count: int) -> None:
    """One bed under as many frictions, as replicas."""
    import numpy as np

    from benchmarks.grain_cases import touching_pairs
    from benchmarks.setups import LAWS, bed_setup
    from taichi_erosion.simulation import advance, assemble, energy_totals

    with np.load(case) as arrays:
        setups = [bed_setup({**arrays, "friction": mu}) for mu in frictions(count)]
    sim = assemble(setups, LAWS, numerics)
    advance(sim, [steps * setup.time_step for setup in setups])
    grains = sum(len(setup.grains.radius) for setup in setups)
    touching = sum(touching_pairs(sim, replica) for replica in range(count))
    found = {
        "grain_steps": grains * steps,
        "contacts_per_grain": 2.0 * touching / grains,
        "rebuilds": sum(energy_totals(sim, replica).rebuilds for replica in range(count)),
    }
    sys.stdout.write(json.dumps(found) + "\n")


def main(deck: str, case: str, steps: str, threads: str, precision: str, count: str = "1") -> None:
    """Run one deck; the import stays inside, since a comparison of peers alone needs no simulator."""
    from taichi_erosion.core.setup import Numerics

    numerics = Numerics("cpu", int(threads), "f64" if precision == "f64" else "f32")
    if deck == "ensemble":
        ensemble(int(steps), Path(case), numerics, int(count))
    else:
        repeat(deck, int(steps), Path(case), numerics)


if __name__ == "__main__":
    main(*sys.argv[1:])
