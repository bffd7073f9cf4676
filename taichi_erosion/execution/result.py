"""Result of a run: the JSON document that `run --json` prints, and that lies beside the recording.

    scene           path of the scene file
    title, hash     title and hash of the scene
    seed            of the first replica
    replicas        [{seed, measures, warnings, stopped, time, removed}]: `stopped` is null or the name of a
                    Status in small letters, `time` is simulated [s], `warnings` end with the reason of a
                    stop, `removed` [[time, number]] says how many grains have left the domain by a time
    measures        {observable: {name, value, sd, unit, n, notes, details, shortfalls}}, pooled over
                    replicas; a replica has its own, in the same form; `shortfalls` [{flag, sentence, found,
                    needed, blocks, grains}] say what the set-up lacks for the value, which says nothing where
                    one `blocks`
    measured        {observable: {value, sd, n, source}}: values of a laboratory that the scene states
    grain_steps     released grains times steps; `cell_steps` for air alone
    wall_s          wall time [s], with that of the parts before a resume
    recording       path of the recording or null; where they were made also `silhouettes` and `film`
    numerics        arch, threads, precision; `threads_mean`, the mean number at work, where threads shared
                    replicas; `time_step` for air alone
    limits          warnings, time-step limits and softening numbers (grains), as `run --check` prints them
    convention      of the surface energy (grains only)
    resolved        the scene with all defaults
    effect_digests  {effect: digest of its file}: effects that are not of this package (grains only)
    engine          what compiled the kernels: taichi or quadrants
    versions        of this package, Python and the libraries that a result depends on

Numbers are SI; NaN and infinity become null. Exit codes: `core.errors.ExitCode`.

A run of a scene replaces the recording, document, silhouettes and film of an earlier run of the same scene
under the same name. The document names its scene and the other files; a recording without a document, which
an interruption leaves, is known by the name of the program at its beginning.
"""

import json
import platform
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib.metadata import version
from math import isfinite
from pathlib import Path
from typing import Any

from taichi_erosion import __version__
from taichi_erosion.core.effect_file import failures_of, require_number
from taichi_erosion.core.engine import engine_name
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import REMEDY, require_writable, write_atomic
from taichi_erosion.execution import RunOptions
from taichi_erosion.execution.ensemble_loop import EnsembleRun, failure_message
from taichi_erosion.measures.result import Measurement, as_record, json_value, nan_to_none
from taichi_erosion.scene import Scene, resolve, scene_hash
from taichi_erosion.scene.checkpoint_file import is_checkpoint
from taichi_erosion.scene.schema.air import AirScene
from taichi_erosion.simulation.scene_setup import Library, effect_conditions, effect_params, effective_scene

RECORDINGS = Path("recordings")  # folder of results, unless the user names a file
RECORDING = ".rrd"
SUFFIXES = (RECORDING, ".json", ".png", ".gif")
HEAD = 4096  # bytes of a recording in which the name of its program stands
PROGRAM = b"taichi_erosion"


def recording_path_of_run(path: Path, scene: Scene | AirScene, seed: int, options: RunOptions) -> Path:
    """Recording of a run: as named, or after scene, hash and seed."""
    return options.record or RECORDINGS / f"{path.stem}-{scene_hash(scene)}-{seed}{RECORDING}"


def refuse_unwritable_outputs(path: Path, options: RunOptions, record: Path) -> None:
    """Raise BadInput where an output cannot be written, or would replace a file of others."""
    if not options.no_record:
        refuse_foreign_outputs(record, path, options.force)
    if saved := options.checkpoint:
        require_writable(saved)
        if saved.resolve() == path.resolve():
            raise BadInput(f"{saved}: is the scene itself; give the checkpoint another name")
        if saved.exists() and not options.force and not is_checkpoint(saved):
            raise BadInput(f"{saved}: exists, and is no checkpoint; {REMEDY}")


def refuse_foreign_outputs(record: Path, scene: Path, force: bool = False) -> None:
    """Raise BadInput where a run cannot write its files, or would replace what none of its scene wrote."""
    require_writable(record)
    if record.suffix != RECORDING:
        raise BadInput(f"{record}: is no name of a recording, which ends in {RECORDING}")
    present = [path for suffix in SUFFIXES if (path := record.with_suffix(suffix)).exists()]
    for path in present:
        require_writable(path)
    earlier = files_of_earlier_run(record, scene)
    for path in [] if force else present:
        if path.name not in earlier and not is_own_recording(path):
            raise BadInput(f"{path}: exists, and no run of {scene} wrote it; {REMEDY}")


