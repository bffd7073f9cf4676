"""Live sessions from Python: the simulation runs, stops and changes as the caller says."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, wraps
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any

import pandas as pd

from taichi_erosion import simulation
from taichi_erosion.api import session_entries as entries
from taichi_erosion.api.notebook import result_html, table_of_rows
from taichi_erosion.api.page import PAGES, Page, serve_page
from taichi_erosion.api.runs import PathLike, changes_as_overrides, value_as_toml
from taichi_erosion.execution import insertion
from taichi_erosion.execution import session as sessions
from taichi_erosion.execution.stages import present_grain_fields
from taichi_erosion.verification.effect_contract import examine_effect_files

if TYPE_CHECKING:
    import xarray as xr

    from taichi_erosion.report.figure_style import Figure

PAGE_HEIGHT = 760  # px, in a notebook
OPTIONS = ("seed", "effect_files")  # of a session beside its scene


@dataclass(frozen=True, repr=False)
class LiveSession:
    """One replica of a scene under the caller's control; times in s of the simulation.

    A notebook shows it as a page with its grains, sliders and curves; both steer it, one at a time.
    """

    session: sessions.Session
    turn: Lock = field(default_factory=Lock, compare=False)

    @cached_property
    def page(self) -> Page:
        """Its page, served on this machine from the first call on; `address` opens it in a browser."""
        script = sessions.unused_path(Path("recordings") / f"{self.session.path.stem}-live.txt")
        return serve_page(self.session, script, self.turn)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.session.time

    @property
    def status(self) -> Mapping[str, float | int | str]:
        """Time, stage and totals over the grains."""
        return sessions.session_status(self.session)

    @property
    def table(self) -> pd.DataFrame:
        """All measures in the present state."""
        rows = (
            {"measure": name, "value": each.value, "unit": each.unit, "notes": "; ".join(each.notes)}
            for name, each in sessions.measure_now(self.session).items()
        )
        return table_of_rows(rows).set_index("measure")

    @property
    def grains(self) -> "xr.Dataset":
        """Grains now: position [m], velocity [m s-1], spin [rad s-1], force [N], radius [m], mass [kg]."""
        from taichi_erosion.recording.export import frame_of_state, grain_table

        return grain_table([frame_of_state(simulation.snapshot(self.session.sim, 0))]).isel(time=0)

    @property
    def contacts(self) -> "xr.Dataset":
        """Contacts now: bodies, places [m], forces [N]."""
        from taichi_erosion.recording.export import contact_table

        return contact_table([simulation.contact_network(self.session.sim, 0)])

    @property
    def walls(self) -> "xr.Dataset":
        """Walls now: whether present, rotation and shift [m] since the start, force of the grains [N]."""
        from taichi_erosion.recording.export import wall_table

        sim = self.session.sim
        return wall_table(simulation.wall_poses(sim, 0), simulation.contact_network(sim, 0))

    def fields(
        self, width: float | None = None, extent: Mapping[str, float] | None = None, **at: Any
    ) -> "xr.Dataset":
        """Solid fraction, density, velocity and stress of the grains now, smoothed over a width [m].

        `x`, `y`, `z` are coordinates [m]; an axis that is left out is averaged over its period or its extent
        [m]. Without any: a line along z. Raises BadInput where an open axis has neither.
        """
        from taichi_erosion.recording.export import field_table

        return field_table([present_grain_fields(self.session.sim, 0, at, width, extent)]).isel(time=0)

    def chains(self, to: PathLike) -> Path:
        """Write a picture of the force chains from the side (PNG)."""
        from taichi_erosion.recording.export import force_chain_png, frame_of_state

        sim, walls = self.session.sim, sessions.present_wall_meshes(self.session)
        frame = frame_of_state(simulation.snapshot(sim, 0))
        picture = force_chain_png(frame, simulation.contact_network(sim, 0), walls)
        return sessions.write_file(self.session, Path(to), picture)

    def run(self, seconds: float) -> "LiveSession":
        """Run for a simulated time [s]. Raises SimulationStopped."""
        sessions.run_for_seconds(self.session, seconds)
        return self

    def run_until_rest(self) -> "LiveSession":
        """Run until the grains rest or the stage's time is over. Raises SimulationStopped."""
        sessions.run_until_rest(self.session)
        return self

    def step(self, count: int = 1) -> "LiveSession":
        """Run time steps."""
        sessions.run_session_steps(self.session, count)
        return self

    def next_stage(self) -> "LiveSession":
        """Begin the next stage of the scene. Raises BadInput after the last one."""
        sessions.begin_next_stage(self.session)
        return self

    def set(self, path: str, value: Any) -> "LiveSession":
        """Change an entry of the scene by its dotted path. Raises BadInput where it is fixed."""
        sessions.change_entry(self.session, path, value_as_toml(value))
        return self

    def insert(self, count: int, at: Sequence[float] = (), inlet: str = "") -> "LiveSession":
        """Let grains in at a place [m], through an inlet, or all inlets. Raises BadInput."""
        insertion.insert_grains(self.session, count, at, inlet)
        return self

    def remove(self, *numbers: int) -> "LiveSession":
        """Take grains out by their numbers. Raises BadInput."""
        insertion.remove_grains(self.session, *map(int, numbers))
        return self

    def get(self, path: str) -> Any:
        """Value of an entry of the scene by its dotted path, or a mapping of those below. Raises BadInput."""
        return entries.entry_value(self.session, path)

    def help(self, path: str) -> str:
        """Meaning, unit, default and range of an entry, of effects too. Raises BadInput."""
        return entries.entry_meaning(self.session, path)

    def diff(self, before: str | None = None, after: str | None = None) -> pd.DataFrame:
        """Entries that differ: from the scene file, or a saved state, to the present, or another saved state.

        Raises BadInput for an unknown state.
        """
        pairs = entries.changed_entries(self.session, before, after).items()
        rows = [{"entry": path, "before": old, "after": new} for path, (old, new) in pairs]
        return table_of_rows(rows, columns=("entry", "before", "after")).set_index("entry")

    def watch(self, *names: str) -> "LiveSession":
        """Keep measures for `samples` and `plot` from now on, beside the numbers of the status."""
        sessions.watch_measures(self.session, *names)
        return self

    @property
    def samples(self) -> pd.DataFrame:
        """Numbers of the status, and watched measures, at every check so far, by time [s]."""
        return table_of_rows(self.session.samples, columns=("time_s",)).set_index("time_s")

    def plot(self, name: str) -> "Figure":
        """Figure of a number over the simulated time. Raises BadInput before the first sample."""
        from taichi_erosion.report.figure_style import curve_figure

        return curve_figure(*sessions.sampled_curve(self.session, name), name)

    @property
    def warnings(self) -> list[str]:
        """What to know about the present strengths of effects."""
        return sessions.warnings_of_present_scene(self.session)

    def save(self, name: str) -> "LiveSession":
        """Keep the present state under a name."""
        sessions.save_state_as(self.session, name)
        return self

    def restore(self, name: str) -> "LiveSession":
        """Return to a saved state, bit for bit. Raises BadInput for an unknown name."""
        sessions.restore_saved_state(self.session, name)
        return self

    def snapshot(self, to: PathLike) -> Path:
        """Write a picture from the side (PNG)."""
        return sessions.write_side_picture(self.session, Path(to))

    def __repr__(self) -> str:
        stage = self.session.scene.stages[self.session.state.stage].name
        return f"LiveSession({self.session.path}, {self.time:.6g} s, stage {stage})"

    def _repr_html_(self) -> str:
        frame = f'<iframe src="{self.page.address}" width="100%" height="{PAGE_HEIGHT}"></iframe>'
        return frame + result_html("", [self.page.tunnel_hint], [])


