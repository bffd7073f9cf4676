"""Interactive session: one replica of a scene, advanced, changed and asked by calls.

Contact parameters, gravity, wind and the strength of effects that the session began with change at once, with
nothing compiled anew; an effect that was not there is compiled in, which takes seconds.
"""

from collections.abc import Callable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from itertools import chain, count, pairwise
from math import inf
from operator import index
from pathlib import Path
from shlex import quote
from time import monotonic
from typing import Any

from taichi_erosion import simulation
from taichi_erosion.core.effect import Effect
from taichi_erosion.core.errors import BadInput, SimulationStopped, did_you_mean
from taichi_erosion.core.files import mark_png, mark_toml, refuse_foreign_file, write_atomic
from taichi_erosion.core.setup import GrainTable, Numerics
from taichi_erosion.execution import checks
from taichi_erosion.execution import recorder as recorders
from taichi_erosion.execution import stages as staging
from taichi_erosion.execution.ensemble_loop import EnsembleRun, advance_to_next_check, failure_message
from taichi_erosion.execution.observables import measure_observable
from taichi_erosion.execution.result import apply_instruments
from taichi_erosion.measures.result import Measurement
from taichi_erosion.recording import stream
from taichi_erosion.recording.pictures import film_frame, png_bytes
from taichi_erosion.recording.wall_mesh import WallMesh
from taichi_erosion.scene import Scene, laws
from taichi_erosion.scene.preparation.contacts import contact_table
from taichi_erosion.simulation import Simulation

RUN_TO = "run to"  # command of the history: runs of several calls become one
STATUS_UNITS = {"time_s": "s", "kinetic_J": "J", "speed_largest_m_s": "m/s", "overlap_largest": "radii"}
PHYSICS = ("contact", "gravity", "wind", "effects", "conditions")  # sections that act on grains
LIVE = (*PHYSICS, "measured", "record", "measure")  # sections that may change
LIVE_WIND = ("friction_velocity", "through_flow")  # entries of the wind that may change, as stages do
KEEP_EVERY = 0.25  # s of wall time between two states that are kept
KEEP_SHARE = 0.05  # largest share of the wall time for that [1]
KEEP_BYTES = 4e8  # of kept states; then every second one goes, so that later ones lie closer


@dataclass
class Session:
    """One replica, the overrides that were set, and the states that were saved."""

    path: Path
    scene: Scene  # as changed so far
    overrides: tuple[str, ...]
    opened_with: tuple[str, ...]  # of these
    seed: int
    library: Mapping[str, Effect]
    ensemble: EnsembleRun  # of one replica, whose stages last until the next one is asked for
    time: float = 0.0  # s
    history: list[str] = field(default_factory=list)  # commands that lead to the present state
    saved: dict[str, "Kept"] = field(default_factory=dict)
    callbacks: list[Callable[["Session"], object]] = field(default_factory=list)  # after each advance
    samples: list[dict[str, float]] = field(default_factory=list)  # numbers by name, at each of these
    watched: dict[str, str] = field(default_factory=dict)  # units of the numbers that are printed, by name
    effect_files: checks.EffectFiles = ()  # beside those that the scene names
    states: list["Kept"] = field(default_factory=list)  # at earlier times, and before each change
    keep_at: float = 0.0  # s of the monotonic clock, from which the next one is due
    latest_change: tuple[str, float] = ("", 0.0)  # entry, and s of the monotonic clock
    same_change: float = 0.0  # s of wall time within which changes of one entry are undone together
    revision: int = 0  # number of the changes that led to the present state
    returns: int = 0  # to earlier states, whose runs were given up

    @property
    def sim(self) -> Simulation:
        """Its simulation. Raises BadInput where the device holds another one."""
        if not self.ensemble.sim.device_fields_exist:
            raise BadInput("another run or session has begun in this program since; open this one again")
        return self.ensemble.sim

    @property
    def state(self) -> staging.ReplicaState:
        return self.ensemble.states[0]

    @property
    def time_step(self) -> float:
        return self.sim.setups[0].time_step


Kept = tuple[Session, dict[str, Any]]  # a session as it was, and its grains


