"""V09, V10: a sphere that slides until it rolls, on the level and on an incline.

The sphere rests on a soft floor (its weight dips it by 1e-5 of its radius); the lever arm of friction is
the radius, so rigid-body mechanics holds exactly apart from the tangential spring, which takes up a slip of
about 1e-9 m. Gravity is tilted instead of the floor.
"""

from collections.abc import Iterator
from math import cos, radians, sin, tan

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Setup
from taichi_erosion.verification.bench_run import Trace, bench, crossing, sample
from taichi_erosion.verification.bench_setup import Touch, on_plane, resting_overlap, spheres
from taichi_erosion.verification.claim import Outcome, Precision, below, relative
from taichi_erosion.verification.reference import rigid
from taichi_erosion.verification.reference.hertz import HeadOn, sphere_mass

Floats = NDArray[np.float64]

RADIUS = 5e-3  # m
MASS = sphere_mass(RADIUS, 2500.0)  # kg
YOUNG = 2e9  # E*, Pa
START_SPEED = 0.5  # m s-1
SLOPE = radians(30.0)
PRECISIONS: tuple[Precision, Precision] = ("f64", "f32")


def resting(touch: Touch, slope: float, speed: float = 0.0, spin: float = 0.0) -> Setup:
    """A sphere in balance with its weight on a floor that slopes down along x; spin about y."""
    overlap = resting_overlap(touch, RADIUS, MASS * rigid.GRAVITY * cos(slope))
    # an impact as slow as the dip is deep: the stiffest motion this contact can make
    step = HeadOn(touch.young, RADIUS, MASS, 0.05).duration / 40.0
    grain = spheres([[0.0, 0.0, RADIUS - overlap]], [[speed, 0.0, 0.0]], [[0.0, spin, 0.0]], RADIUS, MASS)
    gravity = (rigid.GRAVITY * sin(slope), 0.0, -rigid.GRAVITY * cos(slope))
    return on_plane(touch, grain, step, gravity=gravity)


def slip_speed(trace: Trace) -> Floats:
    """Speed of the contact point [samples, replicas] in m s-1."""
    return trace.velocity[:, :, 0, 0] - RADIUS * trace.spin[:, :, 0, 1]


def slide_to_roll() -> Iterator[Outcome]:
    """V09: 2 u_0/(7 mu g) and (5/7) u_0, 0.5 %."""
    frictions = (0.1, 0.3, 0.6)
    setups = [resting(Touch(YOUNG, YOUNG / 4.0, 0.5, friction), 0.0, START_SPEED) for friction in frictions]
    ends = np.array([rigid.slide_time(START_SPEED, friction) for friction in frictions])
    shares = np.concatenate([[0.5], np.linspace(0.95, 1.05, 41), [1.5]])
    for precision in PRECISIONS:
        trace = sample(bench(setups, precision), shares[:, None] * ends)
        slip = slip_speed(trace)
        for k, friction in enumerate(frictions):
            # slip falls along a straight line; it is taken as over at 1e-4 of the start, above the ringing
            # of the spring
            over = crossing(trace.time[:, k], slip[:, k], 1e-4 * START_SPEED)
            yield relative(f"slide to roll, mu = {friction}: time [s]", over, ends[k], 5e-3, precision)
            speed = trace.velocity[-1, k, 0, 0]
            wanted = rigid.rolling_speed(START_SPEED)
            yield relative(f"slide to roll, mu = {friction}: speed [m/s]", speed, wanted, 5e-3, precision)


def incline() -> Iterator[Outcome]:
    """V10: accelerations 0.5 %, and the friction (2/7) tan that separates rolling from sliding."""
    critical = rigid.friction_for_rolling(SLOPE)
    ratios = np.array([0.3, 0.6, 0.9, 0.98, 1.02, 1.5, 3.0])
    setups = [resting(Touch(YOUNG, YOUNG / 4.0, 0.3, critical * ratio), SLOPE) for ratio in ratios]
    times = np.array([0.02, 0.06])[:, None] * np.ones(len(ratios))
    for precision in PRECISIONS:
        trace = sample(bench(setups, precision), times)
        span = np.diff(trace.time, axis=0)[0]
        gain = np.diff(trace.velocity[:, :, 0, 0], axis=0)[0] / span
        spin_up = np.diff(trace.spin[:, :, 0, 1], axis=0)[0] / span
        slipping = gain - RADIUS * spin_up
        yield from incline_outcomes(ratios, gain, spin_up, precision)
        # rigid bodies: slip grows as g sin (1 - mu/mu_c); its root is the critical friction
        slope, offset = np.polyfit(ratios[:3], slipping[:3], 1)
        name = "incline: critical friction over (2/7) tan, from the slip of sliding spheres"
        yield relative(name, -offset / slope, 1.0, 5e-3, precision)
        share = slipping / (rigid.GRAVITY * sin(SLOPE))
        yield relative("incline: slip of mu = 0.98 (2/7) tan, over g sin", share[3], 0.02, 0.05, precision)
        yield below("incline: slip of mu = 1.02 (2/7) tan and more, over g sin", share[4:], 1e-3, precision)


def incline_outcomes(
    ratios: Floats, gain: Floats, spin_up: Floats, precision: Precision
) -> Iterator[Outcome]:
    """Accelerations of sliding and of rolling spheres."""
    critical = 2.0 / 7.0 * tan(SLOPE)
    for ratio, found, turned in zip(ratios, gain, spin_up, strict=True):
        name = f"incline 30 deg, mu = {ratio:g} (2/7) tan"
        if ratio < 1.0:
            wanted = rigid.sliding_acceleration(SLOPE, critical * ratio)
            spinning = rigid.sliding_spin_up(SLOPE, critical * ratio, RADIUS)
            yield relative(f"{name}: sliding spin-up [rad/s2]", turned, spinning, 5e-3, precision)
        else:
            wanted = rigid.rolling_acceleration(SLOPE)
        yield relative(f"{name}: acceleration [m/s2]", found, wanted, 5e-3, precision)
