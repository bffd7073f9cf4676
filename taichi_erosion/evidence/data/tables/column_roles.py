"""What every column of a laboratory's table is: observable, condition, scatter, repeats, group, source.

A column is what the user says, else what its heading means, else what its cells look like. What is a guess is
marked as one, so that it can be asked.

A wind that was measured at a height above the bed (`u at 1 m [m/s]`, `wind speed (10 m)`, `U10`) is neither a
friction velocity nor the free stream of a tunnel. With the roughness length of the bed it gives the friction
velocity by the law of the wall.
"""

import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isnan, nan

from taichi_erosion.core.errors import BadInput, did_you_mean
from taichi_erosion.scene.physical_ranges import PhysicalRange, is_other_kind, plausible_units, range_of
from taichi_erosion.scene.schema.units import UnknownUnit, parse_scale, parse_unit, scale_between
from taichi_erosion.tables.cell_numbers import (
    CellFault,
    CellNumber,
    is_missing,
    is_quantity,
    number_or_nan,
    number_with_two_readings,
    plain_cell,
    read_cell,
    reason,
    stated_number,
)
from taichi_erosion.tables.headings import (
    DIAMETER,
    GRAIN_DENSITY,
    KINDS,
    SCATTER,
    Heading,
    Role,
    has_word,
    heading_faults,
    known_words,
    longest_word,
    meaning_of,
    meaning_of_only_angle,
    meaning_of_symbol,
    plain_words,
    qualifying_words,
    read_heading,
    set_stated_unit,
    suggest_meaning,
    unit_in,
    wind_height_of_heading,
)
from taichi_erosion.tables.number_columns import is_dose, stem
from taichi_erosion.tables.spreadsheet import Cells, find_column_and_siblings, has_digit

Ask = Callable[[str, str], str]  # (question, guess) -> answer
Check = Callable[[str], object]  # raises BadInput for an answer that cannot be used
AGREED = "yYjJoOsS"  # first letters of yes, ja, oui, si
MOST_SHARE = 0.6  # largest coefficient of variation that is taken for a share [1]; above, numbers are percent
NUMERIC_SHARE = 0.5  # of the cells with content that are numbers in a column of numbers
HALF = 0.5  # from a diameter of a heap to its radius [1]
PURE_UNITS = ("1", "kg kg-1")  # of places and observables that are shares or pure numbers
NOT_USED = "-"  # in place of a name
SIZES = ("mesh", "phi")  # numbers of grain sizes
MOST_MARKS = 3  # in a column that says which rows count
LIGHTEST = 2000.0  # of grains whose density has no other word [kg m-3]
NONE = ("none", "n a", "control", "untreated", "dry", "air dry", "kontrolle", "trocken")  # may mean 0
NOTE = "note"  # first word of the heading of a column that is not used
UNUSED = f"a column that is not used has a heading that begins with '{NOTE}'"
SHARES = {"": 0.01, "%": 0.01, "1": 1.0, "-": 1.0}  # of a coefficient of variation in such a unit
CONDITION = "conditions."
AIR = tuple(f"conditions.{name}" for name in ("temperature", "pressure", "altitude"))  # of its density
ROUGHNESS_LENGTH = "conditions.roughness_length"
LOWEST_WIND = 0.1  # roughness length over the height of a wind, below which the law of the wall holds [1]


