"""Measurements and calibrated model in words: repeats, levels, errors, places, misfit, numbers."""

from collections.abc import Iterator
from math import log

import numpy as np

from taichi_erosion.evidence.data.number_words import counted, heading, plain
from taichi_erosion.evidence.race.priors import SURE
from taichi_erosion.evidence.race.record import ErrorPart, Interval, LevelPart, PlacePart, Record
from taichi_erosion.evidence.words import vocabulary as say

UNITS = {57.3: "degrees for radians", 100.0: "percent for a share", 10.0: "another unit", 1e3: "another unit"}
TESTED = {"confirmed": "confirm the answer", "undecided": "leave it open"}
NEAR_UNIT = 0.1  # of ln of a factor, within which it is told as that of a unit


def suspects(record: Record) -> str:
    """`row 17`, `rows 17 and 18`: what is to be checked; empty where repeats agree."""
    numbers = [n for each in record.repeats for n in ((each.suspect,) if each.suspect else each.rows)]
    rows = list(map(str, dict.fromkeys(numbers)))
    return f"{'row' if len(rows) == 1 else 'rows'} {say.joined(rows)}" if rows else ""


def repeats_line(record: Record, voc: say.Vocabulary) -> str:
    """Repeats that disagree grossly: told before everything else."""
    words = []
    for each in record.repeats:
        rows = list(map(str, dict.fromkeys(each.rows)))
        are = f"rows {say.joined(rows)} are repeats" if len(rows) > 1 else f"row {rows[0]} has repeats"
        gap = voc.units.value_text(each.observable, abs(each.difference))
        words.append(f"{are} of the {say.quantity(each.observable)} that differ by {gap}")
    return f"Check {suspects(record)} first: {say.told(words)}." if words else ""


def errors_line(record: Record, voc: say.Vocabulary, every: bool = True) -> str:
    """Levels, and of errors that nobody stated `every` one, but for rows that repeats tell of."""
    levels = [each for each in record.levels if each.probability >= SURE]
    known = {str(each.suspect) for each in record.repeats}
    errors = [each for each in record.errors if every and (each.kind != "row" or each.label not in known)]
    words = say.told([error_text(each, voc) for each in (*levels, *errors)])
    return f"Also: {words}.{' Check method, code and unit.' if levels else ''}" if words else ""


def error_text(found: LevelPart | ErrorPart, voc: say.Vocabulary) -> str:
    """`the pile height reads 0.6 mm (0.4 to 0.8) more than the model at all conditions`."""
    name, label = f"the {say.quantity(found.observable)}", found.label if isinstance(found, ErrorPart) else ""
    more = "more" if found.size.value > 0.0 else "less"
    unit = unit_text(found.size.value) if found.kind == "factor" else ""
    times, size = (
        f"{say.interval(found.size)} times",
        f"{voc.difference(found.observable, found.size)} {more}",
    )
    return {
        "factor": f"{name} reads {factor_text(found.size)} at all conditions{unit}",
        "offset": f"{name} reads {size} than the model at all conditions",
        "scatter": f"the scatter of {name}{f' of {label}' if label else ''} is {times} what is stated",
        "row": f"row {label} reads {name} {size} than it should: check it",
    }.get(found.kind, f"{found.kind} {label} reads {name} {size} than the others")


def factor_text(size: Interval) -> str:
    """`4.5 % (3.8 to 5.8) more than the model`; a factor of two or more as it is."""
    if not 0.5 < size.value < 2.0:
        return f"{say.interval(size)} times the model"
    sign = 1.0 if size.value > 1.0 else -1.0
    percent = Interval(*(100.0 * sign * (each - 1.0) for each in (size.value, size.low, size.high)))
    return f"{say.interval(percent, unit='%')} {'more' if sign > 0.0 else 'less'} than the model"


def unit_text(factor: float) -> str:
    """` (percent for a share?)`, where a factor or its inverse is that of a unit."""
    near = (words for size, words in UNITS.items() if abs(abs(log(factor)) - log(size)) < NEAR_UNIT)
    words = next(near, "")
    return f" ({words}?)" if words else ""


def failing(record: Record) -> list[PlacePart]:
    """Places where the model fails if nothing is missing, the worst first."""
    return sorted((each for each in record.where if each.p < say.ADEQUATE), key=lambda each: each.p)


def where_line(record: Record) -> str:
    """`Where the model fails: the measured flux lies above the model at large moisture (p = 0.002).`"""
    words = []
    for each in failing(record):
        at = "everywhere" if each.axis == "level" else f"at large {say.quantity(each.axis)}"
        way = "below" if each.sign < 0 else "above"
        words.append(
            f"the measured {say.quantity(each.observable)} lies {way} the model {at} ({say.chance(each.p)})"
        )
    return f"Where the model fails: {say.told(words)}." if words else ""


def testable(record: Record) -> bool:
    """Whether these measurements can test any effect."""
    return record.decided.verdict != "not_testable"


def rows_text(record: Record) -> str:
    return "the other rows" if record.repeats else f"all {counted(record.fit.n, 'row')}"


def agrees(record: Record) -> bool:
    """Whether the calibrated model agrees with the fitted rows, as a whole and in every place."""
    return not (record.fit.p_before < say.ADEQUATE or failing(record))


def fit_line(record: Record, added: str) -> str:
    """Misfit of the fitted rows before and after what is added."""
    fit = record.fit
    if not added:
        return ""
    before, after = plain(fit.chi2_before / fit.n, 2), plain(fit.chi2_after / fit.n, 2)
    words = f"Misfit per fitted row: {before} before ({say.chance(fit.p_before)}), {after} with {added}"
    rest = " The model still fails: something else acts too, or by another law." * (
        fit.p_after < say.ADEQUATE
    )
    if record.fresh is not None and record.fresh.outcome in TESTED:
        rest += f" {counted(record.fresh.runs, 'new simulation')} {TESTED[record.fresh.outcome]}."
    return f"{words} ({say.chance(fit.p_after)}); 1 is chance.{rest}"


def numbers_line(record: Record, before: bool, without: str = "") -> str:
    """Calibrated numbers; those that were biased without an effect, or that end at the end of their range."""
    words, ends = [], []
    without = "" if record.fit.p_after < say.ADEQUATE else without
    last = [path.rpartition(".")[2] for path in record.numbers]
    for path, each in record.numbers.items():
        end = path.rpartition(".")[2]
        name = say.quantity(end) if last.count(end) == 1 else path
        moved = each.now.low > each.before.value or each.before.value > each.now.high
        biased = f", biased without {without}: {plain(each.before.value, 3)}" if without and moved else ""
        words.append(f"{name} {say.interval(each.before if before else each.now, 3)}{biased}")
        ends += [name] * each.at_end
    more = f" At the end of the searched range: {say.joined(ends)}; check range and unit." if ends else ""
    return f"Calibrated: {say.told(words)}.{more}" if words else ""


def observable_rows(record: Record, voc: say.Vocabulary) -> Iterator[tuple[str, ...]]:
    """Misfit of every observable: rows, root of the mean squared error, mean error, where the model fails."""
    names = np.array(record.rows.observable)
    for name in dict.fromkeys(record.rows.observable):
        gap = voc.scale(name) * record.rows.gap(record.rows.before)[names == name]
        axes = ", ".join(say.quantity(each.axis) for each in failing(record) if each.observable == name)
        errors = plain(float(np.sqrt(np.mean(gap**2))), 2), plain(float(np.mean(gap)), 2)
        yield (
            heading(say.quantity(name), voc.units.value_unit(name)),
            str(gap.size),
            *errors,
            axes or "nowhere",
        )
