"""Values of a study's table against the physical ranges of what they set and measure."""

from collections.abc import Iterator, Sequence
from math import nan
from pathlib import Path
from typing import Any

from taichi_erosion.campaign.study_file import StudyFile
from taichi_erosion.evidence.data.physical_ranges import (
    PhysicalRange,
    condition_faults,
    observable_faults,
    place_range,
)
from taichi_erosion.evidence.data.tables.rows import Table
from taichi_erosion.evidence.models.column_units import readable_table
from taichi_erosion.evidence.models.simulator import dotted_paths


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
            allowed, own = function_range(path, table, name), nan
        yield from condition_faults(table, name, allowed, own, usual=bool(scenes))
    for name, entry in file.observables.items():
        yield from observable_faults(table, name, entry.measure or name, usual=False)


def function_range(name: str, table: Table, column: str) -> PhysicalRange | None:
    """Range of a condition of a model function whose column states a unit; None where nothing is known."""
    stated = table.units[table.conditions.index(column)]
    return place_range(f"conditions.{name}") if stated else None


def own_number(path: str, scenes: Sequence[dict[str, Any]]) -> float:
    """Number at a dotted path of the first scene that states it; NaN where none does."""
    for scene in scenes:
        found: Any = scene
        for key in path.split("."):
            found = found.get(key) if isinstance(found, dict) else None
        if isinstance(found, int | float) and not isinstance(found, bool):
            return float(found)
    return nan
