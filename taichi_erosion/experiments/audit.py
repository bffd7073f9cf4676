"""The audit of one table: its design, the fitted model, printed numbers and conclusions against both.

    balanced     the k-th lowest level of a column stands as often as its k-th highest
    orthogonal   any two columns of levels are uncorrelated, by the order of their levels

A design is restored by a cell if changing it alone makes it balanced and orthogonal. Of a climb, in which all
factors change together, neither is asked.

Compared are sums of squares, tests, figures of merit and coefficients, under the declared model or that of
the printed lines, in coded or actual factors: whichever brings more numbers out. Where those of many lines do
not come out, the study computed them in another way: then none is called wrong.
"""

import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from itertools import combinations, permutations, product
from math import isnan, nan
from pathlib import Path
from typing import Any

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments import fit as models
from taichi_erosion.experiments import published
from taichi_erosion.experiments.anova import anova, curvature_test
from taichi_erosion.experiments.design import stack_parts
from taichi_erosion.experiments.fit import Fit, Order, Term, figures_of_merit, model_terms, term_name
from taichi_erosion.experiments.optimise import Goal, optimise
from taichi_erosion.experiments.published import Claims, Finding, PrintedNumber, PublishedTable, word_meaning
from taichi_erosion.scene.physical_ranges import range_of
from taichi_erosion.tables.headings import meaning_of, read_heading

NOTHING = 1e-6  # coded levels closer than this are one [1]
ALIKE = 0.02  # of the distance of an axial run from the centre, by which the other one may differ [1]
TOGETHER = 0.99  # correlation of all factors of a climb, whose levels are rounded [1]
SIGNIFICANT = 0.05  # p value of a lack of fit [1]
SHARE_TO_SWAP = 0.8  # of a column's numbers that agree with another quantity where its heading is wrong [1]
SHARE_TO_JUDGE, MOST_LINES = 0.5, 2  # numbers that agree, lines that do not, where one is called wrong [1]
DRAWS, SIGMAS = 40, 4.0  # of the digits that a table does not print [1]
FEW = 3  # numbers from which a column is judged by itself
Numbers = Mapping[tuple[str, str], float]  # by line and quantity
LETTERS = "ABCDEFGHJKLMNOPQRSTUVWXYZ"  # of factors in design programs, without I
SYMBOL = re.compile(
    r"(?:factor \d+ ?:? ?)?(?P<symbol>[a-z]{1,2}\d{0,2})\s*[-:.]\s*(?P<rest>.{2,})"
    r"|(?P<name>.{2,}?)\s*[(,]\s*(?P<behind>[a-z]\d{0,2})\)?"
)


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
    balanced: bool | None  # None of a climb
    orthogonal: bool | None
    cells: tuple[Cell, ...] = ()  # each restores the design alone


@dataclass(frozen=True)
class Comparison:
    """One printed number beside the recomputed one, which is exact to `reach`."""

    table: str
    source: str  # the line it stands in
    quantity: str
    printed: PrintedNumber
    found: float
    reach: float = 0.0

    @property
    def agrees(self) -> bool:
        """To the printed digits."""
        return self.printed.agrees(self.found, self.reach)


@dataclass(frozen=True, eq=False)
class Audit:
    """Everything that was found; `fit` is of the restored levels where one cell restores them."""

    table: PublishedTable
    structure: Structure
    fit: Fit | None
    comparisons: tuple[Comparison, ...]
    findings: tuple[Finding, ...]
    assumptions: tuple[str, ...]


def audit_table(path: Path, response: str | None = None, claims_file: Path | None = None) -> Audit:
    """Audit a table and the claims beside it. Raises BadInput."""
    table, claims = published.read_published_table(path, response), published.read_claims(path, claims_file)
    structure = examine_structure(table.coded)
    folder = (claims_file or path).parent
    assumptions = [f"{name} is another result; --response names it" for name in table.others]
    findings = [*structure_findings(table, structure), *response_findings(table)]
    fits, comparisons = list[Fit](), list[Comparison]()
    sheet = published.read_sheet(folder / claims.anova) if claims.anova else None
    names = [factor.path for factor in table.factors]
    printed = list[Term]()  # terms of the lines of the printed analysis of variance
    for text in next(iter(sheet.columns.values())) if sheet else ():
        with suppress(BadInput):  # named where the lines are compared
            printed += [] if word_meaning("lines", text) else [parse_term(text, names)]
    for terms in dict.fromkeys(((), tuple(printed))):
        try:
            fits.append(fit_table(table, claims, structure, terms))
        except BadInput as fault:
            findings += [] if terms else [Finding("not judged", f"no model can be fitted: {fault}")]
    fit = max(fits, key=lambda each: sum(c.agrees for c in compare(claims, folder, each)[0]), default=None)
    if fit is not None:
        comparisons, statements, actual = compare(claims, folder, fit)
        comparisons = allow_rounding(comparisons, table, lambda each: recompute(each, claims, actual), fit)
        findings += [*statements, *number_findings(comparisons), *fit_findings(fit, comparisons)]
        if claims.target:  # what the fitted surface says of it
            best = optimise([fit], [Goal(fit.response, claims.target.value)])
            nearest = best.optima[0].predictions[fit.response].value
            findings += [Finding("target", sentence, found=nearest) for sentence in best.sentences]
        assumptions += [f"the model has the terms {', '.join(fit.names)}"] if fit is not fits[0] else []
        assumptions += ["the equation is in actual factors"] if actual else []
    sentences = tuple(replace(each, table=each.table or path.name) for each in findings)
    return Audit(table, structure, fit, tuple(comparisons), sentences, tuple(assumptions))


