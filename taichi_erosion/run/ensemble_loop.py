"""Playing a scene: advance, guard, end stages, until every replica is finished or has failed."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.core.snapshot import Failure, Status
from taichi_erosion.run.sanity_checks import (
    MOMENTUM_AFTER,
    count_failure,
    impacts_of,
    momentum_failure,
    restitution_failure,
)
from taichi_erosion.run.stages import (
    ROUNDING,
    Actor,
    begin_stage,
    close_stage,
    is_over,
    keep_frame,
    tilt_gravity,
    weight_over_diameters,
)
from taichi_erosion.scene import Scene
from taichi_erosion.simulation import Simulation, advance, energies, failure, statuses
from taichi_erosion.simulation.self_checks import Impact

ENERGY_RISE = 0.05  # of the mechanical energy above rest, in one check interval, that stops a replica [1]

Watcher = Callable[["Play"], None]


@dataclass
class Play:
    """An ensemble being played: each replica has a scene of its own, and all have the same check interval."""

    scenes: list[Scene]  # by replica
    sim: Simulation
    actors: list[Actor]
    checks: int = 0  # check intervals done
    grain_steps: float = 0.0  # released grains times steps
    sums: Floats = field(default_factory=lambda: np.zeros((0, 6)))  # of simulation.energies
    impacts: list[Impact] = field(default_factory=list)  # of every pair of materials, before the first step
    lifts: Floats = field(init=False)  # J, by replica: what lifting every grain by its own diameter takes

    def __post_init__(self) -> None:
        self.lifts = np.array([weight_over_diameters(setup) for setup in self.sim.setups])

    @property
    def check_interval(self) -> float:
        """Simulated time between checks [s]."""
        return self.scenes[0].run.check_interval

    @property
    def time(self) -> float:
        """Time of the last check [s]."""
        return self.checks * self.check_interval


def play(stage_play: Play, watchers: list[Watcher]) -> None:
    """Run to the end; every watcher is called after each check."""
    sim, interval = stage_play.sim, stage_play.check_interval
    stage_play.impacts = impacts_of(sim, stage_play.scenes)
    for replica, actor in enumerate(stage_play.actors):
        if actor.stage < 0:
            begin_stage(sim, stage_play.scenes[replica], replica, actor, stage_play.time)
    while any(actor.active for actor in stage_play.actors):
        target = (stage_play.checks + 1) * interval
        advance(sim, [target if actor.active else 0.0 for actor in stage_play.actors])
        stage_play.checks += 1
        stage_play.sums = energies(sim)
        running = np.array([actor.active for actor in stage_play.actors])
        stopped = statuses(sim) != Status.RUNNING
        steps = interval / np.array([setup.time_step for setup in sim.setups])
        stage_play.grain_steps += float((running * steps * stage_play.sums[:, 5]).sum())
        for replica, actor in enumerate(stage_play.actors):
            if actor.active:
                actor.failure = failure(sim, replica) if stopped[replica] else None
                check_replica(stage_play, replica, actor)
        for watcher in watchers:
            watcher(stage_play)


def check_replica(stage_play: Play, replica: int, actor: Actor) -> None:
    """Guards, then tilt, frames and the end of the stage.

    What the contacts give back was found before the first step, and is asked for once.
    """
    sim, scene, time = stage_play.sim, stage_play.scenes[replica], stage_play.time
    actor.failure = (
        actor.failure
        or (restitution_failure(stage_play.impacts, replica, scene, time) if stage_play.checks == 1 else None)
        or energy_failure(stage_play, replica, actor)
    )
    if actor.failure is not None:
        return
    tilt_gravity(sim, scene, replica, actor, time)
    keep_frame(sim, scene, replica, actor, time)
    kinetic = float(stage_play.sums[replica, 0] / stage_play.lifts[replica])
    if is_over(sim, scene, replica, actor, time, kinetic):
        actor.failure = count_failure(sim, replica, time)
        if actor.failure is None and stage_play.grain_steps > MOMENTUM_AFTER:
            actor.failure = momentum_failure(sim, replica, time)
        if actor.failure is not None:
            return
        close_stage(sim, scene, replica, actor)
        begin_stage(sim, scene, replica, actor, time)


def energy_failure(stage_play: Play, replica: int, actor: Actor) -> Failure | None:
    """A failure where mechanical energy grew although nothing did work on the grains.

    Moving walls, released grains, a tilting plate, air, effects and adhesion exchange energy that this sum
    does not hold; there the guard rests.
    """
    translation, rotation, potential, elastic, _, released = stage_play.sums[replica]
    sim, scene = stage_play.sim, stage_play.scenes[replica]
    now = float(translation + rotation + potential + elastic)
    before = actor.energy if released == actor.released else None
    actor.released = int(released)
    moving = bool(scene.stages[actor.stage].move) or moved_before(scene, actor.stage)
    fed = sim.laws.normal == "jkr" or sim.world.driven or sim.world.pair_effects.any
    actor.energy = None if moving or fed else now
    if before is None or actor.energy is None:
        return None
    scale = float(translation + rotation + elastic) + float(stage_play.lifts[replica])
    rise = (now - before) / scale
    return Failure(Status.ENERGY, stage_play.time, -1, -1, rise) if rise > ENERGY_RISE else None


def moved_before(scene: Scene, stage: int) -> bool:
    """Whether a wall was set in motion in an earlier stage; it may still move."""
    return any(earlier.move for earlier in scene.stages[:stage])


def share_done(stage_play: Play) -> float:
    """Rough share of the whole play that is done [1]; stages until rest usually end before their limit."""
    shares = []
    for scene, actor in zip(stage_play.scenes, stage_play.actors, strict=True):
        limits = [stage.duration_max for stage in scene.stages]
        stage = min(max(actor.stage, 0), len(limits) - 1)
        within = min((stage_play.time - actor.began) / limits[stage], 1.0)
        shares.append((sum(limits[:stage]) + within * limits[stage]) / sum(limits) if actor.active else 1.0)
    return min(shares) * (1.0 - ROUNDING)
