"""The audit of one table: read it, look at its design, fit it, compare with what is printed about it."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.anova import anova
from taichi_erosion.experiments.audit.comparisons import (
    Comparison,
    compare_anova,
    compare_equation,
    compare_quality,
    examine_surface,
    fit_findings,
    number_findings,
    test_findings,
)
from taichi_erosion.experiments.audit.published import (
    Claims,
    Finding,
    PublishedTable,
    claims_of,
    read_published,
)
from taichi_erosion.experiments.audit.structure import Structure, examine_structure, structure_findings
from taichi_erosion.experiments.design_table import Floats
from taichi_erosion.experiments.fit import Fit, coefficient_table, fit_model, quality
from taichi_erosion.experiments.terms import Order


@dataclass(frozen=True, eq=False)
class Audit:
    """Everything that was found; `fit` is of the restored levels where one cell restores them."""

    table: PublishedTable
    structure: Structure
    fit: Fit | None
    comparisons: tuple[Comparison, ...]
    agree_as_printed: int  # of the comparisons, with the levels as printed
    findings: tuple[Finding, ...]


def audit(path: Path, response: str | None = None, claims_file: Path | None = None) -> Audit:
    """Audit a table and the claims beside it."""
    table = read_published(path, response)
    claims = claims_of(path, claims_file)
    structure = examine_structure(table)
    findings = list(structure_findings(table, structure))
    restored = structure.restored(table.coded)
    try:
        as_printed = fit_table(table, claims, structure, table.coded)
        fit = as_printed if restored is None else fit_table(table, claims, structure, restored)
    except BadInput as fault:
        findings.append(Finding("setting", f"no model can be fitted: {fault}"))
        return Audit(table, structure, None, (), 0, tuple(named(findings, path)))
    comparisons, said = compare(claims, fit)
    first, _ = (comparisons, said) if fit is as_printed else compare(claims, as_printed)
    surface, _ = examine_surface(claims, fit)
    findings += [*said, *number_findings(comparisons), *fit_findings(fit, comparisons), *surface]
    findings += test_findings(claims)
    agree = sum(comparison.agrees for comparison in first)
    return Audit(table, structure, fit, tuple(comparisons), agree, tuple(named(findings, path)))


def fit_table(table: PublishedTable, claims: Claims, structure: Structure, coded: Floats) -> Fit:
    """The model that the study fits, or the largest that its levels suggest and its runs determine."""
    guesses: tuple[Order, ...] = ("linear",) if structure.two_level else ("quadratic", "linear")
    orders: tuple[Order, ...] = guesses if claims.model is None else (claims.model,)
    design = table.design(coded)
    for order in orders[:-1]:
        try:
            return fit_model(design, table.response, order)
        except BadInput:
            continue  # too few runs for it: the next guess is smaller
    return fit_model(design, table.response, orders[-1])


def compare(claims: Claims, fit: Fit) -> tuple[list[Comparison], list[Finding]]:
    """All printed numbers beside the recomputed ones."""
    comparisons, findings = compare_anova(claims.anova, fit) if claims.anova else ([], [])
    return [*comparisons, *compare_quality(claims, fit), *compare_equation(claims, fit)], findings


def named(findings: Sequence[Finding], path: Path) -> list[Finding]:
    """Findings, each with the table it is about."""
    return [finding if finding.table else replace(finding, table=path.name) for finding in findings]


def as_document(result: Audit) -> dict[str, Any]:
    """The audit as one JSON document."""
    table, structure, fit = result.table, result.structure, result.fit
    cell = structure.chosen
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
        "cell": None if cell is None else cell_record(table, cell.row, cell.column, cell.level),
        "cells": [cell_record(table, c.row, c.column, c.level) for c in structure.cells],
        "model": None if fit is None else model_record(fit),
        "printed_numbers": {
            "compared": len(result.comparisons),
            "agree": sum(comparison.agrees for comparison in result.comparisons),
            "agree_as_printed": result.agree_as_printed,
        },
        "findings": [asdict(finding) for finding in result.findings],
    }


def cell_record(table: PublishedTable, row: int, column: int, level: float) -> dict[str, Any]:
    """A restoring cell by column name and row number."""
    factor = table.factors[column]
    return {
        "row": row + 1,
        "column": factor.path,
        "printed": float(table.levels[row, column]),
        "restored_by": factor.centre + factor.half * level,
    }


def model_record(fit: Fit) -> dict[str, Any]:
    """Analysis of variance, coefficients and figures of merit."""
    return {
        "terms": list(fit.names),
        "anova": [asdict(row) for row in anova(fit)],
        "coefficients": [asdict(line) for line in coefficient_table(fit)],
        "quality": asdict(quality(fit)),
    }