@dataclass(frozen=True)
class Column:
    """One column: its place in the file, its heading, and what it is."""

    place: int
    heading: Heading
    role: Role
    name: str = ""  # of an observable; of a condition, or of one whose sd stands here, the place that it sets
    title: str = ""  # of a condition, by which rows and studies call it
    firm: bool = True  # False: a guess from the cells
    numeric: bool = True
    of: int = -1  # place of the observable whose scatter or repeats stand here; -1: of every one
    near: str = ""  # what an unknown heading may mean: misspelt, or with several readings
    height: float = nan  # above the bed at which a wind was measured [m]; NaN: no wind, or none is stated
    factor: float = 1.0  # from the numbers of the column to those of what it measures or sets
    is_repeat: bool = False  # of an observable whose first repeats stand in a column before it
    is_set: bool = False  # of the sd of a condition: about the value to which it was set
    changed: str = ""  # a word of its heading that makes it another quantity than `near`
    unclear: str = ""  # words of its heading that are not understood
    roughness: int = -1  # of a wind at a height: place of the column with the roughness length of each row
    unread: bool = False  # a condition of the table's own, which no model reads
    sd: float = nan  # scatter of single repeats that the user states, in the unit of the column
    cv: float = nan  # likewise, over the value [1]


@dataclass(frozen=True)
class TableOptions:
    """What the user, or a study, says of a table: heading or its name -> what the column measures or sets."""

    observables: Mapping[str, str] = field(default_factory=dict)
    conditions: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    titles: Mapping[str, str] = field(default_factory=dict)  # place of a condition -> its name in a study
    optional: frozenset[str] = frozenset()  # headings of columns that may be missing
    roughness: str | None = None  # length of the bed under winds that were measured at a height
    measures: tuple[str, ...] = ()  # what can be measured; (): whatever the study names
    own_units: Mapping[str, str] = field(default_factory=dict)  # of places of the user's own
    sd: Mapping[str, str] = field(default_factory=dict)  # heading or observable -> scatter of single repeats
    fill_down: bool = False  # blank cells below a condition, a set-up or a source repeat it
    complete: bool = False  # a condition that one row states must be stated by all
    reads: frozenset[str] | None = None  # by the model; others are kept as conditions; None: as they are


def columns_with_roles(cells: Cells, options: TableOptions, faults: list[str]) -> list[Column]:
    """Columns in their order; what is wrong with headings is added to `faults`, and makes them remarks."""
    faults += heading_faults(cells.file, cells.rows)
    named = names_by_column(cells, options, faults)
    columns = [apply_user_unit(column_from(cells, k, named), options) for k in range(len(cells.heading))]
    for column in (each for each in columns if each.place not in named):
        marks = plain_words(column.heading.text).strip(" ?") in known_words()["rows"]["flag"]
        if marks and 1 < len({row[column.place] for _, row in cells.lines}) <= MOST_MARKS:
            where = f"{cells.file}: column '{column.heading.text}' marks rows"
            faults.append(f"{where}: delete those that do not count; {UNUSED}")
    measured = any(column.role == "observable" for column in columns)
    for place, column in enumerate(() if measured else columns):  # as what it means where nothing known is
        if not column.firm and column.numeric and (alone := meaning_of_only_angle(column.heading)):
            words = {"role": "observable", "name": alone, "near": "", "unclear": column.heading.name}
            columns[place] = replace(column, firm=True, **words)
    roles, plain = [], {column.name for column in columns}
    for column in columns:
        if column.changed and column.near in plain:  # another column states the quantity itself
            column = replace(column, near="")
        wrong = list(column_unit_faults(cells, column, column.place in named))
        faults += wrong
        column = replace(column, title=options.titles.get(column.name) or condition_name_of_path(column.name))
        roles.append(replace(column, role="remark", firm=True) if wrong else column)
    return roles


def apply_user_unit(column: Column, options: TableOptions) -> Column:
    heading = column.heading
    texts = {plain_words(text) for text in (heading.text, heading.name, stem(heading.name))}
    unit = next((unit for text, unit in options.units.items() if plain_words(text) in texts), None)
    return column if unit is None else column_in_unit(column, unit)


def column_in_unit(column: Column, unit: str) -> Column:
    return replace(column, heading=set_stated_unit(column.heading, unit))