def examine_structure(coded: Floats) -> Structure:
    """Balance, orthogonality, the restoring cells."""
    off_centre = coded[np.any(np.abs(coded) > NOTHING, axis=1)]
    odd = np.any(np.abs(np.abs(off_centre) - 1.0) > NOTHING, axis=1)
    two_level = len(off_centre) > 0 and int(odd.sum()) < 2  # one wrong cell does not change the answer
    pairs = [abs(np.corrcoef(one, other)[0, 1]) for one, other in combinations(coded.T, 2)]
    if pairs and min(pairs) > TOGETHER:
        return Structure(two_level, None, None)
    balanced, orthogonal = balance_and_orthogonality(coded)
    run = -coded.sum(axis=0)  # that may be missing: then no cell is wrong
    levels = all(np.isin(np.round(abs(run), 6), np.round(np.abs(coded), 6)))
    missing = levels and all(balance_and_orthogonality(np.vstack([coded, run])))
    sought = pairs and not missing and not (balanced and orthogonal)
    return Structure(two_level, balanced, orthogonal, tuple(restoring_cells(coded)) if sought else ())


def balance_and_orthogonality(coded: Floats) -> tuple[bool, bool]:
    """Whether levels are balanced, and whether they are orthogonal."""
    counts = [np.unique(np.round(column, 6), return_counts=True)[1] for column in coded.T]
    return all(np.array_equal(each, each[::-1]) for each in counts), not non_orthogonal_pairs(coded)


def non_orthogonal_pairs(coded: Floats) -> list[tuple[int, int]]:
    places = [np.unique(np.round(column, 6), return_inverse=True)[1].ravel() for column in coded.T]
    centred = [levels - levels.mean() for levels in places]
    pairs = combinations(range(len(places)), 2)
    return [(i, j) for i, j in pairs if abs(centred[i] @ centred[j]) > NOTHING * len(coded)]


def restoring_cells(coded: Floats) -> Iterator[Cell]:
    """Every single change of a level after which nothing is left to find."""
    for column in range(coded.shape[1]):
        if not all(balance_and_orthogonality(np.delete(coded, column, axis=1))):
            continue  # no cell of this column can restore the others
        for row, level in product(range(len(coded)), np.unique(coded[:, column]).tolist()):
            cell = Cell(row, column, level)
            if level != coded[row, column] and all(balance_and_orthogonality(change_cell(coded, cell))):
                yield cell


def change_cell(coded: Floats, cell: Cell) -> Floats:
    changed = coded.copy()
    changed[cell.row, cell.column] = cell.level
    return changed


def structure_findings(table: PublishedTable, structure: Structure) -> Iterator[Finding]:
    """What is wrong with the levels, in sentences."""
    if structure.balanced is None:
        yield Finding("not judged", "all factors change together, as in a climb: no effect is told apart")
        return
    for factor, column in zip(table.factors, table.coded.T, strict=True) if structure.two_level else ():
        high, low = int(np.sum(column > NOTHING)), int(np.sum(column < -NOTHING))
        if high != low:
            sentence = f"{factor.path} is {high} times high and {low} times low"
            yield Finding("unbalanced", sentence, column=factor.path, found=float(high - low))
    yield from orthogonality_findings(table)
    yield from axial_findings(table)
    count = len(structure.cells)
    for cell in structure.cells:
        factor = table.factors[cell.column]
        printed = f"{table.levels[cell.row, cell.column]:g}"
        level = factor.centre + factor.half_range * cell.level
        remark = "it is the only such cell" if count == 1 else f"one of {count} such cells"
        sentence = f"row {cell.row + 1}, {factor.path} is printed {printed}; "
        sentence += f"{level:g} makes the design balanced and orthogonal, and {remark}"
        yield Finding("cell", sentence, "", factor.path, cell.row + 1, printed, level)


