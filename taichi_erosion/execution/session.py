"""Interactive session: one replica of a scene, advanced, changed and asked by calls.

    from taichi_erosion.execution.session import measure_now, open_session, run_for_seconds, change_entry

    session = open_session("scenes/funnel_repose.toml")
    run_for_seconds(session, 0.5)
    change_entry(session, "contact.soil-soil.friction_rolling", "0.3")
    run_for_seconds(session, 0.5)
    print(measure_now(session))

Contact parameters, gravity, wind and the strength of effects that the session began with change at once, with
nothing compiled anew; an effect that was not there is compiled in, which takes seconds.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, count, pairwise
from math import inf
from pathlib import Path
from shlex import quote
from time import monotonic
from typing import Any

from scipy.spatial.distance import cdist

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
from taichi_erosion.execution.scene_run import scene_text_with_overrides
from taichi_erosion.measures.result import Measurement
from taichi_erosion.recording import stream
from taichi_erosion.recording.pictures import film_frame, png_bytes
from taichi_erosion.recording.wall_mesh import WallMesh
from taichi_erosion.scene import Scene, laws, replica_setup
from taichi_erosion.scene.preparation.contacts import contact_table
from taichi_erosion.scene.preparation.fill import pour_with_inlets_open
from taichi_erosion.scene.preparation.setup import append_grains_by_release
from taichi_erosion.simulation import Simulation
from taichi_erosion.simulation.saved_state import remove_grains_from_state

RUN_TO = "run to"  # command of the history: runs of several calls become one
CHANGES = ("set ", "insert ", "remove ")  # commands that change what a run goes on with
STATUS_UNITS = {"time_s": "s", "kinetic_J": "J", "speed_largest_m_s": "m/s", "overlap_largest": "radii"}
NO_PHYSICS = ("measured", "record", "measure")  # sections that do not act on grains
LIVE = ("contact", "gravity", "wind", "effects", "conditions", *NO_PHYSICS)  # sections that may change
LIVE_WIND = {"friction_velocity", "through_flow"}  # entries of the wind that may change
KEEP_EVERY = 0.25  # s of wall time between two states that are kept
KEEP_SHARE = 0.05  # largest share of the wall time for that [1]
KEEP_BYTES = 4e8  # of kept states; then every second one goes, so that later ones lie closer
SAME_CHANGE = 1.0  # s of wall time within which changes of one entry are undone together


@dataclass
class Session:
    """One replica, the overrides that were set, and the states that were saved."""

    path: Path
    scene: Scene  # as changed so far
    overrides: tuple[str, ...]
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

    @property
    def sim(self) -> Simulation:
        return self.ensemble.sim

    @property
    def state(self) -> staging.ReplicaState:
        """Progress of the replica through its stages."""
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
    staging.begin_stage(ensemble.sim, ensemble.scenes[0], 0, ensemble.states[0], 0.0)
    return Session(Path(path), scene, overrides, chosen, library, ensemble, effect_files=files)


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
    staging.begin_stage(session.sim, session.ensemble.scenes[0], 0, session.state, session.time)
    session.history.append("stage")
    return stages[session.state.stage].name


def run_until_time(session: Session, time: float) -> None:
    """Run until a time [s], with callbacks at every check and at the end. Raises SimulationStopped."""
    raise_if_session_failed(session)
    ensemble, tolerance = session.ensemble, 0.5 * session.time_step
    if time < session.time - tolerance:
        raise BadInput(f"run: {time:g} s lie before the present {session.time:g} s; `undo` goes back")
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
    """Raise SimulationStopped where a check has failed, BadInput where the session has no device any more."""
    if not session.sim.device_fields_exist:
        raise BadInput("another run or session has begun in this program since; open this one again")
    if session.state.failure is not None:
        raise SimulationStopped(failure_message(session.state.failure, session.seed))


def run_for_seconds(session: Session, seconds: float) -> None:
    run_until_time(session, session.time + seconds)


def run_session_steps(session: Session, steps: int) -> None:
    run_until_time(session, session.time + steps * session.time_step)


def run_until_rest(session: Session) -> bool:
    """Run until the stage's criterion of rest holds or its time limit is over; returns whether it rests."""
    ensemble = session.ensemble
    limit = session.time + session.scene.stages[session.state.stage].duration_max
    while session.time < limit - 0.5 * session.time_step:
        run_until_time(session, min(ensemble.time + ensemble.check_interval, limit))
        if is_session_at_rest(session):
            return True
    return False


