"""Measurements of a study: rows of its table in the units of the model, sentences about others, faults."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from itertools import pairwise
from math import inf, isfinite, isnan, nan
from pathlib import Path
from shlex import quote

import numpy as np

from taichi_erosion.campaign.study_file import ObservableEntry, StudyFile
from taichi_erosion.core.errors import BadInput, did_you_mean
from taichi_erosion.core.files import one_line_name
from taichi_erosion.evidence.data.problem import Measurements
from taichi_erosion.evidence.data.table_units import DAY, TableUnits
from taichi_erosion.evidence.data.tables.column_roles import AGREED, NOTE, Column, Interview, TableOptions
from taichi_erosion.evidence.data.tables.interview import understand_columns
from taichi_erosion.evidence.data.tables.rows import (
    PLACE,
    SOLO_ROWS,
    STANDARD_ERROR,
    Faults,
    Row,
    Table,
    cell_text,
    row_list_text,
    table_from_cells,
    tidy_columns,
)
from taichi_erosion.scene.physical_ranges import PhysicalRange, plausible_units, range_scale
from taichi_erosion.scene.schema.units import (
    EXAMPLES,
    Scale,
    Unit,
    UnknownUnit,
    conversion_factor,
    parse_scale,
    parse_unit,
    scale_between,
)
from taichi_erosion.tables.cell_numbers import DATE, days_since_first
from taichi_erosion.tables.headings import KINDS, SCATTER, meaning_of, meaning_of_symbol, read_heading
from taichi_erosion.tables.number_words import plain, with_unit
from taichi_erosion.tables.spreadsheet import Cells, apply_number_laws, read_table_cells

AMOUNTS = ("flux", "flux_height")  # observables that can be none
SPREAD_WORDS = {"observable": "single repeats", "condition": "the stated condition"}  # of ±, by role
ATTENUATION = 0.05  # share of a slope that errors of a measured condition may take before it is told
NEAR_SCENE = 30.0  # factor about a scene's own number within which a column is taken as meant


def read_measured_table(path: Path, file: str = "", study: StudyFile | None = None) -> Table:
    """Measurements of a file, a tidy one or a laboratory's own; raises BadInput with all its faults.

    In a laboratory's own table the columns are what the study calls them, else what their headings mean.
    """
    faults = Faults()
    rows = faults.of(read_rows, path, one_line_name(file or path), column_options(study), Interview(), faults)
    faults.raise_if_any()
    assert rows is not None
    return rows


def read_rows(
    path: Path, name: str, options: TableOptions, interview: Interview, faults: Faults
) -> Table | None:
    """Rows of a file, a tidy one or a laboratory's own; what is wrong with it is added to `faults`.

    None where its columns cannot be used; raises BadInput for a file without cells, and for a cross table.
    """
    cells = read_table_cells(path, name, faults)
    if not cells.rows:
        raise BadInput(*faults or [f"{name}: is empty; the first row names the columns: observable, ..."])
    names = [cell.partition("[")[0].strip().lower() for cell in cells.heading]
    if get_close_matches("observable", names, n=1, cutoff=0.85):  # a tidy table, if under another spelling
        tidy = faults.of(tidy_columns, cells)
        faults += [f"--sd {text}: write it in a column 'sd' of this table" for text in options.sd]
        table = None if tidy is None else table_from_cells(cells, tidy, faults, options)
        interview.assume(*cells.notes, *(table.notes if table else ()))
        return table
    if not cells.lines:
        raise BadInput(*faults or [f"{name}: has a heading but no measurement, no measured value"])
    cells, assumed = transpose_sideways_table(cells, interview), len(interview.assumptions)
    cells = dates_as_days(cells, interview)
    columns = understand_columns(cells, options, interview, faults)
    cells = fill_down(cells, columns, options, interview)
    columns = list(without_repeat_labels(columns, cells))
    table = table_from_cells(cells, columns, faults, options)
    interview.assume(*table.notes, *notes_on_cells(cells, columns))
    return replace(table, notes=tuple(interview.assumptions[assumed:]))


def transpose_sideways_table(cells: Cells, interview: Interview) -> Cells:
    """A table with its headings in the first row; one that lies on its side is set upright, if agreed."""
    telling = ("observable", "condition", *SCATTER)
    names = [row[0] for _, row in cells.rows], cells.heading[1:]
    roles = [[meaning_of(read_heading(text).name)[0] for text in texts if text] for texts in names]
    down, across = ([role for role in each if role in telling] for each in roles)
    if len(down) < 2 or "observable" not in down or across:
        return cells
    meaning = "rows and columns are exchanged: the headings stand in the first column"
    question = f"{cells.file}: the headings seem to stand in the first column. Exchange rows and columns"
    if not interview.ask_yes_or_no(question, meaning):
        return cells
    columns = zip(*(row for _, row in cells.rows), strict=True)
    rows = tuple((k, column) for k, column in enumerate(columns, 1) if any(column))
    return apply_number_laws(replace(cells, file=f"{cells.file} (rows and columns exchanged)", rows=rows))


def dates_as_days(cells: Cells, interview: Interview) -> Cells:
    """The cells; dates are days, a condition: readings may drift. Not where repeats have several dates.

    What a date does is then in their scatter, unless a row states its own.
    """
    columns = list(map(list, zip(*(row for _, row in cells.rows), strict=True)))
    roles = {meaning_of(read_heading(text).name)[0] for text in cells.heading}
    has_scatter = roles & ({*SCATTER} - {"n"}) or any("±" in cell for column in columns for cell in column)
    for column in columns:
        heading = read_heading(column[0])  # one of numbers has some that a spreadsheet changed
        if heading.unit or meaning_of(heading.name)[0] in KINDS.values():
            continue
        days = days_since_first(column[1:])
        several = (
            bool(days) and not has_scatter and varies_among_repeats([column[0], *map(str, days)], columns)
        )
        if max(days, default=0) and not several:
            interview.assume(f"column '{column[0]}' counts days since its first date")
            column[:] = f"{DAY} (d)", *map(str, days)
            break
        if several or (not days and any(map(DATE.fullmatch, column[1:]))):
            why = "repeats have several dates" if several else "no dates, or day and month may be exchanged"
            interview.assume(f"not used: '{column[0]}' ({why})")
    rows = zip(cells.rows, zip(*columns, strict=True), strict=True)
    return replace(cells, rows=tuple((line, row) for (line, _), row in rows))


def varies_among_repeats(column: Sequence[str], columns: Sequence[Sequence[str]]) -> bool:
    """Whether most rows that are alike in all known conditions, set-ups and sources have several values."""
    settings: list[Sequence[str]] = [[""] * (len(column) - 1)]
    for other in columns:
        heading = read_heading(other[0])
        roles = meaning_of(heading.name)[0], meaning_of_symbol(heading)[0]
        labels = {"group", "source"} & {*roles} and len({*other}) < len(other)  # not numbers of samples
        settings += [other[1:]] if "condition" in roles or labels else []
    alike: dict[tuple[str, ...], list[str]] = {}
    for key, value in zip(zip(*settings, strict=True), column[1:], strict=True):
        alike.setdefault(key, []).append(value)
    several = [len({*values}) > 1 for values in alike.values() if len(values) > 1]
    return 2 * sum(several) > len(several)


def fill_down(cells: Cells, columns: Sequence[Column], options: TableOptions, interview: Interview) -> Cells:
    """The cells; blank ones below a condition, a set-up or a source repeat it where the user says so."""
    rows = [list(row) for _, row in cells.rows]
    for column in columns:
        content = [row[column.place] for row in rows[1:]]
        blank = content[next((k for k, cell in enumerate(content) if cell), len(content)) :].count("")
        if column.role not in ("condition", "group", "source") or not blank:
            continue
        where = f"column '{column.heading.text}'"
        question = f"{blank} cells of {where} are blank below a value. Fill them from above (yes or no)"
        if not (options.fill_down or interview.choice(question, "no", "")[0] in AGREED):
            continue
        interview.assume(f"{where}: {blank} blank cells are filled with the cell above")
        for above, row in pairwise(rows[1:]):
            row[column.place] = row[column.place] or above[column.place]
    whole = zip(cells.rows, rows, strict=True)
    return replace(cells, rows=tuple((line, tuple(row)) for (line, _), row in whole))


def without_repeat_labels(columns: Sequence[Column], cells: Cells) -> Iterator[Column]:
    """The columns; a column of n with the numbers 1 to k, each once under equal conditions, is not used."""
    kinds = [column.place for column in columns if column.role in ("condition", "group", "source")]
    sets = [tuple(row[place] for place in kinds) for _, row in cells.lines]
    labels = {*map(str, range(1, 1 + max(Counter(sets).values())))}
    for column in columns:
        pairs = {(each, row[column.place]) for each, (_, row) in zip(sets, cells.lines, strict=True)}
        is_label = len(pairs) == len(sets) > len({*sets}) and {number for _, number in pairs} == labels
        yield replace(column, role="remark") if is_label and column.role == "n" else column


def notes_on_cells(cells: Cells, columns: Sequence[Column]) -> Iterator[str]:
    """What is assumed of the cells of a laboratory's table."""
    for column in (each for each in columns if each.role in SPREAD_WORDS):
        if any(sign in row[column.place] for _, row in cells.lines for sign in ("±", "+-", "+/-")):
            what, text = f"deviation of {SPREAD_WORDS[column.role]}", column.heading.text
            yield f"± in '{text}' is the standard {'error' if STANDARD_ERROR.search(text) else what}"
    if not any(column.role == "n" or column.heading.repeats for column in columns):
        yield "no column counts repeats: n is left empty, and a value counts as one measurement"


