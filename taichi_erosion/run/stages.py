"""The acts of an experiment: when a stage ends, what the next one changes, what is measured on the way."""

from dataclasses import dataclass, field
from math import radians

import numpy as np
import scipy

from taichi_erosion.core.setup import Motion, Setup
from taichi_erosion.core.snapshot import AirProfile, Failure, Snapshot, Status
from taichi_erosion.measures.result import Measurement
from taichi_erosion.run.observables import Evidence, measure
from taichi_erosion.run.threshold_search import Hunt, begin_hunt, pursue
from taichi_erosion.scene import Scene
from taichi_erosion.scene.schema.scene import Stage
from taichi_erosion.simulation import (
    Simulation,
    air_profile,
    move_surface,
    remove_surface,
    set_gravity,
    set_through_flow,
    share_touching,
    snapshot,
    spin_up_wind,
)

GOALS = {"rest": "rest", "threshold": "all thresholds were found"}  # what a stage waits for
ROUNDING = 1e-9  # of an interval: a moment that lies on it counts as reached [1]


@dataclass
class Actor:
    """Where one replica stands in the play."""

    seed: int
    stage: int = -1  # before the first
    began: float = 0.0  # s, start of the stage
    finished: bool = False
    failure: Failure | None = None
    energy: float | None = None  # J, mechanical energy at the last check; None where work may have changed it
    released: int = 0
    frames: list[Snapshot] = field(default_factory=list)
    tilts: list[float] = field(default_factory=list)
    measurements: dict[str, Measurement] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    airs: list[AirProfile] = field(default_factory=list)  # with the frames, where there is air
    hunt: Hunt | None = None  # while and after thresholds are looked for

    @property
    def active(self) -> bool:
        """Whether this replica still has steps to do."""
        return not self.finished and self.failure is None


def begin_stage(sim: Simulation, scene: Scene, replica: int, actor: Actor, time: float) -> None:
    """Move on to the next stage: walls vanish or begin to move; after the last one the play is over."""
    actor.stage += 1
    actor.began = time
    actor.energy = None
    actor.frames, actor.tilts, actor.airs = [], [], []
    if actor.stage == len(scene.stages):
        actor.finished = True
        return
    stage = scene.stages[actor.stage]
    for name in stage.remove:
        remove_surface(sim, replica, name)
    for name, order in stage.move.items():
        move_surface(sim, replica, name, Motion(order.velocity, order.spin, order.centre))
    if stage.friction_velocity is not None:
        spin_up_wind(sim, replica, stage.friction_velocity)
    if stage.through_flow is not None:
        set_through_flow(sim, replica, stage.through_flow)
    if stage.until == "threshold":
        actor.hunt = begin_hunt(sim, scene, replica, time)


def tilt_of(stage: Stage, elapsed: float) -> float:
    """Inclination of the apparatus [rad] after a time within the stage [s]."""
    return radians(stage.tilt_rate) * elapsed


def tilt_gravity(sim: Simulation, scene: Scene, replica: int, actor: Actor, time: float) -> None:
    """Turn gravity against the tilt of the apparatus: seen from the plate, gravity turns."""
    stage = scene.stages[actor.stage]
    if stage.tilt_rate == 0.0:
        return
    axis = np.asarray(stage.tilt_axis) / np.linalg.norm(stage.tilt_axis)
    upright = np.asarray(sim.setups[replica].gravity)
    turn = scipy.spatial.transform.Rotation.from_rotvec(-tilt_of(stage, time - actor.began) * axis)
    x, y, z = turn.apply(upright)
    set_gravity(sim, replica, (float(x), float(y), float(z)))
    actor.energy = None


def keep_frame(sim: Simulation, scene: Scene, replica: int, actor: Actor, time: float) -> None:
    """Keep a snapshot for the measures that look at the whole stage."""
    stage = scene.stages[actor.stage]
    orders = [order for name, order in scene.measure.items() if stage_of(scene, name) == actor.stage]
    intervals = [order.every for order in orders if order.every]
    if intervals and time - actor.began >= len(actor.frames) * min(intervals) * (1.0 - ROUNDING):
        actor.frames.append(snapshot(sim, replica))
        actor.tilts.append(tilt_of(stage, time - actor.began))
        if scene.wind is not None:
            actor.airs.append(air_profile(sim, replica))


