"""A session: a scene played by hand, with parameters changed on the way.

    from taichi_erosion.run.session import measure_now, open_session, run_for, set_entry

    session = open_session("scenes/funnel_repose.toml")
    run_for(session, 0.5)
    set_entry(session, "contact.soil-soil.friction_rolling", "0.3")
    run_for(session, 0.5)
    print(measure_now(session))

Contact parameters, gravity, wind and the strength of effects that the session began with change at once, with
nothing compiled anew; an effect that was not there is built in, which takes seconds.

What a session shows: pictures of its grains, a recording that grows, numbers in one line.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Effect
from taichi_erosion.core.errors import BadInput, SimulationStopped
from taichi_erosion.core.setup import Motion, Numerics
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.effects import load_library
from taichi_erosion.measures.result import Measurement
from taichi_erosion.recording import pictures, stream
from taichi_erosion.recording.pictures import SideView, write_png
from taichi_erosion.run.checks import read_scene
from taichi_erosion.run.observables import Evidence, measure
from taichi_erosion.run.recorder import (
    RESTING_SHARE,
    Image,
    Scenery,
    apparatus_box,
    log_scenery,
    log_transport,
    scenery_of,
    standing,
)
from taichi_erosion.run.scene_run import scene_text
from taichi_erosion.run.stages import sentence
from taichi_erosion.scene import Scene, laws
from taichi_erosion.scene.build.contacts import contact_table
from taichi_erosion.scene.schema.fields import unit_vector
from taichi_erosion.scene.schema.scene import Stage
from taichi_erosion.simulation import (
    Simulation,
    advance,
    assemble,
    device_effects,
    effective_scene,
    energies,
    export_state,
    failure,
    import_state,
    ledger,
    move_surface,
    prepare,
    remove_surface,
    set_contacts,
    set_effects,
    set_gravity,
    set_through_flow,
    share_touching,
    snapshot,
    spin_up_wind,
)

WITHOUT_EFFECT = ("measured", "record", "measure")  # sections that the running grains do not feel
LIVE = ("contact", "gravity", "wind", "effects", "conditions", *WITHOUT_EFFECT)
LIVE_WIND = {"friction_velocity", "through_flow"}  # entries of the wind that may change
Watch = Callable[["Session"], None]


@dataclass
class Session:
    """One replica and everything that was done to it."""

    path: Path
    scene: Scene  # as changed so far
    overrides: tuple[str, ...]
    seed: int
    library: Mapping[str, Effect]
    sim: Simulation
    time: float = 0.0  # s
    stage: int = 0
    history: list[str] = field(default_factory=list)
    saved: dict[str, tuple[dict[str, Any], float, int, tuple[str, ...]]] = field(default_factory=dict)
    watchers: list[Watch] = field(default_factory=list)

    @property
    def time_step(self) -> float:
        """Time step [s]."""
        return self.sim.setups[0].time_step


def open_session(path: str | Path, overrides: tuple[str, ...] = (), seed: int | None = None) -> Session:
    """Load a scene and put one replica of it on the device, before its first stage. Raises BadInput."""
    scene = read_scene(Path(path), overrides)
    library = load_library() if scene.effects else {}
    chosen = scene.run.seed if seed is None else seed
    sim = build(scene, chosen, library)
    session = Session(Path(path), scene, overrides, chosen, library, sim)
    begin(session, scene.stages[0])
    return session


def build(scene: Scene, seed: int, library: Mapping[str, Effect]) -> Simulation:
    """A simulation of one replica."""
    numerics = Numerics(precision=scene.run.precision)
    return assemble([prepare(scene, seed, library)], laws(effective_scene(scene, library)), numerics)


def begin(session: Session, stage: Stage) -> None:
    """Do what a stage does at its beginning."""
    for name in stage.remove:
        remove_surface(session.sim, 0, name)
    for name, order in stage.move.items():
        move_surface(session.sim, 0, name, Motion(order.velocity, order.spin, order.centre))
    if stage.friction_velocity is not None:
        spin_up_wind(session.sim, 0, stage.friction_velocity)
    if stage.through_flow is not None:
        set_through_flow(session.sim, 0, stage.through_flow)


def next_stage(session: Session) -> str:
    """Begin the next stage of the scene; returns its name. Raises BadInput after the last one."""
    if session.stage + 1 == len(session.scene.stages):
        raise BadInput(f"stage '{session.scene.stages[session.stage].name}' is the last one")
    session.stage += 1
    begin(session, session.scene.stages[session.stage])
    return session.scene.stages[session.stage].name


def run_to(session: Session, time: float) -> None:
    """Run until a time [s]; watchers see every check interval. Raises SimulationStopped."""
    interval = session.scene.run.check_interval
    while session.time < time - 0.5 * session.time_step:
        session.time = min(session.time + interval, time)
        advance(session.sim, [session.time])
        stopped = failure(session.sim, 0)
        if stopped is not None:
            raise SimulationStopped(sentence(stopped, session.seed))
        for watch in session.watchers:
            watch(session)


def run_for(session: Session, seconds: float) -> None:
    """Run on for some simulated time [s]."""
    run_to(session, session.time + seconds)


def step(session: Session, count: int = 1) -> None:
    """Run a number of time steps."""
    run_to(session, session.time + count * session.time_step)


def run_until_rest(session: Session) -> bool:
    """Run until the stage's criterion of rest holds or its time limit is over; returns whether it rests."""
    stage = session.scene.stages[session.stage]
    limit = session.time + stage.duration_max
    while session.time < limit - 0.5 * session.time_step:
        run_for(session, session.scene.run.check_interval)
        if at_rest(session, stage):
            return True
    return False


