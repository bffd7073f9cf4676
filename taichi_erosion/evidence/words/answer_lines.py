"""Answers of `compare`, `discover`, `adopt`, `next` and `predict` as lines and one table.

Every line has its place: an answer has at most eight, and one table.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import Any

from taichi_erosion.evidence.data.number_words import TableUnits, counted, heading, plain, with_unit
from taichi_erosion.evidence.race.record import (
    CheckPart,
    ExperimentPart,
    HeldOutPart,
    Interval,
    PredictedPart,
    PredictionPart,
    Record,
)
from taichi_erosion.evidence.words import data_words, effect_words
from taichi_erosion.evidence.words import vocabulary as say

HARDER = "Measurements under other conditions test the model harder"
COMPARED = ("observable", "rows", "rms error", "mean error", "fails along")
CANDIDATES = ("effect", "status", "strength (90 %)", "probability")
INTERVALS = ("value (90 %)", "90 % of one measurement", "outside")


@dataclass(frozen=True)
class Table:
    """The table of an answer, as it is read."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Answer:
    """Sentences in the order of the page, and the table."""

    missing: tuple[str, ...]  # what is missing
    holds: tuple[str, ...]  # does it hold
    following: tuple[str, ...]  # what next
    table: Table | None

    @property
    def lines(self) -> tuple[str, ...]:
        return *self.missing, *self.holds, *self.following


def framed(answer: Answer, record: Record, voc: say.Vocabulary) -> Answer:
    """An answer with gross repeats before everything and a spent budget before the last line."""
    spent = f"Stopped at the budget ({counted(record.cost.settings, 'setting')} of the model)"
    stopped = f"{spent}: this is known so far; a larger --budget may change it." * bool(record.cost.stopped)
    missing, following = (data_words.repeats_line(record, voc), *answer.missing), (stopped, *answer.following)
    missing, holds, following = (tuple(filter(None, part)) for part in (missing, answer.holds, following))
    return Answer(missing, holds, following, answer.table)


def again(record: Record, command: str, voc: say.Vocabulary, *words: str) -> str:
    """What comes before every other step: rows to be checked, a set-up to be settled."""
    rows = data_words.suspects(record)
    if not rows and data_words.testable(record):
        return ""
    first = f"Correct or confirm {rows} in the table" if rows else "Mend the errors"
    return f"{first}, then give {voc.command(command, voc.study, *words)} again"


def compare_answer(record: Record, voc: say.Vocabulary) -> Answer:
    """Whether the calibrated model agrees, and where it fails."""
    first, last = compared(record, voc)
    missing = (
        first,
        data_words.errors_line(record, voc, data_words.agrees(record)),
        data_words.where_line(record),
    )
    holds = (data_words.numbers_line(record, before=True),)
    table = Table("measured minus model", COMPARED, tuple(data_words.observable_rows(record, voc)))
    following = (f"{again(record, 'compare', voc) or last}.",)
    return framed(Answer(missing, holds, following, table), record, voc)


def compared(record: Record, voc: say.Vocabulary) -> tuple[str, str]:
    """First and last line of a comparison."""
    fit, rows = record.fit, data_words.rows_text(record)
    size = (
        f"misfit per row {plain(fit.chi2_before / fit.n, 2)}, where 1 is chance; {say.chance(fit.p_before)}"
    )
    size += "" if isnan(fit.p_lack_of_fit) else f"; against repeats alone {say.chance(fit.p_lack_of_fit)}"
    if data_words.agrees(record):
        last = HARDER
        return f"The calibrated model agrees with {rows} ({size}).", last
    places = "" if fit.p_before < say.ADEQUATE else " in places"
    last = f"{voc.command('discover', voc.study)} asks which effect is missing"
    return f"The calibrated model fails{places} ({rows}: {size}).", last