def open_session(
    path: str | Path,
    overrides: tuple[str, ...] = (),
    seed: int | None = None,
    effect_files: Sequence[Path] = (),
) -> Session:
    """Load a scene and assemble one replica of it, at the beginning of its first stage. Raises BadInput."""
    files = checks.read_effects(effect_files)
    scene = checks.read_scene(Path(path), overrides, files)
    library = checks.library_of(scene)
    chosen = scene.run.seed if seed is None else seed
    ensemble = build_ensemble(scene, chosen, library)
    session = Session(Path(path), scene, overrides, overrides, chosen, library, ensemble, effect_files=files)
    begin_stage(session)
    return session


def build_ensemble(
    scene: Scene, seed: int, library: Mapping[str, Effect], grains: GrainTable | None = None
) -> EnsembleRun:
    """Ensemble of one replica, before its first stage, of the grains of its scene or of others."""
    numerics = Numerics(precision=scene.run.precision)
    effective, setup = simulation.effective_scene(scene, library), simulation.prepare(scene, seed, library)
    sim = simulation.assemble([replace(setup, grains=grains or setup.grains)], laws(effective), numerics)
    return EnsembleRun([effective], sim, [staging.ReplicaState(seed)], holds=True)


def begin_next_stage(session: Session) -> str:
    """Begin the next stage of the scene; returns its name. Raises BadInput after the last one."""
    stages = session.scene.stages
    if session.state.stage + 1 == len(stages):
        raise BadInput(f"stage '{stages[-1].name}' is the last one")
    scene, state = session.ensemble.scenes[0], session.state
    staging.measure_at_end(session.sim, scene, state.stage, {0: state})
    begin_stage(session)
    session.history.append("stage")
    return stages[session.state.stage].name


def begin_stage(session: Session) -> None:
    """Begin the next stage; the wind that it orders is that of the scene from now on."""
    (scene,), state = session.ensemble.scenes, session.state
    staging.begin_stage(session.sim, scene, 0, state, session.time)
    orders = {name: getattr(scene.stages[state.stage], name) for name in LIVE_WIND}
    session.overrides += tuple(
        f"wind.{name}={value!r}" for name, value in orders.items() if value is not None
    )
    session.scene = checks.read_scene(session.path, session.overrides, session.effect_files)
    scenes = [simulation.effective_scene(session.scene, session.library)]
    session.ensemble = replace(session.ensemble, scenes=scenes)


def run_until_time(session: Session, time: float) -> None:
    """Run until a time [s], with callbacks at every check and at the end. Raises SimulationStopped."""
    raise_if_session_failed(session)
    ensemble, tolerance = session.ensemble, 0.5 * session.time_step
    if not session.time - tolerance <= time < inf:
        raise BadInput(
            f"run: {time:g} s do not lie ahead of the present {session.time:g} s; `undo` goes back"
        )
    while session.time < time - tolerance:
        keep_state_if_due(session)
        if time < ensemble.time + ensemble.check_interval - tolerance:
            simulation.advance(session.sim, [time])
            session.time, session.state.failure = time, simulation.failure_of(session.sim, 0)
        else:
            advance_to_next_check(ensemble)
            session.time = ensemble.time
        if session.history and session.history[-1].startswith(RUN_TO):
            session.history.pop()
        session.history.append(f"{RUN_TO} {session.time!r}")
        raise_if_session_failed(session)
        keep_sample(session)
        for callback in session.callbacks:
            callback(session)


def raise_if_session_failed(session: Session) -> None:
    if session.state.failure is not None:
        raise SimulationStopped(failure_message(session.state.failure, session.seed))


def run_for_seconds(session: Session, seconds: float) -> None:
    run_until_time(session, session.time + seconds)


def run_session_steps(session: Session, steps: int) -> None:
    run_until_time(session, session.time + index(steps) * session.time_step)


def run_until_rest(session: Session) -> bool:
    """Run until the grains rest or the search for thresholds is over; False at the time limit of a stage."""
    ensemble = session.ensemble
    limit = session.time + session.scene.stages[session.state.stage].duration_max
    while session.time < limit - 0.5 * session.time_step:
        run_until_time(session, min(ensemble.time + ensemble.check_interval, limit))
        if is_session_at_rest(session):
            return True
    return False


def is_session_at_rest(session: Session) -> bool:
    """Whether the stage's criterion of rest holds now; of a search for thresholds, whether it is over."""
    stage, state = session.scene.stages[session.state.stage], session.state
    if state.search is not None or session.time - state.began < stage.duration_min:
        return state.search is not None and state.search.is_over
    energies = float(simulation.energy_sums(session.sim)[0, 0]), float(session.ensemble.lifting_energies[0])
    return staging.is_at_rest(session.sim, 0, stage, energies)