def axial_findings(table: PublishedTable) -> Iterator[Finding]:
    """Axial runs of a factor, all others at their centres, that lie unlike far from it on both sides."""
    for k, factor in enumerate(table.factors):
        off_centre = np.abs(table.coded) > NOTHING
        axial = off_centre[:, k] & (off_centre.sum(axis=1) == 1)
        low, high = (end(table.coded[axial, k], initial=0.0) for end in (np.min, np.max))
        if low < 0.0 < high and abs(low + high) > ALIKE * high + SIGMAS * table.rounding[axial, k + 1].max():
            least, most = (factor.centre + factor.half_range * level for level in (low, high))
            ends = f"{least:g} and {most:g} lie unlike far from the centre {factor.centre:g}"
            sentence = f"axial runs of {factor.path}: {ends} ({low:.4g} and {high:.4g} coded)"
            yield Finding("unbalanced", sentence, column=factor.path, found=float(low + high))


def response_findings(table: PublishedTable) -> Iterator[Finding]:
    """Runs without a response, and responses that no measurement can have."""
    missing, allowed = np.isnan(table.values), range_of(meaning_of(read_heading(table.response).name)[1])
    if missing.any():
        sentence = f"{missing.sum()} of {missing.size} runs have no response, and are left out"
        yield Finding("not judged", sentence, column=table.response, row=int(missing.argmax()) + 1)
    for row, value in enumerate(table.values.tolist()) if allowed else ():
        if allowed and allowed.unit == "deg" and not (isnan(value) or allowed.is_possible(value)):
            sentence = f"row {row + 1}: {table.response} is {value:g}; it lies from 0 to 90 degrees"
            yield Finding("number", sentence, "", table.response, row + 1, f"{value:g}")


def orthogonality_findings(table: PublishedTable) -> Iterator[Finding]:
    """The factor that shares something with others; the worst pair where there is no such single one."""
    names = [factor.path for factor in table.factors]
    pairs = non_orthogonal_pairs(table.coded)
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
    sentence = f"{len(pairs)} pair(s) of factors are not orthogonal; most of all "
    sentence += f"{names[one]} and {names[other]}, correlation {most:.2f}"
    yield Finding("not orthogonal", sentence, column=names[one], found=most)


def fit_table(table: PublishedTable, claims: Claims, structure: Structure, terms: tuple[Term, ...]) -> Fit:
    """The model of these terms, or that of the study, or the largest that the runs determine."""
    cells = structure.cells
    coded = change_cell(table.coded, cells[0]) if len(cells) == 1 else table.coded
    design = stack_parts(table.name, table.factors, [("factorial", coded)])
    design = design.with_responses(**{table.response: table.values})
    guesses: tuple[Order, ...] = ("quadratic", "interactions")[structure.two_level :]
    for order in () if terms or claims.model or structure.balanced is None else guesses:
        with suppress(BadInput):  # too few runs for it
            if (fit := models.fit_model(design, table.response, order)).df_error:
                return fit
    return models.fit_model(design, table.response, terms or claims.model or "linear")


def recompute(fit: Fit, claims: Claims, actual: bool) -> Numbers:
    """Every number that a study may print; its equation is in actual or in coded factors."""
    names = [factor.path for factor in fit.factors]
    equation = models.natural_polynomial(fit) if actual else models.coded_polynomial(fit)
    values = {(name, "coefficient"): equation.get(parse_term(name, names), nan) for name in claims.equation}
    values |= {(name, "quality"): value for name, value in asdict(figures_of_merit(fit)).items()}
    rows = {row.source: asdict(row) for row in anova(fit)}
    return values | {(line, name): value for line, row in rows.items() for name, value in row.items()}


def compare(claims: Claims, folder: Path, fit: Fit) -> tuple[list[Comparison], list[Finding], bool]:
    """Printed beside recomputed numbers; wrong headings; whether the equation is in actual factors."""
    comparisons, findings = compare_anova(folder / claims.anova, fit) if claims.anova else ([], [])
    cells = [("equation", name, "coefficient", cell) for name, cell in claims.equation.items()]
    cells += [("quality", name, "quality", cell) for name, cell in claims.quality.items()]
    equations = [
        [Comparison(*cell, printed.get((cell[1], cell[2]), nan)) for cell in cells]
        for printed in (recompute(fit, claims, False), recompute(fit, claims, True))
    ]
    coded, actual = (sum(one.agrees for one in equation) for equation in equations)
    comparisons = [one for one in [*comparisons, *equations[actual > coded]] if np.isfinite(one.found)]
    return comparisons, findings, actual > coded