def discover_answer(record: Record, voc: say.Vocabulary) -> Answer:
    """What is missing, and how far every candidate is known."""
    sure, either = effect_words.acting(record.decided)
    names = say.joined(filter(None, (*sure, say.joined(either, "or"))))
    fit = " ".join(filter(None, (effect_words.law_line(record), data_words.fit_line(record, names))))
    numbers = data_words.numbers_line(record, before=not names, without=names)
    rows = tuple(effect_words.effect_rows(record)) if data_words.testable(record) else ()
    table = Table("candidates; strength 1 is the textbook value", CANDIDATES, rows) if rows else None
    headline, errors = effect_words.headline(record, voc), data_words.errors_line(record, voc)
    missing = headline, errors, data_words.where_line(record)
    return framed(Answer(missing, (fit, numbers), (after_discovery(record, voc),), table), record, voc)


def after_discovery(record: Record, voc: say.Vocabulary) -> str:
    proposals, verdict = voc.command("next", voc.study), record.decided.verdict
    if steps := "; then ".join(filter(None, (again(record, "discover", voc), *acting_steps(record, voc)))):
        return f"{steps}."
    if verdict == "outside_library":
        own = voc.command("effects", "new", "NAME")
        return f"{own} makes an effect of your own; {proposals} asks for more data."
    if verdict == "unstable":
        return f"{voc.command('discover', voc.study)} makes more runs and tests the answer anew."
    return f"{HARDER}." if data_words.agrees(record) else f"{proposals} asks which measurements would decide."


def acting_steps(record: Record, voc: say.Vocabulary) -> Iterator[str]:
    """What to do with everything that is said to act."""
    (sure, either), named = effect_words.acting(record.decided), record.decided.named
    if named and sure:
        yield f"{voc.command('adopt', voc.study, *named)} tests {say.joined(named)} on held-out rows"
    elif sure:
        own = voc.command("effects", "new", "NAME", *(["--from-discovery", voc.results] * bool(record.law)))
        yield f"{own} writes {say.joined(sure)} as an effect of your own, and `adopt` tests it"
    if either:
        names = say.joined(either)
        yield f"{voc.command('next', voc.study)} asks which measurements tell {names} apart"


def adopt_answer(record: Record, voc: say.Vocabulary) -> Answer:
    """Whether the error falls on rows that no fit has seen."""
    held = record.held_out
    if held is None or not held.n:
        names, proposals = say.joined(record.decided.named), voc.command("next", voc.study)
        words = f"No held-out row tests {names}: {proposals} asks which measurements do."
        return framed(Answer((words,), (), (), None), record, voc)
    first, numbers, last = adoption(record, held, voc)
    following = (f"{again(record, 'adopt', voc, *held.adopted) or last}.",)
    return framed(
        Answer((first,), (control(held), numbers), following, error_table(record, held)), record, voc
    )


def adoption(record: Record, held: HeldOutPart, voc: say.Vocabulary) -> tuple[str, str, str]:
    """First line, numbers and last line, from one comparison: the error falls only to an adequate model."""
    rows, names, numbers = counted(held.n, "held-out row"), say.joined(held.adopted), data_words.numbers_line
    change = f"from {plain(held.before, 2)} to {plain(held.after, 2)} per row (1 is chance)"
    misfits = {"held-out": held.p_after, "fitted": record.fit.p_after}
    failing = [f"{name} rows ({say.chance(p)})" for name, p in misfits.items() if p < say.ADEQUATE]
    if not record.improves:
        last = f"Go on with {voc.study}: {voc.command('next', voc.study)} asks which measurements decide"
        fit = record.fit
        fitted = (
            f"of fitted rows from {plain(fit.chi2_before / fit.n, 2)} to {plain(fit.chi2_after / fit.n, 2)}"
        )
        first = f"{names} does not make the model better: the error {fitted}, of {rows} {change}"
        return f"{first}. Do not adopt.", "", last
    if failing:
        last = f"Go on with {voc.written}: {voc.command('discover', voc.written)} asks what else is missing"
        first = f"With {names} the error of {rows} goes {change}, but the model still fails"
        return f"{first}: {say.joined(failing)}.", numbers(record, before=False), last
    left = f"what is left is chance ({say.chance(held.p_after)})"
    first = f"The error falls with {names}: {change} on {rows}; {left}."
    last = f"Go on with {voc.written}: {voc.command('compare', voc.written)} shows the model with it"
    return first, numbers(record, before=False, without=names), last


