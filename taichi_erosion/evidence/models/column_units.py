"""Units of the places that the columns of a study set: entries of scenes, numbers of effects."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

from taichi_erosion.campaign.study_file import StudyFile
from taichi_erosion.core.effect import STRENGTH, Effect
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.foreign_code import EffectFile
from taichi_erosion.evidence.data.transforms import effect_of
from taichi_erosion.evidence.models.simulator import condition_name, dotted_paths
from taichi_erosion.scene.load import toml_table
from taichi_erosion.scene.paths import unit_of_path


@dataclass(frozen=True)
class Declared:
    """Units that no schema has: of effects' numbers, and of the conditions that scenes declare."""

    library: Mapping[str, Effect]
    conditions: Mapping[str, str]  # name -> unit


def place_units(file: StudyFile, path: Path, effect_files: tuple[EffectFile, ...] = ()) -> dict[str, str]:
    """Unit of what every condition of a study sets; empty for a model function, which counts in SI.

    A place that no scene has is left out: the scenes of the study refuse it.
    """
    if file.study.model is not None:
        return {}
    declared = Declared(library_of(file, effect_files), declared_conditions(file, path.parent))
    found = {name: unit_of_column(paths, name, declared, path) for name, paths in file.conditions.items()}
    return {name: unit for name, unit in found.items() if unit is not None}


def library_of(file: StudyFile, effect_files: tuple[EffectFile, ...]) -> Mapping[str, Effect]:
    """Effects whose numbers a column sets; loaded where there is such a column."""
    if not any(effect_of(path) for paths in file.conditions.values() for path in dotted_paths(paths)):
        return {}
    from taichi_erosion.effects import load_library

    return load_library(effect_files)


def declared_conditions(file: StudyFile, folder: Path) -> dict[str, str]:
    """Units of the conditions under [conditions.extra] of the study's scenes."""
    found: dict[str, str] = {}
    for scene in dict.fromkeys(entry.scene for entry in file.observables.values() if entry.scene):
        conditions = readable_table(folder / scene).get("conditions")
        extra = conditions.get("extra") if isinstance(conditions, dict) else None
        for name, entry in extra.items() if isinstance(extra, dict) else ():
            if isinstance(entry, dict) and isinstance(entry.get("unit"), str):
                found[str(name)] = entry["unit"]
    return found


def readable_table(scene: Path) -> dict[str, object]:
    """Raw table of a scene; empty for one that cannot be read, whose fault the validation reports."""
    try:
        return toml_table(scene)
    except BadInput:
        return {}


def unit_of_column(paths: str, column: str, declared: Declared, study: Path) -> str | None:
    """Unit of the places that a column sets; raises BadInput where they count in several."""
    units = {path: unit_of_place(path, declared) for path in dotted_paths(paths)}
    known = {unit for unit in units.values() if unit is not None}
    if len(known) > 1:
        told = ", ".join(f"{path} in {unit}" for path, unit in units.items())
        raise BadInput(f"{study}: conditions.{column} sets places of several units: {told}")
    return next(iter(known), None)


def unit_of_place(path: str, declared: Declared) -> str | None:
    """Unit of the number at a dotted path, None where there is none."""
    name = condition_name(path)
    if name is not None and name in declared.conditions:
        return declared.conditions[name]
    effect, _, number = path.removeprefix("effects.").partition(".")
    if effect_of(path) is None or effect not in declared.library:
        return unit_of_path(path)
    units = {field.name: str(field.metadata["unit"]) for field in fields(declared.library[effect].params)}
    return "1" if number == STRENGTH else units.get(number)