def names_by_column(cells: Cells, options: TableOptions, faults: list[str]) -> dict[int, tuple[Role, str]]:
    """What the user says, by place; a column that is not there is a fault unless it may be missing."""
    name_of: dict[int, tuple[Role, str]] = {}
    pairs: tuple[tuple[Role, Mapping[str, str]], ...]
    pairs = (("observable", options.observables), ("condition", options.conditions), ("unit", options.units))
    for role, names in pairs:
        for text, name in names.items():
            itself, repeats = find_column_and_siblings(cells, text)
            for place in () if role == "unit" else itself or repeats:
                name_of[place] = ("remark", "") if name == NOT_USED else (role, name)
            for place in repeats if role == "observable" else ():
                name_of.setdefault(place, (role, name))
            if not itself and not repeats and text not in options.optional:
                there = ", ".join(filter(None, cells.heading))
                words = f"no column '{text}'; there are: {there}{did_you_mean(text, cells.heading)}"
                faults.append(f"{cells.file}: --{role} {text}={name}: {words}")
    return name_of


def role_of_heading(heading: Heading, content: Sequence[str], numeric: bool) -> tuple[Role, str]:
    """Role of a column and what it measures or sets, by its heading and its unit."""
    role, name = meaning_of(heading.name)
    if is_other_kind(heading.unit, name):  # `clay u*t [m/s]`, `u* in flux run [m/s]`
        _, kind, other = longest_word(heading.name, *KINDS, unit=heading.unit)
        role, name = (KINDS[kind], other) if other else (role, name)
    if role == "n" and (heading.unit or heading.unreadable):  # a porosity, a rate of nitrogen
        role = "unknown"
    if role == "unknown" or (role in ("remark", "group", "source") and numeric and heading.unit):
        behind = heading.unit or unit_in(re.sub(r".*\d", "", content[0] if content else "")) or ""
        role, name = meaning_of_symbol(replace(heading, unit=behind))  # `100 µm` below `d`
    return role, name


def column_from(cells: Cells, place: int, named: Mapping[int, tuple[Role, str]]) -> Column:
    """One column by what is said of it, by its heading, by its cells."""
    heading = read_heading(cells.heading[place])
    content = [row[place] for _, row in cells.lines if not is_missing(row[place])]
    numeric = bool(content) and sum(map(is_quantity, content)) >= NUMERIC_SHARE * len(content)
    if place in named or plain_words(heading.name).partition(" ")[0] == NOTE:
        return Column(place, heading, *named.get(place, ("remark", "")), numeric=numeric)
    role, name = role_of_heading(heading, content, numeric)
    if not numeric:
        labels = longest_word(heading.name, "roles")[2] == "group" and not has_digit(content)
        role = "group" if labels else role
        has_number = any(re.match(r"[<>~≈±(]?\s*[-+]?[.,]?\d", cell) for cell in content)  # `Na2SO4` has none
        counts = role == "n" and has_digit(content)  # `n=3`
        fixed = role in ("group", "source") or counts or (role in ("observable", "condition") and has_number)
        return Column(place, heading, role if fixed else "remark", name if fixed else "", numeric=False)
    height = wind_height_of_heading(heading, name)
    if not isnan(height):
        return Column(place, heading, "remark", firm=False, height=height)
    changed, unclear = qualifying_words(heading) if role in ("observable", "condition") else ("", "")
    is_other = role == "condition" and unclear and is_other_kind(heading.unit, name)  # water sprayed, in mm
    if role == "unknown" or changed or is_other or (unclear and name in AIR):  # of a tyre, of an oven
        near = name if changed else "" if name in AIR else suggest_meaning(heading.name, not heading.unit)
        if not changed and (heading.unreadable or is_other_kind(heading.unit, near)):  # a density of plants
            near = ""
        return Column(place, heading, "remark", firm=False, near=near, changed=changed)
    factor = HALF if role == "observable" and longest_word(heading.name, *KINDS)[1] == "halved" else 1.0
    return Column(place, heading, role, name, firm=role != "spread", factor=factor, unclear=unclear)


