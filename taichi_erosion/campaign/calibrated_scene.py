"""Scene of a calibration with its numbers set: the settings of its confirmation runs as a file to run."""

import tomllib
from collections.abc import Sequence
from pathlib import Path

from taichi_erosion.campaign.calibration_steps import changes_of, complete_settings
from taichi_erosion.campaign.study_file import CalibrationStudy, with_entry
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import marked_toml, refuse_foreign, without_mark, write_atomic
from taichi_erosion.run.checks import read_scene
from taichi_erosion.scene import Scene, resolved, scene_hash
from taichi_erosion.scene.load import file_text, parse_scene
from taichi_erosion.scene.paths import parsed
from taichi_erosion.scene.schema.geometry import Mesh

MARK = "# Written by `doe calibrate`"  # first words of the comment that says what the scene is
SCHEMA_LINE = "#:schema"  # a relative path, which another folder breaks
DIGITS = 6  # of a calibrated number


def write_calibrated_scenes(file: CalibrationStudy, settings: dict[str, float]) -> list[Path]:
    """Write every scene of a calibration with its calibrated numbers."""
    values = complete_settings(file, settings).items()
    overrides = changes_of(file, {path: float(f"{value:.{DIGITS}g}") for path, value in values})
    return [write_calibrated_scene(file, scene, overrides) for scene in file.scenes]


def refuse_foreign_scenes(file: CalibrationStudy, force: bool) -> None:
    """Raise BadInput where a calibrated scene would replace a file of the user, or of another study."""
    for scene in file.scenes:
        refuse_foreign(calibrated_path(file, scene), file.path, force)


def calibrated_path(file: CalibrationStudy, scene: Path) -> Path:
    """Calibrated scene in the folder of the study; beside the old one where that has mesh files."""
    if any(isinstance(wall, Mesh) for wall in read_scene(scene, ()).geometry.values()):
        return scene.with_name(f"{scene.stem}_{file.path.stem}_calibrated.toml")
    return file.folder / f"{scene.stem}_calibrated.toml"


def write_calibrated_scene(file: CalibrationStudy, scene: Path, overrides: Sequence[str]) -> Path:
    """Write one scene."""
    wanted, path = read_scene(scene, tuple(overrides)), calibrated_path(file, scene)
    head = f"{MARK} {file.path.name}: {scene.name} with the numbers that its last step confirmed.\n"
    text = without_mark(calibrated_text(scene, overrides, wanted))
    return write_atomic(path, marked_toml(path, file.path, head + text))


def calibrated_text(scene: Path, overrides: Sequence[str], wanted: Scene) -> str:
    """Text of a scene with changed entries; comments stay where the result is the same scene."""
    import tomlkit

    lines = file_text(scene, str(scene)).splitlines(keepends=True)
    text = "".join(line for line in lines if not line.startswith(SCHEMA_LINE))
    try:
        for override in overrides:
            path, _, value = override.partition("=")
            text = with_entry(text, path.strip().split("."), parsed(override, value.strip()))
        again = parse_scene(tomllib.loads(text), str(scene), scene.parent)
    except BadInput:
        return tomlkit.dumps(resolved(wanted))
    return text if scene_hash(again) == scene_hash(wanted) else tomlkit.dumps(resolved(wanted))
