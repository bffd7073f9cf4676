"""Meaning of a laboratory's table: what its headings say, and questions about the rest.

Every question has a guess, which counts where nobody is asked. Where a guess could make a wrong answer there
is none: without an answer the question is a fault, with what would settle it.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import accumulate
from math import isnan, nan
from statistics import median

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.tables.column_roles import (
    AIR,
    CONDITION,
    HALF,
    NOT_USED,
    ROUGHNESS_LENGTH,
    UNUSED,
    Column,
    Interview,
    Reading,
    TableOptions,
    check_column_unit,
    columns_with_roles,
    condition_name_of_path,
    find_or_ask_unit,
    parse_roughness_length,
    refuse_other_answer,
    set_user_sd,
)
from taichi_erosion.evidence.data.tables.rows import ERROR_OF_MEAN, STANDARD_ERROR, row_faults
from taichi_erosion.measures.boundary_layer import friction_velocity_ratio
from taichi_erosion.scene.physical_ranges import range_of
from taichi_erosion.tables.cell_numbers import CellNumber, is_missing
from taichi_erosion.tables.headings import (
    FRICTION_VELOCITY,
    HEIGHT,
    SCATTER,
    WINDS,
    has_word,
    heading_holds_value,
    is_summary_word,
    known_words,
    meaning_of,
    plain_words,
    word_length,
    words_of,
)
from taichi_erosion.tables.number_columns import (
    AGAIN,
    column_affects_result,
    do_words_name_kinds,
    follows,
    is_height,
    mean_of_repeats,
    non_conditions,
    numbers_of_simulation,
    own_name,
    ranges_of,
    results_of_heaps,
    stem,
)
from taichi_erosion.tables.spreadsheet import Cells

SEVERAL_SD = re.compile(r"(?i)(?<![\d.,])(?:[2-9]|1[.,]96)\s*(?:σ|sigma|s\.?d\b|std|standard dev)")
MULTIPLE = re.compile(r"[x×*·]\s*10\s*(?:\^|\*\*|[-−⁻]|[⁰¹²³⁴-⁹]|\d\b)")  # of a power of ten in a heading
SPREADS = {"sd": "the standard deviation of single repeats", "se": "the standard error of their mean"}
SPREADS |= {NOT_USED: "not used"}
BESIDE = "the repeats stand beside it"
UNREAD = "no effect of the model reads it"
ASKED = f"{AGAIN}: begin its heading with 'note' if it is computed from it, or say"
BESIDE_ANGLE = "it may be a result of the heap: begin its heading with 'note' if it was measured, or say"
OWN = "own"  # answer of who keeps a column as a condition of its own
BY_SET_UP = "; it changes with the set-up alone: what it does may count as levels of set-ups"
RESERVED = "observable value unit sd n group source vault replicate repeat date note comment remark".split()
TENS = "write numbers in the unit itself, without a power of ten; "
MEASURED = "repose_angle [deg], threshold_u_star [m/s], threshold_wind_speed [m/s], pile_height [m] or flux "
MEASURED += "(mass over time and width, all heights) [kg/(m s)], or one more that `measure` of a scene knows"
STRESS = "of a threshold shear stress give u*t = (stress / density of air)^1/2 [m/s] and its sd; "
PROFILE = "a profile over the height is one measurement: fit u* and z0 to its winds, sum its flux: one row"
BLOCK_DIFFERENCE = 0.05  # of the logarithms of two columns, that days or places may make
CHANCE_OF_REPEATS = 1e-3  # p of columns that differ, below which they are no repeats
ROW_OF_VALUE = "write one row for every measured value, with a column for"
UNLIKE_REPEATS = (
    f"they differ more than repeats: {ROW_OF_VALUE} what differs ('block' where each is a day or a place)"
)
CROSS_TABLE = f"of a cross table {ROW_OF_VALUE} each condition"


def understand_columns(
    cells: Cells, options: TableOptions, interview: Interview, faults: list[str], measured: bool = True
) -> list[Column]:
    """The columns of a table, settled, with units; `measured`: one of them must hold a measured quantity."""
    columns = columns_with_roles(cells, options, faults)
    signs = any("±" in row[c.place] for _, row in cells.lines for c in columns if c.role == "observable")
    if signs and re.search(f"{STANDARD_ERROR.pattern}|{ERROR_OF_MEAN}", cells.titles):
        remedy = "write a column 'SE' with n, or the sd of repeats"
        faults.append(f"{cells.file}: words beside the table make ± a standard error: {remedy}")
    faults += row_faults(cells)
    texts = [cells.titles, *(column.heading.text for column in columns if column.role == "observable")]
    if signs and (several := next(filter(None, map(SEVERAL_SD.search, texts)), None)):
        faults.append(f"{cells.file}: ± is '{several[0]}': write the sd of single repeats, in a column 'SD'")
    faults += design_faults(cells, columns, options) if options.measures else ()
    interview.assume(*cells.notes)
    if faults:  # nobody is asked about a table that has to be corrected
        interview = Interview()
    reading = Reading(cells, options, interview, faults)
    measures = any(column.role == "observable" for column in columns)
    columns = drop_wind_profiles(columns, reading)
    columns = join_repeat_columns(settle_columns(columns, reading, measures), reading)
    columns = drop_row_numbers(columns, reading)
    columns = rename_unread_conditions(list(drop_unusable_columns(columns, reading)), reading)
    unclear = {stem(each.unclear): each for each in columns[::-1] if each.unclear}  # of repeats the first
    for words, column in reversed(unclear.items()):
        read_as = f"column '{column.heading.text}' is read as {column.title or column.name}"
        interview.assume(f"{read_as}; check '{words}' in its heading")
    columns = list(link_sd_and_n_columns(list(recognise_set_up_columns(columns, reading)), reading))
    if measured and not any(column.role == "observable" for column in columns):
        names = MEASURED if options.measures else f"one of {', '.join(options.observables) or 'its own'}"
        stress = any(has_word(each.heading.name, known_words()["computed"]["stress"]) for each in columns)
        tens = any(MULTIPLE.search(each.heading.text) for each in columns)
        faults.append(
            f"{cells.file}: no column is known as a measured quantity; {STRESS * stress}{TENS * tens}say "
            f"which one is: --observable 'COLUMN=NAME', or in a study [columns] 'COLUMN' = NAME; NAME "
            f"{names}; {CROSS_TABLE}"
        )
    columns = [check_column_unit(find_or_ask_unit(column, reading), reading) for column in columns]
    return set_user_sd(columns, cells, options, faults)


def design_faults(cells: Cells, columns: Sequence[Column], options: TableOptions) -> Iterator[str]:
    """Columns of a design of simulations, which the user calls no conditions: nothing was measured there."""
    free = [c for c in columns if c.numeric and (c.role in ("condition", "group", "unknown") or not c.firm)]
    free = [c for c in free if not {c.heading.text, c.heading.name} & {*options.conditions}]
    free = [c for c in free if options.reads is not None or not c.name.startswith("contact.")]  # of a scene
    design = numbers_of_simulation({c.heading.text: [row[c.place] for _, row in cells.lines] for c in free})
    if design:
        audit = f"numbers of a simulation (`taichi-erosion audit {cells.file}` checks its design)"
        words = f"{audit} or coded levels (write what was set); {UNUSED}"
        yield f"{cells.file}: {', '.join(map(repr, design))} are {words}"


def drop_wind_profiles(columns: list[Column], reading: Reading) -> list[Column]:
    """The columns without winds at several heights; these, and winds or fluxes beside heights, are faults."""
    winds = [column for column in columns if not isnan(column.height)]
    heights = [c for c in columns if is_height(c.heading, [n.value for n in reading.numbers(c)])]
    over = {c.name for c in columns if c.role in ("observable", "condition")} & {"flux", *WINDS}
    if len({each.height for each in winds}) > 1 or (heights and (winds or over)):
        names = ", ".join(f"'{column.heading.text}'" for column in (heights or winds))
        reading.faults.append(f"{reading.cells.file}: {names}: {PROFILE}; {UNUSED}")
        columns = [replace(each, height=nan, firm=True) if each in winds else each for each in columns]
    return columns


def settle_columns(columns: Sequence[Column], reading: Reading, measured: bool) -> list[Column]:
    """All columns, settled; numbered siblings of one of which only a guess was known are called as it is."""
    settled, first = list[Column](), dict[str, Column]()
    reading = replace(reading, bed=next((c for c in columns if c.name == ROUGHNESS_LENGTH), None))
    for column in columns:
        name = plain_words(stem(column.heading.name))
        if not column.firm and name in first:
            as_first = {key: getattr(first[name], key) for key in ("role", "name", "title", "unread")}
            column = replace(column, **as_first, near="", firm=True)
        settled.append(settle_column(column, reading, measured))
        if column.numeric and not column.firm and name != plain_words(column.heading.name):
            first[name] = settled[-1]
    return settled


def settle_column(column: Column, reading: Reading, measured: bool) -> Column:
    """A column of which only a guess was known, as the user calls it."""
    interview, text = reading.interview, column.heading.text
    if column.firm or not column.numeric:
        if column.factor == HALF:
            interview.assume(f"diameters of heaps are halved: {column.name} is a radius")
        if column.name in WINDS:
            remedy = "let the heading say the height of a measured wind: 'wind speed at 1 m'"
            interview.assume(f"column '{text}' is the free stream of the wind; {remedy}")
        return column
    if not isnan(column.height):
        return wind_to_friction_velocity(column, reading, measured)
    if column.role == "spread":
        question = f"Column '{text}': " + ", ".join(f"{key} = {words}" for key, words in SPREADS.items())
        check = partial(refuse_other_answer, what=f"column '{text}'", allowed=SPREADS)
        answer = interview.choice(question, "sd", f"column '{text}' holds {SPREADS['sd']}", check)
        return replace(column, role={"sd": "sd", "se": "se"}.get(answer, "remark"), firm=True)
    return ask_unknown_column(column, reading)


def ask_unknown_column(column: Column, reading: Reading) -> Column:
    """A column whose heading says nothing known, as the user calls it."""
    text = column.heading.text
    changed = f"'{column.changed}' makes it another quantity than {column.near}"
    hint = f" {changed}." if column.changed else f" '{column.near}' is near its heading." * bool(column.near)
    unread = reading.options.reads is not None  # as a condition of its own, unless its cells speak against it
    choice = OWN if unread else f"--condition '{column.heading.name}=UNIT'"
    question = (
        f"Column '{text}' is not known.{hint} Type the name of a measured quantity (repose_angle, flux, "
        f"...), a place of the scene (conditions.moisture, ...), {NOT_USED} for a column that is not used, "
        f"{choice} for a condition of your own"
    )
    guess = "" if column.near else OWN if unread else NOT_USED
    meaning = f"column '{text}' is not used: its heading says nothing known" * (guess == NOT_USED)
    read = partial(column_as_answered, column, reading)
    if answer := reading.interview.choice(question, guess, meaning, read):
        return read(answer)
    option = "condition" if "." in column.near else "observable"
    advice = f"say --{option} '{text}={column.near}'"
    if not reading.options.measures:  # a study says itself what there is
        choice = reading.options.titles.get(column.near, column.near.rpartition(".")[2])
        advice = f"head it '{choice}', or name it in [columns] of the study"
    elif column.heading.unit and not range_of(CONDITION + own_name(column.heading.name, (), 0)):
        advice += f"; as a condition of your own --condition '{text}={column.heading.unit}'"
    remedy = known_words()["remedies"].get(column.near, (f"give {column.near} itself",))[0]
    why = f"did you mean {column.near}? If so, {remedy}:"
    if column.changed:
        why = f"{changed}: {remedy}; if it is that,"
    if column.changed and option == "condition" and column.changed not in plain_words(text):  # by its unit
        why, advice = f"{changed}: {remedy}, or", f"--condition '{text}={column.heading.unit}' as your own"
    return reading.reject(column, f"{why} {advice}; {UNUSED}")


def column_as_answered(column: Column, reading: Reading, answer: str) -> Column:
    """A column as the user calls it. Raises BadInput for what no scene measures or has."""
    if answer == NOT_USED:
        return replace(column, firm=True)
    if answer == OWN and reading.options.reads is not None:
        return replace(column, role="condition", unread=True, firm=True)
    role, name = ("condition", answer) if "." in answer else meaning_of(answer)
    if role not in ("observable", "condition"):
        role, name = "observable", answer
    column = replace(column, role=role, name=name, title=condition_name_of_path(name), firm=True)
    if wrong := column_meaning_fault(column, {}, reading.options):
        raise BadInput(f"column '{column.heading.text}': {wrong}")
    return column


def wind_to_friction_velocity(column: Column, reading: Reading, measured: bool) -> Column:
    """A wind that was measured at a height, as the friction velocity that the law of the wall gives."""
    text, height, bed = column.heading.text, column.height, reading.bed
    question = (
        f"Column '{text}' is a wind at {height:g} m, no friction velocity. Roughness length z0 of the bed "
        f"with its unit (flat sand: grain diameter / 30, such as '0.008 mm'), for u* = 0.4 U / ln(z / z0); "
        f"{NOT_USED}: the column is not used"
    )
    check = partial(parse_roughness_length, height=height)
    answer = reading.options.roughness or ("" if bed else reading.interview.choice(question, "", "", check))
    if not answer and bed is None:
        return reading.reject(
            column,
            f"a wind at {height:g} m is no friction velocity; give the roughness length of the bed to `study "
            "new`, --roughness '0.008 mm' (flat sand: grain diameter / 30), a column 'z0 [mm]', or one of u*",
        )
    if answer == NOT_USED:
        return replace(column, firm=True)
    length = parse_roughness_length(answer, height) if answer else nan
    reading.interview.assume(
        f"'{text}' becomes a friction velocity, u* = 0.4 U / ln(z / z0), with z = {height:g} m and the "
        f"roughness length z0 {f'= {length:.3g} m' if answer or not bed else f'of {bed.heading.text!r}'}"
    )
    words = known_words()["asked"]["threshold_u_star"]
    threshold = "threshold" in meaning_of(text)[1] or has_word(text, words) or not measured
    role, name = ("observable", "threshold_u_star") if threshold else ("condition", FRICTION_VELOCITY)
    column = replace(column, role=role, name=name, title=condition_name_of_path(name), firm=True)
    if bed and not answer:
        return replace(column, roughness=bed.place)
    return replace(column, factor=friction_velocity_ratio(height, length))


def drop_unusable_columns(columns: Sequence[Column], reading: Reading) -> Iterator[Column]:
    """The columns without what no scene measures or has, and without a second one for one condition."""
    earlier: dict[str, str] = {}
    bent = [each for each in columns if each.role in ("observable", "condition") and each.heading.law]
    for column in columns:
        used = column.role in ("observable", "condition") and not column.unread
        wrong = column_meaning_fault(column, earlier, reading.options) if used else ""
        alike = [each for each in bent if each.role == "observable" or each.name == column.name]
        if used and MULTIPLE.search(column.heading.text):
            wrong = f"its numbers count in a power of ten: {TENS.rstrip('; ')}"
        if alike and column.role in ("sd", "se", "cv", "condition_sd"):
            wrong = f"'{alike[0].heading.text}' is converted: write scatter behind each value, '0.65 ± 0.01'"
        if used:
            earlier.setdefault(column.name, column.heading.text)
        yield reading.reject(column, wrong) if wrong else column


def column_meaning_fault(column: Column, seen: Mapping[str, str], options: TableOptions) -> str:
    """What is wrong with the meaning of a column; empty where nothing is."""
    if column.name in seen and not column.is_repeat:
        option = f"say what it is with --condition '{column.heading.name}=PATH'"
        method = "write a row for each, with a column 'method' or 'soil' that tells them apart"
        remedy = method if column.role == "observable" else option
        remedy = CROSS_TABLE if heading_holds_value(column.heading) else remedy
        return f"means {column.name}, as column '{seen[column.name]}' does; {remedy}; {UNUSED}"
    if not options.measures:  # a study says itself what there is
        return ""
    if column.role == "observable":
        words = f"no scene measures '{column.name}'; known: {', '.join(options.measures)}"
        return "" if column.name in options.measures else words
    if range_of(column.name) or column.name in options.own_units:
        return ""
    no_place = f"'{column.name}' is no unit and no place of a scene (a condition of your own: COLUMN=g/kg)"
    return f"{no_place}; places: {', '.join(known_words()['conditions'])}"


def rename_unread_conditions(columns: Sequence[Column], reading: Reading) -> list[Column]:
    """The columns; conditions that the model does not read get names of their own, or are not used.

    Which numbers are none, of the air too, `number_columns.py` tells; a column that the user names is one.
    """
    reads, names_of_user = reading.options.reads, reading.options.conditions.values()
    measured = [c.place for c in columns if c.role == "observable"]
    rows = [row for _, row in reading.cells.lines if not all(is_missing(row[place]) for place in measured)]
    if reads is None or not rows:
        return list(columns)
    unread = [c for c in columns if c.role == "condition" and c.name not in reads.difference(AIR)]
    others = [c for c in columns if c.role == "condition" and c.name in reads.difference(AIR)]
    down = accumulate(rows, lambda up, row: tuple(x or y for x, y in zip(row, up, strict=True)))
    filled = [*down] if reading.options.fill_down else rows
    labels = ["|".join(row[c.place] for c in columns if c.role == "group") for row in filled]
    set_ups = np.unique(labels, return_inverse=True)[1].astype(np.float64)
    values = {c: np.array([reading.number(row[c.place]).value for row in filled]) for c in (*unread, *others)}
    results = [np.array([reading.number(row[place]).value for row in rows]) for place in measured]
    cells = {c.heading.text: values[c] for c in unread if c.name not in names_of_user}
    clear = (c for c in unread if not (c.unread or c.unclear or c.name in WINDS))
    conditions = [c.heading.text for c in clear if c.name.startswith(CONDITION)]
    by_heading = {c.heading.text: x for c, x in values.items() if c.heading.text not in cells}
    why = non_conditions(cells, [*results, mean_of_repeats(results)], by_heading, set_ups, conditions)
    signs = {c.heading.text for c in unread if any("±" in row[c.place] for row in rows)}  # measured, not set
    if len(values) > 1 and all(c.name == "repose_angle" for c in columns if c.role == "observable"):
        rest = {text: x for text, x in cells.items() if text not in why}
        names = [*results_of_heaps(rest), *signs.difference(conditions).intersection(rest)]
        why |= dict.fromkeys(names, BESIDE_ANGLE)
    for text in (text for text, reason in why.items() if reason == AGAIN):
        computed = has_word(text, words_of("computed")) and (others or len(why) < len(cells))
        why[text] = AGAIN if computed else ASKED
    unused = ", ".join(f"'{t}' ({why[t]})" for t in why if why[t] not in (ASKED, BESIDE_ANGLE))
    reading.interview.assume(f"not used: {unused}" * bool(unused))
    alone = [c for c, x in values.items() if follows(x, set_ups)]
    alone = alone if len(alone) < len(values) else []
    reasons = {c: why.get(c.heading.text, "") for c in unread}
    return list(settle_unread_columns(columns, reasons, alone, reading))


def settle_unread_columns(
    columns: Sequence[Column], why: Mapping[Column, str], alone: Sequence[Column], reading: Reading
) -> Iterator[Column]:
    """The columns; those of `why` are not used where it tells a reason, else conditions with own names.

    `alone` change with the set-up alone.
    """
    names = [*RESERVED, *(c.title for c in columns if c.role == "condition" and c not in why)]
    for column in columns:
        reason, text = why.get(column), column.heading.text
        if reason in (ASKED, BESIDE_ANGLE):
            condition = f"{column.heading.name}={column.heading.unit or 'UNIT'}"
            column = reading.reject(column, f"{reason} --condition '{condition}' where it was set")
        elif column in why and column.name.startswith("contact.") and not column.unclear:
            wrong = f"sets {column.name}, which is calibrated: leave out --closed-form; {UNUSED}"
            column = reading.reject(column, wrong)
        elif reason:
            column = replace(column, role="remark")
        elif reason == "" and column.name not in (reading.options.reads or ()):
            note = f"column '{text}' is kept as a condition; {UNREAD}{BY_SET_UP * (column in alone)}"
            reading.interview.assume(note)
            if column.unclear or not column.name.startswith(CONDITION):  # a grass cover is no salinity
                name = own_name(column.heading.name, names, column.place)
                column = replace(column, name=CONDITION + name, title=name, unclear="")
            column = replace(column, unread=True)
            names.append(column.title)
        yield column


def recognise_set_up_columns(columns: Sequence[Column], reading: Reading) -> Iterator[Column]:
    """The columns; one of words that name kinds, `crop`, `moisture` of `dry` and `wet`, names set-ups.

    Not where it may repeat a condition that is there in numbers.
    """
    lines, settings = reading.cells.lines, [column for column in columns if column.role == "condition"]
    numbers = {c.heading.text: [reading.number(row[c.place]).value for _, row in lines] for c in settings}
    alike = len({*zip(*(map(repr, each) for each in numbers.values()), strict=True)}) < len(lines)
    labels = ["|".join(row[c.place] for c in columns if c.role == "group") for _, row in lines]
    for column in columns:
        words, (role, name) = [row[column.place] for _, row in lines], meaning_of(column.heading.name)
        unstated = role == "condition" and name not in {each.name for each in settings}
        unknown = column.role == "remark" and (role == "unknown" or unstated)
        again = 1 < len({*labels}) == len({*zip(words, labels, strict=True)})  # the texture of a soil
        kinds = unknown and not column.numeric and not again and do_words_name_kinds(words, alike)
        if kinds and (both := ranges_of(words, numbers)):
            why = f"its words divide '{both}' into ranges, and either may act: head it 'set-up', or 'note' if"
            column = reading.reject(column, f"{why} it repeats '{both}'")
        elif kinds:
            reading.interview.assume(f"column '{column.heading.text}' names set-ups: its words are kinds")
            column = replace(column, role="group")
        yield column


def drop_row_numbers(columns: list[Column], reading: Reading) -> list[Column]:
    """The columns; of set-ups that number the rows, `P 1`, `P 2`, the one with most numbers names none."""
    lines = reading.cells.lines
    settings = [[row[c.place] for _, row in lines] for c in columns if c.role == "condition"]
    most = len(lines) if any(len({*each}) > 1 for each in settings) else 2  # words that tell rows apart
    while groups := [column for column in columns if column.role == "group"]:
        labels = ["|".join(row[column.place] for column in groups) for _, row in lines]
        if len({*labels}) < len(lines) or len({re.sub(r"\d", "", each) for each in labels}) >= most:
            break
        numbers = max(groups[::-1], key=lambda c: len({re.sub(r"\D", "", row[c.place]) for _, row in lines}))
        reading.interview.assume(f"not used: '{numbers.heading.text}' (it numbers the rows)")
        columns = [replace(each, role="remark") if each is numbers else each for each in columns]
    return columns


def join_repeat_columns(columns: Sequence[Column], reading: Reading) -> list[Column]:
    """The columns; those whose headings differ in a number alone are repeats of one measurement, if agreed.

    Columns of a cross table are none: their headings hold values of a condition.
    """
    families: dict[tuple[str, str], list[Column]] = {}
    for column in columns:
        if column.role == "observable":
            words = re.sub(r"[\W\d_]+", " ", plain_words(stem(column.heading.name))).strip()
            families.setdefault((column.name, words), []).append(column)
    repeats, means, numbered = set[int](), set[int](), set[int]()
    for family in (each for each in families.values() if len(each) > 1):
        titles = ", ".join(f"'{column.heading.text}'" for column in family)
        meaning = f"columns {titles} are repeats of one measurement"
        if fault := fault_of_repeats(family, reading):
            reading.faults.append(f"{reading.cells.file}: columns {titles}: {fault}")
        elif not reading.interview.ask_yes_or_no(f"Columns {titles}: repeats of one measurement", meaning):
            continue
        repeats |= {column.place for column in family[1:]}
        numbered |= {column.place for column in family}  # `n = 2` is the number of one
        for column in columns:  # of the repeats beside it
            sums_up = any(map(is_summary_word, plain_words(column.heading.name).split()))  # `mean angle`
            if column.name == family[0].name and column not in family and sums_up:
                means.add(column.place)
                reading.interview.assume(f"column '{column.heading.text}' is not used: {BESIDE}")
    result = [replace(column, is_repeat=column.place in repeats) for column in columns]
    result = [replace(c, heading=replace(c.heading, repeats=0)) if c.place in numbered else c for c in result]
    return [replace(c, role="remark", firm=True) if c.place in means else c for c in result]


def fault_of_repeats(family: Sequence[Column], reading: Reading) -> str:
    """Why columns are no repeats of one measurement: headings hold values, or all rows differ alike."""
    if any(heading_holds_value(each.heading) for each in family):
        lengths = family[0].name == "flux" and all(HEIGHT.search(each.heading.text) for each in family)
        return PROFILE if lengths else CROSS_TABLE
    cells = [[reading.number(row[c.place]).value for c in family] for _, row in reading.cells.lines]
    row, column = np.indices((len(cells), len(family)), dtype=np.float64)
    logarithm = np.log(np.where(np.array(cells) > 0.0, cells, nan))
    differ = column_affects_result(column.ravel(), logarithm.ravel(), row.ravel(), CHANCE_OF_REPEATS)
    whole = logarithm[np.isfinite(logarithm).all(axis=1)]
    return UNLIKE_REPEATS if differ and np.ptp(whole.mean(axis=0)) > BLOCK_DIFFERENCE else ""


def link_sd_and_n_columns(columns: Sequence[Column], reading: Reading) -> Iterator[Column]:
    """Scatter and repeats with their observable: the one named, else the last before them.

    Scatter beside the repeats themselves, of a quantity that is not used, or above the values, is not used.
    """
    measured = [column for column in columns if column.role == "observable"]
    repeated = {column.name for column in measured if column.is_repeat}
    quantities = [column for column in columns if column.numeric and column.role not in SCATTER]
    before = list[Column]()
    for column in columns:
        if column.role not in SCATTER or not measured:
            before = [column] if column.role == "remark" and column.numeric and column.heading.unit else []
            yield column
            continue
        words = plain_words(column.heading.name)
        named = (c for c in quantities if word_length(plain_words(c.heading.name), words))
        owners = sorted(named, key=lambda each: len(each.heading.name))[-1:] or before
        left = [each for each in measured if each.place < column.place or each in owners]
        partner = max(left or measured[:1], key=lambda each: (each in owners, each.place))
        shared = column.role == "n" and len(measured) > 1 and partner not in owners
        is_beside = repeated and (shared or partner.name in repeated)
        is_of_other = owners and partner not in owners and column.role != "n"
        why = BESIDE if is_beside else f"it belongs to '{owners[0].heading.text}'" if is_of_other else ""
        numbers = [reading.numbers(each) or [CellNumber(0.0)] for each in (column, partner)]
        units, sizes = {each.unit for each in numbers[0]}, [[abs(x.value) for x in n] for n in numbers]
        unit = column.heading.unit or max(units if len(units) == 1 else {"several"})
        if column.role in ("sd", "se") and not unit and median(sizes[0]) > median(sizes[1]):
            why = f"its numbers are larger than those of '{partner.heading.text}'"
        role = "remark" if why else column.role
        why = f"column '{column.heading.text}' is not used: {why}" if why else ""
        if role == "sd" and unit == "%" != partner.heading.unit:
            role, why = "cv", f"'{column.heading.text}' counts in % of '{partner.heading.text}'"
        reading.interview.assume(why)
        yield replace(column, role=role, of=-1 if shared else partner.place)
