"""Timed grains: beds, funnels, an ensemble, a patch under wind, and beds of two thousand to 200,000 grains.

Of the cases with a speed the median of some rounds counts. The wide beds are copies of one settled bed
side by side, the same packing at every size, on one thread and in its processor time: other work on the
machine counts less.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from benchmarks.peers.cases import Bed, tiled
from benchmarks.roofline import step_bytes
from benchmarks.setups import LAWS, SOIL, bed_setup, filled_funnel, lattice_bed
from benchmarks.stage_times import copy_bandwidth, stage_times
from benchmarks.vector_width import packed_width
from benchmarks.wind_cases import blowing_patch
from taichi_erosion.core.setup import Arch, Numerics, Setup
from taichi_erosion.core.transfer import NUMPY_TYPES, device_fields, element_shape
from taichi_erosion.grains.neighbour_list import ENGAGED
from taichi_erosion.simulation import (
    Simulation,
    advance,
    assemble,
    energy_totals,
    export_bed,
    export_state,
    import_state,
    snapshot,
)

Precision = Literal["f32", "f64"]
Size = Literal["quick", "usual", "large"]  # of the cases on a graphics processor

START = 0.05  # s, until contacts last and a funnel flows
WIDE_START = 0.02  # s, of a funnel that would take a minute
FUNNELS, WIDE_FUNNEL = (2000, 10_000), 50_000  # grains
ENSEMBLE, FUNNELS_MANY = 32, 1000  # replicas
QUICK_ENSEMBLE, QUICK_STEPS = 4, 100  # replicas, and steps of a round, where a driver is software
MILLION_SIDE = 267  # grains along each period of a bed of a million
ROUNDS = 3  # the median is reported
TILES = ((1, 1), (5, 1), (10, 5), (10, 10))  # copies along either period: 2,016 to 201,600 grains
UNTIMED = 200  # steps before the clock starts: contacts settle alike at all sizes
WIDE_STEPS = 200  # steps of a round of the wide cases


@dataclass(frozen=True)
class GrainCase:
    """Grains of one kind of setup, on so many threads."""

    name: str
    begin: Callable[[Numerics], Simulation]  # past its start, kernels compiled
    threads: int
    precision: Precision = "f32"
    steps: int = 1000
    arch: Arch = "cpu"

    def __str__(self) -> str:
        where = f"{self.threads} thread(s)" if self.arch == "cpu" else self.arch
        return f"{self.name}, {where}, {self.precision}"


def after(until: float, setups: Callable[[], list[Setup]]) -> Callable[[Numerics], Simulation]:
    """Replicas that have run for a time [s]."""

    def begin(numerics: Numerics) -> Simulation:
        sim = assemble(setups(), LAWS, numerics)
        advance(sim, [until] * len(sim.setups))
        return sim

    return begin


def after_on_cpu(until: float, setups: Callable[[], list[Setup]]) -> Callable[[Numerics], Simulation]:
    """Replicas that have run for a time [s] on all cores of the CPU, and one step on another device."""

    def begin(numerics: Numerics) -> Simulation:
        start = after(until, setups)(Numerics("cpu", 0, numerics.precision))
        state, listed = export_state(start), start.setups
        sim = assemble(listed, LAWS, numerics)
        import_state(sim, state)
        done = int(energy_totals(sim, 0).step)
        advance(sim, [(done + 1) * setup.time_step for setup in listed])
        return sim

    return begin


def standard_grain_cases(cores: int) -> list[GrainCase]:
    """Beds, funnels, a patch of sand that blows, and ensembles on one core and on all."""
    bed = after(START, lambda: [lattice_bed(0)])
    beds = after(START, lambda: [lattice_bed(seed) for seed in range(ENSEMBLE)])
    funnels = [after(START, lambda grains=grains: [filled_funnel(0, grains)]) for grains in FUNNELS]
    return [
        GrainCase("settled bed", bed, 1),
        GrainCase("settled bed", bed, 1, "f64"),
        *(GrainCase("funnel", funnel, 1) for funnel in funnels),
        GrainCase("funnel", after(WIDE_START, lambda: [filled_funnel(0, WIDE_FUNNEL)]), 1, steps=200),
        GrainCase("saltation patch", blowing_patch, 1),
        GrainCase("ensemble of beds", beds, 1, steps=300),
        GrainCase("ensemble of beds", beds, cores, steps=300),
    ]


def device_grain_cases(arch: Arch, size: Size) -> list[GrainCase]:
    """A bed, a funnel and an ensemble, started on the CPU; `large`: also what fills a graphics processor."""
    quick = size == "quick"
    beds, steps = QUICK_ENSEMBLE if quick else ENSEMBLE, QUICK_STEPS if quick else 1000
    cases: dict[str, Callable[[], list[Setup]]] = {
        "settled bed": lambda: [lattice_bed(0)],
        "funnel": lambda: [filled_funnel(0, FUNNELS[0] if quick else FUNNELS[1])],
        "ensemble of beds": lambda: [lattice_bed(seed) for seed in range(beds)],
    }
    found = [
        GrainCase(name, after_on_cpu(START, setups), 1, steps=steps, arch=arch)
        for name, setups in cases.items()
    ]
    if size == "large":
        wide: dict[str, Callable[[], list[Setup]]] = {
            "ensemble of funnels": lambda: [filled_funnel(seed, FUNNELS[0]) for seed in range(FUNNELS_MANY)],
            "bed of a million": lambda: [lattice_bed(0, MILLION_SIDE)],
        }
        found += [GrainCase(name, after(WIDE_START, setups), 1, arch=arch) for name, setups in wide.items()]
    return found


def grain_count(sim: Simulation) -> int:
    """Grains of all replicas."""
    return sum(len(setup.grains.radius) for setup in sim.setups)


def touching_pairs(sim: Simulation, replica: int) -> int:
    """Pairs of grains that touch."""
    label: Any = export_bed(sim, replica)["pair_label"]
    return int((label.astype(np.int64) & ENGAGED).sum())


def rate(sim: Simulation, steps: int, done: int) -> dict[str, float]:
    """Grain-steps per second of `steps` more steps after `done`, contacts per grain, rebuilds."""
    before, start = energy_totals(sim, 0).rebuilds, time.perf_counter()
    advance(sim, [(done + steps) * setup.time_step for setup in sim.setups])
    seconds, grains = time.perf_counter() - start, grain_count(sim)
    return {
        "grain_steps_per_s": grains * steps / seconds,
        "contacts_per_grain": 2.0 * sum(touching_pairs(sim, r) for r in range(len(sim.setups))) / grains,
        "rebuilds": energy_totals(sim, 0).rebuilds - before,
    }


def stage_shares(sim: Simulation, rebuilds_per_step: float) -> dict[str, float]:
    """Share of a step's time that every stage takes [1]."""
    cost = stage_times(sim)
    cost["rebuild"] *= rebuilds_per_step
    return {stage: spent / sum(cost.values()) for stage, spent in cost.items()}