def is_session_at_rest(session: Session) -> bool:
    """Whether the stage's criterion of rest holds now."""
    stage, kinetic = session.scene.stages[session.state.stage], simulation.energy_sums(session.sim)[0, 0]
    energies = float(kinetic), float(session.ensemble.lifting_energies[0])
    return staging.is_at_rest(session.sim, 0, stage, energies)


def change_entry(session: Session, path: str, value: str) -> str:
    """Change one entry of the scene while it runs; returns what was done. Raises BadInput."""
    overrides = (*session.overrides, f"{path}={value}")
    scene = checks.read_scene(session.path, overrides, session.effect_files)
    changed = names_of_changed_fields(session.scene, scene)
    if not changed:
        return f"{path} is {value} already"
    library = checks.library_of(scene)
    before, after = session.ensemble.scenes[0], simulation.effective_scene(scene, library)
    fixed = [name for name in names_of_changed_fields(before, after) if name not in LIVE]
    if before.wind is None or after.wind is None:
        fixed += {"wind"} & {*changed, *names_of_changed_fields(before, after)}
    else:
        entries = set(names_of_changed_fields(before.wind, after.wind)) - LIVE_WIND
        fixed += [f"wind.{name}" for name in sorted(entries)]
    if fixed:
        raise BadInput(f"{fixed[0]} is fixed once a run has begun; live are {', '.join(LIVE)}")
    if session.latest_change[0] != path or monotonic() - session.latest_change[1] > SAME_CHANGE:
        keep_state_if_due(session, is_due=True)
    outcome = apply_change(session, scene, library, set(changed))
    session.scene, session.overrides, session.library = scene, overrides, library
    session.history.append(f"set {path} {quote(value)}")
    session.latest_change = path, monotonic()
    return outcome


def warnings_of_present_scene(session: Session) -> list[str]:
    return checks.setup_report(session.scene, session.effect_files)["warnings"]


def names_of_changed_fields(before: Any, after: Any) -> list[str]:
    return [name for name in type(after).model_fields if getattr(before, name) != getattr(after, name)]


def apply_change(session: Session, scene: Scene, library: Mapping[str, Effect], changed: set[str]) -> str:
    """Transfer a changed scene to the running simulation."""
    sim, effective = session.sim, simulation.effective_scene(scene, library)
    if effective.laws != simulation.effective_scene(session.scene, session.library or library).laws:
        raise BadInput("this effect changes a contact law, which is compiled in: begin the session with it")
    simulation.set_contacts(sim, 0, contact_table(effective))
    sim.setups[0] = replace(sim.setups[0], gravity=effective.gravity.vector)
    simulation.set_replica_gravity(sim, 0, sim.setups[0].gravity)
    if "wind" in changed and effective.wind is not None:
        simulation.spin_up_wind(sim, 0, effective.wind.friction_velocity)
        simulation.set_upflow(sim, 0, effective.wind.through_flow)
    state = {} if changed & {"effects", "conditions"} else None
    if state is not None:
        effects = simulation.device_effects(effective, library, float(sim.setups[0].grains.radius.max()))
        state = None if simulation.set_replica_effects(sim, 0, effects) else simulation.export_state(sim)
    if state is not None:
        sim = build_ensemble(scene, session.seed, library, session.sim.setups[0].grains).sim
        simulation.import_state(sim, state)
    # what was stated anew has done work
    states = [replace(session.state, energy=None)]
    session.ensemble = replace(session.ensemble, scenes=[effective], sim=sim, states=states)
    return "at once" if state is None else "after building the effect in"


