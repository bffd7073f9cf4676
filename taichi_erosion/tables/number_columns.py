"""What a column of numbers is that no model reads: a condition, a count, years, a result, or another one."""

import re
import unicodedata
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise

import numpy as np
from scipy.special import chdtrc, fdtrc

from taichi_erosion.core.setup import Floats
from taichi_erosion.scene.schema.units import Kind, parse_scale, parse_unit
from taichi_erosion.tables.cell_numbers import number_or_nan
from taichi_erosion.tables.headings import (
    Heading,
    has_word,
    is_summary_word,
    known_words,
    meaning_of,
    plain_words,
    read_heading,
    words_of,
)

CHANCE = 0.01  # p of a quantity that follows a column where all else is the same, below which the column acts
SAME = 0.998  # share of a column's variance that a parabola of another one explains: it is that one again
EXACT = 1e-5  # share that is left where both are one quantity in many digits
ROUNDED = 4.0  # variance that is left over that of rounding, up to which both are one quantity
AGAIN, ALIKE = "it follows the measured quantity within their digits", "it changes with"
SET_UNITS = ("kg/m2", "s", "K")  # of doses, ages and temperatures, which follow from no result
RESULT_UNITS = ("m/s", "Pa", "N", "deg")  # of what does
RESULT, COUNTS = "it is a result beside the measured quantity", "it counts rows or years"
ABOVE = re.compile(
    r"height|z|elevation|hohe|messhohe|hauteur|altura|高度|высота|(?:measuring|sampling|trap) height"
    r"|(?:height|hohe) (?:above|over|uber) .*"
)
SURFACE_LAYER = 100.0  # m above the ground, below which the law of the wall holds
NUMBERED = re.compile(
    r"(?i)(?:[\s_(#-](?:no|nr|rep(?:s|eat|licate|etition)?|wdh|test|run)\.?)?"
    r"(?:[\s_.#-]*\(?\d+\)?|[\s_.#-]+\(?(?-i:I{1,3}|I?V)\)?)\s*$"
)
NumbersByHeading = Mapping[str, Floats]
RARE = 0.05  # chance below which a column with blank cells may act: it is asked
AXIAL = 2.0  # largest coded level of a central composite design
LEAST_LEVELS = 6  # different numbers from which a parabola says something
LEAST_FREE = 4  # degrees of freedom, and numbers of lines, from which lines say something
SHARED = 0.95  # share of what varies at one value that they explain
REPEATED = 0.2  # share of rows that repeat others in a design with repeats, at its centre alone
YEARS = (1900.0, 2100.0)
RESULTS = re.compile(  # words of what is measured or computed beside a measurement, by their beginning
    r"\b(?:tan\b|tangen|predict|residual|fitted|calculat|simulat|model|expected|berechnet|vorhergesagt|caught|collected|"
    r"trapped|loss|error|relativer fehler|erreur relat|相对误差|hausner|(?:mass|weight) of sand|sand mass)"
)


def stem(heading: str) -> str:
    """A heading without the number of a repeat: `angle` of `angle 1` and of `angle rep. 1`."""
    bare = NUMBERED.sub("", heading)
    return bare if bare and bare.count("(") == bare.count(")") else heading


def is_height(heading: Heading, values: Sequence[float]) -> bool:
    """Whether a column holds heights above the bed at which something was measured, not those of sites."""
    name, unit = plain_words(heading.name), heading.unit
    if not (ABOVE.fullmatch(name) and unit and parse_scale(unit).kind == parse_unit("m").kind):
        return False
    return len({*values}) > 1 and max(values) * parse_scale(unit).factor < SURFACE_LAYER