def add_detection_limits(table: Table, interview: Interview) -> Table:
    """The table; an amount that was not seen, `0` or `no transport`, gets the limit below which it lies.

    It is the least limit that the table states, else the least amount: what is less may not have been seen.
    """
    for name in AMOUNTS:
        rows_of_name = [row for row in table.rows if row.observable == name and not row.value < 0.0]
        unseen = list(dict.fromkeys(row.line for row in rows_of_name if is_unseen(row)))
        limits = [row for row in rows_of_name if row.censored and row.reach == -inf and row.value > 0.0]
        above_zero = limits or [row for row in rows_of_name if row.value > 0.0]
        if not unseen or not above_zero:
            continue
        unit = above_zero[0].unit
        limit = min(value_unit_factor(row, unit, table.file) * row.value for row in above_zero)
        source = "the least limit of the table" if limits else "the least value that was seen"
        interview.assume(
            f"{name}: 0 and no transport are read as '<{cell_text(limit)}' {unit}, {source}, in "
            f"{row_list_text(unseen)}; write '<' and the least value that is seen where it is another"
        )
        below = {"value": limit, "unit": unit, "censored": True, "reach": -inf, "sd": nan}
        rows = [replace(r, **below) if r.observable == name and is_unseen(r) else r for r in table.rows]
        table = replace(table, rows=tuple(rows))
    return table


