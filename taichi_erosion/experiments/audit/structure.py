"""Is the design what it claims to be: balanced, orthogonal; and if not, which single cell would restore it?

    balanced     every column of levels adds up to 0
    orthogonal   any two of those columns have the scalar product 0

In a design of three levels the products of two factors must be orthogonal too, or else a sign may stray
unnoticed. A design is restored by a cell if changing it alone makes all of these sums vanish.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments import design
from taichi_erosion.experiments.audit.published import Finding, PublishedTable
from taichi_erosion.experiments.terms import model_matrix, model_terms

NOTHING = 1e-6  # sums of coded levels below it vanish [1]
MOST_ODD = 0.1  # share of the runs beyond which levels are not misprints but the design's own [1]
MOST_NONORTHOGONAL = 2  # factors; where more overlap, the table is no orthogonal design at all
MOST_FACTORS = 6  # a larger two-level factorial is not looked for


@dataclass(frozen=True)
class Cell:
    """A cell and the coded level that would restore the design."""

    row: int  # from 0
    column: int
    level: float


@dataclass(frozen=True, eq=False)
class Structure:
    """What the levels alone say."""

    two_level: bool
    balanced: bool
    orthogonal: bool
    cells: tuple[Cell, ...]  # each restores the design alone
    textbook: str  # name of the design that the rows follow in standard order, but for these cells
    differing: tuple[Cell, ...]

    def restored(self, coded: Floats) -> Floats:
        """The levels with the one cell changed, where one alone restores them."""
        changed, cell = coded.copy(), self.chosen
        if cell is not None:
            changed[cell.row, cell.column] = cell.level
        return changed

    @property
    def chosen(self) -> Cell | None:
        """The cell that restores the design: the only one, or that in which it departs from its textbook."""
        known = [cell for cell in self.cells if len(self.cells) == 1 or cell in self.differing]
        return known[0] if len(known) == 1 else None


def examine_structure(coded: Floats) -> Structure:
    """Balance, orthogonality, the restoring cells, the textbook's design."""
    # almost every row is a corner or the centre; a wrong cell does not change the answer
    off_centre = coded[np.any(np.abs(coded) > NOTHING, axis=1)]
    two_level = bool(len(off_centre) and np.mean(np.abs(np.abs(off_centre) - 1.0) < NOTHING) > 0.75)
    balanced, orthogonal = soundness(coded, two_level)
    cells = () if balanced and orthogonal else tuple(restoring_cells(coded, two_level))
    return Structure(two_level, balanced, orthogonal, cells, *textbook(coded))


def soundness(coded: Floats, two_level: bool) -> tuple[bool, bool]:
    """Whether levels are balanced, and whether they are orthogonal."""
    terms = model_terms(coded.shape[1], "linear" if two_level else "interactions")
    matrix = model_matrix(coded, terms)[:, 1:]
    gram = matrix.T @ matrix
    overlap = gram[np.triu_indices(len(gram), 1)]
    return bool(np.all(np.abs(matrix.sum(axis=0)) < NOTHING)), bool(np.all(np.abs(overlap) < NOTHING))


def restoring_cells(coded: Floats, two_level: bool) -> Iterator[Cell]:
    """Every single change of a level after which nothing is left to find."""
    for column in range(coded.shape[1]):
        if not all(soundness(np.delete(coded, column, axis=1), two_level)):
            continue  # no cell of this column can restore the others
        for row in range(len(coded)):
            for level in (-1.0, 1.0) if two_level else (-1.0, 0.0, 1.0):
                changed = coded.copy()
                changed[row, column] = level
                if level != coded[row, column] and all(soundness(changed, two_level)):
                    yield Cell(row, column, level)


def textbook(coded: Floats) -> tuple[str, tuple[Cell, ...]]:
    """The named design that the first rows follow but for fewer than one cell in ten, and those cells."""
    found: tuple[str, tuple[Cell, ...]] = ("", ())
    fewest = coded.size / 10.0
    for name, points in named_designs(coded.shape[1]):
        rest = coded[len(points) :]
        if len(points) > len(coded) or np.any(np.abs(rest) > NOTHING):
            continue  # behind the design only centre points may follow
        places = np.argwhere(np.abs(coded[: len(points)] - points) > NOTHING)
        if len(places) < fewest:
            fewest = len(places)
            found = name, tuple(Cell(int(r), int(c), float(points[r, c])) for r, c in places)
    return found


