"""Answers of `compare`, `discover`, `adopt`, `next` and `predict` as lines and one table.

Every line has its place: an answer has at most eight, and one table.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf, isnan
from pathlib import Path
from typing import Any

from taichi_erosion.evidence import record as records
from taichi_erosion.evidence.data.table_units import DAY, TableUnits
from taichi_erosion.evidence.race.priors import ADEQUATE, SURE
from taichi_erosion.evidence.record import Interval, Record
from taichi_erosion.evidence.words import part_words
from taichi_erosion.evidence.words import vocabulary as say
from taichi_erosion.scene.physical_ranges import range_at
from taichi_erosion.tables.number_words import count_noun, heading, plain, toml_key, with_unit

LIKELIER = 0.5  # probability from which a set is likelier than all others together
HARDER = "Measurements under other conditions test the model harder"
COMPARED = ("observable", "rows", "rms error", "mean error", "fails along")
CANDIDATES = ("effect", "status", "strength (90 %)", "probability")
INTERVALS = ("value (90 %)", "90 % of one measurement", "outside")


@dataclass(frozen=True)
class Table:
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


def trim_answer(answer: Answer, record: Record) -> Answer:
    """An answer without empty lines, and a spent budget before the last one."""
    spent = f"Stopped at the budget ({count_noun(record.settings, 'setting')} of the model)"
    stopped = f"{spent}: this is known so far; a larger --budget may change it." * bool(record.stopped)
    parts = answer.missing, answer.holds, (stopped, *answer.following)
    missing, holds, following = (tuple(filter(None, part)) for part in parts)
    return Answer(missing, holds, following, answer.table)


def first_step_text(record: Record, command: str, voc: say.Vocabulary, *words: str) -> str:
    """What comes before every other step: rows to be checked, a set-up to be settled."""
    if not record.repeats and part_words.can_test_any_effect(record):
        return ""
    first = "Correct or confirm the repeats that differ" if record.repeats else "Fix the errors above"
    return f"{first} and run {voc.command(command, voc.study, *words)} again"


def compare_answer(record: Record, voc: say.Vocabulary) -> Answer:
    """Whether the calibrated model agrees, and where it fails."""
    first, last = comparison_lines(record, voc)
    errors = part_words.errors_line(record, voc, part_words.agrees(record))
    missing = first, errors, part_words.failing_places_line(record)
    holds = (part_words.scatter_line(record, voc), part_words.calibrated_numbers_line(record, before=True))
    table = Table("measured minus model", COMPARED, tuple(part_words.observable_misfit_rows(record, voc)))
    following = (f"{first_step_text(record, 'compare', voc) or last}.",)
    return trim_answer(Answer(missing, holds, following, table), record)


def comparison_lines(record: Record, voc: say.Vocabulary) -> tuple[str, str]:
    rows, p = part_words.row_count_text(record), record.p_lack_of_fit
    size = f"misfit per row {plain(record.chi2_per_row_before, 2)}, where 1 is chance"
    size += f"; {say.p_text(record.p_misfit)}"
    size += "" if isnan(p) else f"; against repeats alone {say.p_text(p)}"
    if part_words.agrees(record):
        return f"The calibrated model {part_words.agreement_text(record)} ({size}).", HARDER
    last = f"{voc.command('discover', voc.study)} asks which effect is missing"
    if not (record.p_misfit < ADEQUATE or part_words.worst_places(record)):
        words = "The means scatter about the calibrated model more than their repeats allow"
        words = words if part_words.fails(record) else f"The calibrated model {part_words.doubt_text(record)}"
        return f"{words} ({rows}: {size}): preparations differ, or something is missing.", last
    failing = part_words.failure_text(record)
    if not failing.startswith("fails"):
        return f"The calibrated model {failing} ({size}): check grains and units, or something acts.", last
    places = "" if record.p_misfit < ADEQUATE else " in places"
    return f"The calibrated model fails{places} ({rows}: {size}).", last


def discover_answer(record: Record, voc: say.Vocabulary) -> Answer:
    """What is missing, and how far every candidate is known."""
    firm, either = part_words.sure_and_group(record)
    names = part_words.acting_text(record) if firm or either else ""
    fit = " ".join(filter(None, (part_words.law_line(record), part_words.misfit_line(record, names))))
    numbers = part_words.calibrated_numbers_line(record, before=not names, without=names)
    rows = tuple(part_words.candidate_table_rows(record)) if part_words.can_test_any_effect(record) else ()
    table = Table("candidates; strength 1 is the textbook value", CANDIDATES, rows) if rows else None
    headline, errors = part_words.headline_text(record, voc), part_words.errors_line(record, voc)
    missing = headline, errors, part_words.failing_places_line(record)
    vault = record.vault
    before, _, last = adoption_lines(record, vault, voc) if vault and vault.n else ("", "", "")
    holds = fit, before and f"Adopted before: {before[0].lower()}{before[1:]}", numbers
    return trim_answer(Answer(missing, holds, (discovery_steps_text(record, voc, last),), table), record)


def sensitivity_table(record: Record) -> Table | None:
    """What depends on the priors; None where the answer rests on something else."""
    title = f"priors halved and doubled (probability of the answer): {part_words.prior_change_text(record)}"
    rows = []
    for prior, answers in record.sensitivity.items():
        chances = (say.probability_text(part_words.answer_probability(record, each)) for each in answers)
        cells = map("{} ({})".format, map(part_words.acting_text, answers), chances)
        rows.append((part_words.PRIORS[prior], *cells))
    return Table(title, ("prior", "halved", "doubled"), tuple(rows)) if rows else None


def discovery_steps_text(record: Record, voc: say.Vocabulary, adopted: str) -> str:
    proposals = voc.command("next", voc.study)
    steps = first_step_text(record, "discover", voc), *([adopted] if adopted else action_texts(record, voc))
    if words := "; then ".join(filter(None, steps)):
        return f"{words}."
    if record.verdict == "outside_library" or record.refuted:
        curve = f"{voc.command('report', voc.study)} draws the curve; " * bool(record.curves)
        command = voc.command("effects", "new", "NAME")
        return f"{curve}{command} makes an effect of your own, and `adopt` tests it."
    if record.fresh_runs is not None and record.fresh_runs.more_runs:
        return f"{voc.command('discover', voc.study)} makes more runs and tests the answer anew."
    return f"{HARDER}." if part_words.agrees(record) else f"{proposals} asks which measurements would decide."


def action_texts(record: Record, voc: say.Vocabulary) -> Iterator[str]:
    """What to do with everything that is said to act."""
    (firm, either), named = part_words.sure_and_group(record), record.named
    if named and firm:
        yield f"{voc.command('adopt', voc.study, *named)} tests {say.join_words(named)} on held-out rows"
    elif firm:
        origin = ["--from-discovery", voc.results] * bool(record.law)
        words = voc.command("effects", "new", "NAME", *origin)
        yield f"{words} writes {say.join_words(firm)} as an effect of your own, and `adopt` tests it"
    if either:
        yield f"{voc.command('next', voc.study)} asks which measurements tell {say.join_words(either)} apart"


def adopt_answer(record: Record, voc: say.Vocabulary) -> Answer:
    """Whether the error falls on rows that no fit has seen."""
    vault = record.vault
    if vault is None or not vault.n:
        names, proposals = say.join_words(record.named), voc.command("next", voc.study)
        words = f"No held-out row tests {names}: {proposals} asks which measurements do."
        return trim_answer(Answer((words,), (), (), None), record)
    first, numbers, last = adoption_lines(record, vault, voc)
    following = (f"{first_step_text(record, 'adopt', voc, *vault.adopted) or last}.",)
    holds = control_sentence(record, vault, voc), numbers
    return trim_answer(Answer((first,), holds, following, error_table(record, vault)), record)


def adoption_lines(record: Record, vault: records.HeldOutPart, voc: say.Vocabulary) -> tuple[str, str, str]:
    """First line, numbers and last line, from one comparison: the error falls only to an adequate model."""
    rows, names = count_noun(vault.n, "held-out row"), say.join_words(vault.adopted)
    numbers = part_words.calibrated_numbers_line
    before, after = vault.chi2_per_row_before, vault.chi2_per_row_after
    change = f"from {plain(before, 2)} to {plain(after, 2)} per row (1 is chance)"
    way = "falls" if after < before else "rises"
    misfits = {"held-out": vault.p_after, "fitted": record.p_misfit_after}
    failing = [f"{name} rows ({say.p_text(p)})" for name, p in misfits.items() if p < ADEQUATE]
    check = f"Check row {say.join_words(map(str, vault.slips))} of the table"
    slip = f"{check}: ten times too large or too small? Correct it, adopt again" * bool(vault.slips)
    if not part_words.naming_lowers_misfit(record):
        last = f"Go on with {voc.study}: {voc.command('next', voc.study)} asks which measurements decide"
        ends = record.chi2_per_row_before, record.chi2_per_row_after
        fitted = " to ".join(plain(each, 2) for each in ends)
        first = f"The model is no better with {names}: the error of fitted rows goes from {fitted}"
        return f"{first}, that of {rows} {change}. Do not adopt.", "", slip or last
    if failing:
        last = f"Go on with {voc.sequel}: {voc.command('discover', voc.sequel)} asks what else is missing"
        first = f"With {names} the error of {rows} {way} {change}, and the model still fails"
        return f"{first}: {say.join_words(failing)}.", numbers(record, before=False), slip or last
    hardly = "hardly " * (vault.p_after < part_words.AGREED)
    remainder = f"what is left is {hardly}chance ({say.p_text(vault.p_after)})"
    first = f"The error falls with {names}: {change} on {rows}; {remainder}."
    if after >= before or vault.chi2_per_row_wrong_effect <= after:  # another effect does as well
        first = f"The {rows} hardly test {names}: their error goes {change}; {remainder}."
    last = f"Go on with {voc.sequel}: {voc.command('compare', voc.sequel)} shows the model with it"
    return first, numbers(record, before=False, without=names), last


def control_sentence(record: Record, vault: records.HeldOutPart, voc: say.Vocabulary) -> str:
    """What a random other effect does, what no row needs, and how varied and unseen the rows are."""
    sets, whole = {frozenset(key.split("+")): p for key, p in record.probabilities.items()}, {*vault.adopted}
    idle = [each for each in vault.adopted if sets.get(frozenset(whole - {each}), 0.0) > LIKELIER]
    wrong = vault.chi2_per_row_wrong_effect
    end = ", no worse: these rows do not tell which acts" if vault.p_after >= ADEQUATE else ", less than that"
    end *= wrong <= vault.chi2_per_row_after
    other = f"Control: another effect drawn at random, {vault.wrong_effect}, gives {plain(wrong, 2)} per row"
    words = "No control: the study has no other candidate." if isnan(wrong) else f"{other}{end}."
    openings = f" The held-out rows have been opened {vault.opened} times: they are no longer unseen."
    alike = f" All held-out rows have {voc.units.conditions_text(vault.alike)}: no other value is tested."
    needless = f" The rows need no {say.join_words(idle)}: without it they are explained as well."
    return words + needless * bool(idle) + alike * bool(vault.alike) + openings * (vault.opened > 1)


def error_table(record: Record, vault: records.HeldOutPart) -> Table:
    """Misfit per row of fitted and held-out rows, with a control."""
    parts, wrong = [(n, record.effects.get(n)) for n in vault.adopted], vault.chi2_per_row_wrong_effect
    names = (f"{name} {part_words.strength_text(part)}" if part else name for name, part in parts)
    addition = say.join_words(names)
    rows = [
        ("before", plain(record.chi2_per_row_before, 2), plain(vault.chi2_per_row_before, 2)),
        (f"with {addition}", plain(record.chi2_per_row_after, 2), plain(vault.chi2_per_row_after, 2)),
    ]
    rows += [] if isnan(wrong) else [(f"control: {vault.wrong_effect}", "-", plain(wrong, 2))]
    columns = ("model", f"{record.n} fitted rows", f"{vault.n} held-out rows")
    return Table("misfit per row (1 is chance)", columns, tuple(rows))


def next_answer(record: Record, voc: say.Vocabulary) -> Answer:
    keys = list(dict.fromkeys(key for each in record.next_experiments for key in each.predictions))
    if not keys:
        sets = {frozenset(key.split("+")): p for key, p in record.probabilities.items()}
        share = sum(p for names, p in sets.items() if names >= max(sets, key=lambda each: sets[each]))
        chance = say.probability_text(share)
        words = f"One explanation has probability {chance}; measurements are proposed where more are left."
        if record.refuted and record.verdict == "none_detected":
            words = f"The rows do not agree with the likeliest explanation (probability {chance})."
        elif share < SURE:
            words = "No measurement in the present ranges separates the explanations."
        words += other_ranges_text(record, voc) * (share < SURE)
        if not part_words.can_test_any_effect(record):
            words = "No measurement is proposed before the errors above are fixed."
        return trim_answer(Answer((words,), (), (), None), record)
    leading, more = keys[: say.MOST_TOLD], len(keys) - say.MOST_TOLD
    names = [*map(explanation_name, leading), *([count_noun(more, "other explanation")] if more > 0 else [])]
    words = say.join_words(names, "from" if len(names) == 2 else "and")
    reading = "Add the new rows to the table, read it again with `study new`"
    last = f"{reading}, and run {voc.command('discover', voc.study)} again."
    expects = (f"expected by {explanation_name(key)}" for key in leading)
    columns = ("measure", "at", *expects, "chance to decide, with those above", "cost")
    rows = tuple(experiment_table_row(each, leading, voc) for each in record.next_experiments)
    table = Table("next measurements, the best first", columns, rows)
    return trim_answer(Answer((f"These measurements would separate {words}.",), (), (last,), table), record)


def other_ranges_text(record: Record, voc: say.Vocabulary) -> str:
    """How to have measurements proposed beyond the present conditions, up to twice as far."""
    columns = {name: x for name, x in record.rows.conditions.items() if x.min() < x.max() and name != DAY}
    possible = {name: range_at(f"conditions.{name}") for name in columns}
    limits = {name: (each.usual or (0.0, each.high))[1] for name, each in possible.items() if each}
    ends = {n: (x.min(), min(2.0 * x.max() - x.min(), limits.get(n, inf))) for n, x in columns.items()}
    spans = [f"{n} {' to '.join(voc.units.condition_text(n, x) for x in each)}" for n, each in ends.items()]
    ranges = ", ".join(f"{toml_key(name)} = [{a:.4g}, {b:.4g}]" for name, (a, b) in ends.items())
    words = f" To look at {say.join_words(spans)}, add to {voc.study}: [laboratory] ranges = {{ {ranges} }}."
    return words if ends else ""


def explanation_name(key: str) -> str:
    """`a + b`, `errors of measurement alone`."""
    return say.EXPLANATIONS.get(key) or key.replace("+", " + ")


def experiment_table_row(
    experiment: records.ExperimentPart, keys: list[str], voc: say.Vocabulary
) -> tuple[str, ...]:
    name, unit = experiment.observable, voc.units.value_unit(experiment.observable)
    expected = (experiment.predictions.get(key) for key in keys)
    values = (say.interval(each, 3, voc.scale(name)) if each else "-" for each in expected)
    at, chance = voc.units.conditions_text(experiment.conditions), say.probability_text(experiment.chance)
    return heading(say.in_words(name), unit), at, *values, chance, plain(experiment.cost, 2)


def prediction_answer(
    prediction: records.PredictionPart, about: Mapping[str, Any], units: TableUnits
) -> Answer:
    """Which model answers, what its intervals rest on, and how they have held."""
    hidden, name, with_ = about["rows_hidden"], Path(about["study"]).name, say.join_words(about["adopted"])
    model = f"the adopted model, with {with_} ({name})" if with_ else f"the calibrated model of {name}"
    every = f"of {count_noun(len(prediction.rows), 'prediction')}"
    new = sum(row.unseen for row in prediction.rows)
    soil = f"; for {new} {every} the soil or batch was not measured (a column `group` names it)" * bool(new)
    again = "adopted before table or study changed, or advised against; `adopt` again takes it in"
    missing = [f"Predicted by {model}.", f"`value` is the model corrected by what its residuals show{soil}."]
    lost = f"Not predicted: {say.join_words(prediction.lost)}, of which no row has a known scatter."
    missing += [lost] * bool(prediction.lost)
    missing += [f"Left out: {say.join_words(prediction.outdated)}, {again}."] * bool(prediction.outdated)
    holds = [coverage_line("fitted rows, each predicted from the others,", prediction.fitted)]
    if prediction.held_out is not None:
        holds += [coverage_line("held-out rows", prediction.held_out)]
    elif hidden:
        holds += [f"{count_noun(hidden, 'held-out row')} are kept for `adopt`."]
    runs = count_noun(prediction.new_runs, "new simulation")
    fresh = sum(row.simulated for row in prediction.rows)
    holds += [f"{runs} answer for {fresh} {every}."] * bool(prediction.new_runs)
    outside = sum(bool(row.outside) for row in prediction.rows)
    none = sum(isnan(row.value) for row in prediction.rows)
    why = "no value: the model could not be run there, or its budget is spent"
    following = [f"{none} {every} {'has' if none == 1 else 'have'} {why}."] * bool(none)
    lie = f"{'lies' if outside == 1 else 'lie'} outside the measured conditions"
    following += [f"{outside} {every} {lie}: nothing checks the model there."] * bool(outside)
    if prediction.constant:
        following += [f"As in the study, not in the table: {units.conditions_text(prediction.constant)}."]
    return Answer(tuple(missing), tuple(holds), tuple(following), prediction_rows(prediction, units))


def coverage_line(rows: str, check: records.CheckPart) -> str:
    """How many measured values lie inside their intervals."""
    if not check.n:
        return f"There are no {rows.rstrip(',')} to check the intervals with."
    few = f": the intervals are too narrow ({say.p_text(check.p)})" * (check.p < ADEQUATE)
    limits = f" {count_noun(check.limits, 'row')} with a limit cannot be checked." * bool(check.limits)
    return f"{check.inside} of {check.n} {rows} lie inside their 90 % interval{few}.{limits}"


def prediction_rows(prediction: records.PredictionPart, units: TableUnits) -> Table | None:
    if not prediction.rows:
        return None
    names = prediction.rows[0].condition_units
    columns = ("observable", *map(heading, names, names.values()), "model", *INTERVALS)
    titles = [heading(say.in_words(r.observable), units.value_unit(r.observable)) for r in prediction.rows]
    places = [[plain(row.conditions[name], 4) for name in names] for row in prediction.rows]
    cells = ((*value_cells(row, units), out_of_range_text(row)) for row in prediction.rows)
    titles = [", ".join(filter(None, (t, row.group))) for t, row in zip(titles, prediction.rows, strict=True)]
    rows = tuple((title, *at, *texts) for title, at, texts in zip(titles, places, cells, strict=True))
    return Table("predictions", columns, rows)


def value_cells(row: records.PredictedPart, units: TableUnits) -> tuple[str, ...]:
    """Model, value with its interval, interval of one measurement; dashes where the model has no value."""
    if isnan(row.value):
        return ("-",) * 3
    scale = units.value(row.observable, 1.0) or 1.0
    value = say.interval(Interval(row.value, row.low, row.high), 3, scale)
    single = f"{plain(scale * row.measured_low)} to {plain(scale * row.measured_high)}"
    return plain(scale * row.model), value, single


def out_of_range_text(row: records.PredictedPart) -> str:
    """`diameter beyond 2487 um`."""
    ends = [f"{n} beyond {with_unit(plain(x, 4), row.condition_units[n])}" for n, x in row.outside.items()]
    return ", ".join(ends + [f"{row.group} not measured"] * (row.unseen and bool(row.group)))


ANSWERS = {"compare": compare_answer, "discover": discover_answer, "adopt": adopt_answer, "next": next_answer}
