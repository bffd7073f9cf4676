"""V21, V22, V24: restarts and precisions give the same results; bad starts stop with a reason.

V21: the same bits after a restart. Forty grains fall through each other into a tube, with friction, rolling
resistance and adhesion, long enough for several rebuilds of the neighbour lists.

V22: single precision against double, for one contact and for a heap. The claim is about a graphics processor
in single precision; the same comparison is made on the CPU, where both precisions run everywhere.

V24: what cannot be simulated stops with a reason, and the other replicas go on.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import nan, pi, sqrt

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Setup
from taichi_erosion.core.snapshot import Failure, Snapshot, Status
from taichi_erosion.scene.change import SAMPLE
from taichi_erosion.simulation import export_state, failure, import_state, snapshot
from taichi_erosion.verification.claims import PRECISIONS, Outcome, Precision, below, holds
from taichi_erosion.verification.closed_forms import TUMBLING, WHOLE, state_bytes, tumbling
from tests.verification.contact import bulk
from tests.verification.contact.normal_impact import hertz_cases
from tests.verification.contact.oblique_impact import OXIDE, impact_at, scenes
from tests.verification.small_scenes import advance_all, final_states, simulation_of

HALF = 0.05  # s
HEAP_SEEDS = (11, 12, 13, 14)


def differing(first: Snapshot, second: Snapshot) -> int:
    """Bytes of the state that differ."""
    one, other = (np.frombuffer(state_bytes(state), np.uint8) for state in (first, second))
    return int(np.count_nonzero(one != other))


def restart() -> Iterator[Outcome]:
    """V21: half a run, exported, imported by a fresh simulation and finished, against the run in one go."""
    setups = [tumbling(1), tumbling(2)]
    for precision in PRECISIONS:
        whole = simulation_of(setups, precision, TUMBLING)
        advance_all(whole, HALF)
        kept = export_state(whole)
        advance_all(whole, WHOLE)
        wanted = [snapshot(whole, k) for k in range(2)]
        resumed = simulation_of(setups, precision, TUMBLING)
        import_state(resumed, kept)
        advance_all(resumed, WHOLE)
        bits = sum(differing(snapshot(resumed, k), wanted[k]) for k in range(2))
        yield Outcome("restart: bytes of the state that differ", float(bits), 0.0, 0.0, precision)


def single_and_double() -> Iterator[Outcome]:
    """V22: impacts to 1e-5 of the speed of approach, a heap within the scatter of its seeds."""
    head_on = [case.setup for case in hertz_cases()]
    oblique = scenes(impact_at(OXIDE, np.array([10.0, 30.0, 60.0])))
    for name, setups, steps in (("head-on", head_on, 220), ("oblique", oblique, 2400)):
        ends = [steps * setup.time_step for setup in setups]
        double, single = (final_states(setups, ends, p) for p in PRECISIONS)
        errors = [rebound_error(*pair) for pair in zip(double, single, setups, strict=True)]
        yield below(f"{name} impacts: rebound f32 - f64, over the speed", errors, 1e-5, "f32")
    angles = {p: bulk.heap_angles([(bulk.BASE, seed) for seed in HEAP_SEEDS], p) for p in PRECISIONS}
    mean = {name: float(np.mean(found)) for name, found in angles.items()}
    scatter = float(np.std(np.concatenate(list(angles.values())), ddof=1))
    name = f"heap angle [deg], f32 against f64, mean of {len(HEAP_SEEDS)} seeds within their sd"
    yield Outcome(name, mean["f32"], mean["f64"], scatter, "f32")


def rebound_error(double: Snapshot, single: Snapshot, setup: Setup) -> float:
    """Largest difference in velocity or in spin times radius, over the speed before the impact [1]."""
    speed = np.linalg.norm(setup.grains.velocity, axis=1).max()
    moving = np.abs(single.velocity - double.velocity).max()
    turning = np.abs((single.spin - double.spin) * double.radius[:, None]).max()
    return float(max(moving, turning) / speed)


def healthy() -> Setup:
    """Forty grains falling into a tube, guarded as a scene is by default."""
    return replace(tumbling(1, surface_energy=1e-3), overlap_limit=0.2)


def rayleigh_time() -> float:
    """Pi R sqrt(rho/G)/(0.1631 nu + 0.8766) [s] of these grains."""
    solid = SAMPLE["materials"]["sand"]
    shear = solid["young_modulus"] / (2.0 * (1.0 + solid["poisson_ratio"]))
    slowness = sqrt(solid["density"] / shear)
    return pi * healthy().grains.radius[0] * slowness / (0.1631 * solid["poisson_ratio"] + 0.8766)


def overlapping() -> Setup:
    """Two grains start almost inside each other."""
    setup = healthy()
    position = setup.grains.position.copy()
    position[1] = position[0] + [0.2 * setup.grains.radius[0], 0.0, 0.0]
    return replace(setup, grains=replace(setup.grains, position=position))


def bad_starts() -> Iterator[Outcome]:
    """V24."""
    blown_up = (Status.OVERLAP, Status.ENERGY, Status.NOT_FINITE, Status.LOST)
    unstable = replace(healthy(), time_step=5.0 * rayleigh_time())
    cases = {  # name: scene that must stop, reasons that count as right
        "overlapping start": (overlapping(), (Status.OVERLAP,)),
        "time step of five Rayleigh times": (unstable, blown_up),
    }
    for precision in PRECISIONS:
        sim = simulation_of([healthy(), *(setup for setup, _ in cases.values())], precision, TUMBLING)
        advance_all(sim, HALF)
        for replica, (name, (_, reasons)) in enumerate(cases.items(), start=1):
            yield stops(name, failure(sim, replica), reasons, precision)
        kept = snapshot(sim, 0)
        alone = simulation_of([healthy()], precision, TUMBLING)
        advance_all(alone, HALF)
        same = failure(alone, 0) is None and np.array_equal(kept.position, snapshot(alone, 0).position)
        yield holds("a healthy replica beside them ends as if alone", bool(same), precision)
        yield not_a_number(precision)


def stops(name: str, fault: Failure | None, reasons: tuple[Status, ...], precision: Precision) -> Outcome:
    """Whether the replica stopped for one of the reasons."""
    reason = fault.status.name if fault else "it went on"
    right = fault is not None and fault.status in reasons
    return holds(f"{name}: stops with a reason ({reason})", right, precision)


def not_a_number(precision: Precision) -> Outcome:
    """A surface energy that is NaN is refused when it is read, or stops the run."""
    setup = healthy()
    energy = np.full_like(setup.contacts.surface_energy, nan)
    try:
        contacts = replace(setup.contacts, surface_energy=energy)
        sim = simulation_of([replace(setup, contacts=contacts)], precision, TUMBLING)
    except BadInput as refusal:
        return holds(f"surface energy NaN: refused ({refusal})", True, precision)
    advance_all(sim, HALF)
    return stops("surface energy NaN", failure(sim, 0), (Status.NOT_FINITE,), precision)
