"""Runs of scenes, and the effects that they can have, from Python."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import tomlkit

from taichi_erosion.api.notebook import progress_bar, result_html, table_of_rows
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.words.run_words import run_warnings, with_sd_text

if TYPE_CHECKING:
    import xarray as xr

PathLike = str | Path
SceneLike = PathLike | Mapping[str, Any]

# of a run beside its scene
OPTIONS = ("seed", "replicas", "threads", "precision", "arch", "decomposition", "force")


@dataclass(frozen=True, repr=False)
class Run:
    """A run of a scene: its document as `run --json` prints it, and its recording if it has one."""

    document: Mapping[str, Any]

    @property
    def recording(self) -> Path | None:
        """Recording (.rrd); None without one."""
        file = self.document.get("recording")
        return Path(file) if file else None

    @property
    def recorded(self) -> Path:
        """The recording. Raises BadInput for a run without one."""
        if self.recording is None:
            raise BadInput("the run has no recording; run it with record=True")
        return self.recording

    @property
    def table(self) -> pd.DataFrame:
        """Measures: value and standard deviation of all seeds, with units, beside measured values."""
        measured = self.document.get("measured", {})
        return table_of_rows(
            {"measure": name, **{key: measure[key] for key in ("value", "sd", "unit")}}
            | {
                "measured": measured.get(name, {}).get("value"),
                "measured_sd": measured.get(name, {}).get("sd"),
            }
            for name, measure in self.document["measures"].items()
        ).set_index("measure")

    @property
    def seeds(self) -> pd.DataFrame:
        """Measures of every seed, one a row."""
        return table_of_rows(
            {"seed": replica["seed"], "measure": name, "value": measure["value"], "unit": measure["unit"]}
            for replica in self.document["replicas"]
            for name, measure in replica.get("measures", {}).items()
        )

    @property
    def grains(self) -> "xr.Dataset":
        """Recorded grains by time and grain, NaN before release.

        Position [m], velocity [m s-1], spin [rad s-1] and force [N] also by axis; radius [m], contacts, and
        what effects keep of a grain. Grains at rest keep the state with which the bed was last written.
        Raises BadInput for a run without a recording.
        """
        from taichi_erosion.recording.export import grain_table
        from taichi_erosion.recording.readback import read_grains

        return grain_table(read_grains(self.recorded))

    @property
    def contacts(self) -> "xr.Dataset":
        """Recorded contacts, one after the other with their times: bodies, places [m], forces [N].

        Raises BadInput where none are recorded: the scene asks for them with record.contacts.
        """
        from taichi_erosion.recording.export import NO_CONTACTS, contact_table
        from taichi_erosion.recording.readback import read_contacts

        if not (networks := read_contacts(self.recorded)):
            raise BadInput(f"{self.recorded}: {NO_CONTACTS}")
        return contact_table(networks)

    @property
    def fields(self) -> "xr.Dataset":
        """Recorded profiles of solid fraction, density, velocity and stress by time and height.

        Raises BadInput where none are recorded: the scene asks for them with record.fields.
        """
        from taichi_erosion.recording.export import field_table
        from taichi_erosion.recording.readback import read_fields

        if not (profiles := read_fields(self.recorded)):
            raise BadInput(f"{self.recorded}: holds no fields; run the scene with --set record.fields=true")
        return field_table(profiles)

    def report(self, to: PathLike | None = None) -> Path:
        """Page of the run (HTML). Raises BadInput for a run without a recording."""
        from taichi_erosion.report import write_report

        return write_report(self.recorded.with_suffix(".json"), None if to is None else Path(to), True)

    @property
    def warnings(self) -> list[str]:
        """What to know about the set-up and its replicas, each sentence once."""
        return run_warnings(self.document)

    def __repr__(self) -> str:
        measures = (f"{name} {with_sd_text(m)} {m['unit']}" for name, m in self.document["measures"].items())
        return f"Run({self.document['scene']}: {', '.join(measures) or 'no measures'})"

    def _repr_html_(self) -> str:
        return result_html(self.document["title"] or self.document["scene"], self.warnings, [self.table])


def run(
    scene: SceneLike,
    changes: Mapping[str, Any] | None = None,
    record: bool | PathLike = True,
    effect_files: Sequence[PathLike] = (),
    **entries: Any,
) -> Run:
    """Simulate a scene, measure and record it.

    `changes` maps dotted paths of a scene to values, {"grains.count": 3000}. `record` is a file (.rrd), True
    for one in recordings/, or False. Further entries are the options of `./erosion run`: seed, replicas,
    threads, precision, arch, decomposition, force; a name with two underscores is a change,
    grains__count=3000.
    Raises BadInput for a wrong scene or entry, SimulationStopped where every replica fails.
    """
    from taichi_erosion.execution import RunOptions, run_scene

    options = {name: entries.pop(name) for name in OPTIONS if name in entries}
    overrides = changes_as_overrides(changes, entries, OPTIONS)
    with tempfile.TemporaryDirectory() as folder, progress_bar("running") as report:
        recording = None if isinstance(record, bool) else Path(record)
        outputs: dict[str, Any] = {"record": recording, "no_record": record is False, "progress": report}
        inputs: dict[str, Any] = {"overrides": overrides, "effect_files": tuple(map(Path, effect_files))}
        file = Path(folder) / "scene.toml" if isinstance(scene, Mapping) else Path(scene)
        if isinstance(scene, Mapping):
            file.write_text(tomlkit.dumps(scene), encoding="utf-8")
        return Run(run_scene(file, RunOptions(**inputs, **outputs, **options)))


def sweep(
    scene: PathLike,
    path: str,
    values: Sequence[Any],
    changes: Mapping[str, Any] | None = None,
    replicas: int | None = None,
    folder: PathLike = "recordings/sweep",
) -> pd.DataFrame:
    """Measures of a scene along values of one entry, each value run with the same seeds.

    A row is one measure at one value: `path`, measure, value, sd of single runs, unit, n of seeds, note.
    Runs that stand in the ledger of `folder` are not made again. Raises BadInput for what cannot run.
    """
    from taichi_erosion.campaign import sweep as sweeps

    entries = [value_as_toml(value) for value in values]
    with progress_bar("sweeping") as report:
        where = Path(folder), None, None
        overrides = changes_as_overrides(changes, {}, ())
        over = f"{path}={','.join(entries)}"
        points = sweeps.sweep_entry(Path(scene), over, overrides, replicas, where=where, progress=report)
    value_of = dict(zip(entries, values, strict=True))
    return table_of_rows({path: value_of[row.pop("entry")], **row} for row in map(asdict, points))


def changes_as_overrides(
    changes: Mapping[str, Any] | None, entries: Mapping[str, Any], options: Sequence[str]
) -> tuple[str, ...]:
    """Overrides as `--set` takes them, of keywords too. Raises BadInput for one without two underscores."""
    for name in entries:
        if "__" not in name:
            raise BadInput(f"no option '{name}'; there are {', '.join(options)}, and SECTION__ENTRY")
    settings = dict(changes or {}) | {name.replace("__", "."): value for name, value in entries.items()}
    return tuple(f"{path}={value_as_toml(value)}" for path, value in settings.items())


def value_as_toml(value: Any) -> str:
    """A value as TOML writes it, one of NumPy too. Raises BadInput."""
    try:
        return tomlkit.item(value.tolist() if hasattr(value, "tolist") else value).as_string()
    except ValueError:
        raise BadInput(f"{value!r} is no value of a scene: those are numbers, texts, lists, tables") from None


def open_run(file: PathLike) -> Run:
    """A run from its document (.json) or recording (.rrd). Raises BadInput where there is none."""
    from taichi_erosion.report.run_page import read_document

    return Run(read_document(Path(file).with_suffix(".json")))


def effects(effect_files: Sequence[PathLike] = ()) -> pd.DataFrame:
    """All effects, those of own files too: name, title, place, conditions, largest strength [1]."""
    from taichi_erosion.effect_library import load_library

    library = load_library([Path(file) for file in effect_files])
    rows = ((n, e.title, e.place, ", ".join(e.reads), e.most) for n, e in sorted(library.items()))
    names = ("effect", "title", "place", "reads", "largest_strength")
    return table_of_rows(dict(zip(names, row, strict=True)) for row in rows).set_index("effect")