def stage_of(scene: Scene, observable: str) -> int:
    """Index of the stage at whose end an observable is read."""
    name = scene.measure[observable].stage
    names = [stage.name for stage in scene.stages]
    return names.index(name) if name else len(names) - 1


def is_over(sim: Simulation, scene: Scene, replica: int, actor: Actor, time: float, kinetic: float) -> bool:
    """Whether the stage ends now.

    `kinetic` is the translational kinetic energy over what lifting each grain by its own diameter takes [1].
    """
    stage = scene.stages[actor.stage]
    elapsed = time - actor.began
    if stage.until == "threshold" and actor.hunt is not None and pursue(sim, replica, actor.hunt, time):
        return True
    if elapsed >= stage.duration_max * (1.0 - ROUNDING):
        if stage.until in GOALS:
            limit = f"its time limit of {stage.duration_max:g} s"
            actor.warnings.append(f"stage {stage.name} reached {limit} before {GOALS[stage.until]}")
        return True
    if stage.until != "rest" or elapsed < stage.duration_min:
        return False
    if actor.released < len(sim.setups[replica].grains.radius):
        return False
    if kinetic > stage.rest_energy:
        return False
    return share_touching(sim, replica) >= stage.rest_contact_share


def weight_over_diameters(setup: Setup) -> float:
    """Sum of m g d over all grains [J]: what lifting each by its own diameter takes."""
    masses = setup.grains.mass if setup.clumps is None else setup.clumps.mass
    return float(masses.sum() * np.linalg.norm(setup.gravity) * 2.0 * setup.grains.radius.mean())


def close_stage(sim: Simulation, scene: Scene, replica: int, actor: Actor) -> None:
    """Read what is to be read at the end of the stage."""
    due = [name for name in scene.measure if stage_of(scene, name) == actor.stage]
    if not due:
        return
    end = snapshot(sim, replica)
    for name in due:
        evidence = Evidence(
            scene,
            scene.measure[name],
            end,
            tuple(actor.frames),
            tuple(actor.tilts),
            air_profile(sim, replica) if scene.wind is not None else None,
            tuple(actor.airs),
            {} if actor.hunt is None else actor.hunt.found,
        )
        actor.measurements[name] = measure(name, evidence)


CAUSES = {
    Status.OVERLAP: "the time step is too long, the material too soft for these speeds, "
    "or grains start inside each other",
    Status.LOST: "a grain passed a gap in the walls or was shot away by an overlap",
    Status.NOT_FINITE: "a parameter is not a number, or forces grew without bound: shorten the time step",
    Status.ENERGY: "the time step is too long for the stiffest contact",
    Status.OVERFLOW: "lists could not grow: out of memory",
    Status.RESTITUTION: "the time step is too long for impacts at this speed",
    Status.COUNT: "an error of this program: please report it",
    Status.MOMENTUM: "an error of this program: please report it",
    Status.AIR: "the wind crosses more than a cell between two looks: lower wind.look_steps",
    Status.RUNNING: "",
}


def sentence(failure: Failure, seed: int) -> str:
    """Why a replica stopped, in one line."""
    partner = f"grain {failure.partner}" if failure.partner >= 0 else f"wall piece {-1 - failure.partner}"
    said = {
        Status.OVERLAP: f"grain {failure.grain} overlaps {partner} by {failure.value:.3g} radii",
        Status.LOST: f"grain {failure.grain} left the domain at a coordinate of {failure.value:.4g} m",
        Status.AIR: "the pressure of the air was not found",
        Status.NOT_FINITE: f"grain {failure.grain} has a coordinate that is not a number",
        Status.ENERGY: f"mechanical energy grew by {failure.value:.3g} of itself between two checks",
        Status.RESTITUTION: f"an impact gave back {failure.value:.3g} of its speed, not what is stated",
        Status.MOMENTUM: f"forces between grains do not cancel ({failure.value:.3g} of them is left)",
        Status.COUNT: f"grain {failure.grain} is missing, or not all mass is there ({failure.value:.3g})",
    }.get(failure.status, failure.status.name.lower())
    return f"seed {seed} stopped at {failure.time:.6g} s: {said}; likely cause: {CAUSES[failure.status]}"