def set_user_sd(columns: list[Column], cells: Cells, told: TableOptions, faults: list[str]) -> list[Column]:
    """The columns with the scatter of single repeats that the user states, `0.8 deg` or `8 %` of a value."""
    stating = ((c, row[c.place]) for c in columns if c.role in ("sd", "se", "cv") for _, row in cells.lines)
    places_of_scatter = {c.of for c, cell in stating if number_or_nan(cell, cells.decimal_comma) > 0.0}
    for text, scatter in told.sd.items():
        places = {place for group in find_column_and_siblings(cells, text) for place in group}
        names = (text.strip(), meaning_of(text)[1])
        matches = [c for c in columns if c.role == "observable" and (c.place in places or c.name in names)]
        where, wrong = f"{cells.file}: --sd {text}={scatter}", ""
        if not matches:
            wrong = "names no column of a measured quantity"
        elif places_of_scatter & {matches[0].place, -1}:
            wrong = "a column of the table states it; leave it out"
        faults.extend([f"{where}: {wrong}"] if wrong else [])
        for column in () if wrong else matches:
            unit, share = column.heading.unit, scatter.strip().endswith("%") and column.heading.unit != "%"
            value = stated_number(scatter, "1" if share else unit, where, f"0.8 {unit}' or '8 %")
            if value <= 0.0:
                raise BadInput(f"{where}: must be above 0")
            columns[columns.index(column)] = replace(column, **{"cv" if share else "sd": value})
    return columns


def condition_name_of_path(place: str) -> str:
    """Name of a column that sets a place of a scene: `moisture` for `conditions.moisture`."""
    if place == DIAMETER or place.startswith(("contact.", "materials.")):
        return place.split(",")[0].rpartition(".")[2]
    return place.removeprefix("conditions.").split(",")[0].replace(".", "_").replace("-", "_")


def column_unit_faults(cells: Cells, column: Column, named: bool) -> Iterator[str]:
    """A unit that cannot be read, or that is another quantity than the place; `named`: by the user."""
    where = f"{cells.file}: column '{column.heading.text}'"
    used = column.role in ("observable", "condition")
    scatter, size = column.role in ("sd", "se", "cv", "spread"), column.heading.unreadable in SIZES
    if (used or scatter or size) and column.heading.unreadable:
        try:
            parse_scale(column.heading.unreadable)
        except UnknownUnit as error:
            hint = error.hint or "such as [%], [mm], [deg], [m/s], [g/(m s)]"
            hint = f"head it 'grain size ({column.heading.unreadable})' if it is one" if size else hint
            yield f"{where}: '{column.heading.unreadable}' is no unit; {hint}"
    if column.role in SCATTER and has_word(column.heading.name, known_words()["intervals"]["mean"]):
        ways = "variance^1/2, IQR/1.35, half a 95 % CI n^1/2/2"
        yield f"{where}: is no sd of single repeats: give it ({ways}); {UNUSED}"
    if column.role == "cv" and column.heading.unit not in SHARES:
        yield f"{where}: a coefficient of variation counts in % or as a share [1]"
    content = [row[column.place] for _, row in cells.lines]
    first = next(filter(None, content), "")
    noted = plain_words(column.heading.name).partition(" ")[0] == NOTE
    unknown = bool(column.heading.unit) and not noted and meaning_of(column.heading.name)[0] == "unknown"
    fractions = column.role == "remark" and unknown and has_digit([first])  # `1/16` below `size of shot (in)`
    if (used or fractions or column.role == "n") and not (column.numeric or noted):
        yield f"{where} has no numbers that can be read: '{first}' {reason(plain_cell(first))}; {UNUSED}"
    elif used or (unknown and column.numeric):
        yield from (f"{where}: {words}" for words in double_readings(cells, column, content, named))


