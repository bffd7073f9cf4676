"""A published table of runs, and what the study prints about it: `TABLE.claims.toml` beside the table.

model = "quadratic"            # linear | interactions | quadratic; guessed from the levels if left out
anova = "table_9.csv"          # printed analysis of variance
target = 33.52                 # target of the study
[equation]                     # printed coefficients, in coded or actual factors; "1" is the constant
[quality]                      # printed r2, r2_adjusted, r2_predicted, cv, adequate_precision

Numbers are kept as printed: the last digit says how exact they are. In the table, the columns of numbers
before the response are the factors. Set aside are columns that count the runs, that a program adds (point
types, predicted values, residuals), that hold other results, and a factor's levels in other units. The
response is the one that is named, or else the last column of results.
"""

import re
import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from math import nan
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file
from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments.design import Factor, to_coded
from taichi_erosion.experiments.fit import Order
from taichi_erosion.tables.cell_numbers import CellFault, plain_cell, read_cell
from taichi_erosion.tables.headings import SCATTER, meaning_of, plain_words
from taichi_erosion.tables.spreadsheet import read_table_cells

Kind = Literal[
    "unbalanced",  # a factor is not as often high as low
    "not orthogonal",  # factors are confounded
    "cell",  # one cell whose change restores the design
    "lack of fit",  # the model misses the means of its points
    "curvature",  # the centre lies off the plane
    "number",  # a printed number that the table does not give
    "heading",  # a column that holds something else
    "sign",  # a coefficient of the opposite sign
    "target",  # not reached by the fitted surface
    "not judged",  # something that cannot be examined
]
NUMBER = re.compile(
    r"(?P<bound>[<>]?)\s*(?P<number>[+-]?(?:\d+\.?(?P<decimals>\d*)|\.(?P<bare>\d+))(?:[eE](?P<power>[+-]?\d+))?)"
)
HALF = 0.5 * (1.0 + 1e-6)  # of the last digit; a number that ends in 5 may be rounded either way [1]
FEWEST_RUNS = 3
MOST_LEVELS = 6  # of a factor in a designed experiment; a central composite has 5, a misprint adds one
ONE_LINE = 0.9999  # correlation of two columns that hold the same levels in two units, rounded [1]
BRACKETED = re.compile(r"(?P<level>[^()]+?)\s*[(\uff08](?P<other>[^()]+)[)\uff09]")  # 0.6 (+1)
LEVEL_SIGNS = {"+": 1.0, "-": -1.0}


@dataclass(frozen=True)
class Finding:
    """A finding; row counts from 1 below the heading, 0 where none is meant."""

    kind: Kind
    sentence: str
    table: str = ""
    column: str = ""
    row: int = 0
    printed: str = ""
    found: float = nan


@dataclass(frozen=True)
class PrintedNumber:
    """A printed number; `bound` is '<' or '>' where only a limit is printed."""

    text: str
    value: float
    last_digit: float  # size of one unit of the last printed digit
    bound: str = ""

    def agrees(self, value: float, reach: float = 0.0) -> bool:
        """Whether the found number, exact to `reach`, could have been printed like this."""
        if self.bound:
            return value - reach < self.value if self.bound == "<" else value + reach > self.value
        return abs(value - self.value) <= HALF * self.last_digit + 1e-12 * abs(self.value) + reach


def parse_printed(text: str) -> PrintedNumber | None:
    """The number of a cell, stars of significance apart; None for anything else."""
    match = NUMBER.fullmatch(text.strip().rstrip("*").strip())
    if match is None:
        return None
    decimals = len(match["decimals"] or match["bare"] or "")
    power = int(match["power"] or 0)
    return PrintedNumber(text.strip(), float(match["number"]), 10.0 ** (power - decimals), match["bound"])


def parse_claim(value: Any) -> PrintedNumber:
    number = parse_printed(str(value))
    if number is None:
        raise ValueError("must be a number")
    return number


Number = Annotated[PrintedNumber, BeforeValidator(parse_claim)]


