"""Main loop of an ensemble: advance, check, end stages, until every replica is finished or has failed.

The checks: grains are all there, once, with their masses, at finite places; mechanical energy does not grow.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from statistics import fmean

import numpy as np

from taichi_erosion import simulation
from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.execution import Report, stages
from taichi_erosion.execution.threshold_search import advance_search
from taichi_erosion.scene import Scene
from taichi_erosion.simulation import Simulation

ENERGY_RISE = 0.05  # of the mechanical energy above rest, in one check interval, that stops a replica [1]
MASS_ERROR = 1e-5  # of the sum of all masses; they are stored in single precision [1]

FINDINGS = {  # of a check that stopped a replica, and the likely cause
    Status.OVERLAP: (
        "grain {grain} overlaps {partner} by {value:.3g} radii",
        "the time step is too long, the material too soft, or grains start inside each other",
    ),
    Status.LOST: (
        "grain {grain} left the domain at a coordinate of {value:.4g} m",
        "no wall holds it there, or an overlap shot it away; [domain] outside = 'remove' takes "
        "such grains out",
    ),
    Status.NOT_FINITE: (
        "grain {grain} has a coordinate that is not a number",
        "a parameter is not a number, or forces grew without bound: shorten the time step",
    ),
    Status.ENERGY: (
        "mechanical energy grew by {value:.3g} of itself between two checks",
        "the time step is too long for the stiffest contact",
    ),
    Status.OVERFLOW: ("lists of contacts could not grow", "out of memory"),
    Status.COUNT: (
        "grain {grain} is missing, or not all mass is there ({value:.3g})",
        "an error of this program: please report it",
    ),
    Status.AIR: (
        "the pressure of the air was not found",
        "the wind crosses more than a cell between two exchanges: lower wind.look_steps",
    ),
}

Callback = Callable[["EnsembleRun"], None]  # called after each check interval


@dataclass
class EnsembleRun:
    """State of a run of an ensemble: a scene for each replica, one check interval for all."""

    scenes: list[Scene]  # by replica
    sim: Simulation
    states: list[stages.ReplicaState]  # by replica
    repeats: bool = False  # of one scene: what its last stage measures is taken in one window for all
    holds: bool = False  # a stage lasts until the caller begins the next one
    checks: int = 0  # check intervals done
    grain_steps: float = 0.0  # released grains times steps
    wall_s: float = 0.0  # of these steps [s]
    sums: Floats = field(default_factory=lambda: np.zeros((0, 6)))  # of simulation.energies
    lifting_energies: Floats = field(init=False)  # J, by replica; see `lifting_energy`

    def __post_init__(self) -> None:
        self.lifting_energies = np.array([stages.energy_to_lift_grains(setup) for setup in self.sim.setups])

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
    sim = ensemble.sim
    for replica, state in enumerate(ensemble.states):
        if state.stage < 0:
            stages.begin_stage(sim, ensemble.scenes[replica], replica, state, ensemble.time)
    while any(state.active for state in ensemble.states):
        advance_to_next_check(ensemble)
        for callback in callbacks:
            callback(ensemble)
    if ensemble.repeats:
        scene = ensemble.scenes[0]
        final_states = {replica: state for replica, state in enumerate(ensemble.states) if state.finished}
        stages.measure_at_end(sim, scene, len(scene.stages) - 1, final_states)


def advance_to_next_check(ensemble: EnsembleRun) -> None:
    """Advance all active replicas to the next check, and check them."""
    sim, interval, started = ensemble.sim, ensemble.check_interval, time.perf_counter()
    target = (ensemble.checks + 1) * interval
    status = simulation.advance(sim, [target if state.active else 0.0 for state in ensemble.states])
    ensemble.checks += 1
    ensemble.sums = simulation.energy_sums(sim)
    running = np.array([state.active for state in ensemble.states])
    removed = simulation.removed_spheres(sim)
    steps = interval / np.array([setup.time_step for setup in sim.setups])
    ensemble.grain_steps += float((running * steps * ensemble.sums[:, 5]).sum())
    ensemble.wall_s += time.perf_counter() - started
    for replica, state in enumerate(ensemble.states):
        if state.active:
            state.failure = simulation.failure_of(sim, replica) if status[replica] != Status.RUNNING else None
            stages.count_removed(sim, replica, state, ensemble.time, removed[replica])
            check_replica(ensemble, replica, state)


def check_replica(ensemble: EnsembleRun, replica: int, state: stages.ReplicaState) -> None:
    """Sanity checks, then tilt, frames and the end of the stage."""
    sim, scene, now = ensemble.sim, ensemble.scenes[replica], ensemble.time
    state.failure = state.failure or failure_of_energy_gain(ensemble, replica, state)
    if state.failure is not None:
        return
    stages.tilt_gravity(sim, scene, replica, state, now)
    stages.store_frame_if_due(sim, scene, replica, state, now)
    stages.set_steady_air_profile(sim, scene.stages[state.stage], replica)
    if state.search is not None and not state.search.is_over:
        advance_search(sim, replica, state.search, now)
    if ensemble.holds:
        return
    kinetic, lifting = float(ensemble.sums[replica, 0]), float(ensemble.lifting_energies[replica])
    if stages.is_stage_over(sim, scene, replica, state, now, (kinetic, lifting)):
        state.failure = failure_of_lost_grains(sim, replica, now)
        if state.failure is None:
            if not ensemble.repeats or state.stage + 1 < len(scene.stages):
                stages.measure_at_end(sim, scene, state.stage, {replica: state})
            stages.begin_stage(sim, scene, replica, state, now)


def failure_of_energy_gain(ensemble: EnsembleRun, replica: int, state: stages.ReplicaState) -> Failure | None:
    """Failure where mechanical energy grew although nothing did work on the grains.

    Moving walls, released grains, a tilting plate, air, effects and adhesion exchange energy that this sum
    does not hold; there the check is off.
    """
    translation, rotation, potential, elastic, _, released = ensemble.sums[replica]
    sim, past_stages = ensemble.sim, ensemble.scenes[replica].stages[: state.stage + 1]
    now = float(translation + rotation + potential + elastic)
    before = state.energy if released == state.released else None
    state.released = int(released)
    moving = any(stage.move for stage in past_stages)  # one may still move
    driven = sim.laws.normal == "jkr" or sim.world.has_external_forces or sim.world.pair_effects.any
    state.energy = None if moving or driven else now
    if before is None or state.energy is None:
        return None
    scale = float(translation + rotation + elastic) + float(ensemble.lifting_energies[replica])
    if now - before <= ENERGY_RISE * scale:  # both are 0 where nothing moves and nothing weighs
        return None
    return Failure(Status.ENERGY, ensemble.time, -1, -1, (now - before) / scale)


def failure_of_lost_grains(sim: Simulation, replica: int, time: float) -> Failure | None:
    """Failure where grains are missing or doubled, a coordinate is not finite, or mass was lost.

    The grains must be the released rows of the GrainTable, each once, with their masses, without those that
    were counted when they left the domain.
    """
    state, table = simulation.snapshot(sim, replica), sim.setups[replica].grains
    missing = np.setdiff1d(np.arange(len(state.ident) + state.removed), state.ident)
    if len(missing) != state.removed:
        return Failure(Status.COUNT, time, int([*missing, -1][0]), -1, float(len(missing) - state.removed))
    if not np.isfinite(state.position).all() or not np.isfinite(state.velocity).all():
        bad = ~np.isfinite(state.position + state.velocity).all(axis=1)
        return Failure(Status.NOT_FINITE, time, int(np.flatnonzero(bad)[0]), -1, float("nan"))
    weighed, listed = float(state.mass.sum()), float(table.mass[state.ident].sum())
    if abs(weighed - listed) > MASS_ERROR * listed:
        return Failure(Status.COUNT, time, 0, -1, weighed / listed - 1.0)
    return None


def failure_message(failure: Failure, seed: int) -> str:
    """One line: seed, time, the violated check with its numbers, and the likely cause."""
    partner = f"grain {failure.partner}" if failure.partner >= 0 else f"wall piece {-1 - failure.partner}"
    finding, cause = FINDINGS[failure.status]
    violation = finding.format(grain=failure.grain, partner=partner, value=failure.value)
    return f"seed {seed} stopped at {failure.time:.6g} s: {violation}; likely cause: {cause}"


def report_progress(report: Report, ensemble: EnsembleRun) -> None:
    """Report stage, time, thresholds and the rough share done; stages until rest usually end early."""
    shares, names = [], []
    for scene, state in zip(ensemble.scenes, ensemble.states, strict=True):
        share = 1.0
        if state.active:
            limits, elapsed = [stage.duration_max for stage in scene.stages], ensemble.time - state.began
            limit = limits[state.stage]
            within = limit * state.search.share_done(elapsed) if state.search else min(elapsed, limit)
            share = (sum(limits[: state.stage]) + within) / sum(limits)
            names.append(scene.stages[state.stage].name)
        shares.append(share)
    now = f"{(*names, 'measuring')[0]}, {ensemble.time:.3f} s simulated"
    report(fmean(shares) * (1.0 - stages.ROUNDING), "; ".join([now, *thresholds_so_far(ensemble.states)]))


def thresholds_so_far(states: Sequence[stages.ReplicaState]) -> Iterator[str]:
    """`fluid threshold 0.25 m/s in 2 of 3 beds`, of both thresholds u* that searches have bracketed."""
    brackets = [state.search.brackets for state in states if state.search]
    for name in ("fluid_threshold", "impact_threshold"):
        if winds := [each[name].middle for each in brackets if name in each]:
            share, words = f"{len(winds)} of {len(states)} beds", name.replace("_", " ")
            yield f"{words} {fmean(winds):.3g} m/s in {share}"
