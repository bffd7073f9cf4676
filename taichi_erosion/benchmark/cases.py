"""The cases of `bench`, each the median of some rounds."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from typing import Any

from taichi_erosion import __version__
from taichi_erosion.benchmark.air import AIR_COLUMNS, air_case, box_of_wind, tunnel_section
from taichi_erosion.benchmark.patch import blowing_patch
from taichi_erosion.benchmark.rates import Precision, device_bytes, numerics, rate, stage_shares
from taichi_erosion.benchmark.scaling import scaling_cases
from taichi_erosion.benchmark.setups import LAWS, filled_funnel, lattice_bed
from taichi_erosion.benchmark.threshold import threshold_case
from taichi_erosion.core.setup import Setup
from taichi_erosion.simulation import Simulation, advance, assemble, ledger

Report = Callable[[float, str], None]

START = 0.05  # s, until the contacts of a bed last and a funnel flows
WIDE_START = 0.02  # s, of a funnel so wide that more would take a minute
TIMED_STEPS, WIDE_STEPS = 1000, 200
FUNNELS = (2000, 10_000)  # grains
WIDE_FUNNEL = 50_000  # grains
ENSEMBLE = 32  # replicas of the bed in the ensemble case
ENSEMBLE_STEPS = 300
ROUNDS = 3  # the median is reported


@dataclass(frozen=True)
class GrainCase:
    """Grains of one kind of setup, on so many threads."""

    name: str
    begin: Callable[[int, Precision], Simulation]  # on so many threads: past its start, kernels compiled
    threads: int
    precision: Precision
    steps: int = TIMED_STEPS

    def __str__(self) -> str:
        return f"{self.name}, {self.threads} thread(s), {self.precision}"


def begun(setups: list[Setup], until: float, threads: int, precision: Precision) -> Simulation:
    """Replicas past their start."""
    sim = assemble(setups, LAWS, numerics(threads, precision))
    advance(sim, [until] * len(setups))
    return sim


def bed(threads: int, precision: Precision) -> Simulation:
    """A bed that has settled."""
    return begun([lattice_bed(0)], START, threads, precision)


def funnel(grains: int, until: float, threads: int, precision: Precision) -> Simulation:
    """A funnel that empties."""
    return begun([filled_funnel(0, grains)], until, threads, precision)


def beds(threads: int, precision: Precision) -> Simulation:
    """An ensemble of beds that have settled."""
    return begun([lattice_bed(seed) for seed in range(ENSEMBLE)], START, threads, precision)


def grain_cases(cores: int) -> list[GrainCase]:
    """Beds, funnels, a patch of sand that blows, and ensembles on one core and on all."""
    funnels = [GrainCase("funnel", partial(funnel, grains, START), 1, "f32") for grains in FUNNELS]
    wide = GrainCase("funnel", partial(funnel, WIDE_FUNNEL, WIDE_START), 1, "f32", WIDE_STEPS)
    return [
        GrainCase("settled bed", bed, 1, "f32"),
        GrainCase("settled bed", bed, 1, "f64"),
        *funnels,
        wide,
        GrainCase("saltation patch", blowing_patch, 1, "f32"),
        GrainCase("ensemble of beds", beds, 1, "f32", ENSEMBLE_STEPS),
        GrainCase("ensemble of beds", beds, cores, "f32", ENSEMBLE_STEPS),
    ]


def grain_case(case: GrainCase) -> dict[str, Any]:
    """Median speed, with the share of every stage."""
    sim = case.begin(case.threads, case.precision)
    done = int(ledger(sim, 0).step)
    figures = [rate(sim, case.steps, done + k * case.steps) for k in range(ROUNDS)]
    middle = sorted(figures, key=lambda f: f["grain_steps_per_s"])[ROUNDS // 2]
    cores = min(case.threads, sim.workers)
    grains = sum(len(setup.grains.radius) for setup in sim.setups)
    return {
        "case": case.name,
        "grains": grains,
        "threads": case.threads,
        "precision": case.precision,
        "M grain-steps/s": 1e-6 * middle["grain_steps_per_s"],
        "per core": 1e-6 * middle["grain_steps_per_s"] / cores,
        "contacts per grain": middle["contacts_per_grain"],
        "bytes per grain": device_bytes(sim.world) / grains,
        "stages": stage_shares(sim, middle["rebuilds"] / case.steps),
    }


def run_benchmarks(progress: Report | None = None) -> dict[str, Any]:
    """Beds, funnels, a patch that blows and ensembles; air; a threshold; wide beds."""
    cores = len(os.sched_getaffinity(0))
    air = [tunnel_section(), *(box_of_wind(columns) for columns in AIR_COLUMNS)]
    orders: list[tuple[str, Callable[[], dict[str, Any]]]] = [
        *((str(one), partial(grain_case, one)) for one in grain_cases(cores)),
        *((one.name, partial(air_case, one, cores)) for one in air),
        ("fluid threshold", threshold_case),
    ]
    cases: list[dict[str, Any]] = []
    for index, (name, order) in enumerate(orders):
        if progress:
            progress(index / (len(orders) + 1), name)
        cases.append(order())
    if progress:
        progress(len(orders) / (len(orders) + 1), "beds of growing width")
    cases.extend(scaling_cases())
    versions = {"taichi_erosion": __version__, "taichi": version("taichi")}
    return {"cases": cases, "versions": versions, "cores": cores}