def own_name(heading: str, others: Sequence[str], place: int) -> str:
    """Name of letters of any script, digits and _ for a column, another one than some: `salt_content`.

    Latin letters lose their accents, a Greek letter that stands alone is called by its name.
    """
    text = re.sub(r"\bu\*", "u_star ", heading.lower().replace("ß", "ss"))
    text = text.replace("<", " below ").replace(">", " above ")
    bare = re.sub(r"(?<=[a-z])[\u0300-\u036f]+", "", unicodedata.normalize("NFKD", text))
    symbol = re.compile(r"(?<![α-ω\u0301])[α-ω](?![α-ω\u0301])")
    micro = re.sub("μ(?=[a-z])", "u", bare)  # of `µm`
    latin = symbol.sub(lambda sign: unicodedata.name(sign[0]).split()[-1].lower(), micro)
    signs = (x if f"a{x}".isidentifier() and x != "·" else " " for x in unicodedata.normalize("NFKC", latin))
    plain = re.sub(r"[\s_]+", "_", "".join(signs).strip(" _"))[:40].strip("_")
    plain = plain if plain[:1].isalpha() else f"column_{plain or place + 1}"
    return f"column_{place + 1}" if plain in others else plain


def non_conditions(
    columns: NumbersByHeading,
    results: Sequence[Floats],
    conditions: NumbersByHeading,
    set_ups: Floats,
    names: Collection[str] = (),
) -> dict[str, str]:
    """Columns that are no conditions, by their headings, each with the reason.

    `results` are the measured quantities, `conditions` are others, `set_ups` name the set-up of each row,
    `names` are the headings of known conditions, which are computed from no result or other condition.
    """
    others, why = dict(conditions), dict[str, str]()
    for heading, values in sorted(columns.items(), key=lambda each: counts_rows(each[1])):  # these last
        reason = why_column_is_no_condition(heading, values, results, others, value_set_numbers([set_ups]))
        if reason and not (heading in names and reason.startswith((AGAIN, ALIKE, RESULT, COUNTS))):
            why[heading] = reason
        else:
            others[heading] = np.nan_to_num(values)
    return why


def why_column_is_no_condition(
    heading: str, values: Floats, results: Sequence[Floats], others: NumbersByHeading, set_ups: Floats
) -> str:
    """Why a column of numbers is no condition; empty where it is one.

    A column that differs between repeats, with other values in each group of them, is no condition where
    another one varies, so many rows repeat others that this is no accident, and the results follow it neither
    there nor it alone. Few levels far apart are one: those of a treatment.
    """
    distinct, rest = np.unique(values), value_set_numbers([*others.values(), set_ups])
    if np.isnan(values).any():  # a blank cell may stand for none of it, in rows of a set-up of their own
        dose, alike = np.nan_to_num(values), (rest, value_set_numbers([*others.values(), 0.0 * set_ups]))
        acts = any(column_affects_result(dose, y, each, RARE) for y in results for each in alike)
        return "" if acts else "it is not known in every row"
    title = read_heading(heading)
    whole = bool(np.all(values == np.round(values))) and not (title.unit or title.unreadable)
    if distinct.size == 1:
        return "it is the same in all rows"
    is_number = not heading or has_word(heading, known_words()["rows"]["number"])
    counts = distinct.size == values.size == 1 + np.ptp(values) and (is_number or distinct[0] > 0.0)
    counts |= YEARS[0] <= distinct[0] and distinct[-1] <= YEARS[1]
    in_order = counts_rows(values) and is_number
    in_order &= any(np.ptp(x) > 0.0 for x in others.values())
    acts = any(column_affects_result(values, y, np.zeros(y.size)) for y in results)
    if whole and (in_order or (counts and not acts)):
        return COUNTS
    if is_summary_word(re.sub(r"\s*[\[(].*", "", heading)) or RESULTS.search(plain_words(heading)):
        return RESULT
    computed = (is_computed_from_result(values, y) or is_computed_at_each(values, y, others) for y in results)
    if not is_set_by_hand(heading, values) and any(computed):
        return AGAIN
    is_code = whole and np.ptp(values) == distinct.size - 1  # of kinds
    same = [t for t, x in others.items() if is_code and follows(values, x)]
    if same:
        return f"{ALIKE} '{same[0]}' alone"
    is_repeated = values.size - np.unique(rest).size >= REPEATED * values.size
    is_repeated &= any(np.ptp(x) > 0.0 for x in others.values()) and differs_between_groups(values, rest)
    is_repeated &= 2 * distinct.size > values.size or 2.0 * np.ptp(values) <= abs(values).max()
    if is_repeated and not any(acts_here_or_alone(values, y, others, set_ups) for y in results):
        return "it differs between repeats, whose scatter holds what it does"
    return ""