def double_readings(cells: Cells, column: Column, content: Sequence[str], named: bool) -> Iterator[str]:
    """What in a column of numbers has two readings: `none` of a dose, `1.500` beside `250`, a density."""
    none = [each for each in content if plain_words(each) in NONE]
    is_amount = column.name not in AIR if column.role == "condition" else is_dose(column.heading.text)
    is_amount |= any(plain_words(each) not in NONE[:2] for each in none)
    if none and is_amount and column.role != "observable":
        yield f"'{none[0]}' may mean 0: write that where it does, '-' where nothing is known"
    number = number_with_two_readings(content) if cells.form.startswith("text") else ""
    if number and column.role != "remark":
        yield f"'{number}' has two readings: write {re.sub('[.,]', '', number)} or {number}0"
    plain = plain_words(column.heading.name)
    if column.name == GRAIN_DENSITY and not named and plain in known_words()["asked"][GRAIN_DENSITY]:
        least = min(number_or_nan(each, cells.decimal_comma) for each in content)
        if least * parse_scale(column.heading.unit or "kg/m3").factor < LIGHTEST:
            yield "of the bulk or of the grains? Head it 'bulk density' or 'grain density'"


@dataclass
class Interview:
    """Questions that were asked, and what was assumed where a guess was taken."""

    ask: Ask = lambda _, guess: guess
    assumptions: list[str] = field(default_factory=list)
    at_terminal: bool = False  # a person is there, who is asked again

    def choice(self, question: str, guess: str, meaning: str, check: Check = str, why: str = "") -> str:
        """Answer; a guess is recorded with its meaning, what `check` refuses is asked again at a terminal."""
        answer = self.ask(why + question, guess).strip() or guess
        if answer == guess:
            self.assume(meaning)
        elif answer != NOT_USED:
            try:
                check(answer)
            except BadInput as error:
                if not self.at_terminal:
                    raise
                return self.choice(question, guess, meaning, check, f"{error}\n")
        return answer

    def ask_yes_or_no(self, question: str, meaning: str) -> bool:
        """Whether the user says yes; the guess is yes."""
        return self.choice(f"{question} (yes or no)", "yes", meaning)[0] in AGREED

    def assume(self, *meanings: str) -> None:
        new = [each for each in dict.fromkeys(meanings) if each and each not in self.assumptions]
        self.assumptions.extend(new)


def refuse_other_answer(answer: str, what: str, allowed: Collection[str]) -> None:
    """Raise BadInput for an answer that is not among the allowed ones."""
    if answer not in allowed:
        raise BadInput(f"{what}: '{answer}' is not one of {', '.join(allowed)}")


def parse_roughness_length(text: str, height: float) -> float:
    """Roughness length [m] as the user states it, `0.03 mm`; raises BadInput."""
    value = stated_number(text, "m", "roughness length", "0.03 mm")
    if not 0.0 < value < LOWEST_WIND * height:
        limits = f"must lie above 0 and below a tenth of the height of the wind, {height:g} m"
        raise BadInput(f"roughness length '{text}': {limits}")
    return value


def can_be_of_any_size(allowed: PhysicalRange) -> bool:
    """Whether numbers of a quantity can be of any size, so that none tells its unit."""
    return allowed.usual is None and allowed.low <= 0.0 and allowed.unit not in PURE_UNITS


@dataclass(frozen=True)
class Reading:
    cells: Cells
    options: TableOptions
    interview: Interview
    faults: list[str]
    bed: Column | None = None  # that states the roughness length of each row

    def reject(self, column: Column, words: str) -> Column:
        """The column, not used, once what is wrong with it is told."""
        self.faults.append(f"{self.cells.file}: column '{column.heading.text}': {words}")
        return replace(column, role="remark", firm=True)

    def number(self, cell: str) -> CellNumber:
        """What a cell says; nothing where that is no number."""
        try:
            return read_cell(cell, self.cells.decimal_comma)
        except CellFault:
            return CellNumber()

    def numbers(self, column: Column) -> list[CellNumber]:
        numbers = [self.number(row[column.place]) for _, row in self.cells.lines]
        return [number for number in numbers if not isnan(number.value)]


