"""The audit of one table: its design, the fitted model, printed numbers and conclusions against both.

    balanced     every column of levels adds up to 0
    orthogonal   any two of those columns have the scalar product 0

In a design of three levels the products of two factors must be orthogonal too, or else a sign may stray
unnoticed. A design is restored by a cell if changing it alone makes all of these sums vanish.

Compared are sums of squares, tests, figures of merit and coefficients; then the target, which the fitted
surface may not reach.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments.anova import anova, curvature
from taichi_erosion.experiments.design import arranged
from taichi_erosion.experiments.fit import (
    Fit,
    Term,
    coded_polynomial,
    coefficient_table,
    fit_model,
    interaction_terms,
    model_matrix,
    model_terms,
    quality,
    term_name,
)
from taichi_erosion.experiments.optimise import Goal, optimise
from taichi_erosion.experiments.published import (
    Claims,
    Finding,
    Kind,
    Printed,
    PublishedTable,
    claims_of,
    parse_printed,
    read_columns,
    read_published,
)

NOTHING = 1e-6  # sums of coded levels below it vanish [1]
HEADINGS = {
    "sum_of_squares": ("sum of squares", "sum of square", "sum sq", "ss"),
    "df": ("degree of freedom", "degrees of freedom", "df"),
    "mean_square": ("mean square", "mean sq", "ms"),
    "f": ("f value", "f"),
    "p": ("p value", "p"),
}
SOURCES = {
    "Residual": ("residual", "error"),
    "Lack of fit": ("lack of fit", "lackoffit"),
    "Pure error": ("pure error",),
    "Total": ("total", "sum", "cor total", "corrected total"),
    "Model": ("model", "regression"),
}
SHARE_TO_SWAP = 0.8  # of a column's numbers that agree with another quantity where its heading is wrong [1]
SIGNIFICANT = 0.05  # p value of a lack of fit [1]


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

    @property
    def chosen(self) -> Cell | None:
        """The cell that restores the design, if there is only one."""
        return self.cells[0] if len(self.cells) == 1 else None

    def restored(self, coded: Floats) -> Floats:
        """The levels with that cell changed."""
        changed = coded.copy()
        if self.chosen is not None:
            changed[self.chosen.row, self.chosen.column] = self.chosen.level
        return changed


@dataclass(frozen=True)
class Comparison:
    """One printed number beside the recomputed one."""

    table: str
    source: str  # the line it stands in
    quantity: str
    printed: Printed
    found: float

    @property
    def agrees(self) -> bool:
        """To the printed digits."""
        return self.printed.agrees(self.found)


@dataclass(frozen=True, eq=False)
class Audit:
    """Everything that was found; `fit` is of the restored levels where one cell restores them."""

    table: PublishedTable
    structure: Structure
    fit: Fit | None
    comparisons: tuple[Comparison, ...]
    findings: tuple[Finding, ...]


def audit(path: Path, response: str | None = None, claims_file: Path | None = None) -> Audit:
    """Audit a table and the claims beside it. Raises BadInput."""
    table, claims = read_published(path, response), claims_of(path, claims_file)
    structure = examine_structure(table.coded)
    findings, fit, comparisons = list(structure_findings(table, structure)), None, ()
    try:
        fit = fit_table(table, claims, structure)
    except BadInput as fault:
        findings.append(Finding("setting", f"no model can be fitted: {fault}"))
    else:
        comparisons, said = compare(claims, (claims_file or path).parent, fit)
        findings += [*said, *number_findings(comparisons), *fit_findings(fit, comparisons)]
        findings += target_findings(claims.target, fit) if claims.target else ()
    told = tuple(replace(each, table=each.table or path.name) for each in findings)
    return Audit(table, structure, fit, tuple(comparisons), told)


def examine_structure(coded: Floats) -> Structure:
    """Balance, orthogonality, the restoring cells."""
    # almost every row is a corner or the centre; a wrong cell does not change the answer
    off_centre = coded[np.any(np.abs(coded) > NOTHING, axis=1)]
    two_level = bool(len(off_centre) and np.mean(np.abs(np.abs(off_centre) - 1.0) < NOTHING) > 0.75)
    balanced, orthogonal = soundness(coded, two_level)
    cells = () if balanced and orthogonal else tuple(restoring_cells(coded, two_level))
    return Structure(two_level, balanced, orthogonal, cells)


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


def structure_findings(table: PublishedTable, structure: Structure) -> Iterator[Finding]:
    """What is wrong with the levels, in sentences."""
    for factor, column in zip(table.factors, table.coded.T, strict=True) if structure.two_level else ():
        high, low = int(np.sum(column > NOTHING)), int(np.sum(column < -NOTHING))
        if high != low:
            sentence = f"{factor.path} is {high} times high and {low} times low"
            yield Finding("unbalanced", sentence, column=factor.path, found=float(high - low))
    yield from not_orthogonal(table)
    for cell in structure.cells:
        factor, count = table.factors[cell.column], len(structure.cells)
        printed = f"{table.levels[cell.row, cell.column]:g}"
        level = factor.centre + factor.half * cell.level
        only = "it is the only such cell" if count == 1 else f"one of {count} such cells"
        sentence = (
            f"row {cell.row + 1}, {factor.path} is printed {printed}; {level:g} makes the design balanced "
            f"and orthogonal, and {only}"
        )
        yield Finding("cell", sentence, "", factor.path, cell.row + 1, printed, level)


def not_orthogonal(table: PublishedTable) -> Iterator[Finding]:
    """The factor that shares something with others; the worst pair where there is no such single one."""
    gram, names = table.coded.T @ table.coded, [factor.path for factor in table.factors]
    pairs = [(i, j) for i, j in combinations(range(len(gram)), 2) if abs(gram[i, j]) > NOTHING]
    if not pairs:
        return
    common = set(pairs[0]).intersection(*pairs)
    if len(common) == 1:
        (k,) = common
        others = [names[i if j == k else j] for i, j in pairs]
        sentence = f"{names[k]} is not orthogonal to {', '.join(others)}"
        yield Finding("not orthogonal", sentence, column=names[k], found=float(len(others)))
        return
    correlation = np.atleast_2d(np.corrcoef(table.coded, rowvar=False))
    one, other = max(pairs, key=lambda pair: abs(correlation[pair]))
    most = float(correlation[one, other])
    sentence = (
        f"{len(pairs)} pair(s) of factors are not orthogonal; most of all {names[one]} and {names[other]}, "
        f"correlation {most:.2f}"
    )
    yield Finding("not orthogonal", sentence, column=names[one], found=most)


def fit_table(table: PublishedTable, claims: Claims, structure: Structure) -> Fit:
    """The model that the study fits, or the largest that its levels suggest and its runs determine."""
    design = arranged(table.name, table.factors, [("factorial", structure.restored(table.coded))])
    design = design.with_responses(**{table.response: table.values})
    if claims.model is None and not structure.two_level:
        try:
            return fit_model(design, table.response, "quadratic")
        except BadInput:
            pass  # too few runs for it
    return fit_model(design, table.response, claims.model or "linear")


def compare(claims: Claims, folder: Path, fit: Fit) -> tuple[list[Comparison], list[Finding]]:
    """All printed numbers beside the recomputed ones; and what is wrong with headings and sums."""
    comparisons, findings = compare_anova(folder / claims.anova, fit) if claims.anova else ([], [])
    figures, known = asdict(quality(fit)), coded_polynomial(fit)
    for name, cell in claims.quality.items():
        comparisons.append(Comparison("quality", name, name, cell, figures.get(name, float("nan"))))
    for name, cell in claims.equation.items():
        value = known.get(parse_term(name, fit), 0.0)
        comparisons.append(Comparison("equation", name, "coefficient", cell, value))
    return comparisons, findings


def parse_term(text: str, fit: Fit) -> Term:
    """Term of up to three factors that a paper prints as `A^2`, `A2` or `AB`. Raises BadInput."""
    names, count = [factor.path for factor in fit.factors], len(fit.factors)
    plain = "".join(c for c in text if c not in " *^.\u00b7\u00d7").replace("\u00b2", "2")
    for term in ((0,) * count, *model_terms(count, "quadratic"), *interaction_terms(count, 3)):
        used = [name + ("2" if power == 2 else "") for name, power in zip(names, term, strict=True) if power]
        if plain in (("".join(used), "".join(reversed(used))) if used else ("1", "Intercept")):
            return term
    raise BadInput(f"term '{text}': must be a product of {', '.join(names)}, such as {names[0]}^2")


def compare_anova(path: Path, fit: Fit) -> tuple[list[Comparison], list[Finding]]:
    """Every number of a printed analysis of variance; and what is wrong with its headings."""
    (_, sources), *columns = read_columns(path).items()
    findings, lines = list[Finding](), dict[int, str]()
    names, rows = [factor.path for factor in fit.factors], {row.source: asdict(row) for row in anova(fit)}
    for place, text in enumerate(sources):
        known = [source for source, words in SOURCES.items() if text.strip().lower() in words]
        try:
            source = known[0] if known else term_name(parse_term(text, fit), names)
        except BadInput as fault:  # a line that is not understood is said, not dropped
            findings.append(Finding("setting", f"{path.name}: {fault}", path.name, row=place + 1))
        else:
            lines |= {place: source} if source in rows else {}
    comparisons = []
    for heading, column in columns:
        cells = [(source, parse_printed(column[place])) for place, source in lines.items()]
        said, meant = quantity_of(heading, [(cell, rows[source]) for source, cell in cells if cell])
        if said and meant != said:
            sentence = f"{path.name}: column '{heading}' holds the {meant.replace('_', ' ')}"
            findings.append(Finding("heading", sentence, path.name, heading, printed=heading))
        for source, cell in cells if meant else ():
            if cell is not None:
                comparisons.append(Comparison(path.name, source, meant, cell, float(rows[source][meant])))
    return comparisons, findings


def quantity_of(heading: str, cells: Sequence[tuple[Printed, Mapping[str, Any]]]) -> tuple[str, str]:
    """Quantity that a column's heading says, and that with which nearly all its numbers agree, if better."""
    plain = heading.lower().replace("_", " ")
    said = next((quantity for quantity, words in HEADINGS.items() if plain in words), "")
    shares = {
        quantity: float(np.mean([cell.agrees(float(row[quantity])) for cell, row in cells] or [0.0]))
        for quantity in HEADINGS
    }
    best = max(shares, key=lambda quantity: shares[quantity])
    better = shares[best] >= SHARE_TO_SWAP and shares[best] > shares.get(said, 0.0)
    return said, best if better else said


