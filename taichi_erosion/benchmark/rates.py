"""Grain-steps per second of a prepared case (a NumPy file, which other codes can run as well)."""

import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from taichi_erosion.benchmark.setups import LAWS, bed_setup, funnel_setup
from taichi_erosion.core.setup import Laws, Numerics, Setup
from taichi_erosion.core.transfer import device_fields, inner_shape
from taichi_erosion.grains.neighbour_list import ENGAGED
from taichi_erosion.simulation import (
    Simulation,
    advance,
    assemble,
    export_bed,
    export_state,
    import_state,
    ledger,
)
from taichi_erosion.simulation.stage_times import stage_times

Precision = Literal["f32", "f64"]

NUMBER_BYTES = {"f32": 4, "i32": 4, "f64": 8}  # of one number on the device
BED_UNTIMED = 200  # steps before the clock starts: contacts that engage


def numerics(threads: int, precision: Precision) -> Numerics:
    """CPU with so many threads."""
    return Numerics("cpu", threads, precision)


def timed(sim: Simulation, steps: int, done: int) -> float:
    """Wall time [s] of `steps` more steps of every replica."""
    start = time.perf_counter()
    advance(sim, [(done + steps) * setup.time_step for setup in sim.setups])
    return time.perf_counter() - start


def touching_pairs(sim: Simulation, replica: int) -> int:
    """Pairs of grains that touch."""
    label: Any = export_bed(sim, replica)["pair_label"]
    return int((label.astype(np.int64) & ENGAGED).sum())


def rate(sim: Simulation, steps: int, done: int) -> dict[str, float]:
    """Grain-steps per second, contacts among grains per grain, rebuilds."""
    before = ledger(sim, 0).rebuilds
    seconds = timed(sim, steps, done)
    sums, touching = ledger(sim, 0), sum(touching_pairs(sim, replica) for replica in range(len(sim.setups)))
    grains = sum(len(setup.grains.radius) for setup in sim.setups)
    return {
        "grain_steps_per_s": grains * steps / seconds,
        "contacts_per_grain": 2.0 * touching / grains,
        "rebuilds": sums.rebuilds - before,
    }


def stage_shares(sim: Simulation, rebuilds_per_step: float) -> dict[str, float]:
    """Share of a step's time that every stage takes [1]."""
    cost = stage_times(sim)
    cost["rebuild"] *= rebuilds_per_step
    return {stage: spent / sum(cost.values()) for stage, spent in cost.items()}


def device_bytes(owner: Any) -> int:
    """Memory of all fields of a record [byte]."""
    sizes = [
        NUMBER_BYTES[field.dtype.to_string()] * np.prod((*field.shape, *inner_shape(field)), dtype=np.int64)
        for field in device_fields(owner)
    ]
    return int(sum(sizes))


@dataclass(frozen=True)
class Window:
    """A simulation whose kernels are compiled, and the state from which it is timed, again and again."""

    sim: Simulation
    start: dict[str, Any]
    untimed: int  # steps before


def window(setup: Setup, chosen: Laws, numbers: Numerics, untimed: int) -> Window:
    """The window that begins after so many untimed steps."""
    sim = assemble([setup], chosen, numbers)
    start = export_state(sim)
    advance(sim, [max(untimed, 1) * setup.time_step])
    return Window(sim, export_state(sim) if untimed else start, untimed)


def window_rate(chosen: Window, steps: int) -> dict[str, float]:
    """Speed over the first `steps` of a window."""
    import_state(chosen.sim, chosen.start)
    return rate(chosen.sim, steps, chosen.untimed)


def bed_window(case: Path, numbers: Numerics, surface_energy: float = 0.0) -> Window:
    """A settled bed from a case file; with a surface energy [J m-2] its grains stick to each other by JKR."""
    with np.load(case) as arrays:
        setup = bed_setup(arrays)
    chosen = LAWS
    if surface_energy > 0.0:
        chosen = replace(LAWS, normal="jkr")
        energy = surface_energy * (np.arange(len(setup.contacts.surface_energy)) == 0)  # not to the floor
        setup = replace(setup, contacts=replace(setup.contacts, surface_energy=energy))
    return window(setup, chosen, numbers, BED_UNTIMED)


def funnel_window(case: Path, numbers: Numerics) -> Window:
    """A funnel that empties, from its first step on."""
    with np.load(case) as arrays:
        setup = funnel_setup(arrays)
    return window(setup, LAWS, numbers, 0)
