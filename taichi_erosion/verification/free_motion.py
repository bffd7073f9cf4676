"""V01: a grain in free fall follows the parabola.

A leapfrog step reproduces uniform acceleration exactly, so only rounding is left: 1e-12 of the path in
double precision. In single precision a thousand additions, each off by up to half a unit in the last place,
leave up to 5e-5; 1e-4 is asked.
"""

from collections.abc import Iterator

import numpy as np

from taichi_erosion.simulation import advance
from taichi_erosion.verification.bench_run import bench, states
from taichi_erosion.verification.bench_setup import Touch, contact_table, sphere_setup, spheres
from taichi_erosion.verification.claim import Outcome, Precision, below, holds

GRAVITY = (0.3, -0.4, -9.81)  # m s-2
START = np.array([0.01, -0.02, 1.0])  # m
VELOCITY = np.array([0.5, 0.2, 1.5])  # m s-1
STEP, STEPS = 1e-4, 1000  # s, 1
LIMIT: dict[Precision, float] = {"f64": 1e-12, "f32": 1e-4}


def free_fall() -> Iterator[Outcome]:
    """V01."""
    touch = Touch(1e9, 1e9)
    setup = sphere_setup(
        spheres(START, VELOCITY, 0.0, 1e-3, 1e-5), contact_table(touch, touch), STEP, gravity=GRAVITY
    )
    for precision, limit in LIMIT.items():
        sim = bench([setup], precision)
        before = states(sim, 1)[0]
        yield holds("a grain released at t = 0 is seen at t = 0", len(before.radius) == 1, precision)
        advance(sim, [STEP * STEPS])
        state = states(sim, 1)[0]
        fallen = np.array(GRAVITY) * state.time
        path = START + (VELOCITY + 0.5 * fallen) * state.time
        length = np.linalg.norm(path - START)
        yield below(
            "free fall: error of the position over the path",
            (state.position - path) / length,
            limit,
            precision,
        )
        speed = np.linalg.norm(VELOCITY + fallen)
        error = (state.velocity - VELOCITY - fallen) / speed
        yield below("free fall: error of the velocity over the speed", error, limit, precision)
