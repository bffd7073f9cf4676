"""Printed sums of squares, tests, figures of merit and coefficients against those that the table gives."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.anova import Row, anova, curvature
from taichi_erosion.experiments.audit.claims import Claims, Finding, Printed, parse_printed
from taichi_erosion.experiments.audit.reading import read_columns
from taichi_erosion.experiments.fit import Fit, coded_polynomial
from taichi_erosion.experiments.quality import Quality, quality
from taichi_erosion.experiments.terms import parse_term, term_name

HEADINGS = {
    "sum_of_squares": ("sum of squares", "sum of square", "sum_sq", "ss"),
    "df": ("degree of freedom", "degrees of freedom", "df"),
    "mean_square": ("mean square", "mean_sq", "ms"),
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
QUANTITIES = tuple(HEADINGS)
SHARE_TO_SWAP = (
    0.8  # of a column's numbers that must agree with another quantity to call its heading wrong [1]
)


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


def compare_anova(path: Path, fit: Fit) -> tuple[list[Comparison], list[Finding]]:
    """Every number of a printed analysis of variance; and what is wrong with its headings and sums."""
    columns = read_columns(path)
    lines, findings = read_lines(columns, fit, path)
    rows = {row.source: row for row in anova(fit)}
    quantities, swapped = recognise(columns, lines, rows, path)
    comparisons = [
        Comparison(path.name, source, quantity, cell, float(getattr(rows[source], quantity)))
        for place, source in lines.items()
        for heading, quantity in quantities.items()
        if source in rows and (cell := parse_printed(columns[heading][place])) is not None
    ]
    return comparisons, [*findings, *swapped, *broken_sums(comparisons, path)]


def read_lines(
    columns: Mapping[str, Sequence[str]], fit: Fit, path: Path
) -> tuple[dict[int, str], list[Finding]]:
    """Recomputed line that every printed one stands for, by its place."""
    names = [factor.path for factor in fit.factors]
    lines: dict[int, str] = {}
    findings = []
    for place, text in enumerate(columns[next(iter(columns))]):
        known = [source for source, words in SOURCES.items() if text.strip().lower() in words]
        try:
            lines[place] = known[0] if known else term_name(parse_term(text, names), names)
        except BadInput as fault:  # a line that is not understood is said, not dropped
            findings.append(Finding("setting", f"{path.name}: {fault}", table=path.name, row=place + 1))
    return lines, findings


def recognise(
    columns: Mapping[str, Sequence[str]], lines: Mapping[int, str], rows: Mapping[str, Row], path: Path
) -> tuple[dict[str, str], list[Finding]]:
    """Quantity of every column: what its heading says, or what its numbers say if they say it clearly."""
    found, findings = {}, []
    for heading in list(columns)[1:]:
        plain = heading.strip().lower().removeprefix("column_headed_").replace("_", " ")
        said = next((q for q, words in HEADINGS.items() if plain in [w.replace("_", " ") for w in words]), "")
        cells = {place: parse_printed(columns[heading][place]) for place in lines}
        meant = best_quantity(cells, lines, rows, said)
        if meant and said and meant != said:
            sentence = f"{path.name}: column '{heading}' holds the {meant.replace('_', ' ')}"
            findings.append(Finding("heading", sentence, table=path.name, column=heading, printed=heading))
        if meant or said:
            found[heading] = meant or said
    return found, findings


def best_quantity(
    cells: Mapping[int, Printed | None], lines: Mapping[int, str], rows: Mapping[str, Row], said: str
) -> str:
    """Quantity that nearly all numbers of a column agree with, empty where there is none better than said."""
    shares = {}
    for quantity in QUANTITIES:
        pairs = [
            cell.agrees(float(getattr(rows[lines[place]], quantity)))
            for place, cell in cells.items()
            if cell is not None and lines[place] in rows
        ]
        shares[quantity] = sum(pairs) / len(pairs) if pairs else 0.0
    best = max(shares, key=lambda quantity: shares[quantity])
    return best if shares[best] >= SHARE_TO_SWAP and shares[best] > shares.get(said, 0.0) else ""


def broken_sums(comparisons: Sequence[Comparison], path: Path) -> Iterator[Finding]:
    """Printed lack of fit and pure error that do not add up to the printed residual."""
    sums = {c.source: c.printed for c in comparisons if c.quantity == "sum_of_squares"}
    if not {"Residual", "Lack of fit", "Pure error"} <= set(sums):
        return
    residual, lack, pure = (sums[name] for name in ("Residual", "Lack of fit", "Pure error"))
    rounding = 0.5 * (residual.last_digit + lack.last_digit + pure.last_digit)
    total = lack.value + pure.value
    if abs(total - residual.value) > rounding:
        sentence = (
            f"{path.name}: lack of fit {lack.text} and pure error {pure.text} add up to {total:.4g}, "
            f"the residual is printed {residual.text}"
        )
        yield Finding("sum", sentence, table=path.name, column="Lack of fit", printed=lack.text, found=total)


def compare_quality(claims: Claims, fit: Fit) -> list[Comparison]:
    """Printed figures of merit."""
    figures: Quality = quality(fit)
    return [
        Comparison("quality", name, name, cell, float(getattr(figures, name, float("nan"))))
        for name, cell in claims.quality.items()
    ]


def compare_equation(claims: Claims, fit: Fit) -> list[Comparison]:
    """Printed coefficients in coded units."""
    names = [factor.path for factor in fit.factors]
    known = coded_polynomial(fit)
    return [
        Comparison("equation", name, "coefficient", cell, known.get(parse_term(name, names), 0.0))
        for name, cell in claims.equation.items()
    ]


def number_findings(comparisons: Sequence[Comparison]) -> Iterator[Finding]:
    """A sentence for every printed number that does not come out."""
    for c in comparisons:
        if c.agrees:
            continue
        kind = "sign" if c.quantity == "coefficient" and c.printed.opposite(c.found) else "number"
        what = f"{c.source}, {c.quantity.replace('_', ' ')}" if c.source != c.quantity else c.source
        sentence = f"{c.table}: {what} is printed {c.printed.text}; the table gives {c.found:.5g}"
        if kind == "sign":
            sentence += ", the opposite sign"
        yield Finding(kind, sentence, table=c.table, column=c.source, printed=c.printed.text, found=c.found)


def fit_findings(fit: Fit, comparisons: Sequence[Comparison]) -> Iterator[Finding]:
    """What the fit says about itself: lack of fit, and curvature that passes for noise."""
    lack = next((row for row in anova(fit) if row.source == "Lack of fit" and row.df), None)
    if lack is not None and lack.p < 0.05:
        sentence = f"the model misses the means of its points: lack of fit F = {lack.f:.3g}, p = {lack.p:.2g}"
        yield Finding("lack of fit", sentence, found=lack.p)
    bend = curvature(fit)
    if bend is None:
        return
    hidden = any(c.agrees and c.quantity == "f" for c in comparisons)
    used = "; the printed F values count it as noise" if hidden else ""
    side = "below" if bend.difference < 0.0 else "above"
    sentence = (
        f"the corners lie {abs(bend.difference):.4g} {side} the centre "
        f"(p = {bend.p:.2g}): {bend.sum_of_squares:.4g} of the residual {fit.ss_error:.4g} is curvature; "
        f"without it the mean square is {bend.ms_error:.4g} with {bend.df_error} degree(s) of freedom{used}"
    )
    yield Finding("curvature", sentence, found=bend.sum_of_squares)
