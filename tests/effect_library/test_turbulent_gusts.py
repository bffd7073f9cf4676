"""Gusts: their statistics are the stated ones, and drag, lift and torque of a grain are those of the gust."""

from collections.abc import Iterator
from math import exp, log, sqrt, tan
from typing import Any

import numpy as np
import pytest

from taichi_erosion.core.device import start_device, stop_device
from taichi_erosion.core.effect import Probe, replica_effect
from taichi_erosion.core.effect_device import bind
from taichi_erosion.core.effect_probe import allocate_bench, evaluate_bench_grain, make_probe, write_members
from taichi_erosion.core.setup import Numerics
from taichi_erosion.core.transfer import download_field
from taichi_erosion.coupling.drag import drag_law
from taichi_erosion.effect_library import load_library
from taichi_erosion.effect_library.turbulent_gusts import EFFECT, Params
from tests.verification.reference.flow import LAWS, Stream

GUSTS = Params()
FRICTION_VELOCITY, WIND = 0.4, 3.0  # m s-1
CHANCE = 0.37
RADIUS, DENSITY, VISCOSITY = 1.25e-4, 1.225, 1.789e-5  # m, kg m-3, Pa s
HEIGHT = 0.01  # m
VELOCITY = np.array([0.8, 0.1, -0.3])  # m s-1, of the grain
TIMES = np.linspace(0.0, 1.0, 40)  # s, fifty timescales
TIME = 0.15  # s, of a strong gust
GRAIN: dict[str, Any] = {"velocity": tuple(VELOCITY), "radius": RADIUS, "mass": 2.0e-8, "height": HEIGHT}
GRAIN |= {"air_velocity": (WIND, 0.0, 0.0), "air_density": DENSITY, "air_viscosity": VISCOSITY}
GRAIN |= {"friction_velocity": FRICTION_VELOCITY, "chance": CHANCE, "void_fraction": 1.0}


@pytest.fixture(autouse=True, scope="module")
def device() -> Iterator[None]:
    start_device(Numerics("cpu", 1, "f64"))
    yield
    stop_device()


@pytest.fixture(scope="module")
def two_limits() -> Probe:
    return make_probe(EFFECT, allocate_bench(drag_law("two_limits")))


def process(square: float, cube: float, times: np.ndarray, chance: float = CHANCE) -> np.ndarray:
    """Sum of 24 waves, from the equation of the effect."""
    k = np.arange(1, 25)
    rates = np.array([tan(np.pi * (n - 0.5) / 48.0) for n in k]) / GUSTS.timescale
    phases = chance * (square * k**2 + cube * k**3)
    return np.cos(np.outer(times, rates) + 2.0 * np.pi * phases).sum(axis=1) / np.sqrt(12.0)


def gusts(wind: float, height: float, times: np.ndarray, chance: float = CHANCE) -> np.ndarray:
    """Streamwise and vertical gust [m s-1] at a mean wind [m s-1] and a height [m], from the equation."""
    along, other = process(7919.0, 3571.0, times, chance), process(5003.0, 9973.0, times, chance)
    spread = sqrt(log(1.0 + min(2.5 * FRICTION_VELOCITY / wind, 0.4) ** 2))
    layers = height * FRICTION_VELOCITY * DENSITY / VISCOSITY
    upward = min(0.56 * 2.5, 0.009 * layers**2) * FRICTION_VELOCITY
    c = -1.0 / (0.56 * 2.5**2)
    streamwise = wind * (np.exp(spread * along - 0.5 * spread**2) - 1.0)
    return np.column_stack([streamwise, upward * (c * along + sqrt(1.0 - c**2) * other)])


@pytest.mark.parametrize("law", LAWS)
def test_the_drag_in_gusts_is_that_of_the_law_of_the_run(law: str):
    probe = make_probe(EFFECT, allocate_bench(drag_law(law)))
    slip = np.array([WIND, 0.0, 0.0]) - VELOCITY
    change = gusts(WIND, HEIGHT, TIMES)
    for void in (0.5, 1.0):

        def force(velocity: np.ndarray, void: float = void) -> np.ndarray:
            speed = float(np.linalg.norm(velocity))
            return LAWS[law](Stream(speed, 2.0 * RADIUS, DENSITY, VISCOSITY, void)) * velocity / speed

        found = [probe(GUSTS, {}, time=time, **GRAIN | {"void_fraction": void})[0] for time in TIMES]
        want = [force(slip + np.array([u, 0.0, w])) - force(slip) for u, w in change]
        # phases of up to 1e8 turns in double precision: 1e-8 of a turn
        assert np.array(found) == pytest.approx(np.array(want), rel=1e-6, abs=1e-6 * np.abs(want).max())