def counts_rows(values: Floats) -> bool:
    """Whether whole numbers count the rows of a table, in their order."""
    return values.size > 1 and bool(np.all(np.diff(values) == 1.0) and values[0] == np.round(values[0]))


def acts_here_or_alone(values: Floats, result: Floats, others: NumbersByHeading, set_ups: Floats) -> bool:
    """Whether a result follows a column where all else is the same, or follows it and no other one."""
    if column_affects_result(values, result, value_set_numbers([*others.values(), set_ups])):
        return True
    first, *more = (column_affects_result(x, result, set_ups) for x in (values, *others.values()))
    return first and not any(more)


def do_words_name_kinds(words: Sequence[str], alike: bool) -> bool:
    """Whether words name kinds: each has two rows on average, or one of rows that are otherwise `alike`."""
    kinds, bare = len({*words}), len({re.sub(r"\d", "", each) for each in words})
    return "" not in words and kinds > 1 and (2 * kinds <= len(words) or (alike and bare == len(words)))


def ranges_of(words: Sequence[str], conditions: Mapping[str, Sequence[float]]) -> str:
    """A condition of which each word has a range of its own, as `dry` and `wet` of a moisture; else empty."""
    for name, numbers in conditions.items():
        by_word = [[x for word, x in zip(words, numbers, strict=True) if word == each] for each in {*words}]
        ends = sorted((min(each), max(each)) for each in by_word)
        if all(below[1] < above[0] for below, above in pairwise(ends)):
            return name
    return ""


def numbers_of_simulation(columns: Mapping[str, Sequence[str]]) -> list[str]:
    """Headings of two columns or more that vary, of numbers that a simulation sets or coded levels."""
    words, factors, clear = known_words()["numbers"], list[str](), False
    for text, cells in columns.items():
        levels = {x for cell in cells if not np.isnan(x := number_or_nan(cell.replace(",", "."), False))}
        coded = {-1.0, 1.0} <= levels == {-x for x in levels} and max(levels) <= AXIAL
        coded &= meaning_of(text)[0] == "unknown" and not read_heading(text).unit
        strong = has_word(text, words["simulation"])
        if len(levels) > 1 and (coded or strong or has_word(text, words["contact"])):
            factors, clear = [*factors, text], clear or coded or strong
    return factors if clear and len(factors) > 1 else []


def results_of_heaps(columns: NumbersByHeading) -> list[str]:
    """Headings of what a heap of grains may have beside its angle: different in all rows, in uneven steps."""
    names = [text for text in columns if has_word(text, known_words()["numbers"]["heap"])]
    different = [text for text in names if np.unique(columns[text]).size == columns[text].size > 1]
    return [text for text in different if not is_set_by_hand(text, columns[text])]


def value_set_numbers(columns: Sequence[Floats]) -> Floats:
    """Number of each row's set of values; equal for equal sets."""
    return np.unique(np.column_stack(columns), axis=0, return_inverse=True)[1].ravel().astype(np.float64)


def follows(column: Floats, other: Floats) -> bool:
    """Whether a column has one value for each value of another one, some of which are repeated."""
    return np.unique(other).size < column.size and not differs_at_equal_values(column, other)


def differs_at_equal_values(column: Floats, other: Floats) -> bool:
    """Whether a column differs where another one does not."""
    return np.unique(value_set_numbers([other, column])).size > np.unique(other).size


