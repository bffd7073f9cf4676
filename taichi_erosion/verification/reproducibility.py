"""V21, V23: the same bits after a restart, on any number of threads, and alone or in company.

Forty grains fall through each other into a tube, with friction, rolling resistance and adhesion, long
enough for several renewals of the neighbour lists.

V22: single precision against double, for one contact and for a heap.

The claim is about a graphics processor in single precision; the same comparison is made on the CPU, where
both precisions run everywhere.

V24: what cannot be simulated stops with a reason, and the other replicas go on.
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import nan, pi, sqrt

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Laws, Setup
from taichi_erosion.core.snapshot import Failure, Snapshot, Status
from taichi_erosion.simulation import Simulation, advance, export_state, failure, import_state, snapshot
from taichi_erosion.verification.claim import PRECISIONS, Outcome, Precision, below, holds
from taichi_erosion.verification.contact.bulk import (
    BASE,
    DIAMETER,
    SOFT_GLASS,
    column_scene,
    heap_angles,
    soft_touch,
)
from taichi_erosion.verification.contact.normal_impact import hertz_cases
from taichi_erosion.verification.contact.oblique_impact import SOLIDS, impact_at, scenes
from taichi_erosion.verification.small_scenes import final_states, simulation_of

LAWS = Laws(normal="jkr", rolling="elastic_plastic")
HALF, WHOLE = 0.05, 0.10  # s
STATE = ("position", "velocity", "spin", "contacts")


def tumbling(seed: int, count: int = 40) -> Setup:
    """Grains poured into a narrow tube."""
    touch = soft_touch(friction=0.5, friction_rolling=0.2, surface_energy=0.01)
    return column_scene(touch, count, 3.0 * DIAMETER, seed)


def fingerprint(state: Snapshot) -> str:
    """Hash of every bit of the state."""
    digest = hashlib.sha256()
    for name in STATE:
        digest.update(np.ascontiguousarray(getattr(state, name)).tobytes())
    return digest.hexdigest()


def run_to(sim: Simulation, time: float) -> None:
    """Advance all replicas."""
    advance(sim, [time] * len(sim.setups))


def differing(first: Snapshot, second: Snapshot) -> int:
    """Numbers of the state that differ in any bit."""
    return sum(
        int(np.count_nonzero(getattr(first, name).view(np.uint8) != getattr(second, name).view(np.uint8)))
        for name in STATE
    )


def restart() -> Iterator[Outcome]:
    """V21: half a run, exported, taken over by a fresh simulation and finished, against the run in one go."""
    setups = [tumbling(1), tumbling(2)]
    for precision in PRECISIONS:
        whole = simulation_of(setups, precision, LAWS)
        run_to(whole, HALF)
        kept = export_state(whole)
        run_to(whole, WHOLE)
        wanted = [snapshot(whole, k) for k in range(2)]
        resumed = simulation_of(setups, precision, LAWS)
        import_state(resumed, kept)
        run_to(resumed, WHOLE)
        bits = sum(differing(snapshot(resumed, k), wanted[k]) for k in range(2))
        yield Outcome("restart: bytes of the state that differ", float(bits), 0.0, 0.0, precision)


def threads_and_ensembles() -> Iterator[Outcome]:
    """V23: one hash on one and two threads, alone and among other replicas."""
    target = tumbling(3)
    company = [
        tumbling(4),
        target,
        replace(tumbling(5), time_step=target.time_step / 2.0),
        tumbling(6, count=25),
    ]
    for precision in PRECISIONS:
        prints = {}
        for name, setups, place, threads in (
            ("1 thread", [target], 0, 1),
            ("2 threads", [target], 0, 2),
            ("in company, 2 threads", company, 1, 2),
        ):
            sim = simulation_of(setups, precision, LAWS, threads)
            run_to(sim, WHOLE)
            prints[name] = fingerprint(snapshot(sim, place))
        for name in list(prints)[1:]:
            yield holds(
                f"same hash alone on 1 thread and {name}", prints[name] == prints["1 thread"], precision
            )


HEAP_SEEDS = (11, 12, 13, 14)


def single_and_double() -> Iterator[Outcome]:
    """V22."""
    yield from contact_outcomes()
    angles = {p: heap_angles([(BASE, seed) for seed in HEAP_SEEDS], p) for p in ("f64", "f32")}
    mean = {name: float(np.mean(found)) for name, found in angles.items()}
    scatter = float(np.std(np.concatenate(list(angles.values())), ddof=1))
    name = f"heap angle [deg], f32 against f64, mean of {len(HEAP_SEEDS)} seeds within their sd"
    yield Outcome(name, mean["f32"], mean["f64"], scatter, "f32")


def contact_outcomes() -> Iterator[Outcome]:
    """Velocities and surface speeds after head-on and oblique impacts, 1e-5 of the speed of approach."""
    head_on = [case.setup for case in hertz_cases()]
    oblique = scenes(impact_at(SOLIDS["aluminium oxide"], np.array([10.0, 30.0, 60.0])))
    for name, setups, steps in (("head-on", head_on, 220), ("oblique", oblique, 2400)):
        ends = [steps * setup.time_step for setup in setups]
        double, single = (final_states(setups, ends, p) for p in ("f64", "f32"))
        errors = [rebound_error(*pair) for pair in zip(double, single, setups, strict=True)]
        yield below(f"{name} impacts: rebound f32 - f64, over the speed", errors, 1e-5, "f32")


def rebound_error(double: Snapshot, single: Snapshot, setup: Setup) -> float:
    """Largest difference in velocity or in spin times radius, over the speed before the impact [1]."""
    speed = np.linalg.norm(setup.grains.velocity, axis=1).max()
    moving = np.abs(single.velocity - double.velocity).max()
    turning = np.abs((single.spin - double.spin) * double.radius[:, None]).max()
    return float(max(moving, turning) / speed)


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
        sim = simulation_of([healthy(), *(case.setup for case in cases)], precision, LAWS)
        advance(sim, [DURATION] * (1 + len(cases)))
        for replica, case in enumerate(cases, start=1):
            yield stops(case, failure(sim, replica), precision)
        kept = snapshot(sim, 0)
        alone = simulation_of([healthy()], precision, LAWS)
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
        sim = simulation_of([case.setup], precision, LAWS)
    except BadInput as refusal:
        return holds(f"{case.name}: refused ({refusal})", True, precision)
    advance(sim, [DURATION])
    return stops(case, failure(sim, 0), precision)
