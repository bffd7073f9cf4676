"""Parts of a record in words: repeats, errors, misfit, calibrated numbers; what acts, statuses, laws.

Headline, table and last line share the names of `sure_and_group`, so that they cannot contradict each other.
"""

from collections.abc import Iterable, Iterator
from math import isfinite, log

import numpy as np

from taichi_erosion.evidence import record as parts
from taichi_erosion.evidence.race.priors import ADEQUATE, FAMILYWISE, SURE
from taichi_erosion.evidence.record import Interval, LawPart, Record
from taichi_erosion.evidence.words import vocabulary as say
from taichi_erosion.tables.number_words import count_noun, heading, plain

FAR = 2.0  # sd of a row, mean distance from which a model does not follow the rows by its numbers
UNITS = {57.3: "degrees for radians", 100.0: "percent for a share", 10.0: "another unit", 1e3: "another unit"}
TESTED = {"confirmed": "confirm the answer", "undecided": "leave it open"}
FAULTS = {  # of a set-up
    "source_changed": "{} has changed since `study new`: run it again to take over the changes",
    "unit": "{}: its rows are about {} times what the calibrated model says{}: check the unit of its column",
    "scatter": "{}: repeats scatter {} times as much as is stated: "
    "a condition that the table lacks, or an sd stated too small",
    "repeats": "{}: repeats in {} differ by {}: check {}",
    "too_few_rows": "too few rows to tell effects apart: {} under different conditions; at least {} are "
    "needed to calibrate {} and to test an effect",
    "held_out": "; {} more are held out (none with fraction = 0, no ranges and no sources under [vault])",
    "unknown_scatter": "no row has an sd, no repeats differ: the scatter is unknown; add either, or "
    "say --sd 'NAME=8 %'",
    "repeated_but_for": "; rows are alike but for {}: a heading 'note' says that it was measured, not set",
}
PRIORS = {  # that are halved and doubled
    "nothing": "odds that nothing is missing",
    "unlisted": "odds of what is not in the list",
    "step": "odds of one more effect",
    "typical": "strengths expected",
    "dose": "doses expected",
    "errors": "errors expected",
}
ONE_LESS = " minus one"  # of what a dose counts
AGREED = 0.1  # chance of a misfit from which a model agrees; below ADEQUATE it fails, between it is open
RARELY = "less than one time in ten"  # below AGREED
LIKELY = 0.5  # probability above which an effect acts rather than not
UNLIKE = 2.0  # scatter of repeats over what is stated, from which it is told
NEAR_UNIT = 0.1  # of ln of a factor, within which it is told as that of a unit


def row_list(lines: Iterable[int]) -> str:
    """`row 17`, `rows 4, 17 and 18`."""
    rows = list(map(str, dict.fromkeys(lines)))
    return f"{'row' if len(rows) == 1 else 'rows'} {say.join_words(rows)}"


def errors_line(record: Record, voc: say.Vocabulary, every: bool = True) -> str:
    """Levels, and where wanted `every` error that nobody stated, of rows that can test something."""
    levels = [each for each in record.levels if each.probability >= SURE]
    errors = record.errors if every and can_test_any_effect(record) else ()
    words = say.first_and_count_text([error_text(each, voc) for each in (*levels, *errors)])
    return f"Also: {words}.{' Check method, code and unit.' if levels else ''}" if words else ""