def insert_grains(session: Session, count: int, at: Sequence[float], inlet: str) -> None:
    """Let grains of the scene in from now on, as `pour_with_inlets_open` says. Raises BadInput."""
    keep_state_if_due(session, is_due=True)
    scene, setup = session.ensemble.scenes[0], session.sim.setups[0]
    if count < 1 or setup.clumps is not None or (count > 1 and not any(setup.gravity)):
        raise BadInput("insert: one sphere or more, with gravity, without which they would not fall clear")
    sample = {"grains": scene.grains.model_copy(update={"count": count})}
    fill = {"fill": pour_with_inlets_open(scene, session.time, at, inlet, setup.grains.release_time.max())}
    new = replica_setup(scene.model_copy(update=sample | fill), session.seed + len(setup.grains.mass)).grains
    here, first = simulation.snapshot(session.sim, 0), new.release_time <= session.time
    gaps = cdist(new.position[first], here.position) - new.radius[first][:, None] - here.radius
    if gaps.min(initial=inf) < 0.0:
        raise BadInput("insert: a grain lies there already; name another place")
    state, place = simulation.export_state(session.sim), f" through {inlet}" if inlet else ""
    grains = append_grains_by_release(setup.grains, int(state["released"][0] + state["removed"][0]), new)
    place = f" at {' '.join(repr(float(x)) for x in at)}" if at else place
    sim = build_ensemble(session.scene, session.seed, session.library, grains).sim
    replace_simulation(session, sim, state, f"insert {count}{place}")


def remove_grains(session: Session, *numbers: int) -> None:
    """Take grains out by their numbers. Raises BadInput for one that is not there, and for clumps."""
    missing = set(numbers) - set(simulation.snapshot(session.sim, 0).ident.tolist())
    if missing or session.sim.world.has_clumps:
        raise BadInput(f"remove: no sphere of its own has the number {min(missing or numbers)}")
    keep_state_if_due(session, is_due=True)
    state = remove_grains_from_state(simulation.export_state(session.sim), 0, numbers)
    replace_simulation(session, session.sim, state, f"remove {' '.join(map(str, numbers))}")


def replace_simulation(session: Session, sim: Simulation, state: dict[str, Any], line: str) -> None:
    """Go on in a simulation with a state, to which a command has led that did work."""
    simulation.import_state(sim, state)
    session.ensemble = replace(session.ensemble, sim=sim, states=[replace(session.state, energy=None)])
    session.history.append(line)
    session.latest_change = "", 0.0


def measure_now(session: Session) -> dict[str, Measurement]:
    """All observables of the scene in the present state, of the frames of its stage where there are any."""
    scene, state = session.scene, session.state
    window = staging.steady_transport_window(scene, state.stage, [state])
    if not state.frames:
        state = replace(state, frames=[simulation.snapshot(session.sim, 0)], tilts=[0.0])
    inputs = staging.measure_inputs_of_replica(session.sim, scene, 0, state, window)
    measurements = {name: measure_observable(name, inputs(name)) for name in scene.measure}
    return apply_instruments(measurements, scene, session.library)


def copy_session_lists(session: Session) -> Session:
    lists = {name: list(value) for name, value in vars(session.state).items() if isinstance(value, list)}
    ensemble = replace(session.ensemble, states=[replace(session.state, **lists)])
    return replace(session, ensemble=ensemble, samples=[*session.samples], history=[*session.history])


def bytes_of_kept_states(states: Sequence[Kept]) -> int:
    return sum(values.nbytes for _, grains in states for values in grains.values())