def wait_for_turn(method: Callable[..., Any]) -> Callable[..., Any]:
    """A method of a live session that waits for its turn beside the page."""

    @wraps(method)
    def call_in_turn(live_session: LiveSession, *args: Any, **options: Any) -> Any:
        with live_session.turn:
            return method(live_session, *args, **options)

    return call_in_turn


for _name, _member in list(vars(LiveSession).items()):
    if isinstance(_member, property) and _member.fget:
        setattr(LiveSession, _name, property(wait_for_turn(_member.fget)))
    elif callable(_member) and not _name.startswith("_"):
        setattr(LiveSession, _name, wait_for_turn(_member))


def live(
    scene: PathLike,
    changes: Mapping[str, Any] | None = None,
    *,
    seed: int | None = None,
    effect_files: Sequence[PathLike] = (),
    **entries: Any,
) -> LiveSession:
    """A session at the beginning of the first stage of a scene, with changes as in `run`. Raises BadInput."""
    files = [Path(file) for file in effect_files]
    for page in PAGES:  # they pause before the device is given to another session
        with page.turn:
            page.playing = False
    examine_effect_files(files)
    overrides = changes_as_overrides(changes, entries, OPTIONS)
    return LiveSession(sessions.open_session(Path(scene), overrides, seed, files))