def error_text(error: parts.LevelPart | parts.ErrorPart, voc: say.Vocabulary) -> str:
    """`the pile height reads 0.6 mm (0.4 to 0.8) more than the model at all conditions`."""
    name, label = f"the {say.in_words(error.observable)}", getattr(error, "label", "")
    more, lies = ("more", "above") if error.value > 0.0 else ("less", "below")
    unit = unit_mistake_text(error.value) if error.kind == "factor" else ""
    times, scale = f"{say.interval(error, 3)} times", voc.scale(error.observable)
    along = -scale if error.value < 0.0 else scale  # a difference is counted along its sign
    far = say.interval(error, 2, along, voc.units.value_unit(error.observable))
    size, other = f"{far} {more}", getattr(error, "other", "") or "the others"
    relation = f"is {times} that of" if getattr(error, "is_factor", False) else f"lies {far} {lies}"
    return {
        "factor": f"{name} reads {factor_text(error)} at all conditions{unit}",
        "offset": f"{name} reads {size} than the model at all conditions",
        "scatter": f"the scatter of {name} is {say.interval(error)} times that of sd or repeats",
        "row": f"row {label} reads {name} {size} than the other rows make likely: check it",
    }.get(error.kind, f"{name} of {label} {relation} {other}, beyond what their conditions explain")


def factor_text(size: Interval) -> str:
    """`4.5 % (3.8 to 5.8) more than the model`; a factor of two or more as it is."""
    if not 0.5 < size.value < 2.0:
        return f"{say.interval(size)} times the model"
    sign = 1.0 if size.value > 1.0 else -1.0
    percent = Interval(*(100.0 * sign * (each - 1.0) for each in (size.value, size.low, size.high)))
    return f"{say.interval(percent, unit='%')} {'more' if sign > 0.0 else 'less'} than the model"


def unit_mistake_text(factor: float) -> str:
    """` (percent for a share?)`, where a factor or its inverse is that of a unit."""
    size = abs(log(factor))
    return next((f" ({words}?)" for unit, words in UNITS.items() if abs(size - log(unit)) < NEAR_UNIT), "")


def worst_places(record: Record) -> list[parts.PlacePart]:
    """Places where the model fails if nothing is missing, the worst first."""
    return sorted((each for each in record.where if each.p < ADEQUATE), key=lambda each: each.p)


def failing_places_line(record: Record) -> str:
    """`Where the model fails: the measured flux lies above the model at large moisture (p = 0.002).`"""
    words = []
    for each in worst_places(record):
        at = "everywhere" if each.axis == "level" else f"at large {say.in_words(each.axis)}"
        way = "below" if each.sign < 0 else "above"
        what = f"the measured {say.in_words(each.observable)} lies {way} the model {at}"
        words.append(f"{what} ({say.p_text(each.p)})")
    return f"Where the model fails: {say.first_and_count_text(words)}." if words else ""


def can_test_any_effect(record: Record) -> bool:
    return record.verdict != "not_testable"


def row_count_text(record: Record) -> str:
    return "the other rows" if record.repeats else f"all {count_noun(record.n, 'row')}"


def naming_lowers_misfit(record: Record) -> bool:
    """Whether what is named lowers the misfit, and no held-out rows refute that."""
    vault = record.vault
    worse = vault is not None and vault.chi2_after >= vault.chi2_before and not vault.p_worse >= ADEQUATE
    return record.chi2_after < record.chi2_before and not worse


def agrees(record: Record) -> bool:
    """Whether it agrees as a whole, with repeats, in every place."""
    return not (fails(record) or doubt_text(record))


def doubt_text(record: Record) -> str:
    """What keeps a model that does not fail from agreement; empty where nothing does."""
    from scipy.special import chdtrc

    if any(each.p_as_stated < ADEQUATE for each in record.where):  # and what rows scatter would
        return "has a trend that the stated scatter would not make"
    wide = [(x.factor, x.repeats) for x in record.scatter if x.factor > UNLIKE]
    if unlike := [f for f, freedom in wide if chdtrc(freedom, freedom * f**2) < 0.5 * FAMILYWISE]:
        return f"agrees only because repeats scatter {plain(max(unlike), 2)} times as much as is stated"
    rare = record.p_misfit < AGREED or record.p_lack_of_fit < AGREED
    return f"has a misfit that chance makes {RARELY}" * rare


def fails(record: Record) -> bool:
    """Whether the calibrated model fails as a whole, against repeats, or in a place."""
    return record.p_misfit < ADEQUATE or record.p_lack_of_fit < ADEQUATE or bool(worst_places(record))