class Claims(BaseModel):
    """What is printed about one table; files are beside it."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    model: Order | None = None
    anova: str | None = None
    target: Number | None = None
    equation: dict[str, Number] = {}
    quality: dict[str, Number] = {}


def read_claims(table: Path, file: Path | None = None) -> Claims:
    """Claims of a table: of the named file or of the one beside it; none without a file. Raises BadInput."""
    path = file or table.with_suffix(".claims.toml")
    if file is None and not path.exists():
        return Claims()
    try:
        # a number keeps its printed digits: its text, not its value, says how exact it is
        return Claims.model_validate(tomllib.loads(read_text_file(path), parse_float=str))
    except ValidationError as error:
        fault = error.errors()[0]
        place = ".".join(map(str, fault["loc"]))
        message = fault["msg"].removeprefix("Value error, ")
        raise BadInput(f"{path}: {place} = {fault['input']!r}: {message}") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{path}: {error}") from None


@cache
def anova_vocabulary() -> dict[str, dict[str, list[str]]]:
    """Words of columns, of lines and quantities of an analysis of variance."""
    return tomllib.loads((files("taichi_erosion.experiments") / "vocabulary.toml").read_text("utf-8"))


def word_meaning(kind: str, text: str) -> str:
    """What the words of a heading mean; empty for others. A number may follow the word of a column."""
    plain = plain_words(text)
    plain = plain if kind != "columns" else re.sub(r" ?\d.*", "", plain) or plain
    return next((meaning for meaning, words in anova_vocabulary()[kind].items() if plain in words), "")


@dataclass(frozen=True)
class Sheet:
    """Cells of a printed table by heading, as text."""

    file: Path
    columns: dict[str, list[str]]
    comma: bool  # decimal commas

    def cell_number(self, text: str) -> PrintedNumber | None:
        plain = plain_cell(text)
        return parse_printed(plain.replace(",", ".") if self.comma else re.sub(r",(?=\d{3}\b)", "", plain))

    def numbers(self, heading: str, strict: bool = False) -> Floats:
        """Numbers of a column, NaN where nothing was measured; of `0.6 (+1)` the first. Raises BadInput.

        A column with a lone + has signs for its levels. Without `strict` words are NaN too.
        """
        numbers = np.full(len(self.columns[heading]), nan)
        signed = "+" in self.columns[heading]
        for row, cell in enumerate(self.columns[heading]):
            match = BRACKETED.fullmatch(cell.replace("\N{EN DASH}", "-"))
            plain = plain_cell(match["level"] if match else cell.replace("\N{EN DASH}", "-"))
            try:
                sign = LEVEL_SIGNS.get(plain, 0.0) if signed else 0.0
                numbers[row] = sign or read_cell(plain, self.comma, single=True).value
            except CellFault as fault:
                if strict:
                    raise BadInput(f"{self.file}: row {row + 1}, {heading} = '{cell}' {fault}") from None
        return numbers

    def last_digit(self, heading: str) -> float:
        """Size of one unit of the last printed digit of a column; spreadsheets drop zeros at the end."""
        digits = re.findall(r"\d[.,](\d+)(?:[eE]([+-]?\d+))?", " ".join(self.columns[heading]))
        return min((10.0 ** (int(power or 0) - len(decimals)) for decimals, power in digits), default=1.0)


def read_sheet(path: Path) -> Sheet:
    """Cells of a text file or a workbook by heading. Raises BadInput."""
    faults = list[str]()
    cells = read_table_cells(path, str(path), faults)
    if faults or not cells.rows:
        raise BadInput(faults[0] if faults else f"{path}: holds no table")
    names = [f"{n} ({k + 1})" if n in cells.heading[:k] else n for k, n in enumerate(cells.heading)]
    columns = {name: [row[k] for _, row in cells.lines] for k, name in enumerate(names)}
    return Sheet(path, columns, cells.decimal_comma)


@dataclass(frozen=True, eq=False)
class PublishedTable:
    """Levels as printed, and coded by each factor's own low and high."""

    name: str
    factors: tuple[Factor, ...]
    levels: Floats  # as printed, [runs, factors]
    coded: Floats  # [runs, factors]
    response: str
    values: Floats  # [runs]; NaN without a result
    set_aside: tuple[str, ...]  # columns that are neither
    others: tuple[str, ...]  # of them the results
    rounding: Floats  # half of the last digit of response and coded levels, [runs, 1 + factors]


