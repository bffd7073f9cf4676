"""The set-up before physics: what has to be right before a misfit says anything about missing effects.

Beside the faults that training runs show (`emulator/run_faults.py`): a unit that would explain a factor, rows
that lie off as a whole, calibrated numbers at a bound, model values that could not be computed. Where a fault
blocks, nothing is named.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from math import log, pi
from time import perf_counter

import numpy as np

from taichi_erosion.evidence.answers.discover import Answer, analysed, nameless_discovery
from taichi_erosion.evidence.answers.study_files.start_values import model_at_start
from taichi_erosion.evidence.data.comparison_rows import comparison_rows, condition_numbers
from taichi_erosion.evidence.data.findings import Estimate, LevelShift, Rows, SetUpFault
from taichi_erosion.evidence.data.number_words import plain
from taichi_erosion.evidence.data.problem import Bools, Floats, Problem, Progress
from taichi_erosion.evidence.data.tables.spreadsheet import source_changed
from taichi_erosion.evidence.inference.prepared_problem import NO_VALUE
from taichi_erosion.evidence.inference.verdict_levels import REJECTION_LEVEL, fails, least_rows, too_few_rows
from taichi_erosion.evidence.models.load_study import Study, first_study
from taichi_erosion.evidence.models.predictor import seed_mean

FAR = 5.0  # sd by which every row of an observable is off that is off as a whole
UNLIKE = 2.0  # scatter of repeated rows over the stated one from which they differ much more than stated
LEAST_ROWS = 3  # fewer have no level of their own
SEEDS = 4  # of the model at its start values, where a unit is looked for
NEAR = log(1.6)  # of a ratio to the factor of a unit, in logarithms: what is missing may move it too
EVEN = 0.2  # spread of the rows' ratios over that factor, in logarithms: a unit is the same for all of them
MISFIT = 3.0  # squared residual per row from which calibration has not explained a factor
MOVED = 3.0  # prior sd by which calibration has moved a number where it has explained one instead
UNITS = {  # factors, and what they would be
    10.0: "a power of ten",
    180.0 / pi: "degrees for radians",
    100.0: "percent for a share",
    1000.0: "milli or kilo",
}
ANGULAR = (180.0 / pi,)
SHARPEST = 2.0  # half width of the interval of a level, as a factor, from which it points at no unit
ANGLES = ("deg", "degree", "degrees", "\N{DEGREE SIGN}", "rad", "1", "")
TOO_FEW = "too_few_rows"  # kind of fault against which experiments help
WAITS = "The verdict on physics waits until this is settled: what follows describes the set-up, not the soil."
NOTHING = "Nothing is named: the set-up comes first."


def sentences(faults: Sequence[SetUpFault]) -> list[str]:
    """Sentences before an answer; the last one says whether the verdict on physics waits."""
    order = sorted(faults, key=lambda fault: (fault.kind != "repeats", not fault.blocks))
    told = [fault.sentence for fault in order]
    return [*dict.fromkeys(told), *([WAITS] if blocked(faults) else [])]


def blocked(faults: Sequence[SetUpFault]) -> bool:
    """Whether the verdict on physics waits."""
    return any(fault.blocks for fault in faults)


def lacks_rows(faults: Sequence[SetUpFault]) -> bool:
    """Whether the verdict waits for nothing but more rows."""
    return {fault.kind for fault in faults if fault.blocks} == {TOO_FEW}


def set_up_faults(
    study: Study,
    rows: Rows,
    parameters: Mapping[str, Estimate],
    warnings: Sequence[str],
    levels: Sequence[LevelShift] = (),
) -> tuple[SetUpFault, ...]:
    """All faults, from the rows and numbers of the calibrated bare model.

    An observable whose level the answer leaves free (`levels`) blocks nothing by its level.
    """
    found = [*study.faults, *(fault for shift in levels for fault in level_unit(study, shift))]
    start = values_at_start(study, rows)
    strained = any(number.at_bound or moved_far(study, path, number) for path, number in parameters.items())
    useless = {fault.place for fault in study.faults if fault.blocks}
    useless |= {fault.place for fault in found if fault.kind == "unit"}
    free = {shift.observable: shift for shift in levels}
    for name in dict.fromkeys(each for each in rows.observable if each not in useless):
        chosen = np.array([each == name for each in rows.observable])
        units = list(unit_faults(study, name, rows, start, chosen, strained))
        found += units or offset_faults(name, rows, chosen, free.get(name))
    found += bound_faults(study, parameters)
    failed = [words for words in warnings if words.startswith(NO_VALUE)]
    return (*found, *(SetUpFault("failed_runs", "model", words, False) for words in failed))


def source_faults(study: Study) -> Iterator[SetUpFault]:
    """The laboratory's table, where it has changed since the study was made of it.

    `study new` corrects the table that adopted studies share, and writes its digest into the first of them.
    """
    path, first = first_study(study.path, study.file)
    same = first.study.measurements == study.file.study.measurements and path.parent == study.path.parent
    head = first.study if same else study.file.study
    if head.made_from and source_changed(source := study.path.parent / head.made_from, head.made_from_digest):
        words = f"{source.name} has changed since `study new`: run it again to take over the changes"
        yield SetUpFault("source_changed", "table", words, False)


def table_faults(problem: Problem) -> tuple[SetUpFault, ...]:
    """What the table of a study cannot carry, known before its model is asked."""
    return (*disagreements(problem), *repeat_faults(problem), *row_faults(problem))


def disagreements(problem: Problem) -> Iterator[SetUpFault]:
    """Repeats of which the table, held-out rows included, has a wrong value."""
    table = problem.measurements
    for each in comparison_rows(problem, table).apart:
        gap = table.table_units.value_text(each.observable, each.gap)
        words = (
            f"{each.observable}: {numbered(each.lines)} are repeats and differ by {gap}: "
            f"check {numbered(each.suspects)}"
        )
        yield SetUpFault("repeats", each.observable, words, False)


def numbered(lines: Sequence[int]) -> str:
    """`row 17`, `rows 4, 17 and 18`."""
    *first, last = map(str, lines)
    return f"rows {', '.join(first)} and {last}" if first else f"row {last}"


def row_faults(problem: Problem) -> Iterator[SetUpFault]:
    """Fewer rows under different conditions than tell effects apart, where there are candidates."""
    points, calibrated = counted_rows(problem)
    if not problem.candidates or not too_few_rows(points, calibrated):
        return
    hidden = f", {len(problem.vault.rows)} more held out" if len(problem.vault.rows) else ""
    numbers = "1 number is" if calibrated == 1 else f"{calibrated} numbers are"
    words = (
        f"too few rows to tell effects apart: {points} under different conditions{hidden}, where {numbers} "
        "calibrated; an effect and a level take one more each, and one row must be left to contradict: at "
        f"least {least_rows(calibrated)} rows"
    )
    yield SetUpFault(TOO_FEW, "table", words, True)


def counted_rows(problem: Problem) -> tuple[int, int]:
    """Visible rows under different conditions, and calibrated numbers."""
    table = problem.visible()
    points = len(set(zip(table.observable, condition_numbers(table), strict=True)))
    return points, len(problem.parameters) + len(problem.adopted)


def missing_rows(problem: Problem) -> int:
    """Rows under other conditions that a table lacks to tell effects apart."""
    points, calibrated = counted_rows(problem)
    return max(least_rows(calibrated) - points, 0)


def repeat_faults(problem: Problem) -> Iterator[SetUpFault]:
    """Rows under the same conditions that differ much more than their stated scatter."""
    for name, noise in comparison_rows(problem, problem.visible()).noise.items():
        factor = noise.stated_factor
        if not factor > UNLIKE or not noise.p < REJECTION_LEVEL:
            continue
        words = (
            f"{name}: rows under the same conditions differ {factor:.2g} times as much as their stated "
            "scatter: a condition that the table or the study lacks, or a scatter that is stated too small"
        )
        yield SetUpFault("repeats", name, words, factor > FAR)


def values_at_start(study: Study, rows: Rows) -> Floats:
    """Model value of every row at the start values; NaN where there is none."""
    first = study.file.study.seed
    seeds, found = np.arange(first, first + SEEDS, dtype=np.int64), np.full(len(rows.observable), np.nan)
    for name in dict.fromkeys(rows.observable):
        chosen = np.array([each == name for each in rows.observable])
        conditions = {key: np.array(column[chosen]) for key, column in rows.conditions.items()}
        found[chosen] = seed_mean(model_at_start(study, name, conditions, seeds))
    return found


def moved_far(study: Study, path: str, number: Estimate) -> bool:
    """Whether calibration has moved a number by `MOVED` prior sd from its start."""
    known = next((each for each in study.problem.parameters if each.path == path), None)
    if known is None or known.start <= 0.0 or number.value <= 0.0:
        return False
    return abs(log(number.value / known.start)) > MOVED * known.prior_sd_log


def unit_faults(
    study: Study, name: str, rows: Rows, start: Floats, chosen: Bools, strained: bool
) -> Iterator[SetUpFault]:
    """A unit that would explain a factor between measured and modelled values.

    The factor is looked for at the start values, since calibration may have absorbed it; it counts where
    calibration has not explained the rows, or has strained a number to explain them.
    """
    both = chosen & np.isfinite(start) & (start > 0.0) & (rows.measured > 0.0)
    unexplained = strained or float(np.mean(rows.residual[chosen] ** 2)) > MISFIT
    if both.sum() < LEAST_ROWS or not unexplained:
        return
    ratio = np.log(rows.measured[both] / start[both])
    middle, spread = float(np.median(ratio)), float(np.std(ratio))
    for factor, meaning in unit_factors(study, name):
        if abs(abs(middle) - log(factor)) < NEAR and spread < EVEN * log(factor):
            words = (
                f"{name}: measured over modelled values are {ratio_words(rows.measured[both], start[both])}: "
                f"a factor of {factor:.3g} ({meaning}) in a unit would explain them; "
                f"the table says [{unit_of(study, name)}]: check it there and in the study"
            )
            yield SetUpFault("unit", name, words, True)
            return


def offset_faults(
    name: str, rows: Rows, chosen: Bools, shift: LevelShift | None = None
) -> Iterator[SetUpFault]:
    """All rows of an observable lie far off on one side; `shift`: its level, where that is left free."""
    gap = (rows.measured - rows.predicted)[chosen]
    sd = np.hypot(rows.measured_sd, np.nan_to_num(rows.predicted_sd))[chosen]
    off = gap / np.where(sd > 0.0, sd, np.nan)
    if off.size < LEAST_ROWS or not (np.all(off > FAR) or np.all(off < -FAR)):
        return
    if shift is not None:
        words = f"{shift.sentence.rstrip('.')}; what follows leaves this level free"
        yield SetUpFault("offset", name, words, False)
        return
    side = "above" if off[0] > 0.0 else "below"
    words = (
        f"{name}: all {off.size} rows lie {side} the calibrated model by more than {FAR:g} sd (measured "
        f"over modelled values {ratio_words(rows.measured[chosen], rows.predicted[chosen])}). The method, "
        "the plate, the contact law or a unit may shift a level as a whole as well as a missing effect: "
        "only what changes along the conditions tells them apart"
    )
    yield SetUpFault("offset", name, words, False)


def level_unit(study: Study, shift: LevelShift) -> Iterator[SetUpFault]:
    """A unit that would explain a free level; the answer is judged beside that level and does not wait."""
    low, high = shift.low, shift.high
    if shift.kind != "factor" or not 0.0 < low < high < low * SHARPEST**2:
        return
    for factor, meaning in unit_factors(study, shift.observable):
        if any(log(low) - NEAR < log(each) < log(high) + NEAR for each in (factor, 1.0 / factor)):
            words = (
                f"{shift.observable}: measured is {shift.value:.3g} ({low:.3g} to {high:.3g}) times the "
                f"model; a factor of {factor:.3g} ({meaning}) in a unit would explain most of it: check "
                f"[{unit_of(study, shift.observable)}] in the table. What follows leaves this level free"
            )
            yield SetUpFault("unit", shift.observable, words, False)
            return


def unit_factors(study: Study, name: str) -> Iterator[tuple[float, str]]:
    """Factors by which the unit of an observable may be wrong: degrees for radians only of an angle."""
    for factor, meaning in UNITS.items():
        if factor not in ANGULAR or unit_of(study, name) in ANGLES:
            yield factor, meaning


def unit_of(study: Study, name: str) -> str:
    """Unit of an observable in the table."""
    table = study.problem.measurements
    return table.unit[table.observable.index(name)]


def ratio_words(measured: Floats, modelled: Floats) -> str:
    """Range of the ratios of two columns."""
    ratio = measured / np.where(modelled != 0.0, modelled, np.nan)
    low, high = f"{np.nanmin(ratio):.2g}", f"{np.nanmax(ratio):.2g}"
    return low if low == high else f"{low} to {high}"


def bound_faults(study: Study, parameters: Mapping[str, Estimate]) -> Iterator[SetUpFault]:
    """Calibrated numbers at a bound of their range."""
    ranges = {each.path: (each.low, each.high) for each in study.problem.parameters}
    for path, number in parameters.items():
        if number.at_bound:
            bound = min(ranges.get(path, ()), key=lambda end: abs(end - number.value), default=number.value)
            words = (
                f"{path}: its calibration ends at the bound of its range ({plain(bound)}); the answer holds "
                "for this bound: widen the range, or ask what the number stands in for"
            )
            yield SetUpFault("at_bound", path, words, False)


def discovery(study: Study, seed: int, progress: Progress) -> Answer:
    """The answer of `discover` with the faults of its set-up; where one blocks, nothing is named."""
    start, problem, waits = perf_counter(), study.problem, blocked(study.faults)
    if waits:
        answer = Answer(nameless_discovery(problem, seed, progress))
    else:
        answer = analysed(problem, seed, problem.budget, progress)
    found = answer.record
    faults = set_up_faults(study, found.rows_before, found.parameters, found.warnings, found.levels)
    if blocked(faults):
        found = found if waits else nameless_discovery(problem, seed, progress)
        places = [place.sentence for place in found.where if fails(place.p)]
        found, answer = replace(found, verdict="not_testable", sentences=(NOTHING, *places)), Answer(found)
    return replace(answer, record=replace(found, faults=faults, wall_s=perf_counter() - start))
