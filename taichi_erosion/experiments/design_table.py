"""A design: levels of factors run by run, in coded and in natural units, and its CSV table.

    x = (natural - centre) / half,   centre = (high + low) / 2,   half = (high - low) / 2

with x the coded level [1]: -1 at the low, +1 at the high end of a factor's range. The table can be filled in
by a spreadsheet and comes back unchanged. One row a run, in standard order: `run` (standard order, from 1),
`turn` (when it is carried out), `block`, `point`, one column of natural values for every factor headed
`path [unit] low..high`, one of coded levels headed `coded path`, then the responses. An empty cell of a
response is a run without a result.

Reference: Box, Hunter & Hunter (2005), Statistics for Experimenters, 2nd ed., ch. 5.
"""

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite, nan
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.files import read_text_file

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
PointKind = Literal["factorial", "edge", "axial", "centre", "path", "space", "added"]
SAME_POINT = 1e-9  # coded levels closer than this are one level; they come from decimal numbers [1]


@dataclass(frozen=True)
class Factor:
    """A parameter and the range over which a design varies it, in the parameter's own unit."""

    path: str  # dotted path of a scene's parameter, or any name of a column
    low: float  # coded -1
    high: float  # coded +1
    unit: str = "1"

    def __post_init__(self) -> None:
        """Refuse a range that is none."""
        if not (isfinite(self.low) and isfinite(self.high) and self.low < self.high):
            raise BadInput(f"factor {self.path}: low = {self.low:g}, high = {self.high:g}; needs low < high")

    @property
    def centre(self) -> float:
        """Natural value at the coded level 0."""
        return 0.5 * (self.low + self.high)

    @property
    def half(self) -> float:
        """Natural width of one coded unit."""
        return 0.5 * (self.high - self.low)


@dataclass(frozen=True, eq=False)
class Design:
    """Runs of an experiment, its rows in standard order.

    `run_order[i]` is the turn (from 1) in which row i is carried out; `by_turn` lists rows in that order.
    """

    name: str
    factors: tuple[Factor, ...]
    coded: Floats  # [runs, factors]
    run_order: Integers  # [runs], 1 ... runs
    blocks: Integers  # [runs], 1 ...
    kinds: tuple[PointKind, ...]  # [runs]
    responses: dict[str, Floats] = field(default_factory=dict)  # by name, [runs]; NaN where a run failed

    @property
    def natural(self) -> Floats:
        """Levels in the factors' own units, [runs, factors]."""
        return to_natural(self.factors, self.coded)

    @property
    def by_turn(self) -> Integers:
        """Rows in the order in which they are carried out."""
        return np.argsort(self.run_order, kind="stable")

    def __len__(self) -> int:
        """Number of runs."""
        return len(self.coded)

    def settings(self, row: int) -> dict[str, float]:
        """Natural value of every factor in one row, by path."""
        return {
            factor.path: float(value) for factor, value in zip(self.factors, self.natural[row], strict=True)
        }

    def with_responses(self, **responses: ArrayLike) -> "Design":
        """The design with columns of results, given in standard order."""
        columns = {name: np.asarray(column, dtype=float) for name, column in responses.items()}
        for name, column in columns.items():
            if column.shape != (len(self),):
                raise ValueError(f"response {name}: {column.shape} values for {len(self)} runs")
        return replace(self, responses=self.responses | columns)


def to_natural(factors: Sequence[Factor], coded: ArrayLike) -> Floats:
    """Natural values of coded levels, [..., factors]; -1, 0 and +1 give low, centre and high to the bit."""
    levels = np.asarray(coded, dtype=float)
    low, high = np.array([f.low for f in factors]), np.array([f.high for f in factors])
    centre, half = np.array([f.centre for f in factors]), np.array([f.half for f in factors])
    return np.where(levels == -1.0, low, np.where(levels == 1.0, high, centre + half * levels))


def to_coded(factors: Sequence[Factor], natural: ArrayLike) -> Floats:
    """Coded levels of natural values, [..., factors]."""
    centre, half = np.array([f.centre for f in factors]), np.array([f.half for f in factors])
    return (np.asarray(natural, dtype=float) - centre) / half


def refuse_bad_factors(factors: Sequence[Factor], fewest: int, design: str) -> None:
    """Raise BadInput for too few factors or one that stands twice."""
    paths = [factor.path for factor in factors]
    twice = [path for path in dict.fromkeys(paths) if paths.count(path) > 1]
    if twice:
        raise BadInput(f"{design}: factor {twice[0]} is named twice")
    if len(paths) < fewest:
        raise BadInput(f"{design}: {len(paths)} factor(s); needs at least {fewest}")


def arranged(
    name: str,
    factors: Sequence[Factor],
    parts: Sequence[tuple[PointKind, Floats]],
    seed: int | None = None,
    blocks: Sequence[int] | None = None,
) -> Design:
    """A design of several parts, one below the other; every part may be a block of its own.

    With a seed the runs are carried out in random order within their blocks, without one in standard order.
    """
    coded = np.concatenate([points for _, points in parts])
    of_part = [1] * len(parts) if blocks is None else blocks
    block = np.repeat(np.array(of_part, dtype=np.int64), [len(points) for _, points in parts])
    return Design(
        name=name,
        factors=tuple(factors),
        coded=coded + 0.0,  # a level of -0.0 would print with its sign
        run_order=run_order(block, seed),
        blocks=block,
        kinds=tuple(kind for kind, points in parts for _ in points),
    )