def device_bytes(owner: Any) -> int:
    """Memory of all fields of a record [byte]."""
    sizes = [
        NUMPY_TYPES[str(field.dtype)]().itemsize
        * np.prod((*field.shape, *element_shape(field)), dtype=np.int64)
        for field in device_fields(owner)
    ]
    return int(sum(sizes))


def roofline_share(sim: Simulation, speed: float) -> dict[str, float]:
    """Bandwidth of a copy on the device, and the share of it that a speed [grain-steps s-1] uses."""
    contacts = sum(touching_pairs(sim, r) for r in range(len(sim.setups)))
    moved, bandwidth = step_bytes(sim, contacts) / grain_count(sim), copy_bandwidth()
    return {
        "GB/s of a copy": 1e-9 * bandwidth,
        "bytes per grain-step": moved,
        "share of bandwidth": moved * speed / bandwidth,
    }


def grain_case(case: GrainCase) -> dict[str, Any]:
    """Median speed, with the share of every stage."""
    sim = case.begin(Numerics(case.arch, case.threads, case.precision))
    done, grains = int(energy_totals(sim, 0).step), grain_count(sim)
    rates = [rate(sim, case.steps, done + k * case.steps) for k in range(ROUNDS)]
    middle = sorted(rates, key=lambda found: found["grain_steps_per_s"])[ROUNDS // 2]
    speed = 1e-6 * middle["grain_steps_per_s"]
    found = {
        "case": case.name,
        "grains": grains,
        "precision": case.precision,
        "M grain-steps/s": speed,
        "contacts per grain": middle["contacts_per_grain"],
        "bytes per grain": (device_bytes(sim.world) + device_bytes(sim.buffers)) / grains,
    }
    if case.arch != "cpu":
        return found | {"device": case.arch} | roofline_share(sim, 1e6 * speed)
    return found | {
        "threads": case.threads,
        "per core": speed / min(case.threads, sim.workers),
        "vector bits": packed_width(),
        "stages": stage_shares(sim, middle["rebuilds"] / case.steps),
    }


def wide_bed_case(setup: Setup) -> dict[str, Any]:
    """Nanoseconds of one thread for a grain-step, and bytes of a grain."""
    sim = assemble([setup], LAWS, Numerics("cpu", 1, "f32"))
    grains = grain_count(sim)
    advance(sim, [UNTIMED * setup.time_step])
    spent = []
    for done in UNTIMED + WIDE_STEPS * np.arange(1, ROUNDS + 1):
        start = time.process_time()
        advance(sim, [done * setup.time_step])
        spent.append(time.process_time() - start)
    sums = energy_totals(sim, 0)
    return {
        "case": "wide bed",
        "grains": grains,
        "ns per grain-step": 1e9 * float(np.median(spent)) / (grains * WIDE_STEPS),
        "bytes per grain": device_bytes(sim.world) / grains,
        "touching": 2.0 * sums.contacts / grains,
        "stages": stage_shares(sim, sums.rebuilds / (UNTIMED + ROUNDS * WIDE_STEPS)),
    }


def wide_bed_cases() -> list[dict[str, Any]]:
    """Beds of all sizes, copies of one that has settled."""
    sim = after(START, lambda: [lattice_bed(0)])(Numerics("cpu", 1, "f32"))
    bed = Bed(snapshot(sim, 0).position, sim.setups[0].period[:2])
    return [wide_bed_case(bed_setup(SOIL | asdict(tiled(bed, tiles)))) for tiles in TILES]