def change_entry(session: Session, path: str, value: str) -> str:
    """Change one entry of the scene while it runs; returns what was done. Raises BadInput."""
    overrides = (*session.overrides, f"{path}={value}")
    scene = checks.read_scene(session.path, overrides, session.effect_files)
    if not names_of_changed_fields(session.scene, scene):
        return f"{path} is {value} already"
    library = checks.library_of(scene)
    refuse_fixed_entries(session, simulation.effective_scene(scene, library))
    changed = names_of_changed_fields(session.scene.wind, scene.wind) if scene.wind else ()
    order = f"stages.{session.state.stage}"  # the wind that its present stage orders is what blows
    overrides += tuple(f"{order}.{name}={getattr(scene.wind, name)!r}" for name in changed)
    scene = checks.read_scene(session.path, overrides, session.effect_files)
    is_new = session.latest_change[0] != path or monotonic() - session.latest_change[1] > session.same_change
    if is_new:
        keep_state_if_due(session, is_due=True)
    outcome = apply_change(session, scene, library)
    session.revision += is_new
    session.scene, session.overrides, session.library = scene, overrides, library
    session.history.append(f"set {path} {quote(value)}")
    session.latest_change = path, monotonic()
    return outcome


def refuse_fixed_entries(session: Session, after: Scene) -> None:
    """Raise BadInput where a scene, after its effects, changes what a run has begun with."""
    before = session.ensemble.scenes[0]
    fixed = [name for name in names_of_changed_fields(before, after) if name not in LIVE]
    if before.wind is not None and after.wind is not None:
        live = LIVE_WIND[session.state.search is not None :]  # a search for thresholds has its own winds
        entries = names_of_changed_fields(before.wind, after.wind)
        fixed += [f"wind.{name}" for name in entries if name not in live]
    elif before.wind is not after.wind:
        fixed.append("wind")
    if fixed:
        raise BadInput(f"{fixed[0]} is fixed once a run has begun; live are {', '.join(LIVE)}")


def warnings_of_present_scene(session: Session) -> list[str]:
    return checks.setup_report(session.scene, session.effect_files)["warnings"]


def names_of_changed_fields(before: Any, after: Any) -> list[str]:
    return [name for name in type(after).model_fields if getattr(before, name) != getattr(after, name)]


def apply_change(session: Session, scene: Scene, library: Mapping[str, Effect]) -> str:
    """Transfer a changed scene to the running simulation; what was read under the one before is let go."""
    sim, before, after = session.sim, session.ensemble.scenes[0], simulation.effective_scene(scene, library)
    if after.laws != before.laws:
        raise BadInput("this effect changes a contact law, which is compiled in: begin the session with it")
    changed = {*names_of_changed_fields(session.scene, scene), *names_of_changed_fields(before, after)}
    effects = simulation.device_effects(after, library, float(sim.setups[0].grains.radius.max()))
    if "measure" in changed:
        session.state.begin_frames(session.time)
    if not changed.intersection(PHYSICS):
        session.ensemble = replace(session.ensemble, scenes=[after])
        return "at once"
    lay_bed_of_search(session)
    simulation.set_contacts(sim, 0, contact_table(after))
    set_gravity_and_wind(session, before, after)
    rises = after.wind is not None and after.wind.through_flow != 0.0
    is_compiled = simulation.set_replica_effects(sim, 0, effects) and rises <= sim.coupling.has_through_flow
    if not is_compiled:
        state = simulation.export_state(sim)
        sim = build_ensemble(scene, session.seed, library, sim.setups[0].grains).sim
        simulation.import_state(sim, state)
    session.ensemble = replace(session.ensemble, scenes=[after], sim=sim)
    staging.begin_readings(sim, after, 0, session.state, session.time)
    return "at once" if is_compiled else "after building it in"


def lay_bed_of_search(session: Session) -> None:
    """Put the grains back as a search for thresholds found them, which begins anew with what changes."""
    if session.state.search is not None:
        simulation.import_bed(session.sim, 0, session.state.search.bed)