def named_designs(count: int) -> Iterator[tuple[str, Floats]]:
    """Designs in standard order."""
    if 2 < count < max(design.CYCLES):
        yield "Plackett-Burman", design.plackett_burman_points(count)
    if count in design.TOGETHER:
        yield "Box-Behnken", design.box_behnken_points(count)
    if count <= MOST_FACTORS:
        yield "two-level factorial", design.grid_points(count, 2)


def structure_findings(table: PublishedTable, structure: Structure) -> Iterator[Finding]:
    """What is wrong with the levels, in sentences."""
    yield from odd_levels(table)
    for factor, column in zip(table.factors, table.coded.T, strict=True) if structure.two_level else ():
        high, low = int(np.sum(column > NOTHING)), int(np.sum(column < -NOTHING))
        if high != low:
            sentence = f"{factor.path} is {high} times high and {low} times low"
            yield Finding("unbalanced", sentence, column=factor.path, found=float(high - low))
    yield from not_orthogonal(table)
    for cell in structure.cells:
        yield cell_finding(table, structure, cell)


def odd_levels(table: PublishedTable) -> Iterator[Finding]:
    """Rows of a factor that stand on none of its levels, where nearly all others do."""
    for factor, column, levels in zip(table.factors, table.coded.T, table.levels.T, strict=True):
        odd = np.flatnonzero(np.min(np.abs(column[:, None] - np.array([-1.0, 0.0, 1.0])), axis=1) > NOTHING)
        for row in odd if len(odd) <= max(1.0, MOST_ODD * len(column)) else ():
            printed = f"{levels[row]:g}"
            sentence = f"{factor.path} = {printed} in row {row + 1} is no level of this design"
            yield Finding("level", sentence, column=factor.path, row=int(row) + 1, printed=printed)


def not_orthogonal(table: PublishedTable) -> Iterator[Finding]:
    """Factors that share something with others; one sentence for a table that is no orthogonal design."""
    gram, names = table.coded.T @ table.coded, [factor.path for factor in table.factors]
    pairs = [(i, j) for i, j in combinations(range(len(gram)), 2) if abs(gram[i, j]) > NOTHING]
    left, left_out = list(pairs), 0
    while left:  # factors, left out one after the other, until no pair overlaps
        named = [factor for pair in left for factor in pair]
        worst = max(set(named), key=named.count)
        left, left_out = [pair for pair in left if worst not in pair], left_out + 1
    if left_out > MOST_NONORTHOGONAL:
        correlation = np.atleast_2d(np.corrcoef(table.coded, rowvar=False))
        one, other = max(pairs, key=lambda pair: abs(correlation[pair]))
        most = float(correlation[one, other])
        sentence = f"{len(pairs)} pairs of factors are not orthogonal; most of all {names[one]} and "
        sentence += f"{names[other]}, correlation {most:.2f}"
        yield Finding("not orthogonal", sentence, column=names[one], found=most)
        return
    for k, name in enumerate(names):
        others = [names[i if j == k else j] for i, j in pairs if k in (i, j)]
        if others and len(others) >= min(len(names) - 1, 2):
            sentence = f"{name} is not orthogonal to {', '.join(others)}"
            yield Finding("not orthogonal", sentence, column=name, found=float(len(others)))


def cell_finding(table: PublishedTable, structure: Structure, cell: Cell) -> Finding:
    """The sentence for a cell that restores the design."""
    factor, count = table.factors[cell.column], len(structure.cells)
    printed = f"{table.levels[cell.row, cell.column]:g}"
    level = factor.centre + factor.half * cell.level
    sentence = f"row {cell.row + 1}, {factor.path} is printed {printed}; {level:g} makes the design balanced "
    sentence += "and orthogonal, and "
    sentence += "it is the only such cell" if count == 1 else f"one of {count} such cells"
    if cell in structure.differing:
        sentence += (
            f"; it is also where the table departs from the {structure.textbook} design in standard order"
        )
    return Finding("cell", sentence, "", factor.path, cell.row + 1, printed, level)
