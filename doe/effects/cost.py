"""What an effect costs: processor time of a grain's step with it alone, over that of the bare model.

A bed of grains lies in a light wind in which nothing moves, the state in which most grains of a run are most
of the time. Bare runs stand between the others, so that their scatter says what the ratios are worth.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from taichi_erosion.core.device import stop_device
from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.effects import load_library
from taichi_erosion.scene import Scene, parse_scene
from taichi_erosion.simulation import advance, assemble, prepare

COUNT, SIDE = 1500, 14.0  # grains, and length and width of the patch in diameters [1]
DIAMETER = 2.5e-4  # m
SETTLED = 0.05  # s
REPEATS, STEPS = 7, 400  # the fastest of so many timings of so many steps counts
BARE_EVERY = 4  # effects between two bare runs


@dataclass(frozen=True)
class Cost:
    """One row: an effect, or the bare model where the name is empty."""

    effect: str
    place: str
    nanoseconds: float  # of one core for one step of one grain
    ratio: float  # over the mean of all bare runs [1]


def bed_scene(effect: str) -> Scene:
    """A bed in a light wind, moist and dry enough for every effect."""
    table: dict[str, Any] = {
        "scene": {"kind": "saltation", "title": "a bed at rest"},
        "conditions": {"moisture": 0.004},
        "run": {"overlap_limit": 0.9},
        "grains": {"count": COUNT, "material": "sand", "size": {"law": "monodisperse", "diameter": DIAMETER}},
        "materials": {"sand": {"density": 2650.0, "young_modulus": 2e5, "poisson_ratio": 0.25}},
        "contact": {"sand-sand": {"restitution": 0.5, "friction_sliding": 0.5}},
        "geometry": {"ground": {"shape": "plane", "material": "sand"}},
        "fill": {"law": "layers", "pitch": 1.15 * DIAMETER, "first_height": DIAMETER},
        "wind": {
            "length": SIDE * DIAMETER,
            "width": SIDE * DIAMETER,
            "height": 0.02,
            "friction_velocity": 0.1,
        },
        "stages": [{"name": "rest", "until": "time", "duration_max": SETTLED}],
    }
    if effect:
        table["effects"] = {effect: {"strength": 1.0}}
    return parse_scene(table, "bed")


def nanoseconds(effect: str) -> float:
    """Processor time of one step of one grain [ns], on one core."""
    setup = prepare(bed_scene(effect), 1, load_library())
    sim = assemble([setup], Laws(), Numerics(threads=1))
    advance(sim, [SETTLED])
    spent = []
    for repeat in range(REPEATS):
        began = time.process_time()
        advance(sim, [SETTLED + (repeat + 1) * STEPS * setup.time_step])
        spent.append(time.process_time() - began)
    stop_device()
    return 1e9 * min(spent) / (STEPS * COUNT)


def costs() -> Iterator[Cost]:
    """Cost of every effect that acts on the device, and of the bare model before, between and after."""
    library = load_library()
    names = [name for name, effect in library.items() if effect.constants is not None]
    order = [one for k, name in enumerate(names) for one in (*[""] * (k % BARE_EVERY == 0), name)] + [""]
    spent = [nanoseconds(name) for name in order]
    base = float(np.mean([value for name, value in zip(order, spent, strict=True) if not name]))
    for name, value in zip(order, spent, strict=True):
        yield Cost(name, library[name].place if name else "", value, value / base)
