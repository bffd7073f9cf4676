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

import io
import re
import tomllib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file
from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments.design import Factor, to_coded
from taichi_erosion.experiments.fit import Order

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


def claims_of(table: Path, file: Path | None = None) -> Claims:
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


Columns = Mapping[str, Sequence[str]]  # cells by heading
FEWEST_RUNS = 3
MOST_LEVELS = 6  # of a factor in a designed experiment; a central composite has 5, a misprint adds one


def read_columns(path: Path) -> dict[str, list[str]]:
    """Cells of a CSV table by heading, as text. Raises BadInput."""
    try:
        text = io.StringIO(read_text_file(path, "utf-8-sig"))
        with warnings.catch_warnings(action="error"):  # of cells beyond the heading
            table = pd.read_csv(text, dtype=str, index_col=False, keep_default_na=False).fillna("")
    except (OSError, ValueError, pd.errors.ParserWarning) as error:
        raise BadInput(f"{path}: cannot be read as a CSV table: {str(error).strip()}") from None
    return {str(heading).strip(): column.tolist() for heading, column in table.items()}


def numbers_of(cells: Sequence[str]) -> Floats:
    """Numbers of a column, with any of the signs that print uses for minus; NaN for anything else."""
    plain = [cell.replace("\N{MINUS SIGN}", "-").replace("\N{EN DASH}", "-") for cell in cells]
    return np.asarray(pd.to_numeric(pd.Series(plain), errors="coerce"), dtype=np.float64)


def column_numbers(table: Columns, heading: str, file: Path) -> Floats:
    """One column of finite numbers. Raises BadInput."""
    if heading not in table:
        raise BadInput(f"{file}: column '{heading}' is missing; there are: {', '.join(table)}")
    values = numbers_of(table[heading])
    for row in np.flatnonzero(~np.isfinite(values)).tolist():
        raise BadInput(f"{file}: row {row + 1}, {heading} = '{table[heading][row]}' must be a number")
    return values


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


def read_published(path: Path, response: str | None = None) -> PublishedTable:
    """A table of runs; the response is the last column where it is not named. Raises BadInput."""
    table = read_columns(path)
    names = list(table)
    wanted = response or names[-1]
    values = column_numbers(table, wanted, path)
    if len(values) < FEWEST_RUNS:
        raise BadInput(f"{path}: {len(values)} run(s); needs at least {FEWEST_RUNS}")
    chosen = factor_columns(table, names[: names.index(wanted)], path)
    if not chosen:
        raise BadInput(f"{path}: no column of factor levels before the response '{wanted}'")
    levels = np.column_stack(list(chosen.values()))
    factors = tuple(factor_of(name, column) for name, column in chosen.items())
    coded = np.round(to_coded(factors, levels), 9) + 0.0
    aside = tuple(name for name in names if name not in chosen and name != wanted)
    return PublishedTable(str(path), factors, levels, coded, wanted, values, aside)


def factor_columns(table: Columns, names: Sequence[str], file: Path) -> dict[str, Floats]:
    """Columns of levels by name: not of words, no counter, and of few levels where there are such columns."""
    written = [name for name in names if np.isfinite(numbers_of(table[name])).any()]
    numbers = {name: column_numbers(table, name, file) for name in written}
    counter = np.arange(1.0, len(next(iter(table.values()))) + 1.0)
    levels = {n: x for n, x in numbers.items() if np.ptp(x) > 0.0 and np.any(np.sort(x) != counter)}
    return {n: x for n, x in levels.items() if len(np.unique(x)) <= MOST_LEVELS} or levels


def factor_of(name: str, column: Floats) -> Factor:
    """A factor whose low and high are the outermost of the levels that stand more than once."""
    levels, counts = np.unique(column, return_counts=True)
    common = levels[counts > 1] if np.sum(counts > 1) > 1 else levels
    return Factor(name, float(common[0]), float(common[-1]))
