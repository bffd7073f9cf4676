"""Table of new conditions: read as a laboratory's table is, in the user's units."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from taichi_erosion.campaign.study_file import StudyFile
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import one_line_name
from taichi_erosion.evidence.data.measured import (
    condition_scales,
    named_by_study,
    settled_columns,
    study_name,
)
from taichi_erosion.evidence.data.problem import Conditions, Floats, Measurements
from taichi_erosion.evidence.data.tables.column_roles import Column, column_roles
from taichi_erosion.evidence.data.tables.laboratory_table import Choices, LaboratoryTable
from taichi_erosion.evidence.data.tables.spreadsheet import Cells, read_cells
from taichi_erosion.evidence.data.tables.tidy_table import Table
from taichi_erosion.scene.schema.units import Scale, conversion, parse_scale

OBSERVABLE = "observable"  # heading of a column that says what is to be predicted; without it: everything


@dataclass(frozen=True)
class NewConditions:
    """Rows at which the model is asked, one for each observable wanted, and the table that they come from."""

    observable: tuple[str, ...]
    conditions: Conditions  # as the model takes them
    lines: tuple[int, ...] = ()  # rows of the file
    written: tuple[Mapping[str, float], ...] = ()  # the conditions in the units of the table
    scales: Mapping[str, Scale] = field(default_factory=dict)  # of `written`, as the model takes them
    file: str = ""
    constant: Mapping[str, float] = field(default_factory=dict)  # not set by the table: as in the study


def read_new_conditions(
    path: Path, file: StudyFile, places: Mapping[str, str], known: Measurements
) -> NewConditions:
    """Conditions of a table in the units of use; raises BadInput with all its faults.

    `places` are the units of what the conditions set, `known` the measurements of the study: a column without
    a unit is in the unit of the study's own table.
    """
    faults: list[str] = []
    cells = read_cells(path, one_line_name(path), faults)
    if not cells.rows or not cells.lines:
        raise BadInput(f"{path}: holds no conditions; the first row names the columns, the others set them")
    columns = condition_columns(cells, file, faults)
    scales = scales_of(cells, columns, file, places, known)
    numbers = condition_numbers(cells, columns)
    constant = {name: constant_value(cells, name, known) for name in file.conditions if name not in columns}
    wanted = list(wanted_rows(cells, list(file.observables)))
    used = {name: np.array([scales[name].used(numbers[name][row]) for row, _ in wanted]) for name in columns}
    used |= {name: np.full(len(wanted), value) for name, value in constant.items()}
    written = tuple({name: float(numbers[name][row]) for name in columns} for row, _ in wanted)
    return NewConditions(
        tuple(name for _, name in wanted),
        {name: used[name] for name in file.conditions},
        tuple(cells.lines[row][0] for row, _ in wanted),
        written,
        {name: replace(scales[name], unit=scales[name].unit or places.get(name, "")) for name in columns},
        str(path),
        {name: value for name, value in constant.items() if np.isfinite(value)},
    )


def condition_columns(cells: Cells, file: StudyFile, faults: list[str]) -> dict[str, Column]:
    """Columns that set conditions of the study, by its names; raises BadInput with `faults` and their own.

    A heading that nearly says a condition is one.
    """
    found: dict[str, Column] = {}
    columns = column_roles(cells, named_by_study(cells, file), faults)
    columns = list(settled_columns(columns, file, cells, faults, []))
    if faults:
        raise BadInput(*faults)
    for column in columns:
        name = study_name(column.name, column.heading.name, file) if column.role == "condition" else ""
        if name in found:
            raise BadInput(f"{cells.file}: '{column.heading.text}' sets {name}, as another column does")
        if name in file.conditions:
            found[name] = column
    return found


def scales_of(
    cells: Cells,
    columns: Mapping[str, Column],
    file: StudyFile,
    places: Mapping[str, str],
    known: Measurements,
) -> dict[str, Scale]:
    """Scale of every column: by its own unit, else by that of the study's table; raises BadInput."""
    table = LaboratoryTable(cells, list(columns.values()), Choices())
    names = [name for name in file.conditions if name in columns]
    usual = {name: known.table_units.conditions.get(name, Scale()).unit for name in names}
    units = [table.cell_unit(columns[name]) or usual[name] or None for name in names]
    for name, unit in zip(names, units, strict=True):
        if unit and usual[name] and conversion(parse_scale(unit), parse_scale(usual[name])) is None:
            raise BadInput(f"{cells.file}: {name} is in {unit}, in the table of the study in {usual[name]}")
    stated = Table(cells.file, tuple(names), tuple(units), ())
    chosen = file.model_copy(update={"conditions": {name: file.conditions[name] for name in names}})
    return condition_scales(stated, chosen, places)


def condition_numbers(cells: Cells, columns: Mapping[str, Column]) -> dict[str, Floats]:
    """Numbers of the columns as written; raises BadInput with every cell that is none."""
    table, faults = LaboratoryTable(cells, list(columns.values()), Choices()), list[str]()
    found: dict[str, Floats] = {}
    for name, column in columns.items():
        texts = [table.condition(line, row, column, faults) for line, row in cells.lines]
        empty = [line for (line, row), text in zip(cells.lines, texts, strict=True) if not row[column.place]]
        faults += [f"{cells.file}: row {line}, {column.heading.text} is empty" for line in empty]
        found[name] = np.array([float(text) if text else np.nan for text in texts])
    if faults:
        raise BadInput(*faults)
    return found


def constant_value(cells: Cells, name: str, known: Measurements) -> float:
    """The study's only value of a condition that the table leaves out; raises BadInput for several."""
    column = known.conditions[name]
    values = np.unique(column[np.isfinite(column)])
    if values.size > 1:
        span = " to ".join(known.table_units.condition_text(name, float(values[k])) for k in (0, -1))
        raise BadInput(f"{cells.file}: no column sets {name}, which the study varies from {span}; add it")
    return float(values[0]) if values.size else np.nan


def wanted_rows(cells: Cells, observables: Sequence[str]) -> Iterator[tuple[int, str]]:
    """Row and observable of every prediction; raises BadInput for an observable that the study has not."""
    headings = [text.strip().lower() for text in cells.heading]
    place = headings.index(OBSERVABLE) if OBSERVABLE in headings else None
    for index, (line, row) in enumerate(cells.lines):
        if place is None or not row[place]:
            yield from ((index, name) for name in observables)
        elif row[place] in observables:
            yield index, row[place]
        else:
            there = ", ".join(observables)
            raise BadInput(f"{cells.file}: row {line}, observable = '{row[place]}'; the study has {there}")
