"""Grain-steps per second of a prepared case (a NumPy file, which other codes can run as well)."""

import time
from pathlib import Path
from typing import Literal

import numpy as np

from taichi_erosion.benchmark.setups import LAWS, bed_setup, funnel_setup
from taichi_erosion.core.setup import Numerics, Setup
from taichi_erosion.simulation import Simulation, advance, assemble, ledger

Precision = Literal["f32", "f64"]

BED_UNTIMED = 200  # steps before the clock starts: compilation, and contacts that engage


def numerics(threads: int, precision: Precision) -> Numerics:
    """CPU with so many threads."""
    return Numerics("cpu", threads, precision)


def timed(sim: Simulation, steps: int, done: int) -> float:
    """Wall time [s] of `steps` more steps of every replica."""
    start = time.perf_counter()
    advance(sim, [(done + steps) * setup.time_step for setup in sim.setups])
    return time.perf_counter() - start


def warmed(setup: Setup, threads: int, precision: Precision, untimed: int) -> Simulation:
    """A simulation whose kernels are compiled; without untimed steps, one more that stands at its start."""
    sim = assemble([setup], LAWS, numerics(threads, precision))
    advance(sim, [max(untimed, 1) * setup.time_step])
    return sim if untimed else assemble([setup], LAWS, numerics(threads, precision))


def rate(sim: Simulation, steps: int, done: int) -> dict[str, float]:
    """Grain-steps per second, contacts among grains per grain, rebuilds."""
    before = ledger(sim, 0).rebuilds
    seconds = timed(sim, steps, done)
    sums = ledger(sim, 0)
    return {
        "grain_steps_per_s": len(sim.setups) * len(sim.setups[0].grains.radius) * steps / seconds,
        "contacts_per_grain": 2.0 * sums.contacts / max(sums.released, 1),
        "rebuilds": sums.rebuilds - before,
    }


def bed_rate(case: Path, steps: int, threads: int, precision: Precision) -> dict[str, float]:
    """Speed on a settled bed from a case file."""
    with np.load(case) as arrays:
        setup = bed_setup(arrays)
    return rate(warmed(setup, threads, precision, BED_UNTIMED), steps, BED_UNTIMED)


def funnel_rate(case: Path, steps: int, threads: int, precision: Precision) -> dict[str, float]:
    """Speed of a funnel that empties, from its first step on."""
    with np.load(case) as arrays:
        setup = funnel_setup(arrays)
    return rate(warmed(setup, threads, precision, 0), steps, 0)
