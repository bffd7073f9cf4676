"""A bed alone, then beside busy programs that leave one core: one thread, two threads, the adaptive team.

All three take turns with the same simulation, each for the same wall time. The rates of two threads are those
of a team that does not adapt.
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from statistics import median
from typing import Any

from benchmarks.grain_cases import START, after, grain_count
from benchmarks.setups import lattice_bed
from taichi_erosion.core.setup import Numerics
from taichi_erosion.simulation import Simulation, advance, energy_totals
from taichi_erosion.simulation.team import Team

BUSY = "while True: pass"
THREADS = 2
TURN, TURNS = 1.0, 7  # s; the median is reported
PORTION = 100  # steps between two looks at the clock


def teams() -> dict[str, Team]:
    """Teams of a run on two threads."""
    return {"one thread": Team(absent=1, adapts=False), "two threads": Team(adapts=False), "adaptive": Team()}


@contextmanager
def busy_programs(count: int) -> Iterator[None]:
    """Endless loops in processes of their own."""
    programs = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


def shared_cases(cores: int) -> list[dict[str, Any]]:
    """The settled bed with all cores free, and with all but one taken."""
    sim = after(START, lambda: [lattice_bed(0)])(Numerics("cpu", THREADS, "f32"))
    cases = [shared_case(sim, "nothing else runs")]
    with busy_programs(max(cores - 1, 1)):
        return [*cases, shared_case(sim, "one core is free")]


def turn(sim: Simulation, seconds: float) -> float:
    """Rate over so much wall time [M grain-steps/s]."""
    step = sim.setups[0].time_step
    first = done = int(energy_totals(sim, 0).step)
    start = now = time.perf_counter()
    while now < start + seconds:
        done += PORTION
        advance(sim, [done * step])
        now = time.perf_counter()
    return 1e-6 * grain_count(sim) * (done - first) / (now - start)


def shared_case(sim: Simulation, cores: str) -> dict[str, Any]:
    """Median rates of all three [M grain-steps/s], and medians of the ratios turn by turn."""
    rates: dict[str, list[float]] = {}
    ways = teams()
    for _ in range(TURNS):
        for way, team in ways.items():
            sim.team = team
            rates.setdefault(way, []).append(turn(sim, TURN))
    ratios = {
        f"adaptive / {way}": [a / b for a, b in zip(rates["adaptive"], rates[way], strict=True)]
        for way in ("one thread", "two threads")
    }
    known = {"case": f"shared: {cores}", "grains": grain_count(sim), "threads": THREADS, "precision": "f32"}
    return known | {name: median(found) for name, found in (rates | ratios).items()}