def set_gravity_and_wind(session: Session, before: Scene, after: Scene) -> None:
    """Transfer those that differ; gravity that is set tilts with the apparatus."""
    sim = session.sim
    if after.gravity != before.gravity:
        sim.setups[0] = replace(sim.setups[0], gravity=after.gravity.vector)
        simulation.set_replica_gravity(sim, 0, sim.setups[0].gravity)
        staging.tilt_gravity(sim, after, 0, session.state, session.time)
    if before.wind is not None and after.wind is not None:
        if after.wind.friction_velocity != before.wind.friction_velocity:
            simulation.spin_up_wind(sim, 0, after.wind.friction_velocity)
        simulation.set_upflow(sim, 0, after.wind.through_flow)


def measure_now(session: Session) -> dict[str, Measurement]:
    """All observables now, of the frames of the stage if there are any; of past stages as at their ends."""
    scene, state = session.scene, session.state
    window = staging.steady_transport_window(scene, state.stage, [state])
    if not state.frames:
        state = replace(state, frames=[simulation.snapshot(session.sim, 0)], tilts=[0.0])
    inputs, past = staging.measure_inputs_of_replica(session.sim, scene, 0, state, window), state.measurements
    names = scene.measure
    measurements = {name: past.get(name) or measure_observable(name, inputs(name)) for name in names}
    return apply_instruments(measurements, scene, session.library)


def copy_session_lists(session: Session) -> Session:
    state, search = session.state, session.state.search
    lists = {name: value.copy() for name, value in vars(state).items() if isinstance(value, list | dict)}
    shared = {id(part): part for part in (search.bed, search.scene)} if search else {}
    state = replace(state, search=deepcopy(search, shared), **lists)
    ensemble = replace(session.ensemble, states=[state])
    return replace(session, ensemble=ensemble, samples=[*session.samples], history=[*session.history])


def bytes_of_kept_states(states: Sequence[Kept]) -> int:
    return sum(values.nbytes for _, grains in states for values in grains.values())


def keep_state_if_due(session: Session, is_due: bool = False) -> None:
    """Keep the present state where one is due; those of later times, from before a return, go."""
    states, began = session.states, monotonic()
    here = session.time, session.revision
    while states and (states[-1][0].time > here[0] or (states[-1][0].time, states[-1][0].revision) == here):
        states.pop()
    if is_due or began >= session.keep_at:
        states.append((copy_session_lists(session), simulation.export_state(session.sim)))
        if bytes_of_kept_states(states) > KEEP_BYTES:  # those before a change stay
            pairs = enumerate(pairwise(states))
            states[:-1] = [a for k, (a, b) in pairs if k % 2 == 0 or a[0].revision != b[0].revision]
        session.keep_at = began + max(KEEP_EVERY, (monotonic() - began) / KEEP_SHARE)


def return_to_time(session: Session, time: float) -> None:
    """Return to the kept state nearest to a time [s], the last of several; later ones stay until a run."""
    if session.state.failure is None and (not session.states or session.states[-1][0].time <= session.time):
        keep_state_if_due(session, is_due=True)
    resume_from_state(session, min(reversed(session.states), key=lambda state: abs(state[0].time - time)))


def undo_latest_change(session: Session) -> None:
    """Return to the state before the latest change, bit for bit. Raises BadInput where there is none."""
    earlier = [each for each in session.states if each[0].revision < session.revision]
    if not earlier:
        raise BadInput("there is no change to undo")
    resume_from_state(session, earlier[-1])


def save_state_as(session: Session, name: str) -> None:
    session.saved[name] = copy_session_lists(session), simulation.export_state(session.sim)


def restore_saved_state(session: Session, name: str) -> None:
    """Return to a saved state, parameters, samples and history included. Raises BadInput for no such name."""
    resume_from_state(session, saved_state(session, name))


def resume_from_state(session: Session, state: Kept) -> None:
    """Return to a state, bit for bit."""
    then, grains = state
    if session.sim is then.ensemble.sim:
        apply_change(session, then.scene, then.library)
        sim = session.sim
    else:  # an effect has been built in, or grains inserted, since
        sim = build_ensemble(then.scene, session.seed, then.library, then.ensemble.sim.setups[0].grains).sim
    simulation.import_state(sim, grains)
    session.ensemble = replace(copy_session_lists(then).ensemble, sim=sim)
    session.scene, session.library, session.overrides = then.scene, then.library, then.overrides
    has_run_on = (then.time, then.history) != (session.time, session.history[: len(then.history)])
    session.time, session.revision, session.returns = then.time, then.revision, session.returns + has_run_on
    session.samples[:], session.history[:] = then.samples, then.history
    session.latest_change = "", 0.0


