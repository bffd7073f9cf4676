"""What a run asks of itself: do contacts give back what is stated, are all grains and all momentum there?"""

import numpy as np

from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.scene import Scene
from taichi_erosion.scene.build.limits import expected_speed
from taichi_erosion.simulation import Simulation, force_imbalance, snapshot
from taichi_erosion.simulation.self_checks import Impact, first_impacts

RESTITUTION_ERROR = 0.1  # that stops a run: four times the largest of the shipped scenes, 0.024 [1]
SPEED_LEAST = 1e-2  # m s-1, of an impact where nothing falls
MOMENTUM_ERROR = 1e-5  # of the forces between grains: a dozen contacts, each rounded to 6e-8, ten times [1]
MOMENTUM_AFTER = 1e8  # grain-steps: the question takes half a second to load, a tenth of that run
MASS_ERROR = 1e-5  # of the sum of all masses; they are kept in single precision [1]


def impacts_of(sim: Simulation, scenes: list[Scene]) -> list[Impact]:
    """First impacts of all replicas, at the largest speed that each scene expects."""
    return first_impacts(sim, [max(expected_speed(scene), SPEED_LEAST) for scene in scenes])


def restitution_error(impact: Impact) -> float:
    """What an impact gave back too much or too little [1]; adhesion may take any share of it."""
    error = impact.found - impact.stated
    return max(error, 0.0) if impact.adhesive else abs(error)


def restitution_failure(impacts: list[Impact], replica: int, scene: Scene, time: float) -> Failure | None:
    """A failure where a pair does not give back what is stated, and nobody insists on the time step."""
    wrong = [i for i in impacts if i.replica == replica and not restitution_error(i) <= RESTITUTION_ERROR]
    if not wrong or scene.run.force_time_step:
        return None
    return Failure(Status.RESTITUTION, time, -1, -1, wrong[0].found)


def count_failure(sim: Simulation, replica: int, time: float) -> Failure | None:
    """A failure where grains that came in are neither inside nor known to have left, or weigh otherwise.

    No grain may leave: one that does stops its replica. So those inside must be the released rows of the
    GrainTable, each once, with their masses.
    """
    state, table = snapshot(sim, replica), sim.setups[replica].grains
    if not np.array_equal(state.ident, np.arange(len(state.ident))):
        missing = np.setdiff1d(np.arange(len(state.ident)), state.ident)
        return Failure(Status.COUNT, time, int(missing[0]), -1, float(len(missing)))
    if not np.isfinite(state.position).all() or not np.isfinite(state.velocity).all():
        bad = ~np.isfinite(state.position + state.velocity).all(axis=1)
        return Failure(Status.NOT_FINITE, time, int(np.flatnonzero(bad)[0]), -1, float("nan"))
    weighed, listed = float(state.mass.sum()), float(table.mass[: len(state.mass)].sum())
    if abs(weighed - listed) > MASS_ERROR * listed:
        return Failure(Status.COUNT, time, 0, -1, weighed / listed - 1.0)
    return None


def momentum_failure(sim: Simulation, replica: int, time: float) -> Failure | None:
    """A failure where the forces between grains do not add up to nothing."""
    astray = force_imbalance(sim, replica)
    if astray <= MOMENTUM_ERROR:
        return None
    return Failure(Status.MOMENTUM, time, -1, -1, astray)
