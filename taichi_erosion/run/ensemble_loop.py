"""Main loop of an ensemble: advance, check, end stages, until every replica is finished or has failed."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.run import Report
from taichi_erosion.run.sanity_checks import count_failure
from taichi_erosion.run.stages import (
    ROUNDING,
    ReplicaState,
    begin_stage,
    lifting_energy,
    measure_stage,
    stage_is_over,
    store_frame,
    tilt_gravity,
)
from taichi_erosion.scene import Scene
from taichi_erosion.simulation import Simulation, advance, energies, failure, statuses

ENERGY_RISE = 0.05  # of the mechanical energy above rest, in one check interval, that stops a replica [1]
PROGRESS_INTERVAL = 0.2  # s of wall time

Callback = Callable[["EnsembleRun"], None]  # called after each check interval


@dataclass
class EnsembleRun:
    """State of a run of an ensemble: a scene for each replica, one check interval for all."""

    scenes: list[Scene]  # by replica
    sim: Simulation
    states: list[ReplicaState]  # by replica
    checks: int = 0  # check intervals done
    grain_steps: float = 0.0  # released grains times steps
    sums: Floats = field(default_factory=lambda: np.zeros((0, 6)))  # of simulation.energies
    lifting_energies: Floats = field(init=False)  # J, by replica; see `lifting_energy`

    def __post_init__(self) -> None:
        self.lifting_energies = np.array([lifting_energy(setup) for setup in self.sim.setups])

    @property
    def check_interval(self) -> float:
        """Simulated time between checks [s]."""
        return self.scenes[0].run.check_interval

    @property
    def time(self) -> float:
        """Time of the last check [s]."""
        return self.checks * self.check_interval


def run_ensemble(ensemble: EnsembleRun, callbacks: list[Callback]) -> None:
    """Advance all replicas to their ends, check by check."""
    sim, interval = ensemble.sim, ensemble.check_interval
    for replica, state in enumerate(ensemble.states):
        if state.stage < 0:
            begin_stage(sim, ensemble.scenes[replica], replica, state, ensemble.time)
    while any(state.active for state in ensemble.states):
        target = (ensemble.checks + 1) * interval
        advance(sim, [target if state.active else 0.0 for state in ensemble.states])
        ensemble.checks += 1
        ensemble.sums = energies(sim)
        running = np.array([state.active for state in ensemble.states])
        stopped = statuses(sim) != Status.RUNNING
        steps = interval / np.array([setup.time_step for setup in sim.setups])
        ensemble.grain_steps += float((running * steps * ensemble.sums[:, 5]).sum())
        for replica, state in enumerate(ensemble.states):
            if state.active:
                state.failure = failure(sim, replica) if stopped[replica] else None
                check_replica(ensemble, replica, state)
        for callback in callbacks:
            callback(ensemble)


def check_replica(ensemble: EnsembleRun, replica: int, state: ReplicaState) -> None:
    """Sanity checks, then tilt, frames and the end of the stage."""
    sim, scene, now = ensemble.sim, ensemble.scenes[replica], ensemble.time
    state.failure = state.failure or energy_failure(ensemble, replica, state)
    if state.failure is not None:
        return
    tilt_gravity(sim, scene, replica, state, now)
    store_frame(sim, scene, replica, state, now)
    kinetic = float(ensemble.sums[replica, 0] / ensemble.lifting_energies[replica])
    if stage_is_over(sim, scene, replica, state, now, kinetic):
        state.failure = count_failure(sim, replica, now)
        if state.failure is None:
            measure_stage(sim, scene, replica, state)
            begin_stage(sim, scene, replica, state, now)


def energy_failure(ensemble: EnsembleRun, replica: int, state: ReplicaState) -> Failure | None:
    """Failure where mechanical energy grew although nothing did work on the grains.

    Moving walls, released grains, a tilting plate, air, effects and adhesion exchange energy that this sum
    does not hold; there the check is off.
    """
    translation, rotation, potential, elastic, _, released = ensemble.sums[replica]
    sim, stages = ensemble.sim, ensemble.scenes[replica].stages
    now = float(translation + rotation + potential + elastic)
    before = state.energy if released == state.released else None
    state.released = int(released)
    moving = any(stage.move for stage in stages[: state.stage + 1])  # one may still move
    driven = sim.laws.normal == "jkr" or sim.world.driven or sim.world.pair_effects.any
    state.energy = None if moving or driven else now
    if before is None or state.energy is None:
        return None
    scale = float(translation + rotation + elastic) + float(ensemble.lifting_energies[replica])
    rise = (now - before) / scale
    return Failure(Status.ENERGY, ensemble.time, -1, -1, rise) if rise > ENERGY_RISE else None


def share_done(ensemble: EnsembleRun) -> float:
    """Rough share of the whole run that is done [1]; stages until rest usually end before their limit."""
    shares = []
    for scene, state in zip(ensemble.scenes, ensemble.states, strict=True):
        limits = [stage.duration_max for stage in scene.stages]
        stage = min(max(state.stage, 0), len(limits) - 1)
        within = min((ensemble.time - state.began) / limits[stage], 1.0)
        shares.append((sum(limits[:stage]) + within * limits[stage]) / sum(limits) if state.active else 1.0)
    return min(shares) * (1.0 - ROUNDING)


@dataclass
class ProgressReporter:
    """Callback that reports the stage, its time and the share done, at most every PROGRESS_INTERVAL."""

    report: Report
    last: float = 0.0  # s of the monotonic clock

    def __call__(self, ensemble: EnsembleRun) -> None:
        now = time.monotonic()
        if now - self.last < PROGRESS_INTERVAL:
            return
        self.last = now
        both = zip(ensemble.scenes, ensemble.states, strict=True)
        active = [scene.stages[state.stage].name for scene, state in both if state.active]
        name = active[0] if active else "measuring"
        self.report(share_done(ensemble), f"{name}, {ensemble.time:.3f} s simulated")
