"""Is the design what it claims to be: balanced, orthogonal; and if not, which single cell would restore it?

    balanced     every column of levels adds up to 0
    orthogonal   any two of those columns have the scalar product 0

In a design of three levels the products of two factors must be orthogonal too, or else a sign may stray
unnoticed. A design is restored by a cell if changing it alone makes all of these sums vanish.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from taichi_erosion.experiments import design
from taichi_erosion.experiments.audit.published import Finding, PublishedTable
from taichi_erosion.experiments.design_table import Floats
from taichi_erosion.experiments.terms import columns, interaction_terms, linear_terms

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

    def restored(self, coded: Floats) -> Floats | None:
        """The levels with the one cell changed, where one alone restores them."""
        cell = self.chosen
        if cell is None:
            return None
        changed = coded.copy()
        changed[cell.row, cell.column] = cell.level
        return changed

    @property
    def chosen(self) -> Cell | None:
        """The cell that restores the design: the only one, or that in which it departs from its textbook."""
        if len(self.cells) == 1:
            return self.cells[0]
        known = [cell for cell in self.cells if cell in self.differing]
        return known[0] if len(known) == 1 else None


def examine_structure(table: PublishedTable) -> Structure:
    """Balance, orthogonality, the restoring cells, the textbook's design."""
    coded = table.coded
    two_level = is_two_level(coded)
    sums, products = imbalance(coded, two_level), overlap(coded, two_level)
    balanced, orthogonal = bool(np.all(sums < NOTHING)), bool(np.all(products < NOTHING))
    cells = () if balanced and orthogonal else tuple(restoring_cells(coded, two_level))
    name, differing = textbook(coded)
    return Structure(two_level, balanced, orthogonal, cells, name, differing)


def is_two_level(coded: Floats) -> bool:
    """Whether almost every row is a corner or the centre; a wrong cell does not change the answer."""
    corner = np.abs(np.abs(coded) - 1.0) < NOTHING
    centre = np.all(np.abs(coded) < NOTHING, axis=1)
    return bool(np.mean(corner[~centre]) > 0.75) if (~centre).any() else False


def imbalance(coded: Floats, two_level: bool) -> Floats:
    """Size of the sum of every column, the products of a three-level design included."""
    return np.abs(np.sum(contrasts(coded, two_level), axis=0))


def overlap(coded: Floats, two_level: bool) -> Floats:
    """Size of the scalar products of all pairs of columns."""
    matrix = contrasts(coded, two_level)
    gram = matrix.T @ matrix
    return np.abs(gram[np.triu_indices(len(gram), 1)])


def contrasts(coded: Floats, two_level: bool) -> Floats:
    """Columns that a sound design keeps apart."""
    count = coded.shape[1]
    terms = linear_terms(count) + (() if two_level else interaction_terms(count))
    return columns(coded, terms)


def restoring_cells(coded: Floats, two_level: bool) -> Iterator[Cell]:
    """Every single change of a level after which nothing is left to find."""
    for column in range(coded.shape[1]):
        others = np.delete(coded, column, axis=1)
        if not is_sound(others, two_level):
            continue  # no cell of this column can restore the others
        for row in range(len(coded)):
            for level in (-1.0, 1.0) if two_level else (-1.0, 0.0, 1.0):
                changed = coded.copy()
                changed[row, column] = level
                if level != coded[row, column] and is_sound(changed, two_level):
                    yield Cell(row, column, level)


def is_sound(coded: Floats, two_level: bool) -> bool:
    """Whether levels are balanced and orthogonal."""
    return bool(np.all(imbalance(coded, two_level) < NOTHING) and np.all(overlap(coded, two_level) < NOTHING))


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
    if structure.two_level:
        yield from unbalanced(table)
    yield from not_orthogonal(table)
    for cell in structure.cells:
        yield cell_finding(table, structure, cell)


