"""Columns of tables as a study takes them: units and ranges of what they set; tables of new conditions."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

import numpy as np

from taichi_erosion.campaign.study_file import StudyFile, value_at_keys
from taichi_erosion.core.effect import STRENGTH, Effect
from taichi_erosion.core.effect_file import EffectFile
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name
from taichi_erosion.evidence.data.measured import column_options, condition_scales, value_faults
from taichi_erosion.evidence.data.problem import Conditions, Measurements
from taichi_erosion.evidence.data.table_units import DAY
from taichi_erosion.evidence.data.tables.column_roles import Column, Interview
from taichi_erosion.evidence.data.tables.interview import understand_columns
from taichi_erosion.evidence.data.tables.rows import Faults, Row, RowReader, Table
from taichi_erosion.evidence.data.transforms import effect_of_path
from taichi_erosion.evidence.models.simulator import condition_name_of_dotted_path, dotted_paths
from taichi_erosion.scene.load import read_toml
from taichi_erosion.scene.paths import unit_at_path
from taichi_erosion.scene.physical_ranges import OBSERVED, range_at
from taichi_erosion.scene.schema.units import Scale, conversion_factor, parse_scale
from taichi_erosion.tables.cell_numbers import DATE, is_missing
from taichi_erosion.tables.spreadsheet import Cells, read_table_cells

OBSERVABLE = "observable"  # heading of a column that says what is to be predicted; without it: everything


def condition_units(file: StudyFile, path: Path, effect_files: tuple[EffectFile, ...] = ()) -> dict[str, str]:
    """Unit of what every condition of a study sets; empty for a model function, which counts in SI.

    A place that no scene has is left out: the scenes of the study refuse it. Raises BadInput where the places
    of a column count in several units.
    """
    if file.study.model is not None:
        return {}
    columns = {name: dotted_paths(paths) for name, paths in file.conditions.items()}
    declared, library = declared_units_of_study(file, path.parent), dict[str, Effect]()
    if any(effect_of_path(each) for paths in columns.values() for each in paths):
        from taichi_erosion.effect_library import load_library

        library |= load_library(effect_files)
    units_of: dict[str, str] = {}
    for name, paths in columns.items():
        units = {each: unit_at_dotted_path(each, library, declared) for each in paths}
        names = {unit for unit in units.values() if unit is not None}
        if len(names) > 1:
            message = ", ".join(f"{each} in {unit}" for each, unit in units.items())
            raise BadInput(f"{path}: conditions.{name} sets places of several units: {message}")
        if names:
            units_of[name] = names.pop()
    return units_of


def unit_at_dotted_path(path: str, library: Mapping[str, Effect], declared: Mapping[str, str]) -> str | None:
    """Unit of the number at a dotted path, None where there is none."""
    name = condition_name_of_dotted_path(path)
    if name is not None and name in declared:
        return declared[name]
    effect, _, number = path.removeprefix("effects.").partition(".")
    if effect_of_path(path) is None or effect not in library:
        return unit_at_path(path)
    units = {field.name: str(field.metadata["unit"]) for field in fields(library[effect].params)}
    return "1" if number == STRENGTH else units.get(number)


def declared_units_of_study(file: StudyFile, folder: Path) -> dict[str, str]:
    """Units of the conditions under [conditions.extra] of the study's scenes."""
    scenes = dict.fromkeys(entry.scene for entry in file.observables.values() if entry.scene)
    return {name: unit for scene in scenes for name, unit in declared_units(folder / scene).items()}


def declared_units(scene: Path) -> dict[str, str]:
    """Units of the conditions under [conditions.extra] of a scene."""
    extra = value_at_keys(raw_scene_table(scene), ("conditions", "extra"))
    entries = extra.items() if isinstance(extra, dict) else ()
    units = {str(name): value_at_keys(entry, ("unit",)) for name, entry in entries}
    return {name: unit for name, unit in units.items() if isinstance(unit, str)}