def at_rest(session: Session, stage: Stage) -> bool:
    """Whether all grains are released, slow, and in contact."""
    setup = session.sim.setups[0]
    sums = energies(session.sim)[0]
    g = sum(c * c for c in setup.gravity) ** 0.5
    scale = float((setup.grains.mass * 2.0 * setup.grains.radius).sum()) * g
    calm = sums[5] == len(setup.grains.radius) and sums[0] <= stage.rest_energy * scale
    return bool(calm and share_touching(session.sim, 0) >= stage.rest_contact_share)


def set_entry(session: Session, path: str, value: str) -> str:
    """Change one entry of the scene while it runs; returns what was done. Raises BadInput."""
    overrides = (*session.overrides, f"{path}={value}")
    scene = read_scene(session.path, overrides)
    changed = [
        name for name in type(scene).model_fields if getattr(scene, name) != getattr(session.scene, name)
    ]
    refuse_fixed(session.scene, scene, changed)
    library = session.library or (load_library() if scene.effects else {})
    done = apply_change(session, scene, library, set(changed))
    session.scene, session.overrides, session.library = scene, overrides, library
    return done if changed else f"{path} is {value} already"


def refuse_fixed(before: Scene, after: Scene, changed: list[str]) -> None:
    """Raise BadInput where a change needs a new run."""
    fixed = [name for name in changed if name not in LIVE]
    if "wind" in changed:
        if before.wind is None or after.wind is None:
            fixed.append("wind")
        else:
            entries = type(after.wind).model_fields
            moved = {name for name in entries if getattr(before.wind, name) != getattr(after.wind, name)}
            fixed += [f"wind.{name}" for name in sorted(moved - LIVE_WIND)]
    if fixed:
        raise BadInput(f"{fixed[0]} is fixed once a run has begun; live are {', '.join(LIVE)}")


def apply_change(session: Session, scene: Scene, library: Mapping[str, Effect], changed: set[str]) -> str:
    """Carry a changed scene over to the running simulation."""
    sim, built = session.sim, effective_scene(scene, library)
    if built.laws != effective_scene(session.scene, session.library or library).laws:
        raise BadInput("this effect changes a contact law, which is compiled in: begin the session with it")
    set_contacts(sim, 0, contact_table(built))
    x, y, z = unit_vector(built.gravity.direction)
    g = built.gravity.magnitude
    set_gravity(sim, 0, (g * x, g * y, g * z))
    if "wind" in changed and scene.wind is not None:
        spin_up_wind(sim, 0, scene.wind.friction_velocity)
        set_through_flow(sim, 0, scene.wind.through_flow)
    if not changed & {"effects", "conditions"}:
        return "at once"
    effects = device_effects(scene, library, float(sim.setups[0].grains.radius.max()))
    if set_effects(sim, 0, effects):
        return "at once"
    rebuild(session, scene, library)
    return "after building the effect in"


def rebuild(session: Session, scene: Scene, library: Mapping[str, Effect]) -> None:
    """Assemble anew with other effects and carry the state over."""
    state = export_state(session.sim)
    session.sim = build(scene, session.seed, library)
    import_state(session.sim, state)


def measure_now(session: Session) -> dict[str, Measurement]:
    """All observables of the scene, read from the grains as they are."""
    end: Snapshot = snapshot(session.sim, 0)
    found = {}
    for name, order in session.scene.measure.items():
        found[name] = measure(name, Evidence(session.scene, order, end, (end,), (0.0,)))
    return found