def failure_text(record: Record) -> str:
    """`fails on all 30 rows`, or what is unusual of a model that follows the rows."""
    rows = row_count_text(record)
    if record.chi2_per_row_before > 1.0 or record.p_lack_of_fit < ADEQUATE or worst_places(record):
        return f"fails on {rows}"
    numbers = {name: (part.before.value, part.start) for name, part in record.parameters.items()}
    numbers = {name: ends for name, ends in numbers.items() if min(ends) > 0.0}  # no adopted strengths
    gap = record.rows.residuals(record.rows.before) / record.rows.sd  # levels are no part of it
    if any(each.kind == "group" for each in record.errors) or not numbers or np.mean(gap**2) > FAR**2:
        return f"follows {rows}, by levels or set-ups that differ more than is usual"
    name = max(numbers, key=lambda each: abs(np.log(np.divide(*numbers[each]))))
    ends, title = [plain(number, 3) for number in numbers[name]], say.in_words(name.rpartition(".")[2])
    return f"follows {rows}, by an unusual {title}, {' where about '.join(ends)} is expected"


def agreement_text(record: Record) -> str:
    """`agrees with all 30 rows if the sand flux scatters 2.9 times as much as its sd or repeats`."""
    wide = (each for each in record.errors if each.kind == "scatter" and each.low > 1.0)
    sizes = (f"the {say.in_words(each.observable)} scatters {plain(each.value, 2)} times" for each in wide)
    words = [f"{size} as much as its sd or repeats" for size in sizes]
    words += ["set-ups differ"] * any(each.kind == "group" for each in record.errors)
    return f"agrees with {row_count_text(record)}{f' if {say.join_words(words)}' if words else ''}"


def scatter_line(record: Record, voc: say.Vocabulary) -> str:
    """`Scatter of single measurements: flux 8 %, from repeats or blocks (40 degrees of freedom).`"""
    words = []
    for each in record.scatter:
        share, name = each.kind == "factor", each.observable
        size = f"{plain(100.0 * each.sd, 2)} %" if share else voc.units.value_text(name, each.sd)
        repeats = f"repeats or blocks ({each.repeats} degrees of freedom)"
        origin = repeats if each.repeats else "what is stated"
        both = f"what is stated and {origin}, which scatter {plain(each.factor, 2)} times as much"
        words.append(f"{say.in_words(name)} {size}, from {both if isfinite(each.factor) else origin}")
    return f"Scatter of single measurements: {say.first_and_count_text(words)}." if words else ""


def misfit_line(record: Record, added: str) -> str:
    """Misfit of the fitted rows before and after what is added."""
    if not added:
        return ""
    before, after = plain(record.chi2_per_row_before, 2), plain(record.chi2_per_row_after, 2)
    words = f"Misfit per fitted row: {before} before ({say.p_text(record.p_misfit)}), {after} with {added}"
    p, fresh = record.p_misfit_after, record.fresh_runs
    rest = " The model still fails: something else acts too, or by another law." * (p < ADEQUATE)
    if fresh is not None and fresh.outcome in TESTED:
        rest += f" {count_noun(fresh.runs, 'new simulation')} {TESTED[fresh.outcome]}."
    return f"{words} ({say.p_text(p)}); 1 is chance.{rest}"


def calibrated_numbers_line(record: Record, before: bool, without: str = "") -> str:
    """Calibrated numbers; those that were biased without an effect, or that end at the end of their range."""
    words, ends = [], []
    without = "" if record.p_misfit_after < ADEQUATE else without
    last = [path.rpartition(".")[2] for path in record.parameters]
    for end, (path, each) in zip(last, record.parameters.items(), strict=True):
        name = say.in_words(end) if last.count(end) == 1 else path
        has_moved = not each.low <= each.before.value <= each.high
        biased = f", biased without {without}: {plain(each.before.value, 3)}" if without and has_moved else ""
        words.append(f"{name} {say.interval(each.before if before else each, 3)}{biased}")
        ends += [name] * each.at_end
    more = f" At the end of the searched range: {say.join_words(ends)}; check range and unit." if ends else ""
    return f"Calibrated: {say.first_and_count_text(words)}.{more}" if words else ""


