"""The audit of one table: its design, the fitted model, printed numbers and conclusions against both.

Compared are sums of squares, tests, figures of merit and coefficients; then the target, which the fitted
surface may not reach.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments.anova import anova, curvature
from taichi_erosion.experiments.audit.published import (
    Claims,
    Columns,
    Finding,
    Kind,
    Printed,
    PublishedTable,
    claims_of,
    parse_printed,
    read_columns,
    read_published,
)
from taichi_erosion.experiments.audit.structure import Cell, Structure, examine_structure, structure_findings
from taichi_erosion.experiments.fit import Fit, coded_polynomial, coefficient_table, fit_model, quality
from taichi_erosion.experiments.optimise import Goal, optimise
from taichi_erosion.experiments.terms import Order, Term, interaction_terms, model_terms, term_name

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
    fit: Fit | None = None
    comparisons: tuple[Comparison, ...] = ()
    agree_as_printed: int = 0  # of the comparisons, with the levels as printed
    findings: tuple[Finding, ...] = ()


def audit(path: Path, response: str | None = None, claims_file: Path | None = None) -> Audit:
    """Audit a table and the claims beside it."""
    table = read_published(path, response)
    claims, folder = claims_of(path, claims_file)
    structure = examine_structure(table.coded)
    found = Audit(table, structure, findings=tuple(structure_findings(table, structure)))
    try:
        as_printed = fit_table(table, claims, structure, table.coded)
        fit = fit_table(table, claims, structure, structure.restored(table.coded))
    except BadInput as fault:
        findings = [*found.findings, Finding("setting", f"no model can be fitted: {fault}")]
    else:
        comparisons, said = compare(claims, folder, fit)
        findings = [*found.findings, *said, *number_findings(comparisons), *fit_findings(fit, comparisons)]
        findings += target_findings(claims.target, fit) if claims.target else ()
        agree = sum(comparison.agrees for comparison in compare(claims, folder, as_printed)[0])
        found = replace(found, fit=fit, comparisons=tuple(comparisons), agree_as_printed=agree)
    return replace(found, findings=tuple(replace(f, table=f.table or path.name) for f in findings))


def fit_table(table: PublishedTable, claims: Claims, structure: Structure, coded: Floats) -> Fit:
    """The model that the study fits, or the largest that its levels suggest and its runs determine."""
    guesses: tuple[Order, ...] = ("linear",) if structure.two_level else ("quadratic", "linear")
    *larger, last = guesses if claims.model is None else (claims.model,)
    for order in larger:
        try:
            return fit_model(table.design(coded), table.response, order)
        except BadInput:
            continue  # too few runs for it: the next guess is smaller
    return fit_model(table.design(coded), table.response, last)


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
    """Every number of a printed analysis of variance; and what is wrong with its headings and sums."""
    columns, lines, findings = read_columns(path), dict[int, str](), list[Finding]()
    for place, text in enumerate(next(iter(columns.values()))):
        known = [source for source, words in SOURCES.items() if text.strip().lower() in words]
        try:
            names = [factor.path for factor in fit.factors]
            lines[place] = known[0] if known else term_name(parse_term(text, fit), names)
        except BadInput as fault:  # a line that is not understood is said, not dropped
            findings.append(Finding("setting", f"{path.name}: {fault}", path.name, row=place + 1))
    rows = {row.source: asdict(row) for row in anova(fit)}
    lines = {place: source for place, source in lines.items() if source in rows}
    quantities = {heading: quantity_of(heading, columns, lines, rows) for heading in list(columns)[1:]}
    for heading, (said, meant) in quantities.items():
        if said and meant != said:
            sentence = f"{path.name}: column '{heading}' holds the {meant.replace('_', ' ')}"
            findings.append(Finding("heading", sentence, path.name, heading, printed=heading))
    comparisons = [
        Comparison(path.name, source, meant, cell, float(rows[source][meant]))
        for place, source in lines.items()
        for heading, (_, meant) in quantities.items()
        if meant and (cell := parse_printed(columns[heading][place])) is not None
    ]
    return comparisons, findings


def quantity_of(
    heading: str, columns: Columns, lines: Mapping[int, str], rows: Mapping[str, Mapping[str, Any]]
) -> tuple[str, str]:
    """Quantity that a column's heading says, and that with which nearly all its numbers agree, if better."""
    plain = heading.strip().lower().removeprefix("column_headed_").replace("_", " ")
    said = next((quantity for quantity, words in HEADINGS.items() if plain in words), "")
    cells = [(parse_printed(columns[heading][place]), rows[source]) for place, source in lines.items()]
    shares = {
        quantity: float(np.mean([cell.agrees(float(row[quantity])) for cell, row in cells if cell] or [0.0]))
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
        "design": structure.textbook or None,
        "two_level": structure.two_level,
        "balanced": structure.balanced,
        "orthogonal": structure.orthogonal,
        "cell": None if structure.chosen is None else cell_record(table, structure.chosen),
        "cells": [cell_record(table, cell) for cell in structure.cells],
        "model": None if fit is None else model_record(fit),
        "printed_numbers": {
            "compared": len(result.comparisons),
            "agree": sum(comparison.agrees for comparison in result.comparisons),
            "agree_as_printed": result.agree_as_printed,
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


def model_record(fit: Fit) -> dict[str, Any]:
    """Analysis of variance, coefficients and figures of merit."""
    return {
        "terms": list(fit.names),
        "anova": [asdict(row) for row in anova(fit)],
        "coefficients": [asdict(line) for line in coefficient_table(fit)],
        "quality": asdict(quality(fit)),
    }