def raw_scene_table(scene: Path) -> dict[str, object]:
    """Raw table of a scene; empty for one that cannot be read, whose fault the validation reports."""
    try:
        return read_toml(scene)
    except BadInput:
        return {}


def impossible_study_values(table: Table, file: StudyFile, folder: Path) -> Iterator[str]:
    """Impossible values of a table, and columns whose unit seems mistaken, one line each.

    A model function may count in any unit: of its table only impossible values with a stated unit are told.
    """
    scenes = [raw_scene_table(folder / e.scene) for e in file.observables.values() if e.scene is not None]
    for name, paths in file.conditions.items():
        if name not in table.conditions:
            continue
        path, unit = dotted_paths(paths)[0], table.units[table.conditions.index(name)]
        values = (value_at_keys(scene, path.split(".")) for scene in scenes)
        value = next((float(n) for n in values if type(n) in (int, float)), 0.0)
        place = path if scenes else f"conditions.{path}"
        allowed = range_at(place) if scenes or unit else None
        yield from value_faults(table, name, allowed, value, usual=bool(scenes))
        factor = 1.0 if scenes or not allowed else parse_scale(allowed.unit).factor  # a function counts in SI
        for end in file.laboratory.ranges.get(name, ()):
            if allowed and not allowed.is_possible(end / factor):
                counts = f"{end:g}" + f" in SI, {end / factor:.4g} {allowed.unit}," * (factor != 1.0)
                span = f"[{allowed.low:g}, {allowed.high:g}] {allowed.unit}"
                yield f"laboratory.ranges.{name}: {counts} is outside {span}"
    for name, entry in file.observables.items():
        yield from value_faults(table, name, OBSERVED.get(entry.measure or name), usual=False)


@dataclass(frozen=True)
class NewConditions:
    """Rows at which the model is asked, one for each observable wanted, and the table that they come from."""

    observable: tuple[str, ...]
    conditions: Conditions  # as the model takes them
    group: tuple[str, ...] = ()  # set-up, soil or batch of each, empty where it is none that was measured
    lines: tuple[int, ...] = ()  # rows of the file
    table_values: tuple[Mapping[str, float], ...] = ()  # the conditions in the units of the table
    scales: Mapping[str, Scale] = field(default_factory=dict)  # of these, as the model takes them
    file: str = ""
    constant: Mapping[str, float] = field(default_factory=dict)  # not set by the table: as in the study


def read_new_conditions(
    path: Path, file: StudyFile, places: Mapping[str, str], measured: Measurements, folder: Path
) -> NewConditions:
    """Conditions of a table in the units of use; raises BadInput with all its faults.

    `places` are the units of what the conditions set, `measured` the rows of the study: a column without a
    unit is in the unit of the study's own table. `folder`: of the study. Impossible values are refused.
    """
    faults = Faults()
    cells = read_table_cells(path, one_line_name(path), faults)
    if not cells.rows or not cells.lines:
        raise BadInput(f"{path}: holds no conditions; the first row names the columns, the others set them")
    columns, groups = columns_setting_conditions(cells, file, measured, faults)
    table = condition_rows(cells, columns, faults)
    chosen = file.model_copy(update={"conditions": {name: file.conditions[name] for name in columns}})
    scales = faults.of(condition_scales, table, chosen, places) or {}
    faults += impossible_study_values(table, chosen, folder)
    absent = [name for name in file.conditions if name not in columns]
    constant = {name: faults.of(only_value_of_condition, cells, name, measured) for name in absent}
    queries = faults.of(rows_and_observables_wanted, cells, list(file.observables)) or []
    faults.raise_if_any()
    rows, reader = [row for row, _ in queries], RowReader(cells, groups, faults)
    texts = [dict(zip(columns, table.rows[row].conditions, strict=True)) for row in rows]
    values: Conditions = {name: np.array([scales[name].to_use(at[name]) for at in texts]) for name in columns}
    values |= {name: np.full(len(queries), value) for name, value in constant.items()}
    return NewConditions(
        tuple(name for _, name in queries),
        {str(name): values[name] for name in file.conditions},
        tuple(reader.text(cells.lines[row][1], "group") for row in rows),
        tuple(cells.lines[row][0] for row in rows),
        tuple(texts),
        {name: replace(scales[name], unit=scales[name].unit or places.get(name, "")) for name in columns},
        str(path),
        {name: value for name, value in constant.items() if value is not None and np.isfinite(value)},
    )