def odd_levels(table: PublishedTable) -> Iterator[Finding]:
    """Rows of a factor that stand on none of its levels, where nearly all others do."""
    for k, factor in enumerate(table.factors):
        column = table.coded[:, k]
        odd = np.flatnonzero(np.min(np.abs(column[:, None] - np.array([-1.0, 0.0, 1.0])), axis=1) > NOTHING)
        for row in odd if len(odd) <= max(1.0, MOST_ODD * len(column)) else ():
            printed = f"{table.levels[row, k]:g}"
            sentence = f"{factor.path} = {printed} in row {row + 1} is no level of this design"
            yield Finding("level", sentence, column=factor.path, row=int(row) + 1, printed=printed)


def unbalanced(table: PublishedTable) -> Iterator[Finding]:
    """Factors that are not as often high as low."""
    for k, factor in enumerate(table.factors):
        high, low = int(np.sum(table.coded[:, k] > NOTHING)), int(np.sum(table.coded[:, k] < -NOTHING))
        if high != low:
            sentence = f"{factor.path} is {high} times high and {low} times low"
            yield Finding("unbalanced", sentence, column=factor.path, found=float(high - low))


def not_orthogonal(table: PublishedTable) -> Iterator[Finding]:
    """Factors that share something with others."""
    matrix = columns(table.coded, linear_terms(len(table.factors)))
    gram = matrix.T @ matrix
    pairs = [(i, j) for i, j in combinations(range(len(gram)), 2) if abs(gram[i, j]) > NOTHING]
    if nonorthogonal_factors(pairs) > MOST_NONORTHOGONAL:
        yield worst_pair(table, pairs)
        return
    for k, factor in enumerate(table.factors):
        others = [table.factors[i if j == k else j].path for i, j in pairs if k in (i, j)]
        if others and len(others) >= min(len(table.factors) - 1, 2):
            sentence = f"{factor.path} is not orthogonal to {', '.join(others)}"
            yield Finding("not orthogonal", sentence, column=factor.path, found=float(len(others)))


def nonorthogonal_factors(pairs: Sequence[tuple[int, int]]) -> int:
    """How few factors, left out one after the other, leave no pair that overlaps."""
    left, count = list(pairs), 0
    while left:
        named = [factor for pair in left for factor in pair]
        worst = max(set(named), key=named.count)
        left = [pair for pair in left if worst not in pair]
        count += 1
    return count


def worst_pair(table: PublishedTable, pairs: Sequence[tuple[int, int]]) -> Finding:
    """One sentence for a table that is no orthogonal design at all."""
    correlation = np.atleast_2d(np.corrcoef(table.coded, rowvar=False))
    one, other = max(pairs, key=lambda pair: abs(correlation[pair]))
    sentence = (
        f"{len(pairs)} pairs of factors are not orthogonal; most of all {table.factors[one].path} and "
        f"{table.factors[other].path}, correlation {correlation[one, other]:.2f}"
    )
    column = table.factors[one].path
    return Finding("not orthogonal", sentence, column=column, found=float(correlation[one, other]))


def cell_finding(table: PublishedTable, structure: Structure, cell: Cell) -> Finding:
    """The sentence for a cell that restores the design."""
    factor = table.factors[cell.column]
    printed = f"{table.levels[cell.row, cell.column]:g}"
    level = factor.centre + factor.half * cell.level
    alone = (
        "it is the only such cell"
        if len(structure.cells) == 1
        else f"one of {len(structure.cells)} such cells"
    )
    book = (
        f"; it is also where the table departs from the {structure.textbook} design in standard order"
        if cell in structure.differing
        else ""
    )
    return Finding(
        "cell",
        f"row {cell.row + 1}, {factor.path} is printed {printed}; {level:g} makes the design balanced and "
        f"orthogonal, and {alone}{book}",
        column=factor.path,
        row=cell.row + 1,
        printed=printed,
        found=level,
    )
