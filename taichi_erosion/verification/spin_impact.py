"""V07, V08: impacts of two spinning spheres (tests 7 and 8 of Chung & Ooi).

Two equal spheres with opposite spins have no slip where they touch: spins and tangential speeds must come
out as they went in. Two unequal spheres exchange equal and opposite forces along one line, so linear and
angular momentum stay. While such a pair slides, its slip falls by 3.5 mu (1 + e) v_n as in test 6, whatever
the masses.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taichi_erosion.core.setup import GrainTable, Setup
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.verification.bench_run import final_states
from taichi_erosion.verification.bench_setup import (
    contact_table,
    pair_impact,
    sphere_setup,
    spheres,
    touch_of,
)
from taichi_erosion.verification.claim import Outcome, Precision, below, relative
from taichi_erosion.verification.reference.hertz import HeadOn, Solid, series, sphere_mass

Floats = NDArray[np.float64]

ALLOY = Solid(7.0e10, 0.33, 2700.0)
COPPER = Solid(1.2e11, 0.35, 8900.0)
NYLON = Solid(2.5e9, 0.40, 1000.0)
RESTITUTION, FRICTION = 0.5, 0.4
RADIUS, SPEED = 0.1, 0.2  # m, m s-1 of each sphere
SPINS = np.array([0.175, 1.0, 5.0, 22.86])  # rad s-1, the range of the published line
PARTNER_RADIUS = 0.5  # m, test 8
# directions of the line of centres: along an axis, and one along none
DIRECTIONS = (np.array([1.0, 0.0, 0.0]), np.array([0.48, -0.6, 0.64]))
# rounding of 1e-16 or 6e-8 per step, at random over the thousands of steps of a contact
LIMIT_SPIN: dict[Precision, float] = {"f64": 1e-10, "f32": 1e-4}
LIMIT_LINEAR: dict[Precision, float] = {"f64": 1e-12, "f32": 1e-5}
LIMIT_ANGULAR: dict[Precision, float] = {"f64": 1e-10, "f32": 1e-4}


def across(direction: Floats) -> Floats:
    """A unit vector at right angles to `direction`."""
    side = np.cross(direction, [0.0, 0.0, 1.0])
    return side / np.linalg.norm(side)


def equal_pair(solid: Solid, direction: Floats, spin: float) -> Setup:
    """Test 7: equal spheres, equal and opposite spins about a line at right angles to their centres."""
    touch = touch_of(solid, solid, RESTITUTION, FRICTION)
    impact = pair_impact(touch, (RADIUS, RADIUS), solid.density, 2.0 * SPEED)
    step = impact.duration / 200.0
    half = (RADIUS + 3.5 * SPEED * step) * direction
    turn = spin * across(direction)
    grains = spheres(
        [-half, half], [SPEED * direction, -SPEED * direction], [turn, -turn], RADIUS, 2.0 * impact.mass
    )
    return sphere_setup(grains, contact_table(touch, touch), step)


def equal_spins() -> Iterator[Outcome]:
    """V07."""
    choices = [(s, d, w) for s in (ALLOY, COPPER) for d in DIRECTIONS for w in SPINS]
    setups = [equal_pair(*choice) for choice in choices]
    for precision, limit in LIMIT_SPIN.items():
        ends = final_states(setups, [400.0 * setup.time_step for setup in setups], precision)
        spin = [end.spin - setup.grains.spin for setup, end in zip(setups, ends, strict=True)]
        yield below("T7: change of spin [rad/s]", np.ravel(spin), limit, precision)
        drift = [
            end.velocity - np.outer(end.velocity @ direction, direction)
            for (_, direction, _), end in zip(choices, ends, strict=True)
        ]
        yield below("T7: tangential speed after [m/s]", np.ravel(drift), limit, precision)


def unequal_pair(solid: Solid, partner: Solid, direction: Floats, slip: float) -> Setup:
    """Test 8: a small sphere whose surface turns with `slip` [m s-1] meets a large one at rest."""
    touch = touch_of(solid, partner, RESTITUTION, FRICTION)
    masses = [sphere_mass(RADIUS, solid.density), sphere_mass(PARTNER_RADIUS, partner.density)]
    impact = HeadOn(touch.young, series(RADIUS, PARTNER_RADIUS), series(masses[0], masses[1]), SPEED)
    step = impact.duration / 4000.0
    apart = RADIUS + PARTNER_RADIUS + 3.5 * SPEED * step
    grains = spheres(
        [-apart * direction, 0.0 * direction],
        [SPEED * direction, 0.0 * direction],
        [slip / RADIUS * across(direction), 0.0 * direction],
        [RADIUS, PARTNER_RADIUS],
        masses,
    )
    return sphere_setup(grains, contact_table(touch, touch), step)


def linear(grains: GrainTable | Snapshot) -> Floats:
    """Linear momentum [kg m s-1]."""
    return grains.mass @ grains.velocity


def angular(grains: GrainTable | Snapshot) -> Floats:
    """Angular momentum about the origin [kg m2 s-1]."""
    moving = grains.mass[:, None] * grains.velocity
    inertia = 0.4 * grains.mass * grains.radius**2
    return np.cross(grains.position, moving).sum(axis=0) + inertia @ grains.spin


def momentum() -> Iterator[Outcome]:
    """V08."""
    ratios = np.array([0.3, 0.6, 0.9, 2.0])  # X of test 6; the last one sticks
    slips = 3.5 * FRICTION * (1.0 + RESTITUTION) * SPEED / ratios
    partners = ((ALLOY, NYLON), (NYLON, ALLOY), (ALLOY, ALLOY))
    setups = [unequal_pair(a, b, d, slip) for a, b in partners for d in DIRECTIONS for slip in slips]
    for precision in LIMIT_LINEAR:
        ends = final_states(setups, [8000.0 * setup.time_step for setup in setups], precision)
        pairs = [(setup.grains, end) for setup, end in zip(setups, ends, strict=True)]
        lost = [np.linalg.norm(linear(b) - linear(a)) / np.linalg.norm(linear(a)) for a, b in pairs]
        yield below("T8: change of linear momentum, relative", lost, LIMIT_LINEAR[precision], precision)
        lost = [np.linalg.norm(angular(b) - angular(a)) / np.linalg.norm(angular(a)) for a, b in pairs]
        yield below("T8: change of angular momentum, relative", lost, LIMIT_ANGULAR[precision], precision)
        for ratio, slip, (before, after) in zip(ratios[:3], slips, pairs[:3], strict=False):
            beta = -slip_speed(before, after) / slip
            name = f"T8 alloy on nylon: beta at X = {ratio:g}"
            yield relative(name, beta, ratio - 1.0, 5e-3, precision)


def slip_speed(before: GrainTable, after: Snapshot) -> float:
    """Slip after the impact along the slip before it [m s-1], with the line of centres as it was."""
    line = before.position[1] - before.position[0]
    line /= np.linalg.norm(line)

    def slip(grains: GrainTable | Snapshot) -> Floats:
        arms = grains.radius[:, None] * grains.spin
        velocity = grains.velocity[0] - grains.velocity[1] + np.cross(arms[0] + arms[1], line)
        return velocity - (velocity @ line) * line

    old, new = slip(before), slip(after)
    return float(new @ old / np.linalg.norm(old))
