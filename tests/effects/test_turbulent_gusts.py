"""Gusts under each law of drag: their mean force is that of the law, averaged over the wind in NumPy."""

from math import tan

import numpy as np
import pytest

from taichi_erosion.core.device import start_device, stop_device
from taichi_erosion.core.effect_probe import make_bench, probe_of
from taichi_erosion.core.setup import Numerics
from taichi_erosion.coupling.drag import LAWS, drag_law
from taichi_erosion.effects.turbulent_gusts import EFFECT, Params
from taichi_erosion.verification.reference.flow import LAWS as REFERENCE
from taichi_erosion.verification.reference.flow import Stream

GUSTS = Params(deviation=2.5, upward=0.56, intensity=0.4, timescale=0.02)
FRICTION_VELOCITY, WIND, CHANCE = 0.4, 3.0, 0.37  # m s-1, m s-1, of 1
RADIUS, DENSITY, VISCOSITY = 1.25e-4, 1.225, 1.789e-5  # m, kg m-3, Pa s
VELOCITY = np.array([0.8, 0.1, -0.3])  # m s-1, of the grain
TIMES = np.linspace(0.0, 1.0, 40)  # s, fifty timescales
GRAIN = {
    "velocity": tuple(VELOCITY),
    "air_velocity": (WIND, 0.0, 0.0),
    "radius": RADIUS,
    "mass": 2.0e-8,
    "air_density": DENSITY,
    "air_viscosity": VISCOSITY,
    "friction_velocity": FRICTION_VELOCITY,
    "chance": CHANCE,
}


def process(square: float, cube: float) -> np.ndarray:
    """Sum of 24 waves at TIMES, from the equation of the effect."""
    k = np.arange(1, 25)
    rates = np.array([tan(np.pi * (n - 0.5) / 48.0) for n in k]) / GUSTS.timescale
    phases = CHANCE * (square * k**2 + cube * k**3)
    return np.cos(np.outer(TIMES, rates) + 2.0 * np.pi * phases).sum(axis=1) / np.sqrt(12.0)


def mean_gust_force(law: str, void: float) -> np.ndarray:
    """Mean of F(s') - F(s) over TIMES [N], with the law of `verification.reference.flow`."""
    deviation = min(GUSTS.deviation * FRICTION_VELOCITY, GUSTS.intensity * WIND)
    slip = np.array([WIND, 0.0, 0.0]) - VELOCITY
    gusty = np.tile(slip, (len(TIMES), 1))
    gusty[:, 0] += deviation * process(7919.0, 3571.0)
    gusty[:, 2] += deviation * GUSTS.upward * process(5003.0, 9973.0)

    def force(velocity: np.ndarray) -> np.ndarray:
        speed = float(np.linalg.norm(velocity))
        return REFERENCE[law](Stream(speed, 2.0 * RADIUS, DENSITY, VISCOSITY, void)) * velocity / speed

    return np.mean([force(velocity) - force(slip) for velocity in gusty], axis=0)


@pytest.mark.parametrize("law", LAWS)
def test_the_mean_force_of_gusts_is_the_mean_of_the_law_of_drag_of_the_run(law: str):
    start_device(Numerics("cpu", 1, "f64"))
    probe = probe_of(EFFECT, make_bench(drag_law(law)))
    for void in (0.5, 1.0):
        found = [probe(GUSTS, {}, time=time, void_fraction=void, **GRAIN)[0] for time in TIMES]
        want = mean_gust_force(law, void)
        # phases of up to 1e8 turns in double precision: 1e-8 of a turn
        assert np.mean(found, axis=0) == pytest.approx(want, rel=1e-6, abs=1e-6 * np.abs(want).max())
    stop_device()


def test_laws_of_drag_differ_in_the_gusts_of_a_bed():
    forces = [mean_gust_force(law, 0.5)[0] for law in LAWS]
    assert min(abs(a / b - 1.0) for a, b in zip(forces[1:], forces[:-1], strict=True)) > 0.02