def differs_between_groups(values: Floats, rest: Floats) -> bool:
    """Whether values differ within most groups of repeats, and are the same set in few pairs of these.

    A factor of a design has the same levels in each group, or in one all levels but at most one.
    """
    groups = [tuple(np.unique(values[rest == each])) for each in np.unique(rest)]
    sets = [levels for levels in groups if len(levels) > 1]
    differ = len(sets) > len(groups) / 2 and len({*sets}) > len(sets) / 2
    return (
        differ and np.unique(values).size > 1 + max(map(len, sets)) and not group_means_differ(values, rest)
    )


def group_means_differ(values: Floats, rest: Floats) -> bool:
    """Whether means of groups differ by more than values within them do (F test)."""
    same = rest[:, np.newaxis] == np.unique(rest)
    within = np.sum((values - same @ (values @ same / same.sum(axis=0))) ** 2)
    between, free = np.sum((values - values.mean()) ** 2) - within, values.size - same.shape[1]
    return bool(fdtrc(same.shape[1] - 1, free, between / within * free / (same.shape[1] - 1)) < CHANCE)


def steps_of_one_sign(column: Floats, other: Floats) -> int:
    """Number of steps of a column where another one rises at every step, or falls at every step; else 0."""
    pairs = np.unique([column, other], axis=1)
    steps, turns = np.diff(pairs[0]), np.sign(np.diff(pairs[1]))
    return steps.size if np.all(steps > 0.0) and abs(turns.sum()) == steps.size else 0


def vary_together(column: Floats, other: Floats) -> bool:
    """Whether two conditions vary as one, along a line or at five values and more: no row separates them."""
    steps = steps_of_one_sign(np.nan_to_num(column), np.nan_to_num(other))
    return bool(steps >= 4 or (steps >= 2 and np.corrcoef(column, other)[0, 1] ** 2 > SAME))


def is_parabola_of(column: Floats, other: Floats) -> bool:
    both = np.isfinite(column) & np.isfinite(other)
    if np.unique(other[both]).size < LEAST_LEVELS or np.ptp(column[both]) == 0.0:
        return False
    return variance_left_by_parabola(column[both], other[both], np.zeros(int(both.sum()))) < 1.0 - SAME


def unit_kind(heading: str) -> Kind:
    """Kind of the unit that a heading states; that of a pure number without one."""
    unit = read_heading(heading).unit
    return parse_scale(unit).kind if unit else ()


def is_dose(heading: str) -> bool:
    """Whether a column is in the unit of a dose, an age or a temperature."""
    return unit_kind(heading) in {parse_unit(each).kind for each in SET_UNITS}


def is_set_by_hand(heading: str, values: Floats) -> bool:
    """Whether a column is of even steps, of round numbers from a control of 0, or of no result's unit."""
    if is_dose(heading):
        return True
    levels, kind = np.unique(values[np.isfinite(values)]), unit_kind(heading)
    is_round = all(x == float(f"{x:.1e}") for x in levels)
    if is_round and levels[0] == 0.0 and kind not in {parse_unit(each).kind for each in RESULT_UNITS}:
        return not has_word(heading, words_of("computed"))
    return bool(np.ptp(np.diff(levels)) < 1e-6 * np.ptp(levels) / levels.size)


def is_computed_from_result(column: Floats, result: Floats) -> bool:
    """Whether a column is computed from a measured quantity: it follows it within their last digits."""
    x, y = np.array([column, result])[:, np.isfinite(column) & np.isfinite(result)]
    if not is_parabola_of(x, y):
        return False
    basis = np.column_stack([np.ones(y.size), y, y**2, np.log(np.maximum(y, 1e-300))])
    coefficients = np.linalg.lstsq(basis / np.abs(basis).max(axis=0), x)[0] / np.abs(basis).max(axis=0)
    steep = coefficients[1] + 2.0 * coefficients[2] * y + coefficients[3] / np.maximum(y, 1e-100)
    variance = np.sum((x - basis @ coefficients) ** 2) / max(y.size - basis.shape[1], 1)
    rounding = (common_last_digit_size(x) ** 2 + np.mean(steep**2) * common_last_digit_size(y) ** 2) / 12.0
    return bool(variance < max(ROUNDED * rounding, EXACT * np.var(x)))