def allow_rounding(
    comparisons: list[Comparison], table: PublishedTable, numbers_of: Callable[[Fit], Numbers], fit: Fit
) -> list[Comparison]:
    """The comparisons; computed numbers may be off as far as digits that the table lacks move them."""
    if all(one.agrees for one in comparisons):
        return comparisons
    rng = np.random.default_rng(0)
    draws = list[Numbers]()
    half = table.rounding[fit.rows]
    for _ in range(DRAWS):
        shift = half * rng.uniform(-1.0, 1.0, half.shape)
        values, coded = fit.values + shift[:, 0], fit.coded + shift[:, 1:]
        draws.append(numbers_of(replace(fit, values=values, coded=coded)))
    reach = [SIGMAS * float(np.std([draw[c.source, c.quantity] for draw in draws])) for c in comparisons]
    pairs = zip(comparisons, reach, strict=True)
    rounded = [replace(c, reach=far if np.isfinite(far) else 0.0) for c, far in pairs]
    lines = {c.source for c, exact in zip(rounded, comparisons, strict=True) if c.agrees > exact.agrees}
    # a misprint is in one line, digits that the table lacks are missing in all
    return rounded if len(lines) > 1 or half[:, 1:].any() else comparisons


def heading_names(text: str) -> list[str]:
    """A heading, its name without a unit, its symbol and the rest: `A-sliding friction`, `friction (A)`."""
    plain = unicodedata.normalize("NFKC", text).casefold().replace("\u2013", "-").strip()
    match = SYMBOL.fullmatch(plain)
    parts = (match["symbol"] or match["behind"], match["rest"] or match["name"]) if match else ()
    names = (unicodedata.normalize("NFKC", x).casefold() for x in (plain, read_heading(plain).name, *parts))
    return [re.sub(r"[ *^.\u00b7\u00d7:_\-\u2013]", "", name) for name in names]  # and products alike


def parse_term(text: str, names: Sequence[str]) -> Term:
    """Term of up to three factors that a paper prints as `A^2`, `A2`, `AB`, `A-friction`. Raises BadInput.

    Factors may also be named by their places, A, B ... or x1, x2 ..., where no heading is such a name.
    """
    short, factor_names = heading_names(text), [heading_names(name) for name in names]
    if short[0] in ("1", "intercept", "constant"):
        return (0,) * len(names)
    used_names = {each for words in factor_names for each in words}
    for k, letters in enumerate(factor_names):
        letters += [name for name in (LETTERS[k : k + 1].casefold(), f"x{k + 1}") if name not in used_names]
    for term in (*model_terms(len(names), "quadratic"), *models.interaction_terms(len(names), 3)):
        forms = [
            [form for name in words for form in ((name,) if power == 1 else (name + "2", name + name))]
            for words, power in zip(factor_names, term, strict=True)
            if power
        ]
        if any("".join(form) in short for order in permutations(forms) for form in product(*order)):
            return term
    raise BadInput(f"term '{text}': must be a product of {', '.join(names)}, such as {names[0]}^2")


def compare_anova(path: Path, fit: Fit) -> tuple[list[Comparison], list[Finding]]:
    """Every number of a printed analysis of variance; and what is wrong with its headings."""
    sheet = published.read_sheet(path)
    names = [factor.path for factor in fit.factors]
    (_, sources), *columns = sheet.columns.items()
    findings, lines, rows = list[Finding](), dict[int, str](), {row.source: asdict(row) for row in anova(fit)}
    for place, text in enumerate(sources):
        try:
            source = word_meaning("lines", text) or term_name(parse_term(text, names), names)
            if source not in rows:
                raise BadInput(f"'{text}' is no line of this model")
        except BadInput as fault:  # a line that is not understood is said, not dropped
            findings.append(Finding("not judged", f"{path.name}: {fault}", path.name, row=place + 1))
        else:
            lines[place] = source
    comparisons = []
    for heading, column in columns:
        cells = [(line, cell) for place, line in lines.items() if (cell := sheet.cell_number(column[place]))]
        printed_words, meaning = quantity_of_column(heading, [(cell, rows[source]) for source, cell in cells])
        if printed_words and meaning != printed_words:
            sentence = f"{path.name}: column '{heading}' holds the {meaning.replace('_', ' ')}"
            findings.append(Finding("heading", sentence, path.name, heading, printed=heading))
        for source, cell in cells if meaning else ():
            comparisons.append(Comparison(path.name, source, meaning, cell, float(rows[source][meaning])))
    return comparisons, findings