def is_unseen(row: Row) -> bool:
    """Whether a row says that there was nothing, without a limit."""
    return row.value == 0.0 or (row.censored and isnan(row.value))


def column_options(study: StudyFile | None) -> TableOptions:
    """What a study says of the columns of its table: by [columns], or by the same name."""
    if study is None:
        return TableOptions()
    names = {name: name for name in (*study.observables, *study.conditions)} | study.columns
    paths = [(path, name) for name, paths in study.conditions.items() for path in (paths, *paths.split(","))]
    return TableOptions(
        {text: name for text, name in names.items() if name in study.observables},
        {text: study.conditions[name] for text, name in names.items() if name in study.conditions},
        titles={path.strip(): name for path, name in paths},
        optional=frozenset(names),
        complete=study.study.model is None,  # a model of the user's own is told what is not known
    )


def study_measurements(
    table: Table, file: StudyFile, name: str, places: Mapping[str, str] | None = None
) -> tuple[Measurements, list[str]]:
    """Rows that the study uses, in the units of use, and sentences about the others.

    `places` gives the unit of what a condition sets; of the conditions that it leaves out it is SI.
    """
    rows = [row for row in table.rows if row.observable in file.observables]
    if faults := [*missing_column_faults(table, file, name), *unused_condition_faults(table, file, rows)]:
        raise BadInput(*faults)
    scales = condition_scales(table, file, places or {})
    units = {name: model_unit(name, entry, rows, table.file) for name, entry in file.observables.items()}
    factors = np.array([value_unit_factor(row, units[row.observable], table.file) for row in rows])
    pairs = zip(rows, factors.tolist(), strict=True)
    limits = [censoring_limit(r, factor, file.observables[r.observable], table.file) for r, factor in pairs]
    settings = [dict(zip(table.conditions, row.conditions, strict=True)) for row in rows]
    used = [{name: scale.to_use(at[name]) for name, scale in scales.items()} for at in settings]
    names = [", ".join(f"{value:g}" for value in at.values()) for at in used]
    measurements = Measurements(
        observable=tuple(row.observable for row in rows),
        value=factors * np.array([nan if row.censored else row.value for row in rows]),
        sd=factors * np.array([row.sd for row in rows]),
        n=np.array([nan if row.n is None else float(row.n) for row in rows]),
        group=tuple(r.group or name or "all" for r, name in zip(rows, names, strict=True)),
        unit=tuple(units[row.observable] for row in rows),
        conditions={column: np.array([at[column] for at in used]) for column in file.conditions},
        censored=np.array([row.censored for row in rows], dtype=np.bool_),
        limit=np.array(limits),
        source=tuple(row.source for row in rows),
        table_units=TableUnits(observable_unit_scales(rows, units), scales),
        reach=factors * np.array([row.reach for row in rows]),
        condition_sd={  # NaN where a condition is exact
            name: np.array([scale.factor * row.condition_sd.get(name, nan) for row in rows])
            for name, scale in scales.items()
            if any(row.condition_sd.get(name) for row in rows)
        },
        drawn=tuple(row.draw for row in rows),
        heap=heap_of_rows(rows),
        line=tuple(int(place["line"]) if (place := PLACE.fullmatch(r.source)) else r.line for r in rows),
    )
    other = Counter(row.observable for row in table.rows if row.observable not in file.observables)
    unused = [
        f"{each}: {n} rows of {table.file} are of no observable of the study." for each, n in other.items()
    ]
    return measurements, [*table.notes, *unused, *notes_on_condition_errors(measurements, table)]


