"""Answer of `predict` as lines and one table."""

from collections.abc import Iterator, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Any

from taichi_erosion.evidence.data.number_words import counted, heading, plain, with_unit
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.race.record import CheckPart, Interval, PredictedPart, PredictionPart
from taichi_erosion.evidence.words import vocabulary as say
from taichi_erosion.evidence.words.answer_lines import Answer, Table

INTERVALS = ("value (90 %)", "90 % of one measurement", "outside")


def prediction_answer(found: PredictionPart, about: Mapping[str, Any], units: TableUnits) -> Answer:
    """Which model answers, what its intervals rest on, and how they have held."""
    hidden = about["rows_hidden"]
    missing = model_line(about["study"], about["adopted"]), unlisted_line(found), *left_out_lines(found)
    fitted = check_line("fitted rows, each predicted from the others,", found.fitted)
    closed = f"{counted(hidden, 'held-out row')} stay unseen for `adopt`." if hidden else ""
    held = closed if found.held_out is None else check_line("held-out rows", found.held_out)
    constant = f"As in the study, not in the table: {units.setting_text(found.constant)}."
    following = outside_line(found), constant * bool(found.constant)
    missing, holds, following = (tuple(filter(None, part)) for part in (missing, (fitted, held), following))
    return Answer(missing, holds, following, prediction_rows(found, units))


def model_line(study: str, adopted: Sequence[str]) -> str:
    """Which model answers."""
    if not adopted:
        return f"Predicted by the calibrated model of {Path(study).name}."
    return f"Predicted by the adopted model, with {say.joined(adopted)} ({Path(study).name})."


def unlisted_line(found: PredictionPart) -> str:
    """What a value is beside the model, and how likely the residuals show more than chance."""
    words = "`value` is the model corrected by what its residuals show"
    return f"{words} (something is missing: probability {say.probability(found.unlisted)})."


def left_out_lines(found: PredictionPart) -> Iterator[str]:
    """Observables and adopted effects that the prediction does without."""
    if found.lost:
        yield f"Not predicted: {say.joined(found.lost)}, of which no row has a known scatter."
    if found.outdated:
        names = say.joined(found.outdated)
        yield f"Left out: {names}, adopted before the table or the study changed; `adopt` again takes it in."


def check_line(rows: str, check: CheckPart) -> str:
    """How many measured values lie inside their intervals."""
    if not check.n:
        return f"There are no {rows.rstrip(',')} to check the intervals with."
    words = f"{check.inside} of {check.n} {rows} lie inside their 90 % interval"
    few = f": the intervals are too narrow ({say.chance(check.p)})"
    return f"{words}{few * (check.p < say.ADEQUATE)}."


def outside_line(found: PredictionPart) -> str:
    """How many predictions nothing checks."""
    count = sum(bool(row.outside) for row in found.rows)
    lie = "lies" if count == 1 else "lie"
    words = f"{count} of {counted(len(found.rows), 'prediction')} {lie} outside the measured conditions"
    return f"{words}: nothing checks the model there." if count else ""


def prediction_rows(found: PredictionPart, units: TableUnits) -> Table | None:
    """One row for each prediction, in the units of the tables."""
    if not found.rows:
        return None
    names = found.rows[0].condition_units
    columns = ("observable", *map(heading, names, names.values()), "model", *INTERVALS)
    rows = tuple(
        (
            heading(say.quantity(row.observable), units.value_unit(row.observable)),
            *(plain(row.conditions[name], 4) for name in names),
            *value_cells(row, units),
            outside_text(row),
        )
        for row in found.rows
    )
    return Table("predictions", columns, rows)


def value_cells(row: PredictedPart, units: TableUnits) -> Iterator[str]:
    """Model, value with its interval, interval of one measurement; dashes where the model has no value."""
    if isnan(row.value):
        yield from ("-",) * 3
        return
    scale = units.value(row.observable, 1.0) or 1.0
    yield plain(scale * row.model)
    yield say.interval(Interval(row.value, row.low, row.high), 3, scale)
    yield f"{plain(scale * row.measured_low)} to {plain(scale * row.measured_high)}"


def outside_text(row: PredictedPart) -> str:
    """`diameter beyond 2487 um`."""
    ends = ((name, with_unit(plain(end, 4), row.condition_units[name])) for name, end in row.outside.items())
    return ", ".join(f"{name} beyond {end}" for name, end in ends)
