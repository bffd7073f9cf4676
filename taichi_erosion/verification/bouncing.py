"""V12, V13: MFiX-DEM's bouncing grain (DEM02) and stacked pair (DEM03), with the Hertz spring of this
program.

DEM02 varies a linear stiffness and asks that the apex heights approach (h_0 - r) e^(2k) + r. Here the
restitution of the Hertz spring does not depend on speed, so the same limit holds; what remains is the dip
into the floor, which falls as E*^(-2/5). The apex is read in flight as height + v^2/(2 g). DEM03 keeps its
geometry and densities; E* is chosen so that the Hertz force at the start equals that of the linear spring
of 1000 N/m at the floor.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Setup
from taichi_erosion.verification.bench_run import bench, sample
from taichi_erosion.verification.bench_setup import (
    Touch,
    contact_table,
    on_plane,
    planes,
    sphere_setup,
    spheres,
    wall_impact,
)
from taichi_erosion.verification.claim import Outcome, Precision, below, relative
from taichi_erosion.verification.reference import bouncing as exact
from taichi_erosion.verification.reference.hertz import series, sphere_mass

Floats = NDArray[np.float64]

GRAVITY = 9.81  # m s-2
PRECISIONS: tuple[Precision, Precision] = ("f64", "f32")

RADIUS, DENSITY, START = 0.1, 2600.0, 0.5  # DEM02: m, kg m-3, height of the centre in m
DROP = START - RADIUS  # m
RESTITUTIONS = (0.5, 0.7, 0.9, 1.0)
YOUNGS = (1e8, 1e9, 1e10)  # E*, Pa
BOUNCES = 3

STACK_RADIUS, STACK_HEIGHT = 0.5e-3, 1.8e-3  # DEM03: m
STACK_START = (0.45e-3, 1.35e-3)  # m
STACK_DENSITIES = (20000.0, 10000.0)  # kg m-3, lower and upper
STACK_YOUNG = 4.74e6  # E*, Pa: (4/3) E* sqrt(r) d^1.5 = 1000 N/m d at d = r - y_1 = 0.05 mm
STACK_TIME, STACK_SAMPLES = 0.02, 200  # s, 1
STACK_RESTITUTIONS = (0.5, 0.9, 1.0)


def bouncing_grain(young: float, restitution: float) -> Setup:
    """DEM02: a grain dropped on a floor."""
    touch = Touch(young, young / 4.0, restitution)
    impact = wall_impact(touch, RADIUS, DENSITY, float(np.sqrt(2.0 * GRAVITY * DROP)))
    grain = spheres([[0.0, 0.0, START]], 0.0, 0.0, RADIUS, impact.mass)
    return on_plane(touch, grain, impact.duration / 500.0, gravity=(0.0, 0.0, -GRAVITY))


def flight_middles(restitution: float) -> Floats:
    """Times of the first apexes for an infinitely stiff grain [s]."""
    fall = np.sqrt(2.0 * DROP / GRAVITY)
    flights = fall * restitution ** np.arange(1, BOUNCES + 1)
    return fall + 2.0 * np.cumsum(flights) - flights


def exact_heights(young: float, restitution: float) -> Floats:
    """Apexes of the lowest point after each bounce [m], every impact integrated under the weight."""
    spring = exact.Spring(young, RADIUS, sphere_mass(RADIUS, DENSITY), restitution)
    speed = float(np.sqrt(2.0 * GRAVITY * DROP))
    heights = []
    for _ in range(BOUNCES):
        speed = exact.rebound_speed(spring, speed, GRAVITY)
        heights.append(speed**2 / (2.0 * GRAVITY))
    return np.array(heights)


def bounce_heights() -> Iterator[Outcome]:
    """V12: heights of the law itself 0.5 %, and the limit e^(2k) approached as the grain stiffens."""
    choices = [(young, e) for young in YOUNGS for e in RESTITUTIONS]
    setups = [bouncing_grain(*choice) for choice in choices]
    times = np.array([flight_middles(e) for _, e in choices]).T
    wanted = np.array([exact_heights(*choice) for choice in choices]).T
    limit = np.array([exact.bounce_heights(DROP, e, BOUNCES) for _, e in choices]).T
    for precision in PRECISIONS:
        trace = sample(bench(setups, precision), times)
        height = trace.position[:, :, 0, 2] + trace.velocity[:, :, 0, 2] ** 2 / (2.0 * GRAVITY) - RADIUS
        for young, error in zip(YOUNGS, np.hsplit(height / wanted - 1.0, len(YOUNGS)), strict=True):
            name = f"DEM02 E* = {young:.0e} Pa, e = 0.5 to 1, three bounces: heights off the ODE, relative"
            yield below(name, np.ravel(error), 5e-3, precision)
        stiffest = zip(RESTITUTIONS, height[0, -len(RESTITUTIONS) :], limit[0], strict=False)
        for e, got, want in stiffest:
            name = f"DEM02 e = {e}, E* = {YOUNGS[-1]:.0e} Pa: first height against e^2 of the drop [m]"
            yield relative(name, got, want, 0.01, precision)
        worst = np.abs(height / limit - 1.0).reshape(BOUNCES, len(YOUNGS), -1).max(axis=(0, 2))
        order = float(np.polyfit(np.log(YOUNGS), np.log(worst), 1)[0])
        yield Outcome("DEM02: power of E* with which heights approach e^(2k)", order, -0.4, 0.1, precision)


def stacked_scene(restitution: float) -> Setup:
    """DEM03: two grains squeezed between a floor and a lid."""
    touch = Touch(STACK_YOUNG, STACK_YOUNG / 4.0, restitution)
    masses = [sphere_mass(STACK_RADIUS, density) for density in STACK_DENSITIES]
    grains = spheres([[0.0, 0.0, z] for z in STACK_START], 0.0, 0.0, STACK_RADIUS, masses)
    lid = (0.0, 0.0, STACK_HEIGHT, 0.0, 0.0, -1.0)
    walls = planes((0.0, 0.0, 0.0, 0.0, 0.0, 1.0), lid)
    return sphere_setup(grains, contact_table(touch, touch), 1e-7, walls, gravity=(0.0, 0.0, -GRAVITY))


def stacked_reference(restitution: float) -> exact.Stack:
    """The same as ordinary differential equations."""
    masses = [sphere_mass(STACK_RADIUS, density) for density in STACK_DENSITIES]
    middle = exact.Spring(STACK_YOUNG, STACK_RADIUS / 2.0, series(masses[0], masses[1]), restitution)
    floor, lid = (exact.Spring(STACK_YOUNG, STACK_RADIUS, mass, restitution) for mass in masses)
    return exact.Stack(STACK_RADIUS, (masses[0], masses[1]), STACK_HEIGHT, floor, middle, lid, GRAVITY)


def stacked_pair() -> Iterator[Outcome]:
    """V13: heights of both grains over 20 ms, 0.1 % of the grain radius."""
    times = np.linspace(0.0, STACK_TIME, STACK_SAMPLES + 1)
    setups = [stacked_scene(e) for e in STACK_RESTITUTIONS]
    wanted = [exact.stacked_motion(stacked_reference(e), STACK_START, times) for e in STACK_RESTITUTIONS]
    for precision in PRECISIONS:
        trace = sample(bench(setups, precision), np.repeat(times[1:, None], len(setups), axis=1))
        for k, e in enumerate(STACK_RESTITUTIONS):
            error = (trace.position[:, k, :, 2] - wanted[k][1:]) / STACK_RADIUS
            yield below(f"DEM03 e = {e}: heights off the ODE, over the radius", error, 1e-3, precision)