def columns_setting_conditions(
    cells: Cells, file: StudyFile, measured: Measurements, faults: Faults
) -> tuple[dict[str, Column], list[Column]]:
    """Columns that set conditions of the study, by its names, and of groups; raises BadInput with all faults.

    One without a unit has that of the study's table.
    """
    readable = understand_columns(cells, column_options(file), Interview(), faults, measured=False)
    columns = {c.title: c for c in readable if c.role == "condition" and c.title in file.conditions}
    kinds = ("condition",) if faults else ("condition", "remark")  # a column with a fault is a remark too
    there = ", ".join(file.conditions)
    faults += [
        f"{cells.file}: {c.heading.text} is no condition of the study, which has {there}; leave it out"
        for c in readable
        if c.role in kinds
        and c.title not in columns
        and (c.role == "condition" or (c.numeric and c.heading.unit))
    ]
    for name, column in columns.items():
        usual, unit = measured.table_units.conditions.get(name, Scale()).unit, column.heading.unit
        if unit and usual and conversion_factor(parse_scale(unit), parse_scale(usual)) is None:
            faults.append(f"{cells.file}: {name} is in {unit}, in the table of the study in {usual}")
        columns[name] = replace(column, heading=replace(column.heading, unit=unit or usual))
    faults.raise_if_any()
    return columns, [column for column in readable if column.role == "group"]


def condition_rows(cells: Cells, columns: Mapping[str, Column], faults: Faults) -> Table:
    """Rows of conditions alone; cells that hold no number are added to `faults`."""
    reader = RowReader(cells, list(columns.values()), faults)
    rows = []
    for line, row in cells.lines:
        numbers = tuple(reader.read_number(line, row, column).value for column in columns.values())
        for column in (each for each in columns.values() if is_missing(row[each.place])):
            reader.add_fault(line, column, row, "is empty")
        rows.append(Row(line, "", np.nan, False, np.nan, None, "1", "", "", numbers))
    faults += reader.cell_faults()
    units = tuple(column.heading.unit or None for column in columns.values())
    return Table(cells.file, tuple(columns), units, tuple(rows))


def only_value_of_condition(cells: Cells, name: str, measurements: Measurements) -> float:
    """The study's only value of a condition that the table leaves out, or its last day; raises BadInput."""
    if name == DAY and any(DATE.fullmatch(cell) for _, row in cells.lines for cell in row):
        words = f"write '{DAY}', the days since the first date of the study, or leave it out for its last day"
        raise BadInput(f"{cells.file}: a column of dates sets nothing here: {words}")
    column = measurements.conditions[name]
    values = np.unique(column[np.isfinite(column)])
    if values.size > 1 and name != DAY:
        span = " to ".join(measurements.table_units.condition_text(name, float(values[k])) for k in (0, -1))
        raise BadInput(f"{cells.file}: no column sets {name}, which the study varies from {span}; add it")
    return float(values[-1]) if values.size else np.nan


def rows_and_observables_wanted(cells: Cells, observables: Sequence[str]) -> list[tuple[int, str]]:
    """Row and observable of every prediction; raises BadInput for an observable that the study has not."""
    queries: list[tuple[int, str]] = []
    headings = [text.strip().lower() for text in cells.heading]
    place = headings.index(OBSERVABLE) if OBSERVABLE in headings else None
    for index, (line, row) in enumerate(cells.lines):
        if place is None or not row[place]:
            queries += [(index, name) for name in observables]
        elif row[place] in observables:
            queries.append((index, row[place]))
        else:
            there = ", ".join(observables)
            raise BadInput(f"{cells.file}: row {line}, observable = '{row[place]}'; the study has {there}")
    return queries
