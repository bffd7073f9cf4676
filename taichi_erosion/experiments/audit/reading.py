"""A table of runs as somebody published it: which columns are factors, and which levels they mean.

The columns of numbers before the response are the factors, but for one that counts the runs and for those
that hold results. What stands behind the response, other responses or the same levels in other units, is set
aside.
"""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file
from taichi_erosion.experiments.design_table import Design, Factor, Floats, arranged

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
        plain = arranged(self.name, self.factors, [("factorial", points)])
        return plain.with_responses(**{self.response: self.values})


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
        raise BadInput(f"{path}: a heading stands twice in {', '.join(headings)}")
    for number, line in enumerate(lines[1:], start=1):
        if len(line) != len(headings):
            raise BadInput(f"{path}: row {number} has {len(line)} cells, the heading {len(headings)}")
    return {heading: [line[k].strip() for line in lines[1:]] for k, heading in enumerate(headings)}


def read_published(path: Path, response: str | None = None) -> PublishedTable:
    """A table of runs; the response is the last column where it is not named."""
    columns = read_columns(path)
    names = list(columns)
    wanted = response or names[-1]
    if wanted not in columns:
        raise BadInput(f"{path}: no column '{wanted}'; there are: {', '.join(names)}")
    values = numbers(columns, wanted, str(path))
    if len(values) < FEWEST_RUNS:
        raise BadInput(f"{path}: {len(values)} run(s); needs at least {FEWEST_RUNS}")
    chosen, aside = factor_columns(columns, wanted, str(path))
    if not chosen:
        raise BadInput(f"{path}: no column of factor levels beside the response '{wanted}'")
    levels = np.column_stack(list(chosen.values()))
    factors = tuple(factor_of(name, column) for name, column in chosen.items())
    centre, half = np.array([f.centre for f in factors]), np.array([f.half for f in factors])
    coded = np.round((levels - centre) / half, 9) + 0.0
    return PublishedTable(str(path), factors, levels, coded, wanted, values, tuple(aside))


def numbers(columns: Mapping[str, Sequence[str]], name: str, file: str) -> Floats:
    """A column of finite numbers."""
    values = np.array([as_number(text) for text in columns[name]])
    bad = np.flatnonzero(~np.isfinite(values))
    if len(bad):
        raise BadInput(f"{file}: row {bad[0] + 1}, {name} = '{columns[name][bad[0]]}' must be a number")
    return values


def as_number(text: str) -> float:
    """A number with any of the signs that print uses for minus; NaN for anything else."""
    try:
        return float(text.replace("\N{MINUS SIGN}", "-").replace("\N{EN DASH}", "-"))
    except ValueError:
        return float("nan")


def factor_columns(
    columns: Mapping[str, Sequence[str]], response: str, file: str
) -> tuple[dict[str, Floats], list[str]]:
    """Columns of levels by name, and the names of what is set aside."""
    names = list(columns)
    place = names.index(response)
    for side in (names[:place], names[place + 1 :]):  # a table may begin with its response
        found = {name: numbers(columns, name, file) for name in side if not is_text(columns[name])}
        levels = {name: column for name, column in found.items() if not is_idle(name, column)}
        chosen = without_responses(levels)
        if chosen:
            return chosen, [name for name in names if name not in chosen and name != response]
    return {}, []


def is_text(cells: Sequence[str]) -> bool:
    """Whether a column holds words only."""
    return all(as_number(text) != as_number(text) for text in cells)


def is_idle(name: str, column: Floats) -> bool:
    """Whether a column tells runs apart by nothing but their number."""
    return is_counter(name, column) or bool(np.ptp(column) == 0.0)


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