def control(held: HeldOutPart) -> str:
    """What a random other effect does, and how unseen the rows are."""
    end = ", no worse: these rows do not tell which acts" if held.wrong <= held.after else ""
    size = f"{plain(held.wrong, 2)} per row"
    words = f"Control: another effect drawn at random, {held.wrong_effect}, gives {size}{end}."
    seen = f"The held-out rows have been opened {held.opened} times: they are no longer unseen."
    return " ".join([*([] if isnan(held.wrong) else [words]), *([seen] if held.opened > 1 else [])])


def error_table(record: Record, held: HeldOutPart) -> Table:
    """Misfit per row of fitted and held-out rows, with a control."""
    fit, parts = record.fit, [(name, record.effects.get(name)) for name in held.adopted]
    before, after = (plain(chi2 / fit.n, 2) for chi2 in (fit.chi2_before, fit.chi2_after))
    added = say.joined(f"{name} {effect_words.strength_text(part)}" if part else name for name, part in parts)
    rows = [("before", before, plain(held.before, 2)), (f"with {added}", after, plain(held.after, 2))]
    rows += [] if isnan(held.wrong) else [(f"control: {held.wrong_effect}", "-", plain(held.wrong, 2))]
    columns = ("model", f"{fit.n} fitted rows", f"{held.n} held-out rows")
    return Table("misfit per row (1 is chance)", columns, tuple(rows))


def next_answer(record: Record, voc: say.Vocabulary) -> Answer:
    """The measurements that would decide."""
    keys = list(dict.fromkeys(key for each in record.experiments for key in each.predictions))
    if not keys:
        where = f"[laboratory] of {voc.study} may state wider ranges"
        words = f"No measurement under the conditions of the table would decide more; {where}."
        if not data_words.testable(record):
            words = "No measurement is proposed before the errors above are mended."
        return framed(Answer((words,), (), (), None), record, voc)
    shown, more = keys[: say.MOST_TOLD], len(keys) - say.MOST_TOLD
    told = [*map(short, shown), *([f"{more} more"] if more > 0 else [])]
    words = say.joined(told, "from" if len(told) == 2 else "and")
    last = f"Add the new rows to the table and give {voc.command('discover', voc.study)} again."
    expects = (f"expected by {short(key)}" for key in shown)
    columns = ("measure", "at", *expects, "chance to decide, with those above", "cost")
    rows = tuple(experiment_row(each, shown, voc) for each in record.experiments)
    table = Table("next measurements, the best first", columns, rows)
    return framed(Answer((f"These measurements would separate {words}.",), (), (last,), table), record, voc)


def short(key: str) -> str:
    """`a with b`, `no missing effect`."""
    return say.EXPLANATIONS.get(key) or key.replace("+", " with ")


def experiment_row(found: ExperimentPart, keys: list[str], voc: say.Vocabulary) -> tuple[str, ...]:
    """Where to measure, what each explanation expects, the chance to decide."""
    name, unit = found.observable, voc.units.value_unit(found.observable)
    expected = (found.predictions.get(key) for key in keys)
    values = (say.interval(each, 3, voc.scale(name)) if each else "-" for each in expected)
    at, chance = voc.units.setting_text(found.conditions), say.probability(found.chance)
    return heading(say.quantity(name), unit), at, *values, chance, plain(found.cost, 2)


def prediction_answer(found: PredictionPart, about: Mapping[str, Any], units: TableUnits) -> Answer:
    """Which model answers, what its intervals rest on, and how they have held."""
    hidden = about["rows_hidden"]
    corrected = "`value` is the model corrected by what its residuals show."
    missing = model_line(about["study"], about["adopted"]), corrected, *left_out_lines(found)
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
