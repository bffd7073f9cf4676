"""Cost of a grain-step, and memory, from two thousand to two hundred thousand grains.

One small bed is left to settle; copies of it side by side make the wide ones: the same packing.
One thread, and its processor time, so that other work on the machine counts less.
"""

import time
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from taichi_erosion.benchmark.setups import LAWS, SOIL, bed_setup, lattice_bed
from taichi_erosion.core.setup import Floats, Numerics, Setup
from taichi_erosion.core.transfer import inner_shape
from taichi_erosion.simulation import advance, assemble, ledger, snapshot

SETTLED = 0.05  # s, until the contacts of the small bed last
TILES = (1, 2, 5, 10)  # copies along each period: 2,016 to 201,600 grains
UNTIMED = 200  # steps before the clock starts: compilation, and contacts that engage
STEPS = 200  # of every round, the same at all sizes: contacts still settle, and their number must be equal
ROUNDS = 3  # the median is reported
NUMERICS = Numerics("cpu", 1, "f32")
NUMBER_BYTES = {"f32": 4, "i32": 4, "f64": 8}  # of one number on the device


def settled_bed() -> tuple[Floats, float]:
    """Positions of the small bed at rest [m], and its period [m]."""
    setup = lattice_bed(0)
    sim = assemble([setup], LAWS, NUMERICS)
    advance(sim, [SETTLED])
    return snapshot(sim, 0).position, setup.period[0]


def tiled_bed(position: Floats, period: float, tiles: int) -> Setup:
    """Copies of a bed side by side, `tiles` along each period."""
    corners = [(period * x, period * y, 0.0) for x in range(tiles) for y in range(tiles)]
    whole = np.concatenate([position + corner for corner in corners])
    return bed_setup(SOIL | {"position": whole, "period": (tiles * period,) * 2})


def device_fields(owner: Any) -> Iterator[Any]:
    """All fields that a record holds, in records within it too."""
    for entry in fields(owner):
        value = getattr(owner, entry.name)
        if is_dataclass(value):
            yield from device_fields(value)
        elif hasattr(value, "dtype") and hasattr(value, "shape"):
            yield value


def device_bytes(owner: Any) -> int:
    """Memory of all fields of a record [byte]."""
    sizes = [
        NUMBER_BYTES[field.dtype.to_string()] * np.prod((*field.shape, *inner_shape(field)), dtype=np.int64)
        for field in device_fields(owner)
    ]
    return int(sum(sizes))


def scaling_case(position: Floats, period: float, tiles: int) -> dict[str, Any]:
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
    return {
        "case": "wide bed",
        "grains": grains,
        "ns per grain-step": 1e9 * float(np.median(spent)) / (grains * STEPS),
        "bytes per grain": device_bytes(sim.world) / grains,
        "touching": 2.0 * ledger(sim, 0).contacts / grains,
    }


def scaling_cases() -> list[dict[str, Any]]:
    """Beds of all sizes."""
    position, period = settled_bed()
    return [scaling_case(position, period, tiles) for tiles in TILES]