def number_findings(comparisons: Sequence[Comparison]) -> Iterator[Finding]:
    """A sentence for every printed number that does not come out."""
    for c in (each for each in comparisons if not each.agrees):
        kind: Kind = "sign" if c.quantity == "coefficient" and c.printed.agrees(-c.found) else "number"
        what = f"{c.source}, {c.quantity.replace('_', ' ')}" if c.source != c.quantity else c.source
        sentence = f"{c.table}: {what} is printed {c.printed.text}; the table gives {c.found:.5g}"
        sentence += ", the opposite sign" if kind == "sign" else ""
        yield Finding(kind, sentence, c.table, c.source, printed=c.printed.text, found=c.found)


def fit_findings(fit: Fit, comparisons: Sequence[Comparison]) -> Iterator[Finding]:
    """Lack of fit, and curvature that is counted as noise."""
    for row in anova(fit):
        if row.source == "Lack of fit" and row.p < SIGNIFICANT:
            sentence = (
                f"the model misses the means of its points: lack of fit F = {row.f:.3g}, p = {row.p:.2g}"
            )
            yield Finding("lack of fit", sentence, found=row.p)
    if (found := curvature(fit)) is None:
        return
    hidden = any(c.agrees and c.quantity == "f" for c in comparisons)
    sentence = (
        f"the corners lie {abs(found.difference):.4g} {'below' if found.difference < 0.0 else 'above'} the "
        f"centre (p = {found.p:.2g}): {found.sum_of_squares:.4g} of the residual {fit.ss_error:.4g} is "
        f"curvature; without it the mean square is {found.ms_error:.4g} with {found.df_error} degree(s) of "
        f"freedom{'; the printed F values count it as noise' if hidden else ''}"
    )
    yield Finding("curvature", sentence, found=found.sum_of_squares)