def quantity_of_column(
    heading: str, cells: Sequence[tuple[PrintedNumber, Mapping[str, Any]]]
) -> tuple[str, str]:
    """Quantity that a column's heading says, and that with which nearly all its numbers agree, if better."""
    words = word_meaning("quantities", heading)
    shares = {
        quantity: float(np.mean([cell.agrees(float(row[quantity])) for cell, row in cells] or [0.0]))
        for quantity in published.anova_vocabulary()["quantities"]
    }
    best = max(shares, key=lambda quantity: shares[quantity])
    is_better = len(cells) >= FEW and shares[best] >= SHARE_TO_SWAP and shares[best] > shares.get(words, 0.0)
    return words, best if is_better else words


def number_findings(comparisons: Sequence[Comparison]) -> Iterator[Finding]:
    """A sentence for every number that does not come out where most others do; else one for their table."""
    for table in dict.fromkeys(c.table for c in comparisons):
        printed = [c for c in comparisons if c.table == table]
        wrong, tests = [c for c in printed if not c.agrees], [c for c in printed if c.quantity != "df"]
        share = np.mean([c.agrees for c in tests] or [0.0])
        if wrong and (share <= SHARE_TO_JUDGE or len({c.source for c in wrong}) > MOST_LINES):
            count = f"{len(wrong)} of {len(printed)} numbers"
            yield Finding("not judged", f"{table}: {count} come out by no model that was tried", table)
            continue
        for c in wrong:
            sign = c.quantity == "coefficient" and c.printed.agrees(-c.found, c.reach)
            line = c.source if c.quantity == "quality" else f"{c.source}, {c.quantity.replace('_', ' ')}"
            opposite = ", the opposite sign" if sign else ""
            sentence = f"{table}: {line} is printed {c.printed.text}; the table gives {c.found:.5g}{opposite}"
            kind = "sign" if sign else "number"
            yield Finding(kind, sentence, table, c.source, printed=c.printed.text, found=c.found)


def fit_findings(fit: Fit, comparisons: Sequence[Comparison]) -> Iterator[Finding]:
    """Lack of fit, and curvature that is counted as noise."""
    for row in anova(fit):
        if row.source == "Lack of fit" and row.p < SIGNIFICANT:
            test = f"lack of fit F = {row.f:.3g}, p = {row.p:.2g}"
            yield Finding("lack of fit", f"the model misses the means of its points: {test}", found=row.p)
        if row.source == "Lack of fit" and np.isnan(row.p):
            yield Finding("not judged", "lack of fit: repeated runs are equal, there is no pure error")
    bend = curvature_test(fit)
    if bend is None or not bend.f > 1.0:  # without it the error would be larger
        return
    hidden = any(c.agrees and c.quantity == "f" for c in comparisons)
    sentence = (
        f"the corners lie {abs(bend.difference):.4g} {'below' if bend.difference < 0.0 else 'above'} the "
        f"centre (p = {bend.p:.2g}): {bend.sum_of_squares:.4g} of the residual {fit.ss_error:.4g} is "
        f"curvature; without it the mean square is {bend.ms_error:.4g} with {bend.df_error} degree(s) of "
        f"freedom{'; the printed F values count it as noise' if hidden else ''}"
    )
    yield Finding("curvature", sentence, found=bend.sum_of_squares)


def audit_document(result: Audit) -> dict[str, Any]:
    table, structure, fit = result.table, result.structure, result.fit
    agree = sum(comparison.agrees for comparison in result.comparisons)
    cells = [
        {"row": f.row, "column": f.column, "printed": float(f.printed), "restored_by": f.found}
        for f in result.findings
        if f.kind == "cell"
    ]
    return {
        "table": table.name,
        "runs": len(table.values),
        "factors": [factor.path for factor in table.factors],
        "response": table.response,
        "set_aside": list(table.set_aside),
        "assumed": list(result.assumptions),
        "two_level": structure.two_level,
        "balanced": structure.balanced,
        "orthogonal": structure.orthogonal,
        "cell": cells[0] if len(cells) == 1 else None,
        "cells": cells,
        "model": fit
        and {
            "terms": list(fit.names),
            "anova": [asdict(row) for row in anova(fit)],
            "coefficients": models.coefficient_table(fit).to_dict("records"),
            "quality": asdict(figures_of_merit(fit)),
        },
        "printed_numbers": {"compared": len(result.comparisons), "agree": agree},
        "findings": [asdict(finding) for finding in result.findings],
    }