def missing_column_faults(table: Table, file: StudyFile, name: str) -> Iterator[str]:
    """Conditions and observables of a study that its table lacks."""
    measured = list(dict.fromkeys(row.observable for row in table.rows))
    named = (("conditions", file.conditions, table.conditions), ("observables", file.observables, measured))
    for section, names, there in named:
        for each in names:
            if each not in there:
                words = f"is not in {table.file}; {section} there: {', '.join(there) or 'none'}"
                yield f"{name}: {section}.{each} {words}{did_you_mean(each, there)}"


def unused_condition_faults(table: Table, file: StudyFile, rows: Sequence[Row]) -> Iterator[str]:
    """Conditions that vary in the rows of a study, and that its model is not given."""
    for place, column in enumerate(table.conditions):
        values = {row.conditions[place] for row in rows if isfinite(row.conditions[place])}
        if column not in file.conditions and len(values) > 1 and file.columns.get(column) != NOTE:
            words = "varies and is not under [conditions]: add it there, or make the study anew;"
            yield f"{table.file}: column '{column}' {words} [columns] {column} = '{NOTE}' leaves it out"


def condition_scales(table: Table, file: StudyFile, places: Mapping[str, str]) -> dict[str, Scale]:
    """Scale of every condition of a study; raises BadInput where a unit does not fit."""
    return {column: condition_column_scale(table, column, places.get(column)) for column in file.conditions}