def keep_state_if_due(session: Session, is_due: bool = False) -> None:
    """Keep the present state where one is due; those of later times, from before a return, go."""
    states, began = session.states, monotonic()
    here = session.time, revision(session)
    while states and (states[-1][0].time > here[0] or (states[-1][0].time, revision(states[-1][0])) == here):
        states.pop()
    if is_due or began >= session.keep_at:
        states.append((copy_session_lists(session), simulation.export_state(session.sim)))
        if bytes_of_kept_states(states) > KEEP_BYTES:  # those before a change stay
            pairs = enumerate(pairwise(states))
            states[:-1] = [a for k, (a, b) in pairs if k % 2 == 0 or revision(a[0]) != revision(b[0])]
        session.keep_at = began + max(KEEP_EVERY, (monotonic() - began) / KEEP_SHARE)


def revision(session: Session) -> int:
    """Number of the changes that led to the present state."""
    return sum(line.startswith(CHANGES) for line in session.history)


def return_to_time(session: Session, time: float) -> None:
    """Return to the kept state nearest to a time [s]; later ones stay until the session runs on."""
    if session.state.failure is None and (not session.states or session.states[-1][0].time < session.time):
        keep_state_if_due(session, is_due=True)
    resume_from_state(session, min(session.states, key=lambda state: abs(state[0].time - time)))


def undo_latest_change(session: Session) -> None:
    """Return to the state before the latest change, bit for bit. Raises BadInput where there is none."""
    earlier = [each for each in session.states if revision(each[0]) < revision(session)]
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
    if session.sim is then.sim:
        apply_change(session, then.scene, then.library, {"wind", "effects"})
        sim = session.sim
    else:  # an effect has been built in, or grains inserted, since
        sim = build_ensemble(then.scene, session.seed, then.library, then.sim.setups[0].grains).sim
    simulation.import_state(sim, grains)
    session.ensemble = replace(copy_session_lists(then).ensemble, sim=sim)
    session.scene, session.library, session.overrides = then.scene, then.library, then.overrides
    session.time = then.time
    session.samples[:], session.history[:] = then.samples, then.history
    session.latest_change = "", 0.0


def saved_state(session: Session, name: str) -> Kept:
    """The state that was saved under a name. Raises BadInput for an unknown name."""
    if name not in session.saved:
        near, names = did_you_mean(name, session.saved), ", ".join(session.saved) or "nothing"
        raise BadInput(f"nothing is saved as '{name}'{near}; there is {names}")
    return session.saved[name]


def session_status(session: Session) -> dict[str, float | int | str]:
    """Time, stage and totals over the grains."""
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
    sets = sum(line.startswith("set ") for line in session.history)
    begun_with = session.overrides[: len(session.overrides) - sets]
    words = [f"--set {quote(each)}" for each in begun_with]
    words += [f"--effect {file.path}" for file in session.effect_files]
    begin = " ".join(["# live", str(session.path), *words, f"--seed {session.seed} < {path.name}"])
    text = "\n".join([begin, *session.history, ""])
    refuse_foreign_file(path, session.path)
    return write_atomic(path, mark_toml(path, session.path, text))


def begin_recording(session: Session, path: Path) -> recorders.Recorder:
    """Begin a recording of the session. Raises BadInput."""
    text = scene_text_with_overrides(session.path, session.overrides)
    title = f"{session.scene.scene.title or session.path.stem}, live"
    recorder = recorders.open_recorder(path, title, text, session.sim, session.scene, 0)
    session.callbacks.append(lambda now: log_session_frame(recorder, now))
    return recorder


def unused_path(path: Path) -> Path:
    """The path, or the first of PATH-2, PATH-3 and so on that does not exist."""
    names = (path.with_name(f"{path.stem}-{number}{path.suffix}") for number in count(2))
    return next(free for free in chain([path], names) if not free.exists())


def log_session_frame(recorder: recorders.Recorder, session: Session) -> None:
    """Write a frame when one is due; after `restore` the frames of later times are written anew."""
    now = staging.count_whole_intervals(session.time, recorder.interval) + 1
    recorder.is_rewritten |= now < recorder.frames
    if now != recorder.frames:
        recorders.log_present_frame(recorder, session.sim, session.scene)
        recorder.frames = now


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
