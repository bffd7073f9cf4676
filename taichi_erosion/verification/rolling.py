"""V11: rolling resistance, type A (constant torque) and type C (elastic-plastic).

A sphere that spins in place on a smooth floor is stopped by the torque mu_r R N alone. On a rough incline
it rolls with (5/7) g (sin - mu_r cos) where tan > mu_r and rests where tan < mu_r. Type C rests without
drift; type A has no state at rest, its torque jumps with the sign of the spin: only that the rattling stays
small and does not grow is asked of it.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import atan

import numpy as np

from taichi_erosion.core.setup import Laws
from taichi_erosion.verification.bench_run import Trace, bench, sample
from taichi_erosion.verification.bench_setup import Touch
from taichi_erosion.verification.claim import Outcome, Precision, below, relative
from taichi_erosion.verification.reference import rigid
from taichi_erosion.verification.sliding import RADIUS, YOUNG, resting

TYPES = {"A": Laws(rolling="constant_torque"), "C": Laws(rolling="elastic_plastic")}
FRICTION_ROLLING = 0.2
START_SPIN = 20.0  # rad s-1
SMOOTH = Touch(YOUNG, YOUNG / 4.0, 0.3, friction_rolling=FRICTION_ROLLING, rolling_damping=0.3)
ROUGH = replace(SMOOTH, friction=0.8)
STEEP, GENTLE = atan(2.0 * FRICTION_ROLLING), atan(0.8 * FRICTION_ROLLING)  # slopes [rad]
TIMES = np.array([0.002, 0.008, 0.02, 0.04, 0.06, 0.08])  # s; the spin lasts 20 ms
DRIFT_LIMIT = 1e-6  # radii per second


def rolling_resistance() -> Iterator[Outcome]:
    """V11."""
    setups = [resting(SMOOTH, 0.0, spin=START_SPIN), resting(ROUGH, STEEP), resting(ROUGH, GENTLE)]
    times = TIMES[:, None] * np.ones(len(setups))
    for precision in ("f64", "f32"):
        for kind, laws in TYPES.items():
            trace = sample(bench(setups, precision, laws), times)
            yield from motion_outcomes(kind, trace, precision)
            if kind == "C":
                # six time constants of the rolling spring have passed by the third sample
                moved = np.diff(trace.position[3:, 2, 0, 0]) / np.diff(trace.time[3:, 2]) / RADIUS
                name = "type C at rest on an incline, tan = 0.8 mu_r: drift [R/s]"
                yield below(name, moved, DRIFT_LIMIT, precision)
            else:
                yield from rattle_outcomes(trace, setups[2].time_step, precision)


def motion_outcomes(kind: str, trace: Trace, precision: Precision) -> Iterator[Outcome]:
    """Decay of a spin and rolling down a steep incline, 0.5 %."""
    spin = trace.spin[:2, 0, 0, 1]
    decay = -(spin[1] - spin[0]) / (trace.time[1, 0] - trace.time[0, 0])
    wanted = rigid.spin_decay(FRICTION_ROLLING, RADIUS)
    yield relative(f"type {kind}: spin decay [rad/s2]", decay, wanted, 5e-3, precision)
    speed, time = trace.velocity[2:, 1, 0, 0], trace.time[2:, 1]
    gain = (speed[-1] - speed[0]) / (time[-1] - time[0])
    wanted = rigid.rolling_acceleration(STEEP, FRICTION_ROLLING)
    name = f"type {kind}: rolling down an incline, tan = 2 mu_r [m/s2]"
    yield relative(name, gain, wanted, 5e-3, precision)


def rattle_outcomes(trace: Trace, step: float, precision: Precision) -> Iterator[Outcome]:
    """Type A on the gentle incline: rms spin bounded by ten steps of the torque, and no growth."""
    spin = trace.spin[2:, 2, 0, 1]
    kick = rigid.spin_decay(FRICTION_ROLLING, RADIUS) * step
    rms = float(np.sqrt(np.mean(spin**2)))
    yield below(
        "type A rattling on an incline: rms spin over ten steps of its torque",
        rms / (10.0 * kick),
        1.0,
        precision,
    )
    later, earlier = np.abs(spin[2:]).max(), np.abs(spin[:2]).max()
    name = "type A rattling on an incline: growth of the spin, over ten steps of its torque"
    yield below(name, max(later - earlier, 0.0) / (10.0 * kick), 1.0, precision)