def condition_column_scale(table: Table, column: str, place: str | None) -> Scale:
    """Scale of a condition from its unit in the table to that of the place it sets; None: SI."""
    unit = table.units[table.conditions.index(column)]
    if unit is None:
        return Scale(place or "")
    try:
        target = parse_unit(place) if place is not None else Unit(1.0, parse_scale(unit).kind)
    except UnknownUnit:
        message = f"sets what is counted in {place}, not a number"
        raise BadInput(f"{table.file}: column '{column}' {message}") from None
    scale = scale_between(unit, target)
    if scale is None:
        message = f"it sets a number in {place}" if place != "1" else "it sets a pure number"
        raise BadInput(f"{table.file}: heading '{column} [{unit}]': {message}; give it in that unit")
    return scale


def heap_of_rows(rows: Sequence[Row]) -> tuple[str, ...]:
    """Heap of each row: the repeat that is named, else the line of a laboratory's table, else the set-up."""
    lines = Counter(row.line for row in rows)

    def heap_of_row(row: Row) -> str:
        if row.repeat:
            return f"{row.group}, repeat {row.repeat}"
        if lines[row.line] > 1:
            return f"row {row.line}"
        return row.source if PLACE.fullmatch(row.source) else row.group

    return tuple(map(heap_of_row, rows))


def model_unit(name: str, entry: ObservableEntry, rows: Sequence[Row], file: str) -> str:
    """Unit of a model's values: that of the study, else the unit of the first row."""
    unit = entry.unit if entry.unit is not None else next(row.unit for row in rows if row.observable == name)
    try:
        parse_unit(unit)
    except UnknownUnit:
        words = f"observables.{name}.unit = '{unit}' is not known; allowed: {EXAMPLES}"
        raise BadInput(f"{file}: {words}") from None
    return unit


def value_unit_factor(row: Row, unit: str, file: str) -> float:
    """Factor from a row's unit to the model's."""
    factor = conversion_factor(parse_unit(row.unit), parse_unit(unit))
    if factor is None:
        raise BadInput(f"{file}: row {row.line}, unit = '{row.unit}': {row.observable} is counted in {unit}")
    return factor


def observable_unit_scales(rows: Sequence[Row], units: Mapping[str, str]) -> dict[str, Scale]:
    """Scale of every observable, from the unit that most of its rows have to that of the model."""
    counts = {name: Counter(row.unit for row in rows if row.observable == name) for name in units}
    usual = {name: count.most_common(1)[0][0] for name, count in counts.items()}
    return {
        n: Scale(u, conversion_factor(parse_unit(u), parse_unit(units[n])) or 1.0) for n, u in usual.items()
    }


def censoring_limit(row: Row, factor: float, entry: ObservableEntry, file: str) -> float:
    """Limit of a censored value in the model's unit, the middle of an interval; NaN for an ordinary value."""
    if not row.censored:
        if entry.transform != "identity" and row.value <= 0.0 and not entry.floor:
            words = f"value = {row.value:g} must be above 0 for transform = '{entry.transform}'"
            raise BadInput(f"{file}: row {row.line}, {words}; write '<' and the least value that is seen")
        return nan
    if isfinite(row.value):
        return factor * row.value
    if entry.floor:
        return entry.floor
    floor = f"give observables.{row.observable}.floor in the study"
    words = "value is empty: write '<' and the least value that is seen"
    raise BadInput(f"{file}: row {row.line}, {words}, or {floor}")


