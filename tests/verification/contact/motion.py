"""V01, V09-V13: free fall, sliding, rolling and bouncing of one grain, and a stacked pair.

V01. A leapfrog step reproduces uniform acceleration exactly: rounding is left, 1e-12 of the path in double
precision, and 5e-5 in single after a thousand additions that are off by up to half a unit in the last place.

V09-V11. A sphere dips by 1e-5 of its radius into its floor; the lever arm of friction is the radius, so
rigid-body mechanics holds exactly apart from a slip of about 1e-9 m that the tangential spring takes up.
Gravity is tilted instead of the floor. The torque mu_r R N of rolling resistance alone stops a sphere that
spins on a smooth floor; on a rough incline it rolls with (5/7) g (sin - mu_r cos) where tan > mu_r and rests
where tan < mu_r. Type C (elastic-plastic) rests without drift. The torque of type A (constant) jumps with the
sign of the spin: only that the rattling stays small and does not grow is asked of it.

V12, V13. MFiX-DEM's bouncing grain (DEM02) and stacked pair (DEM03) with the Hertz spring of this program,
see `reference.contact`. The dip into the floor, by which apex heights miss their limit, falls as E*^(-2/5).
The apex is read in flight as height + v^2/(2 g).
"""

from collections.abc import Iterator
from dataclasses import replace
from math import atan, cos, radians, sin, tan

import numpy as np

from taichi_erosion.core.setup import Floats, Laws, Setup
from taichi_erosion.simulation import advance
from taichi_erosion.verification.claims import PRECISIONS, Outcome, Precision, below, holds, relative
from taichi_erosion.verification.closed_forms import crossing_time, hertz_impact, sphere_mass
from tests.verification import small_scenes as small
from tests.verification.reference.contact import GRAVITY, Spring, rebound_speed, series, stacked_motion

OBLIQUE_GRAVITY = (0.3, -0.4, -9.81)  # m s-2
FALL_START = np.array([0.01, -0.02, 1.0])  # m
VELOCITY = np.array([0.5, 0.2, 1.5])  # m s-1
STEP, STEPS = 1e-4, 1000  # s, 1
LIMIT: dict[Precision, float] = {"f64": 1e-12, "f32": 1e-4}


def free_fall() -> Iterator[Outcome]:
    """V01."""
    grain = small.spheres(FALL_START, VELOCITY, 0.0, 1e-3, 1e-5)
    setup = small.sphere_setup(grain, small.Touch(1e9, 1e9), STEP, gravity=OBLIQUE_GRAVITY)
    for precision, limit in LIMIT.items():
        sim = small.simulation_of([setup], precision)
        (before,) = small.states(sim)
        yield holds("a grain released at t = 0 is seen at t = 0", len(before.radius) == 1, precision)
        advance(sim, [STEP * STEPS])
        (state,) = small.states(sim)
        fallen = np.array(OBLIQUE_GRAVITY) * state.time
        path = FALL_START + (VELOCITY + 0.5 * fallen) * state.time
        error = (state.position - path) / np.linalg.norm(path - FALL_START)
        yield below("free fall: error of the position over the path", error, limit, precision)
        error = (state.velocity - VELOCITY - fallen) / np.linalg.norm(VELOCITY + fallen)
        yield below("free fall: error of the velocity over the speed", error, limit, precision)


RADIUS, DENSITY, START = 0.1, 2600.0, 0.5  # DEM02: m, kg m-3, height of the centre in m
DROP = START - RADIUS  # m
IMPACT_SPEED = float(np.sqrt(2.0 * GRAVITY * DROP))  # m s-1
RESTITUTIONS = (0.5, 0.7, 0.9, 1.0)
YOUNGS = (1e8, 1e9, 1e10)  # E*, Pa
BOUNCES = 3


def bouncing_grain(young: float, restitution: float) -> Setup:
    """DEM02: a grain dropped on a floor."""
    touch = small.Touch(young, young / 4.0, restitution)
    impact = small.head_on(touch, DENSITY, IMPACT_SPEED, RADIUS)
    grain = small.spheres([[0.0, 0.0, START]], 0.0, 0.0, RADIUS, impact.mass)
    return small.sphere_setup(grain, touch, impact.duration / 500.0, small.FLAT, (0.0, 0.0, -GRAVITY))


