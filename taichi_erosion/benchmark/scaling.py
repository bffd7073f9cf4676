"""Cost of a grain-step, and memory, from two thousand to two hundred thousand grains.

One small bed is left to settle; copies of it side by side make the wide ones: the same packing.
One thread, and its processor time, so that other work on the machine counts less.
"""

import time
from typing import Any

import numpy as np

from taichi_erosion.benchmark.rates import device_bytes, stage_shares
from taichi_erosion.benchmark.setups import LAWS, SOIL, bed_setup, lattice_bed
from taichi_erosion.core.setup import Floats, Numerics, Setup
from taichi_erosion.simulation import advance, assemble, ledger, snapshot

SETTLED = 0.05  # s, until the contacts of the small bed last
TILES = ((1, 1), (5, 1), (10, 5), (10, 10))  # copies along either period: 2,016 to 201,600 grains
UNTIMED = 200  # steps before the clock starts: compilation, and contacts that engage
STEPS = 200  # of every round, the same at all sizes: contacts still settle, and their number must be equal
ROUNDS = 3  # the median is reported
NUMERICS = Numerics("cpu", 1, "f32")


def settled_bed() -> tuple[Floats, float]:
    """Positions of the small bed at rest [m], and its period [m]."""
    setup = lattice_bed(0)
    sim = assemble([setup], LAWS, NUMERICS)
    advance(sim, [SETTLED])
    return snapshot(sim, 0).position, setup.period[0]


def tiled_bed(position: Floats, period: float, tiles: tuple[int, int]) -> Setup:
    """Copies of a bed side by side, so many along either period."""
    corners = [(period * x, period * y, 0.0) for x in range(tiles[0]) for y in range(tiles[1])]
    whole = np.concatenate([position + corner for corner in corners])
    return bed_setup(SOIL | {"position": whole, "period": (tiles[0] * period, tiles[1] * period)})


def scaling_case(position: Floats, period: float, tiles: tuple[int, int]) -> dict[str, Any]:
    """Nanoseconds of one thread for a grain-step, and bytes of a grain, on a bed of so many copies."""
    setup = tiled_bed(position, period, tiles)
    grains = len(setup.grains.radius)
    sim = assemble([setup], LAWS, NUMERICS)
    advance(sim, [UNTIMED * setup.time_step])
    spent = []
    for done in UNTIMED + STEPS * np.arange(1, ROUNDS + 1):
        start = time.process_time()
        advance(sim, [done * setup.time_step])
        spent.append(time.process_time() - start)
    sums = ledger(sim, 0)
    return {
        "case": "wide bed",
        "grains": grains,
        "ns per grain-step": 1e9 * float(np.median(spent)) / (grains * STEPS),
        "bytes per grain": device_bytes(sim.world) / grains,
        "touching": 2.0 * sums.contacts / grains,
        "stages": stage_shares(sim, sums.rebuilds / (UNTIMED + ROUNDS * STEPS)),
    }


def scaling_cases() -> list[dict[str, Any]]:
    """Beds of all sizes."""
    position, period = settled_bed()
    return [scaling_case(position, period, tiles) for tiles in TILES]
