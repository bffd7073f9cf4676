"""The cases of `bench`, each the median of some rounds."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

from taichi_erosion import __version__
from taichi_erosion.benchmark.air import AIR_COLUMNS, air_case
from taichi_erosion.benchmark.rates import Precision, numerics, rate
from taichi_erosion.benchmark.scaling import scaling_cases
from taichi_erosion.benchmark.setups import LAWS, SOIL, filled_funnel, lattice_bed
from taichi_erosion.benchmark.threshold import threshold_case
from taichi_erosion.core.setup import Setup
from taichi_erosion.simulation import Simulation, advance, assemble
from taichi_erosion.simulation.stage_times import stage_times

Report = Callable[[float, str], None]

START = 0.05  # s, until the contacts of a bed last and a funnel flows
TIMED_STEPS = 1000
ENSEMBLE = 8  # replicas of the bed in the ensemble case
ROUNDS = 3  # the median is reported


@dataclass(frozen=True)
class GrainCase:
    """Grains of one kind of setup, in so many replicas on so many threads."""

    name: str
    setup: Callable[[int], Setup]  # from a seed
    replicas: int
    threads: int
    precision: Precision


def started(case: GrainCase) -> Simulation:
    """The case past its start; its kernels are compiled."""
    setups = [case.setup(seed) for seed in range(case.replicas)]
    sim = assemble(setups, LAWS, numerics(case.threads, case.precision))
    advance(sim, [START] * case.replicas)
    return sim


def grain_case(case: GrainCase) -> dict[str, Any]:
    """Median speed, with the share of every stage."""
    sim = started(case)
    done = round(START / SOIL["time_step"])
    figures = [rate(sim, TIMED_STEPS, done + k * TIMED_STEPS) for k in range(ROUNDS)]
    middle = sorted(figures, key=lambda f: f["grain_steps_per_s"])[ROUNDS // 2]
    cores = min(case.threads, sim.workers)
    return {
        "case": case.name,
        "grains": case.replicas * len(sim.setups[0].grains.radius),
        "threads": case.threads,
        "precision": case.precision,
        "M grain-steps/s": 1e-6 * middle["grain_steps_per_s"],
        "per core": 1e-6 * middle["grain_steps_per_s"] / cores,
        "contacts per grain": middle["contacts_per_grain"],
        "stages": stage_shares(sim, middle["rebuilds"] / TIMED_STEPS),
    }


def stage_shares(sim: Simulation, rebuilds_per_step: float) -> dict[str, float]:
    """Share of a step's time that every stage takes [1]."""
    cost = stage_times(sim)
    cost["rebuild"] *= rebuilds_per_step
    return {stage: spent / sum(cost.values()) for stage, spent in cost.items()}


def run_benchmarks(progress: Report | None = None) -> dict[str, Any]:
    """A bed, a funnel, the bed in f64, ensembles on one thread and on all, air, a threshold, wide beds."""
    cores = len(os.sched_getaffinity(0))
    orders = [
        GrainCase("settled bed", lattice_bed, 1, 1, "f32"),
        GrainCase("settled bed", lattice_bed, 1, 1, "f64"),
        GrainCase("funnel", filled_funnel, 1, 1, "f32"),
        GrainCase("ensemble of beds", lattice_bed, ENSEMBLE, 1, "f32"),
        GrainCase("ensemble of beds", lattice_bed, ENSEMBLE, cores, "f32"),
    ]
    share = 1.0 / (len(orders) + len(AIR_COLUMNS) + 2)
    cases = []
    for index, order in enumerate(orders):
        if progress:
            progress(index * share, f"{order.name}, {order.threads} thread(s), {order.precision}")
        cases.append(grain_case(order))
    for index, columns in enumerate(AIR_COLUMNS):
        if progress:
            progress((len(orders) + index) * share, f"air, {columns} x {columns} columns")
        cases.append(air_case(columns, cores))
    if progress:
        progress(1.0 - 2.0 * share, "fluid threshold")
    cases.append(threshold_case())
    if progress:
        progress(1.0 - share, "beds of growing width")
    cases.extend(scaling_cases())
    versions = {"taichi_erosion": __version__, "taichi": version("taichi")}
    return {"cases": cases, "versions": versions, "cores": cores}
