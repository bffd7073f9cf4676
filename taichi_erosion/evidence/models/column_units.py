"""Units and physical ranges of what the columns of a study set and measure."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from math import nan
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.study_file import StudyFile
from taichi_erosion.core.effect import STRENGTH, Effect
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.foreign_code import EffectFile
from taichi_erosion.evidence.data.physical_ranges import OBSERVED, column_faults, place_range
from taichi_erosion.evidence.data.tables.rows import Table
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
    scenes = dict.fromkeys(entry.scene for entry in file.observables.values() if entry.scene)
    return {name: unit for scene in scenes for name, unit in declared_units(folder / scene).items()}


def declared_units(scene: Path) -> dict[str, str]:
    """Units of the conditions under [conditions.extra] of a scene."""
    conditions = readable_table(scene).get("conditions")
    extra = conditions.get("extra") if isinstance(conditions, dict) else None
    entries = extra.items() if isinstance(extra, dict) else ()
    units = {str(name): entry.get("unit") for name, entry in entries if isinstance(entry, dict)}
    return {name: unit for name, unit in units.items() if isinstance(unit, str)}


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


def study_value_faults(table: Table, file: StudyFile, folder: Path) -> Iterator[str]:
    """Impossible values of a table, and columns whose unit seems mistaken, one line each.

    A model function may count in any unit: of its table only impossible values with a stated unit are told.
    """
    scenes = [readable_table(folder / e.scene) for e in file.observables.values() if e.scene is not None]
    for name, paths in file.conditions.items():
        if name not in table.conditions:
            continue
        path = dotted_paths(paths)[0]
        if scenes:
            allowed, own = place_range(path), own_number(path, scenes)
        else:
            stated = table.units[table.conditions.index(name)]
            allowed, own = place_range(f"conditions.{path}") if stated else None, nan
        yield from column_faults(table, name, allowed, own, usual=bool(scenes))
    for name, entry in file.observables.items():
        yield from column_faults(table, name, OBSERVED.get(entry.measure or name), usual=False)


def own_number(path: str, scenes: Sequence[dict[str, Any]]) -> float:
    """Number at a dotted path of the first scene that states it; NaN where none does."""
    for scene in scenes:
        found: Any = scene
        for key in path.split("."):
            found = found.get(key) if isinstance(found, dict) else None
        if isinstance(found, int | float) and not isinstance(found, bool):
            return float(found)
    return nan