def read_published_table(path: Path, response: str | None = None) -> PublishedTable:
    """A table of runs; the response is the last column of results where it is not named. Raises BadInput."""
    sheet = read_sheet(path)
    names = list(sheet.columns)
    if response and response not in names:
        raise BadInput(f"{path}: column '{response}' is missing; there are: {', '.join(names)}")
    few, results = column_roles(usable_number_columns(sheet))
    response_name = response or (results or few or names)[-1]
    values = sheet.numbers(response_name, strict=True)
    if (runs := np.isfinite(values).sum()) < FEWEST_RUNS:
        raise BadInput(f"{path}: {runs} run(s) with a result; needs at least {FEWEST_RUNS}")
    few = [name for name in few if name != response_name]
    used = [name for name in few if names.index(name) < names.index(response_name)] or few
    if not used:
        raise BadInput(f"{path}: no column of factor levels before the response '{response_name}'")
    levels = np.column_stack([sheet.numbers(name, strict=True) for name in used])
    for row, k in np.argwhere(np.isnan(levels)).tolist():
        raise BadInput(f"{path}: row {row + 1}, {used[k]} = '{sheet.columns[used[k]][row]}' must be a number")
    factors = tuple(column_factor(name, column) for name, column in zip(used, levels.T, strict=True))
    coded = np.round(to_coded(factors, levels), 9) + 0.0
    # levels from -1 to 1 define the coding, those of star points are rounded
    digits = [sheet.last_digit(name) / f.half_range for name, f in zip(used, factors, strict=True)]
    responses = np.full(len(coded), sheet.last_digit(response_name))
    rounding = 0.5 * np.column_stack([responses, np.array(digits) * (np.abs(coded) > 1.0)])
    aside = tuple(name for name in names if name not in used and name != response_name)
    others = tuple(name for name in results if name in aside)
    return PublishedTable(str(path), factors, levels, coded, response_name, values, aside, others, rounding)


def usable_number_columns(sheet: Sheet) -> dict[str, Floats]:
    """Columns of numbers that vary, no counter and of no program, each in one unit only."""
    columns = dict[str, Floats]()
    for heading in sheet.columns:
        numbers = sheet.numbers(heading)
        role = word_meaning("columns", heading)
        counter = np.arange(1.0, len(numbers) + 1.0)
        varies = len(np.unique(numbers[np.isfinite(numbers)])) > 1
        counts = not role and np.array_equal(np.sort(numbers), counter)
        if varies and not counts and role in ("", "result") and meaning_of(heading)[0] not in SCATTER:
            columns[heading] = numbers
    with np.errstate(invalid="ignore"):
        table = list(columns.values())
        alike = np.abs(np.atleast_2d(np.corrcoef(table))) > ONE_LINE if columns else np.zeros((0, 0))
    usable = {name: column for k, (name, column) in enumerate(columns.items()) if not alike[k, :k].any()}
    return usable if len(usable) > 2 or len(columns) < 3 else columns  # all factors of a climb move together


def column_roles(usable: dict[str, Floats]) -> tuple[list[str], list[str]]:
    """Columns of levels; columns of results, by their word or of many different numbers behind levels."""
    named = [n for n in usable if word_meaning("columns", n) == "result" or meaning_of(n)[0] == "observable"]
    rest = [name for name in usable if name not in named]
    few = [n for n in rest if len(np.unique(usable[n])) <= max(MOST_LEVELS, len(usable[n]) // 2)]
    behind = [n for n in rest if few and n not in few and rest.index(n) > rest.index(few[0])]
    return few or rest, [name for name in usable if name in named or name in behind]


def column_factor(name: str, column: Floats) -> Factor:
    """A factor whose low and high are the most frequent pair of levels, the outermost of equals.

    Levels that stand once are left out where there are others: star points, misprints.
    """
    levels, counts = np.unique(column, return_counts=True)
    if np.sum(counts > 1) > 1:
        levels, counts = levels[counts > 1], counts[counts > 1]
    k = max(range(len(levels) // 2), key=lambda k: (min(counts[k], counts[-1 - k]), -k))
    return Factor(name, float(levels[k]), float(levels[-1 - k]))