def exact_heights(young: float, restitution: float) -> Floats:
    """Apexes of the lowest point after each bounce [m], every impact integrated under the weight."""
    spring = Spring(young, RADIUS, sphere_mass(RADIUS, DENSITY), restitution)
    speeds = [IMPACT_SPEED]
    for _ in range(BOUNCES):
        speeds.append(rebound_speed(spring, speeds[-1]))
    return np.array(speeds[1:]) ** 2 / (2.0 * GRAVITY)


def bounce_heights() -> Iterator[Outcome]:
    """V12: heights of the law itself 0.5 %, and the limit e^(2k) approached as the grain stiffens."""
    choices = [(young, e) for young in YOUNGS for e in RESTITUTIONS]
    setups = [bouncing_grain(*choice) for choice in choices]
    # of the first apexes of an infinitely stiff grain
    fall = np.sqrt(2.0 * DROP / GRAVITY)
    flights = fall * np.array([[e**k for _, e in choices] for k in range(1, BOUNCES + 1)])
    times = fall + 2.0 * np.cumsum(flights, axis=0) - flights
    wanted = np.array([exact_heights(*choice) for choice in choices]).T
    limit = np.array([DROP * e ** (2.0 * np.arange(1, BOUNCES + 1)) for _, e in choices]).T
    for precision in PRECISIONS:
        path = small.trace(setups, times, precision)
        height = path.position[:, :, 0, 2] + path.velocity[:, :, 0, 2] ** 2 / (2.0 * GRAVITY) - RADIUS
        for young, error in zip(YOUNGS, np.hsplit(height / wanted - 1.0, len(YOUNGS)), strict=True):
            name = f"DEM02 E* = {young:.0e} Pa, e = 0.5 to 1, three bounces: heights off the ODE, relative"
            yield below(name, error, 5e-3, precision)
        for e, got, want in zip(RESTITUTIONS, height[0, -len(RESTITUTIONS) :], limit[0], strict=False):
            name = f"DEM02 e = {e}, E* = {YOUNGS[-1]:.0e} Pa: first height against e^2 of the drop [m]"
            yield relative(name, got, want, 0.01, precision)
        worst = np.abs(height / limit - 1.0).reshape(BOUNCES, len(YOUNGS), -1).max(axis=(0, 2))
        order = float(np.polyfit(np.log(YOUNGS), np.log(worst), 1)[0])
        yield Outcome("DEM02: power of E* with which heights approach e^(2k)", order, -0.4, 0.1, precision)


STACK_RADIUS, STACK_HEIGHT = 0.5e-3, 1.8e-3  # DEM03: m
STACK_START = (0.45e-3, 1.35e-3)  # m
STACK_MASSES = [sphere_mass(STACK_RADIUS, density) for density in (20000.0, 10000.0)]  # kg, lower and upper
STACK_YOUNG = 4.74e6  # E*, Pa: (4/3) E* sqrt(r) d^1.5 = 1000 N/m d at d = r - y_1 = 0.05 mm
STACK_RESTITUTIONS = (0.5, 0.9, 1.0)


def stacked_pair() -> Iterator[Outcome]:
    """V13 (DEM03): heights of two grains under a lid over 20 ms, 0.1 % of the radius, against ODEs."""
    times = np.linspace(0.0, 0.02, 201)
    grains = small.spheres([[0.0, 0.0, z] for z in STACK_START], 0.0, 0.0, STACK_RADIUS, STACK_MASSES)
    walls = small.planes(small.FLOOR, (0.0, 0.0, STACK_HEIGHT, 0.0, 0.0, -1.0))
    setups, wanted = [], []
    for e in STACK_RESTITUTIONS:
        touch = small.Touch(STACK_YOUNG, STACK_YOUNG / 4.0, e)
        setups.append(small.sphere_setup(grains, touch, 1e-7, walls, (0.0, 0.0, -GRAVITY)))
        floor, lid = (Spring(STACK_YOUNG, STACK_RADIUS, mass, e) for mass in STACK_MASSES)
        middle = Spring(STACK_YOUNG, STACK_RADIUS / 2.0, series(*STACK_MASSES), e)
        wanted.append(stacked_motion(floor, middle, lid, STACK_HEIGHT, STACK_START, times)[1:])
    for precision in PRECISIONS:
        path = small.trace(setups, times[1:], precision).position
        for k, e in enumerate(STACK_RESTITUTIONS):
            error = (path[:, k, :, 2] - wanted[k]) / STACK_RADIUS
            yield below(f"DEM03 e = {e}: heights off the ODE, over the radius", error, 1e-3, precision)


