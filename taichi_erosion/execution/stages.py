"""Stages of an experiment: state of each replica, start and end of a stage, frames, fields, measurements."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import isnan, radians

import numpy as np
import scipy

from taichi_erosion import simulation
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats, Setup
from taichi_erosion.core.snapshot import AirProfile, Failure, GrainFields, Snapshot
from taichi_erosion.execution.observables import MeasureInput, measure_observable, wind_patch_of_scene
from taichi_erosion.execution.threshold_search import ROUNDING, ThresholdSearch, begin_search
from taichi_erosion.measures.coarse_graining import AXES, Kernel, coarse_grain
from taichi_erosion.measures.result import Measurement
from taichi_erosion.measures.wall_loads import forces_and_torques_on_walls
from taichi_erosion.measures.wind_bed import HOP_TIME, Window, steady_window, stress_ratio
from taichi_erosion.scene import Scene
from taichi_erosion.scene.preparation.walls import motion_of_wall_order
from taichi_erosion.scene.schema.scene import OF_WALLS, Stage
from taichi_erosion.simulation import Simulation

WIDTH = 1.0  # of the kernel of fields over the mean diameter of the grains [1]: it smooths their layers
STEP = 0.5  # between two points of a line, over the width [1]
REACH = 3.0  # of a line beyond the outermost centres, over the width [1]
GOALS = {"rest": "rest", "threshold": "all thresholds were found"}  # end of a stage by `until`


@dataclass
class ReplicaState:
    """Progress of one replica through the stages of its scene, and its measurements so far."""

    seed: int
    stage: int = -1  # before the first
    began: float = 0.0  # s, start of the stage
    finished: bool = False
    failure: Failure | None = None
    energy: float | None = None  # J, mechanical energy at the last check; None where work may have changed it
    released: int = 0
    removed: list[list[float]] = field(default_factory=list)  # time [s], grains that had left the domain
    frames: list[Snapshot] = field(default_factory=list)
    tilts: list[float] = field(default_factory=list)
    measurements: dict[str, Measurement] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    airs: list[AirProfile] = field(default_factory=list)  # with the frames, where there is air
    loads: list[Floats] = field(default_factory=list)  # of walls at the frames, with their shifts, if read
    search: ThresholdSearch | None = None  # from the begin of a threshold stage on
    read_from: float = 0.0  # s, from which the frames are taken

    @property
    def active(self) -> bool:
        return not self.finished and self.failure is None

    def warn(self, text: str) -> None:
        if text not in self.warnings:
            self.warnings.append(text)

    def begin_frames(self, time: float) -> None:
        """Take frames from a time [s] on, and let those before go."""
        self.read_from, self.frames, self.tilts, self.airs, self.loads = time, [], [], [], []


def count_whole_intervals(time: float, interval: float) -> int:
    """Number of whole intervals in a time, up to rounding."""
    return int(time / interval * (1.0 + ROUNDING))


def count_removed(sim: Simulation, replica: int, state: ReplicaState, time: float, spheres: int) -> None:
    """Note the number of grains that have left the domain, where it has grown."""
    setup = sim.setups[replica]
    grains = spheres if setup.clumps is None else spheres * len(setup.clumps.mass) // len(setup.grains.mass)
    if grains > (state.removed[-1][1] if state.removed else 0):
        state.removed.append([time, grains])
        state.energy = None


def begin_stage(sim: Simulation, scene: Scene, replica: int, state: ReplicaState, time: float) -> None:
    """Begin the next stage at a time [s]; after the last one the replica is finished."""
    state.stage += 1
    state.energy = None
    if state.stage == len(scene.stages):
        state.finished = True
        if state.removed and scene.domain.outside is None:
            first, (_, count) = state.removed[0][0], state.removed[-1]
            state.warn(f"{count:,.0f} grains left the domain, the first by {first:.3g} s, and were taken out")
        return
    state.began = time
    stage = scene.stages[state.stage]
    for name in stage.remove:
        simulation.remove_surface(sim, replica, name)
    for name, order in stage.move.items():
        simulation.move_surface(sim, replica, name, motion_of_wall_order(order))
    if stage.friction_velocity is not None:
        simulation.spin_up_wind(sim, replica, stage.friction_velocity)
    if stage.through_flow is not None:
        simulation.set_upflow(sim, replica, stage.through_flow)
    begin_readings(sim, scene, replica, state, time)


def begin_readings(sim: Simulation, scene: Scene, replica: int, state: ReplicaState, time: float) -> None:
    """Take frames and search thresholds anew from a time [s], where what acts on the grains has changed."""
    state.energy = None
    state.begin_frames(time)
    if scene.stages[state.stage].until == "threshold":
        state.search = begin_search(sim, scene, replica, time)


def tilt_gravity(sim: Simulation, scene: Scene, replica: int, state: ReplicaState, time: float) -> None:
    """Rotate gravity by minus the tilt of the apparatus: the frame of reference is that of the plate."""
    stage = scene.stages[state.stage]
    if stage.tilt_rate == 0.0:
        return
    tilt = radians(stage.tilt_rate) * (time - state.began)
    axis = np.asarray(stage.tilt_axis) / np.linalg.norm(stage.tilt_axis)
    upright = np.asarray(sim.setups[replica].gravity)
    x, y, z = scipy.spatial.transform.Rotation.from_rotvec(-tilt * axis).apply(upright)
    simulation.set_replica_gravity(sim, replica, (float(x), float(y), float(z)))
    state.energy = None


def set_steady_air_profile(sim: Simulation, stage: Stage, replica: int) -> None:
    """Steady profile of the air over the grains as they fly now, in a stage whose air has no inertia."""
    if stage.steady_air:
        simulation.spin_up_wind(sim, replica, simulation.friction_velocity(sim, replica))


def store_frame_if_due(sim: Simulation, scene: Scene, replica: int, state: ReplicaState, time: float) -> None:
    """Store a snapshot, once per interval, for the measures that use the whole stage."""
    stage = scene.stages[state.stage]
    intervals = [scene.measure[name].every for name in observables_of_stage(scene, state.stage)]
    shortest = min((interval for interval in intervals if interval), default=None)
    if shortest and time - state.read_from >= len(state.frames) * shortest * (1.0 - ROUNDING):
        state.frames.append(replace(simulation.snapshot(sim, replica), force=None))  # no measure reads it
        state.tilts.append(radians(stage.tilt_rate) * (time - state.began))
        if scene.wind is not None:
            state.airs.append(simulation.air_profile(sim, replica))
        if set(OF_WALLS) & set(observables_of_stage(scene, state.stage)):
            loads = forces_and_torques_on_walls(simulation.contact_network(sim, replica))
            poses = simulation.wall_poses(sim, replica)
            state.loads.append(np.hstack([loads, [pose.translation for pose in poses.values()]]))


def observables_of_stage(scene: Scene, stage: int) -> list[str]:
    """Observables that are measured at the end of a stage: of their own, or of the last one."""
    last, here = scene.stages[-1].name, scene.stages[stage].name
    return [name for name, request in scene.measure.items() if (request.stage or last) == here]


def is_stage_over(
    sim: Simulation, scene: Scene, replica: int, state: ReplicaState, time: float, energy: tuple[float, float]
) -> bool:
    """Whether the stage ends now; `energy`: translational, and that which lifts all grains [J]."""
    stage = scene.stages[state.stage]
    elapsed = time - state.began
    if state.search is not None and state.search.is_over:
        return True
    if elapsed >= stage.duration_max * (1.0 - ROUNDING):
        if stage.until in GOALS:
            limit = f"its time limit of {stage.duration_max:g} s"
            state.warnings.append(f"stage {stage.name} reached {limit} before {GOALS[stage.until]}")
        return True
    if stage.until != "rest" or elapsed < stage.duration_min:
        return False
    return is_at_rest(sim, replica, stage, energy)


def is_at_rest(sim: Simulation, replica: int, stage: Stage, energy: tuple[float, float]) -> bool:
    """Criterion of rest: no grain waits, most are in contact, `energy` (as in `is_stage_over`) is small."""
    kinetic, lifting = energy
    return (
        kinetic <= stage.rest_energy * lifting  # the others ask the device
        and simulation.count_waiting_spheres(sim, replica) == 0
        and simulation.share_of_grains_in_contact(sim, replica) >= stage.rest_contact_share
    )


def energy_to_lift_grains(setup: Setup) -> float:
    """Energy that lifts every grain by the mean diameter, sum of m g d [J]."""
    masses = setup.grains.mass if setup.clumps is None else setup.clumps.mass
    return float(masses.sum() * np.linalg.norm(setup.gravity) * 2.0 * setup.grains.radius.mean())


def measure_at_end(sim: Simulation, scene: Scene, stage: int, replicas: Mapping[int, ReplicaState]) -> None:
    """Measure the observables of the end of a stage in replicas that repeat one scene.

    Means of transport are taken over one window for all of them, in which their air is steady.
    """
    names = observables_of_stage(scene, stage)
    window = steady_transport_window(scene, stage, list(replicas.values())) if names else None
    for replica, state in replicas.items() if names else ():
        inputs = measure_inputs_of_replica(sim, scene, replica, state, window)
        for name in names:
            state.measurements[name] = measurement = measure_observable(name, data := inputs(name))
            if isnan(measurement.value):
                state.warn(f"{name} has no value: {'; '.join(measurement.notes)}")
            elif data.fallen_grains_text in measurement.notes:
                state.warn(data.fallen_grains_text)


def measure_inputs_of_replica(
    sim: Simulation, scene: Scene, replica: int, state: ReplicaState, window: Window | None
) -> Callable[[str], MeasureInput]:
    """Input of each measure of one replica, by name: its present state and the frames of its stage."""
    end = simulation.snapshot(sim, replica)
    of_any_measure = partial(
        MeasureInput,
        scene,
        end=end,
        frames=tuple(state.frames),
        tilts=tuple(state.tilts),
        air=simulation.air_profile(sim, replica) if scene.wind is not None else None,
        airs=tuple(state.airs),
        thresholds={} if state.search is None else state.search.brackets,
        profile=partial(present_grain_fields, sim, replica),
        period=sim.setups[replica].period,
        window=window,
        loads=tuple(state.loads),
        poses=simulation.wall_poses(sim, replica),
        waiting=simulation.count_waiting_spheres(sim, replica),
        network=partial(simulation.contact_network, sim, replica),
    )
    return lambda name: of_any_measure(scene.measure[name])


def steady_transport_window(scene: Scene, stage: int, states: Sequence[ReplicaState]) -> Window | None:
    """Window in which transport by wind is steady; None without wind or where a grid carries the stress."""
    wind = scene.wind
    if wind is None or wind.columns != (1, 1) or (friction := scene.friction_velocity_of_stage(stage)) <= 0.0:
        return None
    if not states or any(len(state.airs) < 2 for state in states):
        return None
    patch, stress = wind_patch_of_scene(scene), wind.density * friction**2
    times = [frame.time - states[0].read_from for frame in states[0].frames]
    hop = HOP_TIME * friction / scene.gravity.magnitude
    return steady_window(times, [stress_ratio(state.airs, patch, stress) for state in states], hop)


def present_grain_fields(
    sim: Simulation,
    replica: int,
    at: Mapping[str, Floats] | None = None,
    width: float | None = None,
    extent: Mapping[str, float] | None = None,
) -> GrainFields:
    """Fields at coordinates [m] by axis; without any on a line along z, at whole multiples of its step.

    An axis that is left out is averaged over its period, or over its `extent` [m]. Raises BadInput without
    either, and for clumps.
    """
    setup, state = sim.setups[replica], simulation.snapshot(sim, replica)
    if setup.clumps is not None:
        raise BadInput("fields: grains are clumps, whose spheres overlap; fields are of single spheres")
    if not len(state.mass):
        raise BadInput("fields: no grain is there")
    chosen = width or WIDTH * 2.0 * float(setup.grains.radius.mean())
    places = {name: np.atleast_1d(np.asarray(at[name], float)) for name in AXES if at and name in at}
    if wrong := [name for name in (*(at or {}), *(extent or {})) if name not in AXES]:
        raise BadInput(f"fields: {wrong[0]} is no axis; there are x, y and z")
    lengths = {name: length for name, length in zip(AXES, setup.period, strict=True) if length > 0.0}
    kernel = Kernel(
        places or points_along_z(state, chosen, lengths), chosen, lengths | dict(extent or {}), setup.period
    )
    for name in AXES:
        if name not in kernel.at and not kernel.extent.get(name, 0.0) > 0.0:
            raise BadInput(f"fields: {name} is open; give its coordinates or the extent to average over")
    return coarse_grain(state, simulation.contact_network(sim, replica), kernel)


def points_along_z(state: Snapshot, width: float, lengths: Mapping[str, float]) -> dict[str, Floats]:
    """Coordinates of a line along z; along an axis without a period it goes through the centre of mass."""
    centre = np.average(state.position, axis=0, weights=state.mass)
    z, reach, step = state.position[:, 2], REACH * width, STEP * width
    line = np.arange(np.floor((z.min() - reach) / step), np.ceil((z.max() + reach) / step) + 1.0) * step
    return {name: centre[k : k + 1] for k, name in enumerate("xy") if name not in lengths} | {"z": line}