def saved_state(session: Session, name: str) -> Kept:
    """The state that was saved under a name. Raises BadInput for an unknown name."""
    if name not in session.saved:
        near, names = did_you_mean(name, session.saved), ", ".join(session.saved) or "nothing"
        raise BadInput(f"nothing is saved as '{name}'{near}; there is {names}")
    return session.saved[name]


def session_status(session: Session) -> dict[str, float | int | str]:
    sums = simulation.energy_totals(session.sim, 0)
    return {
        "time_s": round(session.time, 9),
        "stage": session.scene.stages[session.state.stage].name,
        "released": sums.released,
        "removed": simulation.removed_spheres(session.sim)[0],
        "contacts": sums.contacts,
        "kinetic_J": sums.kinetic_translation + sums.kinetic_rotation,
        "speed_largest_m_s": sums.speed_largest,
        "overlap_largest": sums.overlap_largest,
    }


def present_wall_meshes(session: Session) -> tuple[WallMesh, ...]:
    return recorders.present_walls(recorders.meshes_of(session.scene, session.sim.setups[0]), session.sim, 0)


def write_side_picture(session: Session, path: Path) -> Path:
    """Write the grains seen from the side as PNG. Raises BadInput where a foreign file has the name."""
    setup, now = session.sim.setups[0], simulation.snapshot(session.sim, 0)
    speeds = recorders.resting_speed(setup), stream.FASTEST_COLOUR
    picture = film_frame(now, recorders.side_view(setup), present_wall_meshes(session), speeds)
    return write_file(session, path, png_bytes(picture))


def write_file(session: Session, path: Path, picture: bytes) -> Path:
    """Write a PNG of this session; one of another scene, or a file of the user, stays."""
    refuse_foreign_file(path, session.path)
    return write_atomic(path, mark_png(path, session.path, picture))


def write_session_commands(session: Session, path: Path) -> Path:
    """Write the commands that lead to the present state; a file of the user stays. Raises BadInput."""
    words = [f"--set {quote(each)}" for each in session.opened_with]
    words += [f"--effect {file.path}" for file in session.effect_files]
    begin = " ".join(["# live", str(session.path), *words, f"--seed {session.seed} < {path.name}"])
    text = "\n".join([begin, *session.history, ""])
    refuse_foreign_file(path, session.path)
    return write_atomic(path, mark_toml(path, session.path, text))


def unused_path(path: Path) -> Path:
    """The path, or the first of PATH-2, PATH-3 and so on that does not exist."""
    names = (path.with_name(f"{path.stem}-{number}{path.suffix}") for number in count(2))
    return next(free for free in chain([path], names) if not free.exists())


def status_values_in_units(session: Session) -> dict[str, float]:
    """Numbers of the status by name, in the units that the names end in."""
    return {name: float(x) for name, x in session_status(session).items() if not isinstance(x, str)}


def refuse_unknown_number(session: Session, name: str) -> None:
    """Raise BadInput for a name that is no number of the status and no measure."""
    names = [*status_values_in_units(session), *session.scene.measure]
    if name not in names:
        raise BadInput(f"no number '{name}'{did_you_mean(name, names)}; there are {', '.join(names)}")


def watch_measures(session: Session, *names: str) -> None:
    """Keep measures too at every check, beside the status. Raises BadInput for an unknown name."""
    for name in names:
        refuse_unknown_number(session, name)
    units = {name: entry.unit for name, entry in measure_now(session).items()}
    session.watched |= {name: units.get(name) or STATUS_UNITS.get(name, "") for name in names}


def keep_sample(session: Session) -> None:
    """Keep the numbers of this moment; those of a later time, from before a return, go."""
    now = status_values_in_units(session)
    if not set(session.watched) <= set(now):
        now |= {name: entry.value for name, entry in measure_now(session).items() if name in session.watched}
    while session.samples and session.samples[-1]["time_s"] >= now["time_s"]:
        session.samples.pop()
    session.samples.append(now)


def sampled_curve(session: Session, name: str) -> tuple[list[float], list[float]]:
    """Times [s] and values of a number at the checks so far. Raises BadInput without any."""
    refuse_unknown_number(session, name)
    samples = [sample for sample in session.samples if name in sample]
    if not samples:
        raise BadInput(f"'{name}' has no samples: `watch {name}` before a run keeps them")
    return [sample["time_s"] for sample in samples], [sample[name] for sample in samples]