ROLLING_RADIUS = 5e-3  # m
MASS = sphere_mass(ROLLING_RADIUS, 2500.0)  # kg
YOUNG = 2e9  # E*, Pa
SLOPE = radians(30.0)


def resting(touch: small.Touch, slope: float, spin: float = 0.0, speed: float = 0.0) -> Setup:
    """A sphere in balance with its weight on a floor that slopes down along x; spin about y."""
    gravity = (GRAVITY * sin(slope), 0.0, -GRAVITY * cos(slope))
    spring = 4.0 / 3.0 * touch.young_effective * np.sqrt(ROLLING_RADIUS)
    overlap = (MASS * GRAVITY * cos(slope) / spring) ** (2.0 / 3.0)
    # an impact as slow as the dip is deep: the stiffest motion this contact can make
    step = hertz_impact(touch.young_effective, ROLLING_RADIUS, MASS, 0.05)[2] / 40.0
    start = [[0.0, 0.0, ROLLING_RADIUS - overlap]]
    grain = small.spheres(start, [[speed, 0.0, 0.0]], [[0.0, spin, 0.0]], ROLLING_RADIUS, MASS)
    return small.sphere_setup(grain, touch, step, small.FLAT, gravity)


def slide_to_roll() -> Iterator[Outcome]:
    """V09: a sphere that slides on a floor rolls after 2 u_0 / (7 mu g) with (5/7) u_0, 0.5 %."""
    speed, frictions = 0.5, np.array([0.1, 0.3, 0.6])
    touches = [small.Touch(YOUNG, YOUNG / 4.0, 0.5, friction) for friction in frictions]
    setups = [resting(touch, 0.0, speed=speed) for touch in touches]
    ends = 2.0 * speed / (7.0 * frictions * GRAVITY)
    shares = np.concatenate([[0.5], np.linspace(0.95, 1.05, 41), [1.5]])
    for precision in PRECISIONS:
        path = small.trace(setups, np.outer(shares, ends), precision)
        slip = path.velocity[:, :, 0, 0] - ROLLING_RADIUS * path.spin[:, :, 0, 1]
        for k, friction in enumerate(frictions):
            # it falls along a line and is taken as over at 1e-4 of the start, above the ringing of the spring
            over = crossing_time(path.time[:, k], slip[:, k], 1e-4 * speed)
            name = f"slide to roll, mu = {friction}"
            yield relative(f"{name}: time [s]", over, ends[k], 5e-3, precision)
            last = path.velocity[-1, k, 0, 0]
            yield relative(f"{name}: speed [m/s]", last, 5.0 / 7.0 * speed, 5e-3, precision)


def incline() -> Iterator[Outcome]:
    """V10: accelerations 0.5 %, and the friction (2/7) tan that separates rolling from sliding.

    Sliding, g (sin - mu cos) and a spin-up of (5/2) mu g cos / R; rolling, (5/7) g sin.
    """
    ratios = np.array([0.3, 0.6, 0.9, 0.98, 1.02, 1.5, 3.0])
    frictions, along, across = ratios * 2.0 / 7.0 * tan(SLOPE), GRAVITY * sin(SLOPE), GRAVITY * cos(SLOPE)
    setups = [resting(small.Touch(YOUNG, YOUNG / 4.0, 0.3, friction), SLOPE) for friction in frictions]
    for precision in PRECISIONS:
        path = small.trace(setups, np.array([0.02, 0.06]), precision)
        span = np.diff(path.time, axis=0)[0]
        gain = np.diff(path.velocity[:, :, 0, 0], axis=0)[0] / span
        spin_up = np.diff(path.spin[:, :, 0, 1], axis=0)[0] / span
        for ratio, friction, found, turned in zip(ratios, frictions, gain, spin_up, strict=True):
            name, wanted = f"incline 30 deg, mu = {ratio:g} (2/7) tan", 5.0 / 7.0 * along
            if ratio < 1.0:
                wanted, turn = along - friction * across, 2.5 * friction * across / ROLLING_RADIUS
                yield relative(f"{name}: sliding spin-up [rad/s2]", turned, turn, 5e-3, precision)
            yield relative(f"{name}: acceleration [m/s2]", found, wanted, 5e-3, precision)
        # rigid bodies: slip grows as g sin (1 - mu/mu_c); its root is the critical friction
        share = (gain - ROLLING_RADIUS * spin_up) / along
        slope, offset = np.polyfit(ratios[:3], share[:3], 1)
        name = "incline: critical friction over (2/7) tan, from the slip of sliding spheres"
        yield relative(name, -offset / slope, 1.0, 5e-3, precision)
        yield relative("incline: slip of mu = 0.98 (2/7) tan, over g sin", share[3], 0.02, 0.05, precision)
        yield below("incline: slip of mu = 1.02 (2/7) tan and more, over g sin", share[4:], 1e-3, precision)


