"""A published table of runs, and what the study prints about it: `TABLE.claims.toml` beside the table.

model = "quadratic"            # linear | interactions | quadratic; guessed from the levels if left out
anova = "table_9.csv"          # printed analysis of variance
target = 33.52                 # target of the study
[equation]                     # printed coefficients in coded units, by term; "1" is the constant
[quality]                      # printed r2, r2_adjusted, r2_predicted, cv, adequate_precision

Numbers are kept as printed: the last digit says how exact they are. In the table, the columns of numbers
before the response are the factors, but for one that counts the runs and for those that hold results. What
stands behind the response, other responses or the same levels in other units, is set aside.
"""

import csv
import io
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file
from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments.design_table import Design, Factor, arranged, to_coded
from taichi_erosion.experiments.terms import Order

Kind = Literal[
    "unbalanced",  # a factor is not as often high as low
    "not orthogonal",  # factors are confounded
    "cell",  # one cell whose change restores the design
    "level",  # a level that stands alone
    "lack of fit",  # the model misses the means of its points
    "curvature",  # the centre lies off the plane
    "number",  # a printed number that the table does not give
    "heading",  # a column that holds something else
    "sign",  # a coefficient of the opposite sign
    "target",  # not reached by the fitted surface
    "setting",  # something that cannot be examined
]


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


NUMBER = re.compile(
    r"(?P<bound>[<>]?)\s*(?P<number>[+-]?(?:\d+\.?(?P<decimals>\d*)|\.(?P<bare>\d+))(?:[eE](?P<power>[+-]?\d+))?)"
)
HALF = 0.5 * (1.0 + 1e-6)  # of the last digit; a number that ends in 5 may be rounded either way [1]


@dataclass(frozen=True)
class Printed:
    """A printed number; `bound` is '<' or '>' where only a limit is printed."""

    text: str
    value: float
    last_digit: float  # size of one unit of the last printed digit
    bound: str = ""

    def agrees(self, found: float) -> bool:
        """Whether the found number could have been printed like this."""
        if self.bound:
            return found < self.value if self.bound == "<" else found > self.value
        return abs(found - self.value) <= HALF * self.last_digit + 1e-12 * abs(self.value)


def parse_printed(text: str) -> Printed | None:
    """The number of a cell, stars of significance apart; None for anything else."""
    match = NUMBER.fullmatch(text.strip().rstrip("*").strip())
    if match is None:
        return None
    decimals = len(match["decimals"] or match["bare"] or "")
    power = int(match["power"] or 0)
    return Printed(text.strip(), float(match["number"]), 10.0 ** (power - decimals), match["bound"])


def as_printed(value: Any) -> Printed:
    """Number of a claim."""
    found = parse_printed(str(value))
    if found is None:
        raise ValueError("must be a number")
    return found


Number = Annotated[Printed, BeforeValidator(as_printed)]