def check_column_unit(column: Column, reading: Reading) -> Column:
    """A column whose unit is one of what it measures or sets; the basis of a moisture is told."""
    heading, allowed = column.heading, range_of(column.name)
    unit = reading.options.own_units.get(column.name) or (allowed and allowed.unit)
    fixed = reading.options.measures and unit and heading.unit  # a study says itself what there is
    if column.role not in ("observable", "condition") or not fixed:
        return column
    if scale_between(heading.unit, parse_unit(str(unit))) is None:
        tangent = f" ({heading.unit} of an angle is a tangent: write its angle)" if unit == "deg" else ""
        counted = "a pure number" if unit == "1" else unit
        remedy = known_words()["remedies"].get(column.name, ("give it in that unit",))[0]
        words = f"{column.name} counts in {counted}; {remedy}{tangent}"
        option = f"--condition '{heading.name}={heading.unit}'"
        return reading.reject(column, f"{words}, or say {option} where it is another quantity")
    based = heading.law or has_word(heading.text, known_words()["bases"]["dry"])
    if column.name == "conditions.moisture" and heading.unit in ("%", "‰", "1", "-") and not based:
        assumption = f"'{heading.text}' counts as a share of dry soil by mass"
        reading.interview.assume(f"{assumption} ('wet basis' or 'volumetric' in the heading: otherwise)")
    return column


def find_or_ask_unit(column: Column, reading: Reading) -> Column:
    """A column of numbers with the unit that its heading lacks: that behind its numbers, or an asked one."""
    if column.role not in ("observable", "condition", "cv"):
        return column
    numbers, text = reading.numbers(column), column.heading.text
    if column.role == "condition" and any(0.0 < number.reach < inf for number in numbers):
        reading.interview.assume(f"ranges in column '{text}' count as their middle, sd width / 12^1/2")
    if column.heading.unit:
        return column
    behind = next((number.unit for number in numbers if number.unit), "")
    if unit := behind or reading.options.own_units.get(column.name, ""):
        return column_in_unit(column, unit)
    return assume_or_ask_unit(column, [number.value for number in numbers], reading)


def assume_or_ask_unit(column: Column, values: Sequence[float], reading: Reading) -> Column:
    """A column that states no unit: that of its quantity where all numbers are usual, else an asked one."""
    text, interview = column.heading.text, reading.interview
    if column.role == "cv":
        share = max(values, default=0.0) <= MOST_SHARE
        usual, unit_words = ("1", "a share of the value") if share else ("%", "percent of it")
        meaning = f"'{text}' has no unit in its heading: taken as {unit_words}"
        question = f"Unit of column '{text}' (such as {usual})"
        return column_in_unit(column, interview.choice(question, usual, meaning))
    allowed, measured = range_of(column.name), column.role == "observable"
    if allowed is None or not values:
        return column
    several = can_be_of_any_size(allowed)
    if not several and all(map(allowed.is_usual, values)):
        unit_words = "a pure number or share, 1 is all" if allowed.unit in PURE_UNITS else allowed.unit
        interview.assume(f"'{text}' has no unit in its heading: taken as {unit_words} (--unit '{text}=UNIT')")
        return column if allowed.unit in PURE_UNITS else column_in_unit(column, allowed.unit)
    units = ["UNIT"] if several else plausible_units(values, None, allowed) or [allowed.unit] * measured
    span = f"its numbers are {min(values):g} to {max(values):g}"
    hint = f"such as {allowed.unit}" if several else f"likely {' or '.join(units) or 'none'}"
    question = f"Unit of column '{text}' ({span}; {hint})"
    if answer := interview.choice(question, "", ""):
        return column_in_unit(column, answer)
    unit_words = f"has no unit in its heading: {span}; write it there: '{text} [{units[0]}]'" if units else ""
    unit_words += f", {hint}" * several
    return reading.reject(column, unit_words) if units else column
