"""V33: grains flow out of a flat-bottomed silo as (D - k d)^(5/2), Beverloo's law.

One ensemble of silos of 18 grain diameters, with round holes of 6, 7.5 and 9; the flow is the slope of
grains passed against time, between the shares of the stock named below. Fitted are c and n of W = c (D - k
d)^n for every k from 1.2 to 1.6, which is where spheres lie; the k of the least squares is kept and
printed. Three orifices carry n and k only together, so what n becomes with Beverloo's k = 1.4, and k with
his 5/2, is printed beside it and not judged.

Reference: Beverloo, Leniger & van de Velde (1961), Chem. Eng. Sci. 15, 260.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Laws
from taichi_erosion.simulation import Simulation, advance, remove_surface, snapshot
from taichi_erosion.verification.bench_run import bench, states
from taichi_erosion.verification.bulk_scenes import DIAMETER, MASS, silo_scene, soft_touch
from taichi_erosion.verification.claim import Outcome
from taichi_erosion.verification.reference import bulk

Floats = NDArray[np.float64]

LAWS = Laws(rolling="elastic_plastic")
ORIFICES = np.array([6.0, 7.5, 9.0])  # grain diameters
SILO_RADIUS = 9.0 * DIAMETER
COUNT = 3500
SETTLE, SAMPLE, LONGEST = 0.12, 0.02, 1.2  # s
FIRST_SHARE, LAST_SHARE = 0.04, 0.35  # of the grains that have left while the flow is read [1]


def orifice_flow() -> Iterator[Outcome]:
    """V33."""
    touch = soft_touch(friction=0.5, friction_rolling=0.05)
    setups = [
        silo_scene(touch, COUNT, SILO_RADIUS, width * DIAMETER, seed=k) for k, width in enumerate(ORIFICES)
    ]
    sim = bench(setups, "f32", LAWS)
    advance(sim, [SETTLE] * len(setups))
    density = bulk_density(sim)
    for replica in range(len(setups)):
        remove_surface(sim, replica, "wall2")
    flow = MASS * discharge_rates(sim)
    orifice = ORIFICES * DIAMETER
    rates = ", ".join(f"{1e3 * rate:.2f}" for rate in flow)
    edge, exponent = bulk.discharge_fit(orifice, DIAMETER, flow)
    plain, _ = bulk.discharge_exponent(orifice, DIAMETER, flow, bulk.BEVERLOO_EDGE)
    given = bulk.discharge_edge(orifice, DIAMETER, flow)
    found = zip(flow, orifice, strict=True)
    factor = float(np.mean([bulk.discharge_coefficient(w, density, d, DIAMETER) for w, d in found]))
    name = (
        f"Beverloo: exponent of (D - {edge:.2f} d), flow {rates} g/s through 6, 7.5, 9 d "
        f"(k = 1.4 given: exponent {plain:.2f}, C {factor:.2f}; exponent 2.5 given: k {given:.2f})"
    )
    yield Outcome(name, exponent, bulk.BEVERLOO_EXPONENT, 0.1, "f32")


def bulk_density(sim: Simulation) -> float:
    """Density of the settled filling between two and twelve diameters above the bottom [kg m-3]."""
    low, high = 2.0 * DIAMETER, 12.0 * DIAMETER
    masses = []
    for state in states(sim, len(sim.setups)):
        height = state.position[:, 2]
        masses.append(MASS * np.count_nonzero((height > low) & (height < high)))
    return float(np.mean(masses)) / (np.pi * SILO_RADIUS**2 * (high - low))


def discharge_rates(sim: Simulation) -> Floats:
    """Grains per second through each orifice."""
    replicas = len(sim.setups)
    times, passed = [], []
    ends = np.full(replicas, SETTLE)
    while ends.max() < SETTLE + LONGEST:
        left = [int(np.count_nonzero(snapshot(sim, k).position[:, 2] < 0.0)) for k in range(replicas)]
        times.append(ends.copy())
        passed.append(left)
        flowing = np.array(left) < LAST_SHARE * COUNT
        if not flowing.any():
            break
        ends = ends + SAMPLE * flowing
        advance(sim, [float(end) for end in ends])
    states(sim, replicas)
    return np.array([steady_slope(t, n) for t, n in zip(np.array(times).T, np.array(passed).T, strict=True)])


def steady_slope(time: Floats, passed: Floats) -> float:
    """Slope of grains passed against time between the two shares [s-1]."""
    steady = (passed > FIRST_SHARE * COUNT) & (passed < LAST_SHARE * COUNT)
    return float(np.polyfit(time[steady], passed[steady], 1)[0])
