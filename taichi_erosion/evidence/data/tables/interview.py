"""Meaning of a laboratory's table: what its headings say, and questions about the rest.

Every question has a guess, which counts where nobody is asked. Where a guess could make a wrong answer there
is none: without an answer the question is a fault, with what would settle it.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isnan, nan
from statistics import median
from typing import Literal

from taichi_erosion.core.errors import BadInput, nearest
from taichi_erosion.evidence.data.physical_ranges import likely_units, place_range
from taichi_erosion.evidence.data.tables.cell_numbers import CellFault, CellNumber, read_cell
from taichi_erosion.evidence.data.tables.column_roles import (
    HALF,
    Column,
    Told,
    column_roles,
    friction_factor,
    roughness_length,
    stated_names,
    with_partners,
)
from taichi_erosion.evidence.data.tables.cross_table import cross_table_faults
from taichi_erosion.evidence.data.tables.headings import read_heading, stated_unit
from taichi_erosion.evidence.data.tables.laboratory_table import Choices, tidy_cells
from taichi_erosion.evidence.data.tables.spreadsheet import Cells
from taichi_erosion.evidence.data.tables.tidy_table import Faults
from taichi_erosion.evidence.data.tables.vocabulary import (
    FRICTION_VELOCITY,
    GRAIN_CONTACT,
    SCATTER,
    known_places,
    meaning_of,
    plain_words,
)
from taichi_erosion.scene.paths import unit_of_path
from taichi_erosion.scene.schema.units import parse_unit, scale_between

Ask = Callable[[str, str], str]  # (question, guess) -> answer
NOT_USED = "-"
AGREED, REFUSED = ("yes", "y", "ja", "j", "oui", "o", "si", "sí"), ("no", "n", "nein", "non")
MOST_TRIES = 3  # of an answer that names nothing known
MOST_APART = 2.0  # ratio of the medians of two columns up to which they may hold repeats [1]
MOST_SHARE = 0.6  # largest coefficient of variation that is taken for a share [1]; above, numbers are percent
UNITS = {  # of the program's measures, where a heading has none
    **dict.fromkeys(
        ("repose_angle", "cone_angle", "angle_of_repose", "dynamic_angle", "sliding_angle"), "deg"
    ),
    **dict.fromkeys(("threshold_u_star", "impact_threshold", "threshold_wind_speed", "rolling_onset"), "m/s"),
    "flux": "kg/(m s)",
}
SPREADS = {
    "sd": "the standard deviation of single repeats",
    "se": "the standard error of their mean",
    NOT_USED: "not used",
}
TELLING = ("observable", "condition", *SCATTER)
LEAST_KNOWN = 2  # headings that are known in the first column of such a table


@dataclass
class Interview:
    """Questions that were asked, and what was assumed where a guess was taken."""

    ask: Ask
    assumed: list[str] = field(default_factory=list)

    def choice(self, question: str, guess: str, meaning: str) -> str:
        """Answer to a question; an accepted guess is recorded with its meaning."""
        answer = self.ask(question, guess).strip() or guess
        if answer == guess and meaning:
            self.assumed.append(meaning)
        return answer

    def agreed(self, question: str, meaning: str) -> bool:
        """Whether the user says yes; the guess is yes. Raises BadInput for another word."""
        answer = self.choice(f"{question} (yes or no)", "yes", meaning).lower()
        if answer not in AGREED + REFUSED:
            raise BadInput(f"{question}: '{answer}' is not yes or no")
        return answer in AGREED

    def assume(self, meaning: str) -> None:
        """Record what was assumed without a question."""
        self.assumed.append(meaning)


@dataclass(frozen=True)
class TableWishes:
    """What the command line says of a table beforehand."""

    told: Told = field(default_factory=Told)
    roughness: str | None = None  # length of the bed under winds that were measured at a height
    measures: tuple[str, ...] = ()  # what the scenes of the program measure


def understood(
    cells: Cells, wishes: TableWishes, interview: Interview, faults: Faults
) -> tuple[Cells, list[Column]]:
    """The tidy table and the columns that it was made of; what is wrong is added to `faults`.

    Raises BadInput for a cross table, of which no column means what its heading says.
    """
    columns = column_roles(cells, wishes.told, faults)
    if crossed := list(cross_table_faults(cells, columns, stated_names(cells, wishes.told, []))):
        raise BadInput(*crossed)
    if faults:  # nobody is asked about a table that has to be corrected
        interview = Interview(lambda _, guess: guess)
    measured = any(column.role == "observable" for column in columns)
    answers = [settled(column, interview, wishes, measured, cells, faults) for column in columns]
    answers = repeats_side_by_side(answers, interview, cells, faults)
    columns = with_partners(without_unknown(answers, wishes, cells, faults))
    columns = without_foreign_scatter(without_scatter_of_repeats(columns, interview), interview)
    if not any(column.role == "observable" for column in columns):
        faults.append(
            f"{cells.file}: no column is known as a measured quantity; say which one is: --observable "
            f"'COLUMN=NAME', NAME one of {', '.join(wishes.measures)}"
        )
    columns = [with_asked_unit(column, cells, interview) for column in columns]
    choices = Choices(scatter_behind_sign(cells, interview))
    if not any(column.role == "n" for column in columns):
        interview.assume("no column counts repeats: n is left empty, and a value counts as one measurement")
    return tidy_cells(cells, columns, choices, faults), columns


def scatter_behind_sign(cells: Cells, interview: Interview) -> Literal["sd", "se"]:
    """What stands behind ± in cells: sd or se."""
    if not any("±" in cell or "+-" in cell or "+/-" in cell for _, row in cells.lines for cell in row):
        return "sd"
    question = (
        "Numbers behind ±: sd = standard deviation of single repeats, se = standard error of their mean"
    )
    answer = interview.choice(question, "sd", "numbers behind ± are standard deviations of single repeats")
    if answer not in ("sd", "se"):
        raise BadInput(f"{cells.file}: '{answer}' is not one of sd, se")
    return "se" if answer == "se" else "sd"


def settled(
    column: Column, interview: Interview, wishes: TableWishes, measured: bool, cells: Cells, faults: Faults
) -> Column:
    """A column of which only a guess was known, as the user calls it."""
    if column.sure or not column.numeric:
        return told_free_stream(told_half(column, interview), interview)
    if not isnan(column.height):
        return settled_wind(column, interview, wishes, measured, cells, faults)
    if column.role == "spread":
        return settled_spread(column, interview)
    text = column.heading.text
    nearest = f" '{column.near}' is near its heading." if column.near else ""
    question = (
        f"Column '{text}' is not known.{nearest} Type the name of a measured quantity (repose_angle, flux, "
        f"...), a place of the scene (conditions.moisture, ...), ? for a list of both, or {NOT_USED} for a "
        "column that is not used"
    )
    if column.near:
        answer = interview.choice(question, "", "")
        if not answer:
            faults.append(f"{cells.file}: {near_words(column)}")
            return replace(column, sure=True)
    else:
        answer = interview.choice(
            question, NOT_USED, f"column '{text}' is not used: its heading says nothing known"
        )
    for _ in range(MOST_TRIES):
        told = unknown_name(named(column, answer), wishes)
        if not told:
            break
        answer = interview.choice(f"{told} Column '{text}'", NOT_USED, "")
    return named(column, answer)


def unknown_name(column: Column, wishes: TableWishes) -> str:
    """Why a column as the user calls it is nothing known, and what is; empty for a known one."""
    if column.role == "observable" and column.name not in wishes.measures:
        known = (*wishes.measures, *known_places())
    elif column.role == "condition" and unit_of_path(column.name.split(",")[0].strip()) is None:
        known = known_places()
    else:
        return ""
    near = nearest(column.name, known)
    hint = f" Did you mean '{near}'?" if near else ""
    return f"'{column.name}' is not known.{hint} Known: {', '.join(known)}."


def near_words(column: Column) -> str:
    """Why a column with a heading that is nearly known has to be settled, and how."""
    option = "condition" if "." in column.near else "observable"
    text = column.heading.name
    return (
        f"column '{column.heading.text}': did you mean {column.near}? say --{option} '{text}={column.near}', "
        "or begin the heading of a column that is not used with 'note'"
    )


def named(column: Column, answer: str) -> Column:
    """A column as the user calls it."""
    if answer == NOT_USED:
        return replace(column, sure=True)
    role, name = meaning_of(answer)
    if "." in answer:
        return replace(column, role="condition", name=answer, sure=True)
    if role in ("observable", "condition"):
        return replace(column, role=role, name=name, sure=True)
    return replace(column, role="observable", name=answer, sure=True)


def settled_spread(column: Column, interview: Interview) -> Column:
    """A column of scatter of which the heading does not say which."""
    text = column.heading.text
    question = f"Column '{text}': " + ", ".join(f"{key} = {words}" for key, words in SPREADS.items())
    answer = interview.choice(question, "sd", f"column '{text}' holds standard deviations of single repeats")
    if answer not in SPREADS:
        raise BadInput(f"column '{text}': '{answer}' is not one of {', '.join(SPREADS)}")
    if answer == NOT_USED:
        return replace(column, role="remark", sure=True)
    return replace(column, role="sd" if answer == "sd" else "se", sure=True)


def told_half(column: Column, interview: Interview) -> Column:
    """The column; one that counts twice what is measured is told."""
    told = f"diameters of heaps are halved: {column.name} is a radius"
    if column.factor == HALF and told not in interview.assumed:
        interview.assume(told)
    return column


def told_free_stream(column: Column, interview: Interview) -> Column:
    """The column; a wind without a height is told as the free stream."""
    if column.name in ("threshold_wind_speed", "conditions.wind_speed"):
        interview.assume(
            f"column '{column.heading.text}' is the free stream of the wind; where it was measured at a "
            "height, let the heading say so: 'wind speed at 1 m'"
        )
    return column


def settled_wind(
    column: Column, interview: Interview, wishes: TableWishes, measured: bool, cells: Cells, faults: Faults
) -> Column:
    """A wind that was measured at a height, as the friction velocity that the law of the wall gives."""
    text, height = column.heading.text, column.height
    question = (
        f"Column '{text}' is a wind at {height:g} m, no friction velocity. Roughness length z0 of the bed "
        f"with its unit (flat sand: grain diameter / 30, such as '0.008 mm'), for u* = 0.4 U / ln(z / z0); "
        f"{NOT_USED}: the column is not used"
    )
    answer = wishes.roughness or interview.choice(question, "", "")
    if answer == NOT_USED:
        return replace(column, sure=True)
    if not answer:
        faults.append(
            f"{cells.file}: column '{text}': a wind at {height:g} m is no friction velocity; give the "
            "roughness length of the bed, --roughness '0.008 mm' (flat sand: grain diameter / 30), or a "
            "column of u*"
        )
        return replace(column, sure=True)
    roughness = roughness_length(answer, height)
    factor = friction_factor(height, roughness)
    interview.assume(
        f"'{text}' becomes a friction velocity, u* = 0.4 U / ln(z / z0) = {factor:.3g} U, with z = "
        f"{height:g} m and the roughness length z0 = {roughness:.3g} m"
    )
    threshold = "threshold" in meaning_of(column.heading.name)[1] or not measured
    role, name = ("observable", "threshold_u_star") if threshold else ("condition", FRICTION_VELOCITY)
    return replace(column, role=role, name=name, sure=True, factor=factor)


def without_unknown(
    columns: Sequence[Column], wishes: TableWishes, cells: Cells, faults: Faults
) -> list[Column]:
    """The columns without what no scene measures or has, and without a second one for one condition."""
    found = []
    seen: dict[str, str] = {}
    for column in columns:
        wrong = list(column_faults(column, seen, wishes, cells))
        if column.role in ("observable", "condition"):
            seen.setdefault(column.name, column.heading.text)
        faults += wrong
        found.append(replace(column, role="remark") if wrong else column)
    return found


def repeats_side_by_side(
    columns: Sequence[Column], interview: Interview, cells: Cells, faults: Faults
) -> list[Column]:
    """The columns; those whose headings differ in a number alone are repeats of one measurement, if agreed.

    Columns of different size are none, such as value, scatter and number under one merged heading.
    """
    families: dict[tuple[str, str], list[Column]] = {}
    for column in columns:
        if column.role == "observable":
            families.setdefault((column.name, unnumbered(column)), []).append(column)
    repeats: set[int] = set()
    for family in families.values():
        if len(family) < 2:
            continue
        told = ", ".join(f"'{column.heading.text}'" for column in family)
        middles = [abs(median(numbers(column, cells) or [nan])) for column in family]
        if not max(middles) <= MOST_APART * min(middles):
            faults.append(
                f"{cells.file}: columns {told} are of different size, so no repeats of one measurement; give "
                "each its own heading, such as 'angle', 'SD' and 'n'"
            )
            repeats |= {column.place for column in family[1:]}
            continue
        question = f"Columns {told}: repeats of one measurement"
        if interview.agreed(question, f"columns {told} are repeats of one measurement"):
            repeats |= {column.place for column in family[1:]}
    return [replace(column, is_repeat=column.place in repeats) for column in columns]


def unnumbered(column: Column) -> str:
    """Name of a column without numbers."""
    return " ".join(re.sub(r"[\W\d_]+", " ", plain_words(column.heading.name)).split())


def without_scatter_of_repeats(columns: Sequence[Column], interview: Interview) -> list[Column]:
    """The columns; scatter and number of repeats that stand beside the repeats themselves are not used."""
    names = {column.name for column in columns if column.is_repeat}
    places = {column.place for column in columns if column.role == "observable" and column.name in names}
    found = []
    for column in columns:
        if column.role in SCATTER and places and column.of in (*places, -1):
            interview.assume(f"column '{column.heading.text}' is not used: the repeats stand beside it")
            column = replace(column, role="remark")
        found.append(column)
    return found


def without_foreign_scatter(columns: Sequence[Column], interview: Interview) -> list[Column]:
    """The columns; scatter right behind a quantity that is not used belongs to that one."""
    found: list[Column] = []
    for column in columns:
        before = next((each for each in reversed(found) if each.role not in SCATTER), None)
        foreign = before is not None and before.role == "remark" and before.numeric and before.heading.unit
        measured = next((each for each in columns if each.place == column.of), None)
        named = measured is not None and plain_words(measured.heading.name) in plain_words(
            column.heading.name
        )
        if column.role in SCATTER and column.role != "n" and before is not None and foreign and not named:
            words = f"it stands behind '{before.heading.text}', which is not used"
            interview.assume(f"column '{column.heading.text}' is not used: {words}")
            column = replace(column, role="remark")
        found.append(column)
    return found


def column_faults(
    column: Column, seen: Mapping[str, str], wishes: TableWishes, cells: Cells
) -> Iterator[str]:
    """What is wrong with the meaning of a column."""
    where = f"{cells.file}: column '{column.heading.text}'"
    if column.role == "observable" and column.name not in wishes.measures:
        yield f"{where}: no scene measures '{column.name}'; known: {', '.join(wishes.measures)}"
    if column.role in ("observable", "condition") and column.name in seen and not column.is_repeat:
        yield (
            f"{where} means {column.name}, as column '{seen[column.name]}' does; say what it is with "
            f"--condition '{column.heading.name}=PATH', or begin the heading of the one that is not used "
            "with 'note'"
        )
    if column.role == "condition":
        yield from kind_faults(column, where)


def kind_faults(column: Column, where: str) -> Iterator[str]:
    """A condition that no scene has, or in a unit of another kind than its place."""
    place = column.name.split(",")[0].strip()
    unit = unit_of_path(place)
    if unit is None:
        known = ", ".join(known_places())
        yield f"{where}: no scene has a place '{place}'; known: {known}"
    elif column.heading.unit and scale_between(column.heading.unit, parse_unit(unit)) is None:
        slope = " (a slope in % is a tangent: write its angle)" if place.endswith("slope") else ""
        told = "a pure number" if unit == "1" else unit
        yield f"{where}: {place} counts in {told}; give it in that unit{slope}"


def with_asked_unit(column: Column, cells: Cells, interview: Interview) -> Column:
    """A column of numbers with the unit that its heading lacks."""
    if (
        column.role not in ("observable", "condition", "cv")
        or column.heading.unit
        or cell_units(column, cells)
    ):
        return column
    text = column.heading.text
    if column.role == "cv":
        guess = "%" if max(numbers(column, cells), default=0.0) > MOST_SHARE else "1"
        told = "percent of the value" if guess == "%" else "a share of the value"
        meaning = f"'{text}' has no unit in its heading: taken as {told}"
        answer = interview.choice(f"Unit of column '{text}': % or 1 (a share)", guess, meaning)
        return replace(column, heading=stated_unit(column.heading, answer))
    if column.role == "observable":
        usual = UNITS.get(column.name, "m")
        meaning = f"'{text}' has no unit in its heading: taken as {usual}"
        answer = interview.choice(f"Unit of column '{text}' (such as {usual})", usual, meaning)
        return replace(column, heading=stated_unit(column.heading, answer))
    allowed = place_range(column.name.split(",")[0].strip())
    values = numbers(column, cells)
    if allowed is None or not values:
        return column
    if all(map(allowed.is_usual, values)):
        pure = "a pure number" if column.name.startswith(GRAIN_CONTACT) else "a share: 1 is all"
        told = pure if allowed.unit in ("1", "kg kg-1") else allowed.unit
        interview.assume(f"'{text}' has no unit in its heading: taken as {told} (--unit '{text}=UNIT')")
        return column
    likely = likely_units(values, None, allowed)
    question = (
        f"Unit of column '{text}' (its numbers are {min(values):g} to {max(values):g}; likely "
        f"{' or '.join(likely) or 'none'})"
    )
    answer = interview.choice(question, "", "")
    return replace(column, heading=stated_unit(column.heading, answer)) if answer else column


def cell_units(column: Column, cells: Cells) -> bool:
    """Whether units stand behind the numbers of a column."""
    return any(number.unit for number in cell_numbers(column, cells))


def numbers(column: Column, cells: Cells) -> list[float]:
    """Numbers of a column."""
    return [float(number.value) for number in cell_numbers(column, cells) if number.value]


def cell_numbers(column: Column, cells: Cells) -> Iterator[CellNumber]:
    """Cells of a column that hold a number."""
    for _, row in cells.lines:
        try:
            yield read_cell(row[column.place], cells.decimal_comma)
        except CellFault:
            continue


def upright(cells: Cells, interview: Interview) -> Cells:
    """A table with its headings in the first row; one that lies on its side is set upright, if agreed.

    Rows of the table that is set upright count from the first column of the file. Raises BadInput.
    """
    if not lies_on_its_side(cells):
        return cells
    question = (
        f"{cells.file}: the headings seem to stand in the first column, with one column for every sample. "
        "Exchange rows and columns"
    )
    meaning = "rows and columns are exchanged: the headings stand in the first column"
    return exchanged(cells) if interview.agreed(question, meaning) else cells


def lies_on_its_side(cells: Cells) -> bool:
    """Whether the first column names a measured quantity and more, and the first row nothing known."""
    first = [row[0] for _, row in cells.rows]
    roles = {text: meaning_of(read_heading(text).name)[0] for text in (*first, *cells.heading[1:]) if text}
    down = [roles[text] for text in first if text]
    across = [roles[text] for text in cells.heading[1:] if text]
    known = [role for role in down if role in TELLING]
    return len(known) >= LEAST_KNOWN and "observable" in known and not any(role in TELLING for role in across)


def exchanged(cells: Cells) -> Cells:
    """A table with rows and columns exchanged."""
    columns = zip(*(row for _, row in cells.rows), strict=True)
    rows = tuple((k, column) for k, column in enumerate(columns, 1) if any(column))
    return replace(cells, file=f"{cells.file} (rows and columns exchanged)", rows=rows)
