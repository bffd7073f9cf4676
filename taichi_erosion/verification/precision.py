"""V22: single precision against double, for one contact and for a heap.

The claim is about a graphics processor in single precision; the same comparison is made on the CPU, where
both precisions run everywhere.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.verification.bench_run import bench, sample
from taichi_erosion.verification.claim import Outcome, Precision, below
from taichi_erosion.verification.heaps import BASE, heap_angles
from taichi_erosion.verification.normal_impact import hertz_cases
from taichi_erosion.verification.oblique_impact import SOLIDS, impact_at, scenes

Floats = NDArray[np.float64]

HEAP_SEEDS = (11, 12, 13, 14)


def single_and_double() -> Iterator[Outcome]:
    """V22."""
    yield from contact_outcomes()
    angles = {p: heap_angles([(BASE, seed) for seed in HEAP_SEEDS], p) for p in ("f64", "f32")}
    mean = {name: float(np.mean(found)) for name, found in angles.items()}
    scatter = float(np.std(np.concatenate(list(angles.values())), ddof=1))
    name = f"heap angle [deg], f32 against f64, mean of {len(HEAP_SEEDS)} seeds within their sd"
    yield Outcome(name, mean["f32"], mean["f64"], scatter, "f32")


def contact_outcomes() -> Iterator[Outcome]:
    """Velocities along head-on and oblique impacts, 1e-5 of the speed of approach."""
    head_on = [case.setup for case in hertz_cases()]
    # a quarter of the default steps: the round-off of more steps is not what is asked
    oblique = scenes(impact_at(SOLIDS["aluminium oxide"], np.array([10.0, 30.0, 60.0])))
    for name, setups, steps in (("head-on", head_on, 220), ("oblique", oblique, 2400)):
        for group in by_grain_count(setups):
            times = steps * np.linspace(0.0, 1.0, 23)[:, None] * np.array([s.time_step for s in group])
            paths = {p: sample(bench(group, p), times).velocity for p in ("f64", "f32")} speed =
            np.abs(paths["f64"][0]).max(axis=(1, 2))[None, :, None, None] error = (paths["f32"] -
            paths["f64"]) / speed label = f"single contact, {name}, {len(group[0].grains.mass)} grain(s):
            velocity f32 - f64, over the speed" yield below(label, np.ravel(error), 1e-5, PRECISION)


def by_grain_count(setups: list) -> list[list]:
    """The scenes grouped so that each group can be sampled together."""
    counts = sorted({len(setup.grains.mass) for setup in setups})
    return [[setup for setup in setups if len(setup.grains.mass) == count] for count in counts]


PRECISION: Precision = "f32"