def run_order(blocks: Integers, seed: int | None) -> Integers:
    """Turn of every row, block after block; shuffled within a block where a seed is given."""
    rows = np.arange(len(blocks))
    if seed is not None:
        rows = np.random.default_rng(seed).permutation(rows)
    queue = rows[np.argsort(blocks[rows], kind="stable")]
    turns = np.empty(len(blocks), dtype=np.int64)
    turns[queue] = np.arange(1, len(blocks) + 1)
    return turns


def replicate_groups(coded: Floats, blocks: Integers | None = None) -> Integers:
    """Number of the distinct point (and block) at which each row was run, [runs]."""
    keys = np.round(coded / SAME_POINT) + 0.0  # -0.0 is the same point; a misprint may lie beyond integers
    if blocks is not None:
        keys = np.column_stack([keys, blocks])
    return np.unique(keys, axis=0, return_inverse=True)[1].ravel()


FIXED = ("run", "turn", "block", "point")
CODED = "coded "
FACTOR = re.compile(r"(?P<path>\S+) \[(?P<unit>[^\]]*)\] (?P<low>\S+)\.\.(?P<high>\S+)")
AGREE = 1e-6  # natural value and coded level may differ by this share of a factor's half range [1]


def design_text(design: Design) -> str:
    """The table as CSV."""
    headings = [f"{f.path} [{f.unit}] {f.low!r}..{f.high!r}" for f in design.factors]
    coded = [CODED + f.path for f in design.factors]
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*FIXED, *headings, *coded, *design.responses])
    for row, natural in enumerate(design.natural):
        fixed = [row + 1, int(design.run_order[row]), int(design.blocks[row]), design.kinds[row]]
        numbers = [*natural, *design.coded[row], *(column[row] for column in design.responses.values())]
        writer.writerow([*fixed, *("" if value != value else repr(float(value)) for value in numbers)])
    return text.getvalue()


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


def column_numbers(
    columns: Mapping[str, Sequence[str]], heading: str, file: str, gaps: bool = False
) -> Floats:
    """One column of finite numbers; an empty cell is NaN where gaps are allowed. Raises BadInput."""
    if heading not in columns:
        raise BadInput(f"{file}: column '{heading}' is missing")
    values = np.array([as_number(text) for text in columns[heading]])
    for row, (text, value) in enumerate(zip(columns[heading], values, strict=True), start=1):
        if not isfinite(value) and (text or not gaps):
            raise BadInput(f"{file}: row {row}, {heading} = '{text}' must be a number")
    return values


def as_number(text: str) -> float:
    """A number with any of the signs that print uses for minus; NaN for anything else."""
    try:
        return float(text.replace("\N{MINUS SIGN}", "-").replace("\N{EN DASH}", "-"))
    except ValueError:
        return nan


def read_design(path: Path) -> Design:
    """The design of a table of `design_text`; raises BadInput with file, row and column."""
    columns = read_columns(path)
    if tuple(columns)[:4] != FIXED or not columns["run"]:
        raise BadInput(f"{path}: not a design; its first columns must be {', '.join(FIXED)}")
    return parsed(columns, str(path))


def parsed(columns: Mapping[str, Sequence[str]], name: str) -> Design:
    """The design of columns of text."""
    factors = tuple(factor for heading in columns if (factor := read_factor(heading, name)) is not None)
    if not factors:
        raise BadInput(f"{name}: no factor; a factor's heading is 'path [unit] low..high'")
    known = {*FIXED, *(CODED + f.path for f in factors)}
    natural_headings = {heading for heading in columns if FACTOR.fullmatch(heading)}
    coded = np.column_stack([column_numbers(columns, CODED + f.path, name) for f in factors])
    natural = np.column_stack(
        [column_numbers(columns, heading, name) for heading in columns if heading in natural_headings]
    )
    refuse_disagreement(factors, coded, natural, name)
    order, blocks = (column_numbers(columns, heading, name).astype(np.int64) for heading in ("turn", "block"))
    if sorted(order) != list(range(1, len(coded) + 1)):
        raise BadInput(f"{name}: column turn must hold each of 1 to {len(coded)} once")
    others = [heading for heading in columns if heading not in known | natural_headings]
    return Design(
        name=name,
        factors=factors,
        coded=coded,
        run_order=order,
        blocks=blocks,
        kinds=tuple(read_kind(text, name) for text in columns["point"]),
        responses={heading: column_numbers(columns, heading, name, gaps=True) for heading in others},
    )


def read_factor(heading: str, name: str) -> Factor | None:
    """The factor that a heading describes, None where it describes none."""
    match = FACTOR.fullmatch(heading)
    if match is None:
        return None
    try:
        return Factor(match["path"], float(match["low"]), float(match["high"]), match["unit"])
    except ValueError:
        raise BadInput(f"{name}: heading '{heading}': the range must be two numbers low..high") from None


def read_kind(text: str, name: str) -> PointKind:
    """Kind of a point."""
    for kind in get_args(PointKind):
        if text == kind:
            return kind
    raise BadInput(f"{name}: point = '{text}'; allowed: {', '.join(get_args(PointKind))}")


def refuse_disagreement(factors: Sequence[Factor], coded: Floats, natural: Floats, name: str) -> None:
    """Refuse a table in which only one of a natural value and its coded level was changed."""
    half = np.array([f.half for f in factors])
    wrong = np.argwhere(np.abs(natural - to_natural(factors, coded)) > AGREE * half)
    if len(wrong):
        row, column = wrong[0]
        raise BadInput(
            f"{name}: row {row + 1}, {factors[column].path} = {natural[row, column]:g} does not belong to "
            f"the coded level {coded[row, column]:g}; change both"
        )
