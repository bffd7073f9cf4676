"""V14: mechanical energy of a gas in a box, and of single impacts that stick.

Without friction and damping the springs give back what they took: 1e-4 of the energy at 50 steps per
contact. With friction and damping the sum of kinetic, gravitational and spring energy may only fall. The
total-form tangential spring stiffens as the contact grows, so it is not conservative by itself: an impact
with e = 1 and mu = 10 gains or loses a little. That is a property of the law; the simulator is held to the
fine-step integration of the law, and the figure is printed.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import Laws, Setup
from taichi_erosion.core.snapshot import Ledger
from taichi_erosion.simulation import Simulation, advance, ledger
from taichi_erosion.verification.bench_run import bench
from taichi_erosion.verification.bench_setup import (
    Touch,
    contact_table,
    pair_impact,
    planes,
    sphere_setup,
    spheres,
)
from taichi_erosion.verification.claim import Outcome, Precision, below, relative
from taichi_erosion.verification.oblique_impact import SOLIDS, impact_at, simulated
from taichi_erosion.verification.reference.mindlin import Impact, Rebound, rebound

Floats = NDArray[np.float64]

PRECISIONS: tuple[Precision, Precision] = ("f64", "f32")
SIDE = 4  # grains along an edge of the starting lattice
RADIUS, DENSITY, SPEED = 1e-3, 2500.0, 1.0  # m, kg m-3, m s-1 of the fastest pairs
STIFF = Touch(1e8, 2.5e7)
ROUGH = replace(STIFF, restitution=0.7, friction=0.5, friction_rolling=0.1, rolling_damping=0.3)
LAWS = Laws(rolling="elastic_plastic")  # idle where friction_rolling = 0
STICKING_ANGLES = np.array([60.0, 70.0, 80.0, 85.0])  # deg


def gas(touch: Touch, steps_per_contact: float, seed: int) -> Setup:
    """64 grains on a loose lattice with random velocities and spins, in a box of six planes."""
    rng = np.random.default_rng(seed)
    spacing = 3.0 * RADIUS
    axis = spacing * (np.arange(SIDE) + 0.5)
    position = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    position += rng.uniform(-0.3, 0.3, position.shape) * RADIUS
    velocity = rng.normal(0.0, SPEED / 4.0, position.shape)
    spin = rng.normal(0.0, SPEED / 4.0 / RADIUS, position.shape)
    impact = pair_impact(touch, (RADIUS, RADIUS), DENSITY, SPEED)
    edge = spacing * SIDE
    box = [(0.0,) * 3 + normal for normal in ((1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0))]
    box += [(edge,) * 3 + normal for normal in ((-1.0, 0, 0), (0, -1.0, 0), (0, 0, -1.0))]
    grains = spheres(position, velocity, spin, RADIUS, 2.0 * impact.mass)
    step = impact.duration / steps_per_contact
    return sphere_setup(grains, contact_table(touch, touch), step, planes(*box), gravity=(0.0, 0.0, -9.81))


def total(sums: Ledger) -> float:
    """Mechanical energy [J]."""
    return sums.kinetic_translation + sums.kinetic_rotation + sums.potential + sums.elastic


def histories(sim: Simulation, times: Floats) -> Floats:
    """Mechanical energy of all replicas at `times` [samples, replicas] in J."""
    replicas = len(sim.setups)
    found = []
    for time in times:
        advance(sim, [float(time)] * replicas)
        found.append([total(ledger(sim, replica)) for replica in range(replicas)])
    return np.array(found)


def energy_balance() -> Iterator[Outcome]:
    """V14."""
    setups = [gas(STIFF, 50.0, seed=1), gas(ROUGH, 50.0, seed=2)]
    times = np.linspace(0.0, 0.05, 201)[1:]
    for precision in PRECISIONS:
        conserved, lost = histories(bench(setups, precision, LAWS), times).T
        error = conserved / conserved[0] - 1.0
        yield below("conservative gas: change of energy, relative", error, 1e-4, precision)
        rise = np.maximum(np.diff(lost), 0.0) / lost[0]
        name = "dissipative gas: largest rise of energy between samples, relative"
        yield below(name, rise, 1e-6, precision)
        yield from sticking_outcomes(precision)


def sticking_outcomes(precision: Precision) -> Iterator[Outcome]:
    """Kinetic energy after over before for e = 1, mu = 10, beside the law's own fine-step figure."""
    impact = replace(impact_at(SOLIDS["aluminium oxide"], STICKING_ANGLES), restitution=1.0, friction=10.0)
    after, reference = simulated([impact], precision)[0], rebound(impact)
    before = impact.normal**2 + impact.tangential**2
    found, wanted = energy_after(impact, after) / before, energy_after(impact, reference) / before
    for angle, got, want in zip(STICKING_ANGLES, found, wanted, strict=True):
        name = f"e = 1, mu = 10 at {angle:.0f} deg: energy after over before (1 + what the law creates)"
        yield relative(name, got, want, 5e-3, precision)


def energy_after(impact: Impact, after: Rebound) -> Floats:
    """Twice the kinetic energy per mass [m2 s-2]."""
    return after.normal**2 + after.tangential**2 + 0.4 * (impact.radius * after.spin) ** 2
