"""A design as a CSV table that a spreadsheet can fill in and that comes back unchanged.

One row a run, in standard order: `run` (standard order, from 1), `turn` (when it is carried out), `block`,
`point`, one column of natural values for every factor headed `path [unit] low..high`, one of coded levels
headed `coded path`, then the responses. An empty cell of a response is a run without a result.
"""

import csv
import io
import re
from collections.abc import Mapping, Sequence
from math import isfinite, nan
from pathlib import Path
from typing import get_args

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.plain_file import plain_text
from taichi_erosion.experiments.table import Design, Factor, Floats, PointKind, to_natural

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


def write_design(design: Design, path: Path) -> None:
    """Write the table to a file."""
    path.write_text(design_text(design), encoding="utf-8")


def read_design(path: Path) -> Design:
    """The design of a table that `write_design` wrote; raises BadInput with file, row and column."""
    try:
        lines = list(csv.reader(io.StringIO(plain_text(path, "utf-8-sig"), newline=""), strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"{path}: cannot be read as a CSV table: {error}") from None
    if len(lines) < 2 or tuple(lines[0][:4]) != FIXED:
        raise BadInput(f"{path}: not a design; its first columns must be {', '.join(FIXED)}")
    width = len(lines[0])
    for number, cells in enumerate(lines[1:], start=1):
        if len(cells) != width:
            raise BadInput(f"{path}: row {number} has {len(cells)} cells, the heading {width}")
    columns = {heading: [line[k] for line in lines[1:]] for k, heading in enumerate(lines[0])}
    return parsed(columns, str(path))


def parsed(columns: Mapping[str, Sequence[str]], name: str) -> Design:
    """The design of columns of text."""
    factors = tuple(factor for heading in columns if (factor := read_factor(heading, name)) is not None)
    if not factors:
        raise BadInput(f"{name}: no factor; a factor's heading is 'path [unit] low..high'")
    known = {*FIXED, *(CODED + f.path for f in factors)}
    natural_headings = {heading for heading in columns if FACTOR.fullmatch(heading)}
    coded = np.column_stack([numbers(columns, CODED + f.path, name) for f in factors])
    natural = np.column_stack(
        [numbers(columns, heading, name) for heading in columns if heading in natural_headings]
    )
    refuse_disagreement(factors, coded, natural, name)
    order, blocks = (numbers(columns, heading, name).astype(np.int64) for heading in ("turn", "block"))
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
        responses={heading: numbers(columns, heading, name, gaps=True) for heading in others},
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


def numbers(columns: Mapping[str, Sequence[str]], heading: str, name: str, gaps: bool = False) -> Floats:
    """One column of numbers; an empty cell is NaN where gaps are allowed."""
    if heading not in columns:
        raise BadInput(f"{name}: column '{heading}' is missing")
    values = []
    for row, text in enumerate(columns[heading], start=1):
        try:
            value = nan if gaps and not text.strip() else float(text)
        except ValueError:
            value = nan
        if not isfinite(value) and not (gaps and not text.strip()):
            raise BadInput(f"{name}: row {row}, {heading} = '{text}' must be a number")
        values.append(value)
    return np.array(values)


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