@pytest.mark.parametrize("diameter", [1e-4, 1e-3, 0.05])
def test_gusts_near_a_wall_last_as_long_as_published(two_limits: Probe, diameter: float):
    """The time scale of Kallio & Reeks at y+ = 1.4, 13.7 and 200, beyond which it stays; else the longest."""
    wall = min(0.5 * diameter * FRICTION_VELOCITY * DENSITY / VISCOSITY, 200.0)
    units = 10.0 if wall < 5.0 else 7.122 + 0.5731 * wall - 0.00129 * wall**2
    lasting = units * VISCOSITY / (DENSITY * FRICTION_VELOCITY**2)
    law, known = Params(wall_timescale=10.0), {"grain_diameter": diameter}
    grain = GRAIN | {"velocity": (WIND, 0.0, 0.0)}
    times = TIMES[1:] * lasting / GUSTS.timescale
    found = np.array([two_limits(law, known, time=t, **grain)[0] for t in times])
    # the drag has the sign of the gust, and goes with it along the wind
    assert (np.sign(found[:, 0]) == np.sign(gusts(WIND, HEIGHT, TIMES[1:])[:, 0])).all()
    same = np.array([two_limits(GUSTS, known, time=t, **grain)[0] for t in TIMES[1:]])
    assert found == pytest.approx(same, rel=1e-6, abs=1e-6 * np.abs(same).max())


def sampled(wind: float, height: float) -> np.ndarray:
    """Gusts at 400 times in each of 200 seeds [m s-1]."""
    chances = np.random.default_rng(1).uniform(size=200)
    times = np.arange(400) * 0.73 * GUSTS.timescale
    return np.concatenate([gusts(wind, height, times, chance) for chance in chances])


def test_the_equation_has_the_published_statistics():
    """Log-normal with the deviation of the stress at the wall; the stress of the wind far from the ground."""
    ratio = 1.0 + sampled(1.0, 1e-4)[:, 0]  # 2.5 u* / u = 1 exceeds the limit of 0.4
    # some 2e4 independent gusts: the mean to 0.3 %, higher moments to a few percent; 24 waves have a kurtosis
    # of 3 - 1.5 / 24, so that the tail is a little short
    spread = sqrt(log(1.16))
    quantiles = np.exp(spread * np.array([-2.326, 0.0, 2.326]) - 0.5 * spread**2)
    assert ratio.mean() == pytest.approx(1.0, abs=0.01)
    assert np.quantile(ratio, (0.01, 0.5, 0.99)) == pytest.approx(quantiles, rel=0.03)
    streamwise, vertical = sampled(20.0 * FRICTION_VELOCITY, 0.05).T / FRICTION_VELOCITY
    assert (streamwise.std(), vertical.std()) == pytest.approx((2.5, 1.4), rel=0.03)
    assert -(streamwise * vertical).mean() == pytest.approx(1.0, rel=0.05)
    chances, times = np.random.default_rng(2).uniform(size=4000), np.array([0.1, 0.1 + GUSTS.timescale])
    pairs = np.array([process(7919.0, 3571.0, times, chance) for chance in chances])
    # waves give the correlation to 0.04, 4000 seeds to 0.015
    assert np.corrcoef(pairs.T)[0, 1] == pytest.approx(exp(-1.0), abs=0.07)


def test_lift_and_torque_feel_the_gust():
    """Both effects beside gusts give the forces that they give alone in the wind and shear of the gust."""
    library, bench = load_library(), allocate_bench(drag_law("two_limits"))
    shear = 4000.0  # s-1
    lain = GRAIN | {"velocity": (0.0, 0.0, 0.0), "height": RADIUS, "time": TIME}
    lain |= {"air_velocity": (0.6, 0.0, 0.0), "air_shear": shear}
    change = gusts(0.6, RADIUS, np.array([TIME]))[0]
    assert abs(change[0]) > 0.05, "a time without a gust shows nothing"

    def answer(names: list[str], members: dict[str, Any]) -> np.ndarray:
        effects = [replica_effect(library[n], library[n].params(), 1.0, {}, 0.0) for n in names]
        bound = bind("grain", [effects])
        write_members(bench.grain, members)
        evaluate_bench_grain(bound, bench.grain, bench.force, bench.torque)
        return np.concatenate([download_field(bench.force)[0], download_field(bench.torque)[0]])

    felt = ["rotational_drag", "shear_lift"]
    found, alone = answer([*felt, "turbulent_gusts"], lain), answer(["turbulent_gusts"], lain)
    blown = lain | {"air_velocity": (0.6 + change[0], 0.0, change[1])}
    blown |= {"air_shear": shear * (1.0 + change[0] / 0.6)}
    assert found == pytest.approx(alone + answer(felt, blown), rel=1e-6, abs=1e-20)
    calm = answer(felt, lain)
    assert abs(found[2] - alone[2] - calm[2]) > 0.05 * abs(calm[2]), "lift of the mean wind"