def target_findings(target: Printed, fit: Fit) -> Iterator[Finding]:
    """What the fitted surface says of the study's target."""
    best = optimise([fit], [Goal(fit.response, target.value)])
    nearest = best.optima[0].predictions[fit.response].value
    for sentence in best.sentences:
        yield Finding("target", sentence, found=nearest)


def as_document(result: Audit) -> dict[str, Any]:
    """The audit as one JSON document."""
    table, structure, fit = result.table, result.structure, result.fit
    return {
        "table": table.name,
        "runs": len(table.values),
        "factors": [factor.path for factor in table.factors],
        "response": table.response,
        "set_aside": list(table.set_aside),
        "two_level": structure.two_level,
        "balanced": structure.balanced,
        "orthogonal": structure.orthogonal,
        "cell": None if structure.chosen is None else cell_record(table, structure.chosen),
        "cells": [cell_record(table, cell) for cell in structure.cells],
        "model": None
        if fit is None
        else {
            "terms": list(fit.names),
            "anova": [asdict(row) for row in anova(fit)],
            "coefficients": coefficient_table(fit).to_dict("records"),
            "quality": asdict(quality(fit)),
        },
        "printed_numbers": {
            "compared": len(result.comparisons),
            "agree": sum(comparison.agrees for comparison in result.comparisons),
        },
        "findings": [asdict(finding) for finding in result.findings],
    }


def cell_record(table: PublishedTable, cell: Cell) -> dict[str, Any]:
    """A restoring cell by column name and row number."""
    factor = table.factors[cell.column]
    return {
        "row": cell.row + 1,
        "column": factor.path,
        "printed": float(table.levels[cell.row, cell.column]),
        "restored_by": factor.centre + factor.half * cell.level,
    }