def save(session: Session, name: str) -> None:
    """Keep the state under a name."""
    session.saved[name] = (export_state(session.sim), session.time, session.stage, session.overrides)


def back(session: Session, name: str) -> None:
    """Return to a saved state, parameters included. Raises BadInput for an unknown name."""
    if name not in session.saved:
        raise BadInput(f"nothing is saved as '{name}'; there is {', '.join(session.saved) or 'nothing'}")
    state, session.time, session.stage, session.overrides = session.saved[name]
    session.scene = read_scene(session.path, session.overrides)
    session.sim = build(session.scene, session.seed, session.library)
    import_state(session.sim, state)


MARGIN = 0.01  # m, half the width of a window without grains
WINDOW = (480, 240)  # px: a line of a terminal is twice as high as a character is wide
ROUNDING = 1e-9  # of an interval: a moment that lies on it counts as reached [1]


def resting_speed(session: Session) -> float:
    """Speed below which a grain is drawn as resting [m s-1]."""
    setup = session.sim.setups[0]
    diameter = 2.0 * float(np.median(setup.grains.radius))
    return RESTING_SHARE * float(np.sqrt(np.linalg.norm(setup.gravity) * diameter))


def side_picture(session: Session, is_lettered: bool) -> Image:
    """The grains seen from the side, with time and scale if they can be read."""
    box = apparatus_box(session.sim.setups[0])
    walls = standing(scenery_of(session.scene, session.sim.setups[0], box), session.sim, 0)
    speeds, state = (resting_speed(session), stream.FASTEST_COLOUR), snapshot(session.sim, 0)
    if is_lettered:
        view = SideView((box[0][0], box[0][2]), (box[1][0], box[1][2]))
        return pictures.film_frame(state, view, walls, speeds)
    return pictures.side_picture(state, close_view(state), walls, speeds)


def close_view(state: Snapshot) -> SideView:
    """Window around the grains alone, for pictures of few pixels; without grains a small one."""
    if not len(state.position):
        return SideView((-MARGIN, 0.0), (MARGIN, MARGIN), WINDOW)
    places, margin = state.position[:, [0, 2]], 4.0 * float(state.radius.max())
    low, high = places.min(axis=0) - margin, places.max(axis=0) + margin
    floor = float(places[:, 1].min() - state.radius.max())
    return SideView((float(low[0]), floor), (float(high[0]), float(high[1])), WINDOW)


def write_picture(session: Session, path: Path) -> Path:
    """Write the side picture as PNG."""
    return write_png(path, side_picture(session, is_lettered=True))


def numbers(session: Session) -> dict[str, float | int | str]:
    """Where the session stands."""
    sums = ledger(session.sim, 0)
    return {
        "time_s": round(session.time, 9),
        "stage": session.scene.stages[session.stage].name,
        "released": sums.released,
        "contacts": sums.contacts,
        "kinetic_J": sums.kinetic_translation + sums.kinetic_rotation,
        "speed_largest_m_s": sums.speed_largest,
        "overlap_largest": sums.overlap_largest,
    }


@dataclass
class Film:
    """The recording of a session."""

    recording: stream.Recording
    scenery: Scenery
    interval: float  # s
    shots: int = 0


def open_film(session: Session, path: Path, viewer: str | None = None) -> Film:
    """Begin a recording that a rerun viewer may follow; the session logs to it from now on."""
    scene, setup = session.scene, session.sim.setups[0]
    scenery = scenery_of(scene, setup, apparatus_box(setup))
    text = scene_text(session.path, session.overrides)
    name = f"{scene.scene.title or session.path.stem}, live"
    header = stream.RunHeader(path.stem, name, scene.scene.kind, text, setup.grains.radius, scenery.walls)
    film = Film(stream.open_recording(path, header, viewer), scenery, scene.record.every)
    session.watchers.append(lambda now: shoot(film, now))
    return film


def shoot(film: Film, session: Session) -> None:
    """Log a frame when one is due; a session that went back writes its later frames anew."""
    due = film.shots * film.interval * (1.0 - ROUNDING)
    went_back = session.time < due - film.interval
    film.scenery.is_rewritten |= went_back
    if session.time >= due or went_back:
        state = snapshot(session.sim, 0)
        stream.log_frame(film.recording, state, resting_speed(session))
        stream.log_ledger(film.recording, ledger(session.sim, 0))
        log_scenery(film.recording, film.scenery, session.sim, 0)
        log_transport(film.recording, session.scene, session.sim, 0, state)
        film.shots = int(session.time / film.interval * (1.0 + ROUNDING)) + 1