TYPES = {"A": Laws(rolling="constant_torque"), "C": Laws(rolling="elastic_plastic")}
FRICTION_ROLLING = 0.2
START_SPIN = 20.0  # rad s-1
SMOOTH = small.Touch(YOUNG, YOUNG / 4.0, 0.3, friction_rolling=FRICTION_ROLLING, rolling_damping=0.3)
ROUGH = replace(SMOOTH, friction_sliding=0.8)
STEEP, GENTLE = atan(2.0 * FRICTION_ROLLING), atan(0.8 * FRICTION_ROLLING)  # slopes [rad]
TIMES = np.array([0.002, 0.008, 0.02, 0.04, 0.06, 0.08])  # s; the spin lasts 20 ms
DRIFT_LIMIT = 1e-6  # radii per second
DECAY = 2.5 * FRICTION_ROLLING * GRAVITY / ROLLING_RADIUS  # of the spin by the torque mu_r R N [rad s-2]


def rolling_resistance() -> Iterator[Outcome]:
    """V11."""
    setups = [resting(SMOOTH, 0.0, spin=START_SPIN), resting(ROUGH, STEEP), resting(ROUGH, GENTLE)]
    for precision in PRECISIONS:
        for kind, laws in TYPES.items():
            path = small.trace(setups, TIMES, precision, laws)
            yield from motion_outcomes(kind, path, precision)
            if kind == "C":
                # six time constants of the rolling spring have passed by the third sample
                moved = np.diff(path.position[3:, 2, 0, 0]) / np.diff(path.time[3:, 2]) / ROLLING_RADIUS
                name = "type C at rest on an incline, tan = 0.8 mu_r: drift [R/s]"
                yield below(name, moved, DRIFT_LIMIT, precision)
            else:
                spin = np.abs(path.spin[2:, 2, 0, 1]) / (10.0 * DECAY * setups[2].time_step)
                name = "type A rattling on an incline: rms spin over ten steps of its torque"
                yield below(name, np.sqrt(np.mean(spin**2)), 1.0, precision)
                name = "type A rattling on an incline: growth of the spin, over ten steps of its torque"
                yield below(name, max(spin[2:].max() - spin[:2].max(), 0.0), 1.0, precision)


def motion_outcomes(kind: str, path: small.Trace, precision: Precision) -> Iterator[Outcome]:
    """Decay of a spin and rolling down a steep incline with (5/7) g (sin - mu_r cos), 0.5 %."""
    decay = -np.diff(path.spin[:2, 0, 0, 1]) / np.diff(path.time[:2, 0])
    yield relative(f"type {kind}: spin decay [rad/s2]", decay[0], DECAY, 5e-3, precision)
    speed, time = path.velocity[2:, 1, 0, 0], path.time[2:, 1]
    gain = (speed[-1] - speed[0]) / (time[-1] - time[0])
    wanted = 5.0 / 7.0 * GRAVITY * (sin(STEEP) - FRICTION_ROLLING * cos(STEEP))
    name = f"type {kind}: rolling down an incline, tan = 2 mu_r [m/s2]"
    yield relative(name, gain, wanted, 5e-3, precision)