def notes_on_condition_errors(measurements: Measurements, table: Table) -> Iterator[str]:
    """Conditions whose stated values have errors, and by how much a slope along a measured one is too small.

    That is sd^2 over the variance of the stated values; W. A. Fuller, Measurement Error Models (1987), 1.1.
    """
    for name, sd in measurements.condition_sd.items():
        scale = measurements.table_units.conditions.get(name, Scale())
        most = with_unit(plain(np.nanmax(sd) / scale.factor), measurements.table_units.condition_unit(name))
        count = f"{int(np.sum(sd > 0.0))} of {sd.size} rows"
        yield f"{name}: {count} state its sd, at most {most}; it enters their errors by the model's slope."
        variance = float(np.nanvar(measurements.conditions[name]))
        share = np.mean(np.nan_to_num(sd) ** 2) / variance if variance > 0.0 else 0.0
        if share > ATTENUATION and name not in table.set_conditions:
            yield f"{name}: slopes along it come out {min(100.0 * share, 100.0):.0f} % too small if measured."


def value_faults(
    table: Table, name: str, allowed: PhysicalRange | None, usual_value: float = nan, usual: bool = True
) -> Iterator[str]:
    """Impossible values of a condition or an observable, and a unit that seems mistaken, one line each.

    `usual_value` is the scene's number, 0 where it has none, NaN without a study: a column near it is meant
    as it stands. `usual`: whether values that are possible but unusual are looked at. None is known of a
    place without a range.
    """
    if allowed is None:
        return
    cells = cells_in_unit(table, name, allowed)
    wrong = [each for each in cells if not allowed.is_possible(each[3])]
    odd = [each for each in cells if not allowed.is_usual(each[3])]
    meanings = plausible_units([value for _, value, _, _ in cells], cells[0][2] if cells else None, allowed)
    low, high = usual_value / NEAR_SCENE, usual_value * NEAR_SCENE
    near_own = usual_value > 0.0 and all(low <= used <= high for *_, used in odd)
    hint = ", or rename the column if it holds another quantity"
    hint = f": did you mean [{'] or ['.join(meanings)}]?" if meanings else hint
    reads_new = isnan(usual_value)  # a table without a study, whose owner can answer
    if not wrong and usual and (meanings or reads_new) and 2 * len(odd) > len(cells) and not near_own:
        wrong = odd
        heading = next((c.heading.text for c in table.columns if c.title == name), name)
        hint += (
            f"; if it is right, say --unit {quote(f'{heading}={cells[0][2] or allowed.unit}')}" * reads_new
        )
    for row, value, unit, used in wrong if len(wrong) <= SOLO_ROWS else wrong[:1]:
        text = f"{value:g} {unit}" if unit else f"{value:g} (no unit: {allowed.unit})"
        span = f"outside [{allowed.low:g}, {allowed.high:g}]"
        outside = "which is unusual" if allowed.is_possible(used) else span
        more = f"; {len(wrong) - 1} rows more" if len(wrong) > SOLO_ROWS else ""
        also = f" is {with_unit(f'{used:g}', allowed.unit)}" if unit not in (None, "", allowed.unit) else ""
        message = f"{name} = {text}{also}, {outside}{more}; check number and unit{hint}"
        yield f"{table.file}: row {row.line}, {message}"


def cells_in_unit(
    table: Table, name: str, allowed: PhysicalRange
) -> list[tuple[Row, float, str | None, float]]:
    """Rows of a condition or an observable with their values, as written and in the unit of a range."""
    if name in table.conditions:
        place = table.conditions.index(name)
        cells = [(row, row.conditions[place], table.units[place]) for row in table.rows]
    else:
        cells = [(row, row.value, row.unit) for row in table.rows if row.observable == name]
    scaled = [(row, value, unit, range_scale(unit, allowed)) for row, value, unit in cells if isfinite(value)]
    return [(row, value, unit, scale.to_use(value)) for row, value, unit, scale in scaled if scale]