class Claims(BaseModel):
    """What is printed about one table; files are beside it."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    model: Order | None = None
    anova: str | None = None
    target: Number | None = None
    equation: dict[str, Number] = {}
    quality: dict[str, Number] = {}


def claims_of(table: Path, file: Path | None = None) -> tuple[Claims, Path]:
    """Claims of a table and their folder: of the named file or of the one beside it; none without a file."""
    path = file or table.with_suffix(".claims.toml")
    if file is None and not path.exists():
        return Claims(), table.parent
    try:
        # a number keeps its printed digits: its text, not its value, says how exact it is
        return Claims.model_validate(tomllib.loads(read_text_file(path), parse_float=str)), path.parent
    except ValidationError as error:
        fault = error.errors()[0]
        value = "" if fault["type"] == "missing" else f" = {fault['input']!r}"
        place = ".".join(map(str, fault["loc"]))
        raise BadInput(f"{path}: {place}{value}: {fault['msg'].removeprefix('Value error, ')}") from None
    except (OSError, ValueError) as error:
        raise BadInput(f"{path}: {error}") from None


FEWEST_RUNS = 3
COUNTER_NAMES = ("run", "no", "n", "nr", "std", "order", "test", "trial", "number", "row", "experiment")
MOST_LEVELS = 6  # of a factor in a designed experiment; a central composite has 5, a misprint adds one
Columns = Mapping[str, Sequence[str]]  # cells by heading


def read_columns(path: Path) -> dict[str, list[str]]:
    """Cells of a CSV table by heading; raises BadInput."""
    try:
        text = read_text_file(path, "utf-8-sig")
        lines = [line for line in csv.reader(io.StringIO(text, newline=""), strict=True) if any(line)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path}: cannot be read as a CSV table: {error}") from None
    if not lines:
        raise BadInput(f"{path}: is empty; the first row names the columns")
    headings = [cell.strip() for cell in lines[0]]
    if len(set(headings)) != len(headings):
        shown = ", ".join(" ".join(heading.split()) for heading in headings)
        raise BadInput(f"{path}: a heading stands twice in {shown}")
    for number, line in enumerate(lines[1:], start=1):
        if len(line) != len(headings):
            raise BadInput(f"{path}: row {number} has {len(line)} cells, the heading {len(headings)}")
    return {heading: [line[k].strip() for line in lines[1:]] for k, heading in enumerate(headings)}


def column_numbers(columns: Columns, heading: str, file: Path) -> Floats:
    """One column of finite numbers. Raises BadInput."""
    if heading not in columns:
        raise BadInput(f"{file}: column '{heading}' is missing; there are: {', '.join(columns)}")
    values = np.array([as_number(text) for text in columns[heading]])
    for row, (text, value) in enumerate(zip(columns[heading], values, strict=True), start=1):
        if not isfinite(value):
            raise BadInput(f"{file}: row {row}, {heading} = '{text}' must be a number")
    return values


def as_number(text: str) -> float:
    """A number with any of the signs that print uses for minus; NaN for anything else."""
    try:
        return float(text.replace("\N{MINUS SIGN}", "-").replace("\N{EN DASH}", "-"))
    except ValueError:
        return nan


@dataclass(frozen=True, eq=False)
class PublishedTable:
    """Levels as printed, and coded by each factor's own low and high."""

    name: str
    factors: tuple[Factor, ...]
    levels: Floats  # as printed, [runs, factors]
    coded: Floats  # [runs, factors]
    response: str
    values: Floats  # [runs]
    set_aside: tuple[str, ...]  # columns that are neither

    def design(self, coded: Floats) -> Design:
        """The table as a design of these levels."""
        plain = arranged(self.name, self.factors, [("factorial", coded)])
        return plain.with_responses(**{self.response: self.values})


def read_published(path: Path, response: str | None = None) -> PublishedTable:
    """A table of runs; the response is the last column where it is not named."""
    columns = read_columns(path)
    names = list(columns)
    wanted = response or names[-1]
    values = column_numbers(columns, wanted, path)
    if len(values) < FEWEST_RUNS:
        raise BadInput(f"{path}: {len(values)} run(s); needs at least {FEWEST_RUNS}")
    place = names.index(wanted)
    # a table may begin with its response
    chosen = factor_columns(columns, names[:place], path) or factor_columns(columns, names[place + 1 :], path)
    if not chosen:
        raise BadInput(f"{path}: no column of factor levels beside the response '{wanted}'")
    levels = np.column_stack(list(chosen.values()))
    factors = tuple(factor_of(name, column) for name, column in chosen.items())
    coded = np.round(to_coded(factors, levels), 9) + 0.0
    aside = tuple(name for name in names if name not in chosen and name != wanted)
    return PublishedTable(str(path), factors, levels, coded, wanted, values, aside)


def factor_columns(columns: Columns, names: Sequence[str], file: Path) -> dict[str, Floats]:
    """Columns of levels by name: not of words, no counter, and of few levels where there are such columns."""
    written = [name for name in names if any(isfinite(as_number(text)) for text in columns[name])]
    numbers = {name: column_numbers(columns, name, file) for name in written}
    levels = {k: x for k, x in numbers.items() if not is_counter(k, x) and np.ptp(x) > 0.0}
    few = {name: column for name, column in levels.items() if len(np.unique(column)) <= MOST_LEVELS}
    runs = max((len(column) for column in levels.values()), default=0)
    return few if few and runs > 2 * MOST_LEVELS else levels


def is_counter(name: str, column: Floats) -> bool:
    """Whether a column numbers the runs."""
    counts = np.arange(1, len(column) + 1)
    plain = "".join(c for c in name.lower() if c.isalpha())
    return np.array_equal(column, counts) or (
        plain in COUNTER_NAMES and np.array_equal(np.sort(column), counts)
    )


def factor_of(name: str, column: Floats) -> Factor:
    """A factor whose low and high are the outermost of the levels that stand more than once."""
    levels, counts = np.unique(column, return_counts=True)
    common = levels[counts > 1] if np.sum(counts > 1) > 1 else levels
    return Factor(name, float(common[0]), float(common[-1]))