def observable_misfit_rows(record: Record, voc: say.Vocabulary) -> Iterator[tuple[str, ...]]:
    """Misfit of every observable: rows, root of the mean squared error, mean error, where the model fails."""
    names = np.array(record.rows.observable)
    for name in dict.fromkeys(record.rows.observable):
        gap = voc.scale(name) * record.rows.residuals(record.rows.before)[names == name]
        axes = ", ".join(say.in_words(each.axis) for each in worst_places(record) if each.observable == name)
        errors = plain(float(np.sqrt(np.mean(gap**2))), 2), plain(float(np.mean(gap)), 2)
        title = heading(say.in_words(name), voc.units.value_unit(name))
        yield title, str(gap.size), *errors, axes or "nowhere"


def sure_and_group(decided: parts.DecisionPart) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What acts for sure, and of what one does; nothing where new runs of the scene change the answer."""
    if decided.verdict == "unstable":
        return (), ()
    mechanisms = decided.acting_mechanisms
    firm = mechanisms if decided.together or len(mechanisms) == 1 else ()
    return (*decided.named, *firm), (*decided.group, *(() if firm else mechanisms))


def acting_text(decided: parts.DecisionPart) -> str:
    """`cohesion and either a or b`, `something not in the list`, `nothing`."""
    firm, either = sure_and_group(decided)
    unnamed = {"outside_library": "something not in the list"}.get(decided.verdict, "nothing")
    return say.join_words(filter(None, (*firm, say.join_words(either, "or")))) or unnamed


def prior_change_text(record: Record) -> str:
    """`no name moves`, `cohesion is told, nothing only where errors expected are doubled`."""
    usual, places = acting_text(record), dict[str, list[str]]()
    for prior, answers in record.sensitivity.items():
        for way, each in zip(("halved", "doubled"), answers, strict=True):
            places.setdefault(acting_text(each), []).append(f"{PRIORS[prior]} are {way}")
    moves = [f"{n} only where {say.join_words(at, 'or')}" for n, at in places.items() if n != usual]
    return f"{usual} is told, {say.join_words(moves)}" if moves else "no name moves"


def answer_probability(decision: parts.DecisionPart, other: parts.DecisionPart) -> float:
    """Probability of an answer under other priors: that all of it acts, and one of what is not told apart."""
    firm, either = map(set, sure_and_group(decision))
    if not (firm or either):
        return other.unlisted if decision.verdict == "outside_library" else other.probabilities["none"]
    sets = {key: {*key.split("+")} for key in other.probabilities}
    return sum(other.probabilities[k] for k, n in sets.items() if firm <= n and (not either or either & n))


def headline_text(record: Record, voc: say.Vocabulary) -> str:
    firm, either = ([cause_text(name, record, voc) for name in names] for names in sure_and_group(record))
    chance = say.probability_text(record.unlisted)
    if firm or either:
        words = say.join_words([*firm, f"either {say.join_words(either, 'or')}"] if either else firm)
        open_ = "; these measurements do not tell which" if either else ""
        outside = {*record.acting_mechanisms}.difference(record.effects)
        more = ["Not in the list of effects."] * bool(outside)
        if record.unlisted >= SURE and not record.acting_mechanisms:
            words = f"{words}, and beside it something not in the list (probability {chance})"
            more = [*curve_texts(record, voc)]
        more += [f"Also: {imitation_text(record, voc)}"] * bool(record.imitators)
        return " ".join([f"Missing: {words}{open_}.", *more])
    if record.verdict == "outside_library":
        words = "something not in the list; no listed effect explains the data as the columns are read"
        return " ".join([f"Missing: {words} (probability {chance}).", *curve_texts(record, voc)])
    return no_name_sentence(record, voc)


def curve_texts(record: Record, voc: say.Vocabulary) -> Iterator[str]:
    """`It acts with moisture: the angle of repose rises to about 2 % and falls relative to the model.`"""
    words = dict[str, list[str]]()
    for curve in record.curves:
        at = voc.units.condition_text(curve.condition, curve.turn) if isfinite(curve.turn) else ""
        turns = {"peak": f"rises to about {at} and falls", "trough": f"falls to about {at} and rises"}
        name = say.join_words(map(say.in_words, (curve.condition, *curve.alike)), "or")
        name += ", which vary together in these rows" * bool(curve.alike)
        name += ", which no effect reads under this name" * (curve.unread and not curve.alike)
        shape = turns.get(curve.shape, f"{curve.shape} with it")
        words.setdefault(name, []).append(f"the {say.in_words(curve.observable)} {shape}")
    return (
        f"It acts with {name}: {say.join_words(each)} relative to the model." for name, each in words.items()
    )


def cause_text(name: str, record: Record, voc: say.Vocabulary) -> str:
    """An effect or mechanism with its law, or its strength."""
    law, part, title = record.law, record.effects.get(name), voc.effect_title(name)
    if law is not None and law.mechanism == name:
        return f"{title} with the law {law_text(law, voc)}"
    if part is None or name not in record.named:
        return title
    return f"{title} with strength {strength_text(part)}"


def strength_text(part: parts.EffectPart) -> str:
    """Strength with its interval; that it reaches the end of the list."""
    limit = f", at the limit of the list, {plain(part.most, 2)}" if part.strength_high >= part.most else ""
    return f"{say.interval(part.strength_range)}{limit}"


def law_text(law: LawPart, voc: say.Vocabulary) -> str:
    """`factor = 1 + 0.8 (moisture / 5 %)^1.2`, in the units of the table."""
    numbers = {name: plain(number.value, 2) for name, number in law.numbers.items()}
    numbers |= {name: voc.units.condition_size_text(*size) for name, size in law.sizes.items()}
    text = (law.template or law.expression).format(**numbers)
    counts = voc.doses.get(law.mechanism.partition(":")[0], "strength")
    if counts.endswith(ONE_LESS):
        counts, text = counts.removesuffix(ONE_LESS), f"1 + {text}".replace("+ -", "- ")
    return f"{counts} = {text}"


def law_line(record: Record) -> str:
    """How well the law of what acts is known."""
    law, (firm, either) = record.law, sure_and_group(record)
    if law is None or law.mechanism not in (*firm, *either):
        return ""
    free = [f"the exponent of {name} is {say.interval(power)}; " for name, power in law.powers.items()]
    share = f"{100.0 * law.held_out_share:.0f} % of the misfit at conditions left out of its fit"
    return f"Law: {''.join(free)}it explains {share}."


def no_name_sentence(record: Record, voc: say.Vocabulary) -> str:
    if record.verdict == "unstable":
        names = say.join_words(map(voc.effect_title, (*record.named, *record.group)), "or")
        change = TESTED.get(record.fresh_runs.outcome if record.fresh_runs else "", "change the answer")
        return f"No effect is named: new runs of the scene {change}. Candidates: {names}."
    if not can_test_any_effect(record):
        return "No effect is named before the errors above are fixed."
    if record.refuted or record.imitators:
        return withheld_name_sentence(record, voc)
    leading, share = max(record.probabilities.items(), key=lambda item: item[1])
    places, chances = worst_places(record), [record.p_misfit, record.p_lack_of_fit]
    state = failure_text(record) if fails(record) else agreement_text(record)
    if not fails(record) and (words := doubt_text(record)):
        state, chances = words, [*chances, *(each.p_as_stated for each in record.where)]
    state = f"the model {state} ({say.p_text(float(np.nanmin([*chances, *(each.p for each in places)])))})"
    if not (record.effects or record.where):
        return f"No effect is named: {state}; no condition varies along which one could be seen."
    level = max((each.probability for each in record.levels), default=0.0) >= SURE
    alike = agrees(record) and share >= LIKELY and all(each.kind != "group" for each in record.errors)
    trend = places or any(each.p_as_stated < ADEQUATE for each in record.where)
    if leading == "none" and (alike or (share >= SURE and level and not trend)):
        none = f"probability that none acts: {say.probability_text(share)}"
        return f"No missing effect is seen: {state}{' by errors of measurement' * fails(record)}; {none}."
    why = f"; a name needs {SURE:g}" * (leading not in ("none", "each_set_up"))
    if why and share >= SURE:
        why = f"; among so many candidates one looks as good by chance with {say.p_text(record.p)}"
    titles = say.join_words(map(voc.effect_title, leading.split("+")))
    name = say.EXPLANATIONS.get(leading, f"{titles} alone")
    share = share if share >= SURE else min(share, SURE - 0.01)  # not 0.90 where 0.9 is missed
    best = f"the likeliest, {name}, has probability {say.probability_text(share)}{why}"
    return f"No effect is named: {state}. Of all explanations {best}."


def imitation_text(record: Record, voc: say.Vocabulary) -> str:
    """`A would explain the data, but so would clay; ...`, of columns that vary with an effect's condition."""
    names = say.join_words(map(voc.effect_title, record.imitators), "or")
    at = say.join_words(map(say.in_words, dict.fromkeys(sum(record.imitators.values(), ()))), "or")
    why = "in these rows the two vary together, and either may act: measure at one value of it"
    other = "begin its heading with 'note' if it cannot act"
    return f"{names} would explain the data, but so would {at}; {why}, or {other}."