def is_computed_at_each(column: Floats, result: Floats, others: NumbersByHeading) -> bool:
    """Whether a column is computed from a measured quantity and another column, within their last digits.

    At each value of the other it is linear in the quantity (share of a control) or its square (Shields).
    """
    both = np.isfinite(column) & np.isfinite(result)
    column, result = column[both], result[both]
    for x in (each[both] for each in others.values() if differs_between_groups(column, each[both])):
        same = x[:, np.newaxis] == np.unique(x)
        free = column.size - 2 * same.shape[1]
        if min(free, 2 * same.shape[1]) < LEAST_FREE:
            continue
        for y, slope in ((result, 1.0), (result**2, 2.0 * result)):
            basis = np.hstack([same, same * y[:, np.newaxis]])
            coefficients = np.linalg.lstsq(basis, column)[0]
            steep = slope * (same @ coefficients[same.shape[1] :])
            digits = common_last_digit_size(column), common_last_digit_size(result)
            rounding = (digits[0] ** 2 + np.mean(steep**2) * digits[1] ** 2) / 12.0
            left = float(np.sum((column - basis @ coefficients) ** 2))
            whole = float(np.sum((column - same @ (column @ same / same.sum(axis=0))) ** 2))
            if left < (1.0 - SHARED) * whole and chdtrc(free, left / max(rounding, 1e-300)) > CHANCE:
                return True
    return False


def common_last_digit_size(values: Floats) -> float:
    """Size of the last decimal digit with which numbers are written; 0 beyond the eighth and of zeros."""
    units = (10.0**-k for k in range(-3, 9) if np.any(values))
    return max((x for x in units if np.all(np.abs(values / x - np.round(values / x)) < 1e-6)), default=0.0)


def reading_step(values: Floats) -> float:
    """Step of an instrument: the last digit, or 2 or 5 of it where chance is below one in a hundred."""
    digit = common_last_digit_size(values)
    counts = np.unique(np.round(values / digit)) if digit else np.zeros(0)
    return digit * next((k for k in (5, 2) if k**counts.size > 100 and not np.any(counts % k)), 1)


def mean_of_repeats(results: Sequence[Floats]) -> Floats:
    """Mean (n,) of repeats side by side, with as many digits as they have."""
    mean = np.mean(results, axis=0)
    digit = min(common_last_digit_size(each[np.isfinite(each)]) for each in results)
    return np.round(mean / digit) * digit if digit else mean


def column_affects_result(values: Floats, result: Floats, rest: Floats, chance: float = CHANCE) -> bool:
    """Whether a measured quantity follows a column where all else is the same (F test of a parabola)."""
    both = np.isfinite(result)
    free = int(both.sum()) - np.unique(rest[both]).size - 2
    if free < 1 or not differs_at_equal_values(result[both], rest[both]):
        return False
    share = variance_left_by_parabola(result[both], values[both], rest[both])
    return bool(fdtrc(2, free, (1.0 / max(share, 1e-12) - 1.0) * free / 2.0) < chance)


def variance_left_by_parabola(y: Floats, x: Floats, rest: Floats) -> float:
    """Share of the variance of y, where all else is the same, that a parabola of x leaves."""
    same = rest[:, np.newaxis] == np.unique(rest)
    x = (x - x.mean()) / max(float(np.ptp(x)), 1e-300)
    y, *powers = (each - same @ (each @ same / same.sum(axis=0)) for each in (y, x, x**2))
    residual = y - np.column_stack(powers) @ np.linalg.lstsq(np.column_stack(powers), y)[0]
    return float(residual @ residual / (y @ y))
