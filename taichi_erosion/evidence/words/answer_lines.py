"""Answers of `compare`, `discover`, `adopt` and `next` as lines and one table, for terminal, page and Python.

Every line has its place: an answer has at most eight, and one table.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isnan

from taichi_erosion.evidence.data.number_words import counted, heading, plain
from taichi_erosion.evidence.race.record import ExperimentPart, HeldOutPart, Record
from taichi_erosion.evidence.words import data_words, effect_words
from taichi_erosion.evidence.words import vocabulary as say
from taichi_erosion.evidence.words.data_words import agrees, sufficient
from taichi_erosion.evidence.words.vocabulary import Vocabulary

COMPARED = ("observable", "rows", "rms error", "mean error", "fails along")


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
        """All sentences."""
        return *self.missing, *self.holds, *self.following


def kept(*lines: str) -> tuple[str, ...]:
    """Lines that say something."""
    return tuple(line for line in lines if line)


def compare_answer(record: Record, voc: Vocabulary) -> Answer:
    """Whether the calibrated model agrees, and where it fails."""
    repeats, where = data_words.repeats_line(record, voc), data_words.where_line(record)
    last = f"{voc.command('discover', voc.study)} asks which effect is missing."
    if agrees(record):
        last = f"{voc.command('next', voc.study)} proposes measurements that test the model harder."
    last = again(record, "compare", voc) or last
    return Answer(
        kept(repeats, agreement(record), data_words.errors_line(record, voc), where),
        kept(data_words.repeats_fit_line(record), data_words.numbers_line(record, before=True)),
        kept(data_words.stopped_line(record), last),
        Table("measured minus model", COMPARED, tuple(data_words.observable_rows(record, voc))),
    )


def agreement(record: Record) -> str:
    """The answer of `compare` in one sentence."""
    fit, rows = record.fit, effect_words.rows_text(record)
    if isnan(fit.p_before):
        return (
            "The misfit cannot be judged: the scatter is unknown. Add a column sd, or repeats, to the table."
        )
    size = f"misfit per row {plain(fit.chi2_before / fit.n, 2)}, 1 is chance; {say.chance(fit.p_before)}"
    if agrees(record):
        return f"The calibrated model agrees with {rows} ({size})."
    return f"The calibrated model fails{'' if say.fails(fit.p_before) else ' in places'} ({rows}: {size})."


def again(record: Record, command: str, voc: Vocabulary) -> str:
    """What comes before every other step: rows to be checked, a scatter to be added."""
    rows, same = data_words.suspects(record), f"give {voc.command(command, voc.study)} again."
    if rows:
        return f"Correct or confirm {rows} in the table, then {same}"
    return "" if effect_words.testable(record) else f"Complete the table, then {same}"


def discover_answer(record: Record, voc: Vocabulary) -> Answer:
    """What is missing, and how far every candidate is known."""
    names, table = effect_words.acting(record.decided).names, None
    if effect_words.testable(record):
        title = "candidates; strength 1 is the textbook value"
        table = Table(title, effect_words.COLUMNS, tuple(effect_words.effect_rows(record)))
    headline, where = effect_words.headline(record, voc), data_words.where_line(record)
    fit = " ".join(kept(effect_words.law_line(record.law), data_words.fit_line(record, names)))
    return Answer(
        kept(data_words.repeats_line(record, voc), headline, data_words.errors_line(record, voc), where),
        kept(fit, data_words.numbers_line(record, not names, names if sufficient(record) else "")),
        kept(data_words.stopped_line(record), after_discovery(record, voc)),
        table,
    )


def after_discovery(record: Record, voc: Vocabulary) -> str:
    """What to do after a discovery."""
    steps = kept(again(record, "discover", voc).rstrip("."), *acting_steps(record, voc))
    if steps:
        return f"{'; then '.join(steps)}."
    proposals, verdict = voc.command("next", voc.study), record.decided.verdict
    if verdict == "outside_library":
        return f"{voc.command('effects', 'new', 'NAME')} makes an effect of your own; {proposals} asks for more data."
    if verdict == "unstable":
        return f"{voc.command('discover', voc.study)} makes more runs and tests the answer anew."
    return f"{proposals} proposes measurements that {'test what could act unseen' if agrees(record) else 'decide'}."


def acting_steps(record: Record, voc: Vocabulary) -> Iterator[str]:
    """What to do with everything that is said to act."""
    said, named = effect_words.acting(record.decided), record.decided.named
    if named and said.sure:
        yield f"{voc.command('adopt', voc.study, *named)} tests {say.joined(named)} on held-out rows"
    elif said.sure:
        own = voc.command(
            "effects", "new", "NAME", *(("--from-discovery", voc.results) if record.law else ())
        )
        yield f"{own} writes {say.joined(said.sure)} as an effect of your own, and `adopt` tests it"
    if said.either:
        yield f"{voc.command('next', voc.study)} proposes measurements that tell {say.joined(said.either)} apart"


def adopt_answer(record: Record, voc: Vocabulary) -> Answer:
    """Whether the error falls on rows that no fit has seen."""
    held, repeats = record.held_out, data_words.repeats_line(record, voc)
    if held is None or not held.n:
        words = f"No held-out row tests {say.joined(held.adopted if held else record.decided.named)}: do not trust it yet."
        last = f"{voc.command('next', voc.study)} proposes measurements that test it."
        return Answer(kept(repeats, words), (), (last,), None)
    without = say.joined(held.adopted) if adequate(record, held) else ""
    numbers = data_words.numbers_line(record, before=False, without=without) if falls(held) else ""
    last = again(record, "adopt", voc) or after_adoption(record, held, voc)
    return Answer(
        kept(repeats, error_change(record, held)),
        kept(control(held), numbers),
        kept(data_words.stopped_line(record), last),
        error_table(record, held),
    )


def falls(held: HeldOutPart) -> bool:
    """Whether the error of the held-out rows falls."""
    return held.after < held.before


def adequate(record: Record, held: HeldOutPart) -> bool:
    """Whether the error falls, and no misfit is left on held-out and on fitted rows."""
    return falls(held) and not say.fails(held.p_after) and sufficient(record)


def error_change(record: Record, held: HeldOutPart) -> str:
    """Error before and after, and whether the model is adequate with what was adopted."""
    rows, names = counted(held.n, "held-out row"), say.joined(held.adopted)
    change = f"from {plain(held.before, 2)} to {plain(held.after, 2)} per row (1 is chance)"
    if not falls(held):
        return f"The error of {rows} does not fall with {names}: {change.replace('from', 'it goes from')}. Do not adopt it."
    if adequate(record, held):
        return f"The error falls with {names}: {change} on {rows}; what is left is chance ({say.chance(held.p_after)})."
    where = [f"held-out rows ({say.chance(held.p_after)})"] if say.fails(held.p_after) else []
    where += [] if sufficient(record) else [f"fitted rows ({say.chance(record.fit.p_after)})"]
    return (
        f"With {names} the error of {rows} goes {change}, but the model still fails on {say.joined(where)}."
    )


def control(held: HeldOutPart) -> str:
    """What a random other effect does, and how unseen the rows are."""
    end = ", no worse: these rows do not tell which acts" if held.wrong <= held.after else ""
    words = f"Control: with {held.wrong_effect}, drawn at random, it is {plain(held.wrong, 2)} per row{end}."
    seen = f"The held-out rows have been opened {held.opened} times: they are no longer unseen."
    return " ".join(kept("" if isnan(held.wrong) else words, seen if held.opened > 1 else ""))


def after_adoption(record: Record, held: HeldOutPart, voc: Vocabulary) -> str:
    """The study to go on with."""
    if not falls(held):
        return f"Go on with {voc.study}: {voc.command('next', voc.study)} proposes measurements that decide."
    if adequate(record, held):
        return f"Go on with {voc.written}: {voc.command('compare', voc.written)} shows the model with it."
    return f"Go on with {voc.written}: {voc.command('discover', voc.written)} asks what else is missing."


def error_table(record: Record, held: HeldOutPart) -> Table:
    """Misfit per row of fitted and held-out rows, with a control."""
    fit, parts = record.fit, [(name, record.effects.get(name)) for name in held.adopted]
    before, after = (plain(chi2 / fit.n, 2) for chi2 in (fit.chi2_before, fit.chi2_after))
    added = say.joined(f"{name} {effect_words.strength_text(part)}" if part else name for name, part in parts)
    rows = [("before", before, plain(held.before, 2)), (f"with {added}", after, plain(held.after, 2))]
    rows += [] if isnan(held.wrong) else [(f"control: {held.wrong_effect}", "-", plain(held.wrong, 2))]
    columns = ("model", f"{fit.n} fitted rows", f"{held.n} held-out rows")
    return Table("misfit per row (1 is chance)", columns, tuple(rows))


def next_answer(record: Record, voc: Vocabulary) -> Answer:
    """The measurements that would decide."""
    repeats, stopped = data_words.repeats_line(record, voc), data_words.stopped_line(record)
    keys = list(dict.fromkeys(key for each in record.experiments for key in each.predictions))
    if not keys:
        words = "No measurement within reach would tell the explanations apart any better: stop here."
        return Answer(kept(repeats, words), (), kept(stopped), None)
    words = say.joined(map(voc.explanation, keys), "from" if len(keys) == 2 else "and")
    last = f"Add the new rows to the table and give {voc.command('discover', voc.study)} again."
    expects = (f"expected by {say.EXPLANATIONS.get(key, key)}" for key in keys)
    columns = ("measure", "at", *expects, "chance to decide, with those above", "cost")
    rows = tuple(experiment_row(each, keys, voc) for each in record.experiments)
    table = Table("next measurements, the best first", columns, rows)
    return Answer(
        kept(repeats, f"These measurements would separate {words}."), (), kept(stopped, last), table
    )


def experiment_row(found: ExperimentPart, keys: list[str], voc: Vocabulary) -> tuple[str, ...]:
    """Where to measure, what each explanation expects, the chance to decide."""
    name, at = found.observable, voc.units.setting_text(found.conditions)
    expected = [found.predictions.get(key) for key in keys]
    values = (say.interval(each, 3, voc.scale(name)) if each else "-" for each in expected)
    unit = voc.units.value_unit(name)
    return heading(name, unit), at, *values, say.probability(found.chance), plain(found.cost, 2)
