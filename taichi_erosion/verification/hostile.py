"""V24: what cannot be simulated stops with a reason, and the other replicas go on."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import nan, pi, sqrt

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Laws, Setup
from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.simulation import advance, failure, snapshot
from taichi_erosion.verification.claim import Outcome, Precision, holds
from taichi_erosion.verification.contact.bulk import DIAMETER, SOFT_GLASS, column_scene, soft_touch
from taichi_erosion.verification.small_scenes import bench

LAWS = Laws(normal="jkr", rolling="elastic_plastic")
PRECISIONS: tuple[Precision, Precision] = ("f64", "f32")
DURATION = 0.05  # s


@dataclass(frozen=True)
class Hostile:
    """A scene that must stop, and the reasons that count as right."""

    name: str
    setup: Setup
    reasons: tuple[Status, ...]


def healthy() -> Setup:
    """Forty grains falling into a tube, guarded as a scene is by default."""
    touch = soft_touch(friction=0.5, friction_rolling=0.2, surface_energy=1e-3)
    return replace(column_scene(touch, 40, 3.0 * DIAMETER, seed=1), overlap_limit=0.2)


def rayleigh_time() -> float:
    """Pi R sqrt(rho/G)/(0.1631 nu + 0.8766) [s]."""
    wave = sqrt(SOFT_GLASS.density / SOFT_GLASS.shear)
    return pi * DIAMETER / 2.0 * wave / (0.1631 * SOFT_GLASS.poisson + 0.8766)


def overlapping() -> Setup:
    """Two grains start almost inside each other."""
    setup = healthy()
    position = setup.grains.position.copy()
    position[1] = position[0] + [0.1 * DIAMETER, 0.0, 0.0]
    return replace(setup, grains=replace(setup.grains, position=position))


def poisoned() -> Setup:
    """The surface energy is not a number."""
    setup = healthy()
    energy = np.full_like(setup.contacts.surface_energy, nan)
    return replace(setup, contacts=replace(setup.contacts, surface_energy=energy))


def bad_starts() -> Iterator[Outcome]:
    """V24."""
    blown_up = (Status.OVERLAP, Status.ENERGY, Status.NOT_FINITE, Status.LOST)
    slow = 5.0 * rayleigh_time()
    cases = [
        Hostile("overlapping start", overlapping(), (Status.OVERLAP,)),
        Hostile("time step of five Rayleigh times", replace(healthy(), time_step=slow), blown_up),
    ]
    for precision in PRECISIONS:
        sim = bench([healthy(), *(case.setup for case in cases)], precision, LAWS)
        advance(sim, [DURATION] * (1 + len(cases)))
        for replica, case in enumerate(cases, start=1):
            yield stops(case, failure(sim, replica), precision)
        kept = snapshot(sim, 0)
        alone = bench([healthy()], precision, LAWS)
        advance(alone, [DURATION])
        same = failure(alone, 0) is None and np.array_equal(kept.position, snapshot(alone, 0).position)
        yield holds("a healthy replica beside them ends as if alone", bool(same), precision)
        yield poisoned_outcome(precision)


def stops(case: Hostile, fault: Failure | None, precision: Precision) -> Outcome:
    """Whether the replica stopped for one of its reasons."""
    reason = fault.status.name if fault else "it went on"
    right = fault is not None and fault.status in case.reasons
    return holds(f"{case.name}: stops with a reason ({reason})", right, precision)


def poisoned_outcome(precision: Precision) -> Outcome:
    """A parameter that is not a number is refused at the door or stops the run."""
    case = Hostile("surface energy NaN", poisoned(), (Status.NOT_FINITE,))
    try:
        sim = bench([case.setup], precision, LAWS)
    except BadInput as refusal:
        return holds(f"{case.name}: refused ({refusal})", True, precision)
    advance(sim, [DURATION])
    return stops(case, failure(sim, 0), precision)
