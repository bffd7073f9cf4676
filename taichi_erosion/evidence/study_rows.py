"""Rows of a measurement table as a study needs them: its observables, its conditions, the model's units."""

from collections.abc import Sequence
from math import isfinite, nan

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.measured import Row, Table
from taichi_erosion.evidence.problem import Measurements
from taichi_erosion.evidence.study_file import ObservableEntry, StudyFile
from taichi_erosion.evidence.units import EXAMPLES, UnknownUnit, conversion, parse_unit


def gather(table: Table, file: StudyFile, name: str) -> tuple[Measurements, list[str]]:
    """Rows that the study uses, in the model's units, and what is to be said about the others."""
    for column in file.conditions:
        if column not in table.conditions:
            there = ", ".join(table.conditions) or "none"
            raise BadInput(
                f"{name}: conditions.{column} is no column of {table.file}; conditions there: {there}"
            )
    rows = [row for row in table.rows if row.observable in file.observables]
    for observable in file.observables:
        if observable not in {row.observable for row in rows}:
            there = ", ".join(dict.fromkeys(row.observable for row in table.rows))
            raise BadInput(f"{name}: observables.{observable} has no row in {table.file}; there: {there}")
    places = [table.conditions.index(column) for column in file.conditions]
    units = {name: model_unit(name, entry, rows, table.file) for name, entry in file.observables.items()}
    scales = [scale(row, units[row.observable], table.file) for row in rows]
    limits = [
        limit(row, s, file.observables[row.observable], table.file)
        for row, s in zip(rows, scales, strict=True)
    ]
    measurements = Measurements(
        observable=tuple(row.observable for row in rows),
        value=np.array([nan if r.censored else s * r.value for r, s in zip(rows, scales, strict=True)]),
        sd=np.array([s * row.sd for row, s in zip(rows, scales, strict=True)]),
        n=np.array([nan if row.n is None else float(row.n) for row in rows]),
        group=tuple(group_of(row, places) for row in rows),
        unit=tuple(units[row.observable] for row in rows),
        conditions={
            column: np.array([row.conditions[place] for row in rows])
            for column, place in zip(file.conditions, places, strict=True)
        },
        censored=np.array([row.censored for row in rows], dtype=np.bool_),
        limit=np.array(limits),
        source=tuple(row.source for row in rows),
    )
    return measurements, [*unused_notes(table, file), *unseen_notes(table, file)]


def group_of(row: Row, places: Sequence[int]) -> str:
    """Physical set-up of a row; where none is named, its conditions stand for it."""
    return row.group or ", ".join(f"{row.conditions[place]:g}" for place in places) or "all"


def model_unit(name: str, entry: ObservableEntry, rows: Sequence[Row], file: str) -> str:
    """Unit in which a model answers: what the study says, else the unit of the first row."""
    unit = entry.unit if entry.unit is not None else next(row.unit for row in rows if row.observable == name)
    try:
        parse_unit(unit)
    except UnknownUnit:
        raise BadInput(
            f"{file}: observables.{name}.unit = '{unit}' is not known; allowed: {EXAMPLES}"
        ) from None
    return unit


def scale(row: Row, unit: str, file: str) -> float:
    """Factor from a row's unit to the model's."""
    factor = conversion(parse_unit(row.unit), parse_unit(unit))
    if factor is None:
        raise BadInput(f"{file}: row {row.line}, unit = '{row.unit}': {row.observable} is counted in {unit}")
    return factor


def limit(row: Row, factor: float, entry: ObservableEntry, file: str) -> float:
    """What a censored value lies below, in the model's unit; NaN for an ordinary value."""
    if not row.censored:
        if entry.transform != "identity" and row.value <= 0.0 and not entry.floor:
            raise BadInput(
                f"{file}: row {row.line}, value = {row.value:g} must be above 0 for transform = "
                f"'{entry.transform}'; write '<' and the least value that is seen"
            )
        return nan
    if isfinite(row.value):
        return factor * row.value
    if entry.floor:
        return entry.floor
    raise BadInput(
        f"{file}: row {row.line}, value is empty: write '<' and the least value that is seen, or give "
        f"observables.{row.observable}.floor in the study"
    )


def unused_notes(table: Table, file: StudyFile) -> list[str]:
    """Observables of the table that the study does not ask for."""
    other = [row.observable for row in table.rows if row.observable not in file.observables]
    return [
        f"{name}: {other.count(name)} rows of {table.file} are not used; the study names no such observable."
        for name in dict.fromkeys(other)
    ]


def unseen_notes(table: Table, file: StudyFile) -> list[str]:
    """Conditions that vary in the table and that the model is not told."""
    rows = [row for row in table.rows if row.observable in file.observables]
    notes = []
    for place, column in enumerate(table.conditions):
        values = {row.conditions[place] for row in rows if isfinite(row.conditions[place])}
        if column not in file.conditions and len(values) > 1:
            notes.append(
                f"{column} varies in {table.file}, but is not under [conditions]: the model is not told."
            )
    return notes
