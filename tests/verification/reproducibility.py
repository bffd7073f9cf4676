"""V22: single precision against double, for one contact and for a heap.

The claim is about a graphics processor in single precision; the same comparison is made on the CPU, where
both precisions run everywhere.
"""

from collections.abc import Iterator

import numpy as np

from taichi_erosion.core.setup import Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.verification.claims import PRECISIONS, Outcome, below
from tests.verification.contact import bulk
from tests.verification.contact.normal_impact import hertz_cases
from tests.verification.contact.oblique_impact import OXIDE, impact_at, scenes
from tests.verification.small_scenes import final_states

HEAP_SEEDS = (11, 12, 13, 14)


def single_and_double() -> Iterator[Outcome]:
    """V22: impacts to 1e-5 of the speed of approach, a heap within the scatter of its seeds."""
    head_on = [case.setup for case in hertz_cases()]
    oblique = scenes(impact_at(OXIDE, np.array([10.0, 30.0, 60.0])))
    for name, setups, steps in (("head-on", head_on, 220), ("oblique", oblique, 2400)):
        ends = [steps * setup.time_step for setup in setups]
        double, single = (final_states(setups, ends, p) for p in PRECISIONS)
        errors = [rebound_error(*pair) for pair in zip(double, single, setups, strict=True)]
        yield below(f"{name} impacts: rebound f32 - f64, over the speed", errors, 1e-5, "f32")
    angles = {p: bulk.heap_angles([(bulk.BASE, seed) for seed in HEAP_SEEDS], p) for p in PRECISIONS}
    mean = {name: float(np.mean(found)) for name, found in angles.items()}
    scatter = float(np.std(np.concatenate(list(angles.values())), ddof=1))
    name = f"heap angle [deg], f32 against f64, mean of {len(HEAP_SEEDS)} seeds within their sd"
    yield Outcome(name, mean["f32"], mean["f64"], scatter, "f32")


def rebound_error(double: Snapshot, single: Snapshot, setup: Setup) -> float:
    """Largest difference in velocity or in spin times radius, over the speed before the impact [1]."""
    speed = np.linalg.norm(setup.grains.velocity, axis=1).max()
    moving = np.abs(single.velocity - double.velocity).max()
    turning = np.abs((single.spin - double.spin) * double.radius[:, None]).max()
    return float(max(moving, turning) / speed)
