"""Scene of a calibration with its numbers set: the settings of its confirmation runs as a file to run."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from taichi_erosion.campaign.design_runs import complete_settings
from taichi_erosion.campaign.study_file import CalibrationStudy
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import write_atomic
from taichi_erosion.run.checks import read_scene
from taichi_erosion.scene import Scene, resolved, scene_hash
from taichi_erosion.scene.load import file_text, parse_scene
from taichi_erosion.scene.paths import apply_override
from taichi_erosion.scene.schema.geometry import Mesh

MARK = "# Written by `doe calibrate`"  # first words of a file that may be written again
SCHEMA_LINE = "#:schema"  # a relative path, which another folder breaks
DIGITS = 6  # of a calibrated number


def write_calibrated_scenes(file: CalibrationStudy, settings: Mapping[str, float]) -> list[Path]:
    """Write every scene of a calibration with its calibrated numbers; raises BadInput for a foreign file."""
    values = complete_settings(file, dict(settings))
    linked = {path: value for main, value in values.items() for path in file.study.parameters[main].also}
    numbers = {path: float(f"{value:.{DIGITS}g}") for path, value in (values | linked).items()}
    overrides = [*file.study.study.settings, *(f"{path}={value!r}" for path, value in numbers.items())]
    scenes = dict.fromkeys(file.scene(name) for name in file.study.targets)
    return [write_calibrated_scene(file, scene, overrides) for scene in scenes]


def write_calibrated_scene(file: CalibrationStudy, scene: Path, overrides: Sequence[str]) -> Path:
    """Write one scene into the folder of the study; beside the old one where that has mesh files."""
    wanted = read_scene(scene, tuple(overrides))
    path = file.folder / f"{scene.stem}_calibrated.toml"
    if any(isinstance(wall, Mesh) for wall in wanted.geometry.values()):
        path = scene.with_name(f"{scene.stem}_{file.path.stem}_calibrated.toml")
    if path.exists() and not file_text(path, str(path)).startswith(MARK):
        raise BadInput(f"{path}: exists and was not written by `doe calibrate`; move it away first")
    head = f"{MARK} {file.path.name}: {scene.name} with the numbers that its last step confirmed.\n"
    return write_atomic(path, (head + calibrated_text(scene, overrides, wanted)).encode())


def calibrated_text(scene: Path, overrides: Sequence[str], wanted: Scene) -> str:
    """Text of a scene with changed entries; comments stay where the result is the same scene."""
    import tomlkit
    from tomlkit.exceptions import TOMLKitError

    lines = file_text(scene, str(scene)).splitlines(keepends=True)
    document = tomlkit.parse("".join(line for line in lines if not line.startswith(SCHEMA_LINE)))
    try:
        for override in overrides:
            apply_override(document, override)
        text = tomlkit.dumps(document)
        again = parse_scene(tomlkit.parse(text).unwrap(), str(scene), scene.parent)
        if scene_hash(again) == scene_hash(wanted):
            return text
    except (TOMLKitError, TypeError, ValueError, BadInput):
        pass
    return tomlkit.dumps(resolved(wanted))
