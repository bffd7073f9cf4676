"""A published table of runs, and what the study prints about it: `TABLE.claims.toml` beside the table.

model = "quadratic"            # linear | interactions | quadratic; guessed from the levels if left out
anova = "table_9.csv"          # printed analysis of variance
levels = "table_7.csv"         # printed coding: column `level`, then one for every factor
others = ["table_6.csv"]       # other tables of the same response, in natural units
target = 33.52                 # target of the study
[equation]                     # printed coefficients in coded units, by term; "1" is the constant
[quality]                      # printed r2, r2_adjusted, r2_predicted, cv, adequate_precision
[optimum]                      # printed best setting in natural units, by factor
[t_test]                       # runs = [...], mean, sd, n of the measurement, and the printed p

Numbers are kept as printed: the last digit says how exact they are. In the table, the columns of numbers
before the response are the factors, but for one that counts the runs and for those that hold results. What
stands behind the response, other responses or the same levels in other units, is set aside.
"""

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import isfinite, nan
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file
from taichi_erosion.experiments import design_table
from taichi_erosion.experiments.design_table import Design, Factor, Floats
from taichi_erosion.experiments.terms import Order

Kind = Literal[
    "unbalanced",  # a factor is not as often high as low
    "not orthogonal",  # factors are confounded
    "cell",  # one cell whose change restores the design
    "level",  # a level that stands alone
    "lack of fit",  # the model misses the means of its points
    "curvature",  # the centre lies off the plane
    "number",  # a printed number that the table does not give
    "sum",  # printed parts that do not add up
    "heading",  # a column that holds something else
    "sign",  # a coefficient of the opposite sign
    "coding",  # levels whose order is reversed
    "target",  # not reached by the fitted surface
    "optimum",  # the published optimum against the recomputed one
    "same point",  # one point, two results
    "prediction",  # a run that the fitted surface contradicts
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
        if not isfinite(found):
            return False
        if self.bound:
            return found < self.value if self.bound == "<" else found > self.value
        return abs(found - self.value) <= HALF * self.last_digit + 1e-12 * abs(self.value)

    def cut_off(self, found: float) -> bool:
        """Whether the found number would be printed like this if its further digits were cut off."""
        return 0.0 <= abs(found) - abs(self.value) < self.last_digit and found * self.value >= 0.0

    def opposite(self, found: float) -> bool:
        """Whether it would agree with the opposite sign, and only then."""
        flipped = Printed(self.text, -self.value, self.last_digit, self.bound)
        return not self.agrees(found) and flipped.agrees(found)


def parse_printed(text: str) -> Printed | None:
    """The number of a cell, stars of significance apart; None for anything else."""
    match = NUMBER.fullmatch(text.strip().rstrip("*").strip())
    if match is None:
        return None
    decimals = len(match["decimals"] or match["bare"] or "")
    power = int(match["power"] or 0)
    return Printed(text.strip(), float(match["number"]), 10.0 ** (power - decimals), match["bound"])


ENDING = ".claims.toml"


@dataclass(frozen=True)
class TestClaim:
    """Confirmation runs against a measurement, and the p value that is printed for them."""

    runs: tuple[float, ...]
    mean: float
    sd: float
    n: int
    p: Printed


@dataclass(frozen=True)
class Claims:
    """What is printed about one table; files are beside it."""

    model: Order | None = None
    anova: Path | None = None
    levels: Path | None = None
    others: tuple[Path, ...] = ()
    target: Printed | None = None
    equation: Mapping[str, Printed] = field(default_factory=dict)
    quality: Mapping[str, Printed] = field(default_factory=dict)
    optimum: Mapping[str, Printed] = field(default_factory=dict)
    t_test: TestClaim | None = None


def claims_of(table: Path, file: Path | None = None) -> Claims:
    """Claims of a table, from the named file or from the one beside it; none where there is none."""
    path = file or table.with_suffix("").with_name(table.stem + ENDING)
    if file is None and not path.exists():
        return Claims()
    try:
        # a number keeps its printed digits: its text, not its value, says how exact it is
        document = tomllib.loads(read_text_file(path), parse_float=str)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise BadInput(f"{path}: {error}") from None
    unknown = [key for key in document if key not in {f.name for f in fields(Claims)}]
    if unknown:
        allowed = ", ".join(f.name for f in fields(Claims))
        raise BadInput(f"{path}: unknown field {unknown[0]}; allowed: {allowed}")
    return parsed(document, path)


def parsed(document: Mapping[str, Any], path: Path) -> Claims:
    """Claims of a TOML document."""
    model = document.get("model")
    if model is not None and model not in get_args(Order):
        raise BadInput(f"{path}: model = '{model}'; allowed: {', '.join(get_args(Order))}")

    def beside(name: str | None) -> Path | None:
        return None if name is None else path.parent / name

    return Claims(
        model=model,
        anova=beside(document.get("anova")),
        levels=beside(document.get("levels")),
        others=tuple(path.parent / name for name in document.get("others", ())),
        target=printed(document["target"], path, "target") if "target" in document else None,
        equation=printed_table(document, "equation", path),
        quality=printed_table(document, "quality", path),
        optimum=printed_table(document, "optimum", path),
        t_test=read_test(document["t_test"], path) if "t_test" in document else None,
    )


def printed(value: object, path: Path, name: str) -> Printed:
    """A printed number."""
    found = parse_printed(str(value))
    if found is None:
        raise BadInput(f"{path}: {name} = {value!r} must be a number")
    return found


def printed_table(document: Mapping[str, Any], name: str, path: Path) -> dict[str, Printed]:
    """Printed numbers by name."""
    return {key: printed(value, path, f"{name}.{key}") for key, value in document.get(name, {}).items()}


def read_test(entry: Mapping[str, Any], path: Path) -> TestClaim:
    """The t-test of confirmation runs."""
    missing = [key for key in ("runs", "mean", "sd", "n", "p") if key not in entry]
    if missing:
        raise BadInput(f"{path}: t_test.{missing[0]} is missing")
    runs = tuple(printed(value, path, "t_test.runs").value for value in entry["runs"])
    mean, sd, n = (printed(entry[key], path, f"t_test.{key}").value for key in ("mean", "sd", "n"))
    return TestClaim(runs, mean, sd, int(n), printed(entry["p"], path, "t_test.p"))


FEWEST_RUNS = 3
COUNTER_NAMES = ("run", "no", "n", "nr", "std", "order", "test", "trial", "number", "row", "experiment")
MOST_LEVELS = 6  # of a factor in a designed experiment; a central composite has 5, a misprint adds one


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

    def design(self, coded: Floats | None = None) -> Design:
        """The table as a design, its levels as printed or as given."""
        points = self.coded if coded is None else coded
        plain = design_table.arranged(self.name, self.factors, [("factorial", points)])
        return plain.with_responses(**{self.response: self.values})


def read_published(path: Path, response: str | None = None) -> PublishedTable:
    """A table of runs; the response is the last column where it is not named."""
    columns = design_table.read_columns(path)
    names = list(columns)
    wanted = response or names[-1]
    if wanted not in columns:
        raise BadInput(f"{path}: no column '{wanted}'; there are: {', '.join(names)}")
    values = design_table.column_numbers(columns, wanted, str(path))
    if len(values) < FEWEST_RUNS:
        raise BadInput(f"{path}: {len(values)} run(s); needs at least {FEWEST_RUNS}")
    chosen, aside = factor_columns(columns, wanted, str(path))
    if not chosen:
        raise BadInput(f"{path}: no column of factor levels beside the response '{wanted}'")
    levels = np.column_stack(list(chosen.values()))
    factors = tuple(factor_of(name, column) for name, column in chosen.items())
    coded = np.round(design_table.to_coded(factors, levels), 9) + 0.0
    return PublishedTable(str(path), factors, levels, coded, wanted, values, tuple(aside))


def factor_columns(
    columns: Mapping[str, Sequence[str]], response: str, file: str
) -> tuple[dict[str, Floats], list[str]]:
    """Columns of levels by name, and the names of what is set aside."""
    names = list(columns)
    place = names.index(response)
    for side in (names[:place], names[place + 1 :]):  # a table may begin with its response
        found = {
            name: design_table.column_numbers(columns, name, file)
            for name in side
            if not is_text(columns[name])
        }
        levels = {
            name: column
            for name, column in found.items()
            if not is_counter(name, column) and np.ptp(column) > 0.0
        }
        chosen = without_responses(levels)
        if chosen:
            return chosen, [name for name in names if name not in chosen and name != response]
    return {}, []


def is_text(cells: Sequence[str]) -> bool:
    """Whether a column holds words only."""
    return all(design_table.as_number(text) != design_table.as_number(text) for text in cells)


def without_responses(levels: Mapping[str, Floats]) -> dict[str, Floats]:
    """The columns of few levels, where there are any; the others are then results, not levels."""
    few = {name: column for name, column in levels.items() if len(np.unique(column)) <= MOST_LEVELS}
    runs = max((len(column) for column in levels.values()), default=0)
    return dict(few if few and runs > 2 * MOST_LEVELS else levels)


def is_counter(name: str, column: Floats) -> bool:
    """Whether a column numbers the runs."""
    plain = "".join(c for c in name.lower() if c.isalpha())
    counts = np.array_equal(np.sort(column), np.arange(1, len(column) + 1))
    return counts and (plain in COUNTER_NAMES or np.array_equal(column, np.arange(1, len(column) + 1)))


def factor_of(name: str, column: Floats) -> Factor:
    """A factor whose low and high are the outermost of the levels that stand more than once."""
    levels, counts = np.unique(column, return_counts=True)
    common = levels[counts > 1] if np.sum(counts > 1) > 1 else levels
    return Factor(name, float(common[0]), float(common[-1]))