def withheld_name_sentence(record: Record, voc: say.Vocabulary) -> str:
    """Why what explains the rows best is not named, and what that means."""
    refuted = [record.effects[name] for name in record.refuted]
    if record.imitators:
        return f"No effect is named: {imitation_text(record, voc)}"
    why = "the rows do not agree with its law: another law or effect acts, or they scatter more than stated"
    if record.vault is not None:
        why = "`adopt` found the model no better with it"
    elif strong := [part for part in refuted if part.strength > part.most]:
        size = f"{say.interval(strong[0].strength_range)}, where the list ends at {plain(strong[0].most, 2)}"
        why = f"with a strength of {size}: check the units, or something else acts"
    names = say.join_words(map(voc.effect_title, record.refuted))
    return f"No effect is named: {names} would explain the data best, but {why}."


def candidate_status_text(name: str, record: Record) -> str:
    firm, either = sure_and_group(record)
    if name in firm:
        return "present"
    if name in either:
        others = say.join_words((n for n in either if n != name), "or")
        return f"not told apart from {others}; one of them acts"
    part = record.effects[name]
    if part.status == "excluded":
        return f"excluded above {plain(part.limit, 2)}"
    words = f"cannot be ruled out below {plain(part.unseen_below, 2)}"
    if name in record.refuted:
        words = "likely, but the model fails with it"
    elif part.status == "better_but_not_sufficient":
        words = "better than nothing but not sufficient"
    elif part.probability > LIKELY:
        words = "likely, but not sure"
    elif part.status == "untestable" or not part.unseen_below < part.most:
        words = "not testable here"
    return f"{words}; not told apart from {say.join_words(part.alike, 'or')}" if part.alike else words


def candidate_table_rows(record: Record) -> Iterator[tuple[str, ...]]:
    """Candidates and mechanisms: what acts first, then by probability; a strength where it likely acts."""
    acts = [name for names in sure_and_group(record) for name in names]
    chances = {name: record.probabilities.get(name, 0.0) for name in acts}
    chances |= {name: part.probability for name, part in record.effects.items()}
    for name in sorted(chances, key=lambda name: (name not in acts, -chances[name])):
        part = record.effects.get(name)
        strength = strength_text(part) if part and (name in acts or part.probability >= LIKELY) else "-"
        yield name, candidate_status_text(name, record), strength, say.probability_text(chances[name])