def files_of_earlier_run(record: Path, scene: Path) -> set[str]:
    """Names of the files of an earlier run of a scene, if a document beside the recording tells of one."""
    document = record.with_suffix(".json")
    try:
        earlier = json.loads(document.read_text(encoding="utf-8"))
        is_own = Path(earlier["scene"]).name == scene.name and "taichi_erosion" in earlier["versions"]
    except (OSError, ValueError, TypeError, KeyError):
        return set()
    files = (earlier.get(kind) for kind in ("recording", "silhouettes", "film"))
    return {document.name, *(Path(file).name for file in files if file)} if is_own else set()


def is_own_recording(path: Path) -> bool:
    if path.suffix != RECORDING or not path.is_file():
        return False
    with path.open("rb") as file:
        return PROGRAM in file.read(HEAD)


def apply_instruments(
    measurements: Mapping[str, Measurement], scene: Scene, library: Library
) -> dict[str, Measurement]:
    """Instrument response: measurements after the instrument effects of the scene, in order of name."""
    read = dict(measurements)
    instruments = [library[name] for name in sorted(scene.effects) if library[name].place == "instrument"]
    conditions = effect_conditions(effective_scene(scene, library)) if instruments else {}
    for effect in instruments:
        params, strength = effect_params(scene, effect)
        if strength == 0.0:
            continue
        for name, true in read.items():
            with failures_of(effect, "act"):
                value = require_number(effect, effect.act(params, strength, conditions, name, true.value))
            if isfinite(true.value) and value != true.value:
                factor = abs(value / true.value) if true.value else 1.0
                note = f"{true.value:.6g} {true.unit} before {effect.name}"
                read[name] = replace(true, value=value, sd=true.sd * factor, notes=(*true.notes, note))
    return read


def replica_record(ensemble: EnsembleRun, replica: int) -> dict[str, Any]:
    state, sim = ensemble.states[replica], ensemble.sim
    step = int(sim.world.replicas.step[replica])
    return {
        "seed": state.seed,
        "measures": {name: as_record(m) for name, m in state.measurements.items()},
        "warnings": state.warnings + ([failure_message(state.failure, state.seed)] if state.failure else []),
        "stopped": None if state.failure is None else state.failure.status.name.lower(),
        "time": step * sim.setups[replica].time_step,
        "removed": state.removed,
    }


def run_document(
    path: Path,
    scene: Scene | AirScene,
    replicas: list[dict[str, Any]],
    pooled: Mapping[str, Measurement],
    comparisons: Mapping[str, Any],
    **entries: Any,
) -> dict[str, Any]:
    """The document of a run, with the measured values that `checks.comparable` read before it.

    `entries` are those that differ between grains and air alone.
    """
    if len(comparisons) < len(scene.measured):
        warning = f"not compared with [measured] of {path.name}: grains, apparatus, air or conditions differ"
        entries["limits"]["warnings"].append(warning)
    return {
        "scene": str(path),
        "title": scene.scene.title,
        "hash": scene_hash(scene),
        "seed": replicas[0]["seed"],
        "replicas": replicas,
        "measures": {name: as_record(measurement) for name, measurement in pooled.items()},
        "measured": comparisons,
        "recording": None,
        **entries,
        "resolved": resolve(scene),
        "engine": engine_name(),
        "versions": versions_of_dependencies(),
    }


@cache
def versions_of_dependencies() -> dict[str, str]:
    return {"taichi_erosion": __version__, "python": platform.python_version()} | {
        name: version(name) for name in (engine_name(), "numpy", "scipy", "rerun-sdk")
    }


def write_document_or_warn(record: Path, document: dict[str, Any]) -> None:
    """Write the document beside its recording as strict JSON; a refusal of the disk becomes a warning."""
    text = json.dumps(nan_to_none(document), indent=1, default=json_value, allow_nan=False)
    try:
        write_atomic(record.with_suffix(".json"), (text + "\n").encode())
    except BadInput as error:
        document["replicas"][0]["warnings"].insert(0, str(error))
