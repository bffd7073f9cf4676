"""Printed numbers against those that the table gives, and conclusions against the fitted surface.

Compared are sums of squares, tests, figures of merit and coefficients; then coding, optimum, target, and
runs at the same point. The coding -1, 0, +1 of a table can be read in two ways, factor by factor. The
published optimum decides: in one of them the surface has its best point where the study says so, in the
other at the mirror image.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import sqrt
from pathlib import Path

import numpy as np
from scipy import stats

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.anova import Row, anova, curvature, replicate_error
from taichi_erosion.experiments.audit.published import Claims, Finding, Kind, Printed, parse_printed
from taichi_erosion.experiments.confirm import Sample, confirm
from taichi_erosion.experiments.design_table import Floats, column_numbers, read_columns
from taichi_erosion.experiments.fit import Fit, Quality, coded_polynomial, quality
from taichi_erosion.experiments.optimise import Goal, Optimisation, optimise
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
    """Quantity of every column: that of its heading, or that which nearly all its numbers agree with."""
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
    """Lack of fit, and curvature that is counted as noise."""
    lack = next((row for row in anova(fit) if row.source == "Lack of fit" and row.df), None)
    if lack is not None and lack.p < 0.05:
        sentence = f"the model misses the means of its points: lack of fit F = {lack.f:.3g}, p = {lack.p:.2g}"
        yield Finding("lack of fit", sentence, found=lack.p)
    found = curvature(fit)
    if found is None:
        return
    hidden = any(c.agrees and c.quantity == "f" for c in comparisons)
    used = "; the printed F values count it as noise" if hidden else ""
    side = "below" if found.difference < 0.0 else "above"
    sentence = (
        f"the corners lie {abs(found.difference):.4g} {side} the centre "
        f"(p = {found.p:.2g}): {found.sum_of_squares:.4g} of the residual {fit.ss_error:.4g} is curvature; "
        f"without it the mean square is {found.ms_error:.4g} with {found.df_error} degree(s) of freedom{used}"
    )
    yield Finding("curvature", sentence, found=found.sum_of_squares)


SAME_PLACE = 1e-6  # coded levels closer than this are one point [1]
UNLIKELY = 0.01  # two-sided p value from which two results of one point cannot both be right [1]
LEVEL = "level"  # first column of a table of levels
ERROR = "relative_error"  # column of 100 |y - target| / target [%]


@dataclass(frozen=True)
class Coding:
    """Natural value = centre + step * coded, as printed; `reversed_factors` fit the optimum the other way."""

    centre: Floats
    step: Floats
    reversed_factors: tuple[str, ...] = ()

    def natural(self, coded: Floats) -> Floats:
        """Natural values in the printed coding."""
        return self.centre + self.step * coded

    def coded(self, natural: Floats) -> Floats:
        """Coded levels in the printed coding."""
        return (natural - self.centre) / self.step


def read_levels(path: Path, fit: Fit) -> Coding:
    """The printed coding of every factor."""
    columns = read_columns(path)
    if LEVEL not in columns:
        raise BadInput(f"{path}: column '{LEVEL}' is missing; it holds -1, 0 and 1")
    levels = column_numbers(columns, LEVEL, str(path))
    lines = [np.polyfit(levels, column_numbers(columns, f.path, str(path)), 1) for f in fit.factors]
    return Coding(np.array([line[1] for line in lines]), np.array([line[0] for line in lines]))


def examine_surface(claims: Claims, fit: Fit) -> tuple[list[Finding], Optimisation | None]:
    """Findings on target, optimum, coding and other tables."""
    findings: list[Finding] = []
    best = None
    if claims.target is not None:
        best = optimise([fit], [Goal(fit.response, "target", claims.target.value)])
        findings += [Finding("target", sentence, found=nearest(best, fit)) for sentence in best.sentences]
    if claims.levels is None:
        return findings, best
    coding = read_levels(claims.levels, fit)
    if best is not None and claims.optimum:
        coding = reversed_coding(coding, claims.optimum, best, fit)
        findings += coding_findings(claims.levels, coding, claims.optimum, fit)
        findings += optimum_findings(coding, claims.optimum, best, fit)
    for other in claims.others:
        findings += same_point_findings(other, with_reversals(coding, fit), fit)
        findings += relative_errors(other, claims.target, fit)
    return findings, best


def nearest(best: Optimisation, fit: Fit) -> float:
    """What the surface predicts at its best point."""
    return best.optima[0].predictions[fit.response].value


def reversed_coding(coding: Coding, optimum: Mapping[str, Printed], best: Optimisation, fit: Fit) -> Coding:
    """The coding, with the factors whose published optimum fits the opposite coding.

    Only a single best point decides: where the target is met along a line, nothing is decided.
    """
    if best.met:
        return coding
    point = best.optima[0].coded
    as_said, mirrored = coding.natural(point), coding.natural(-point)
    wrong = [
        factor.path
        for k, factor in enumerate(fit.factors)
        if (cell := optimum.get(factor.path)) is not None
        and abs(mirrored[k] - cell.value) + 0.5 * cell.last_digit < abs(as_said[k] - cell.value)
    ]
    return Coding(coding.centre, coding.step, tuple(wrong))


def with_reversals(coding: Coding, fit: Fit) -> Coding:
    """The coding with its reversed factors turned round."""
    turn = np.array([-1.0 if f.path in coding.reversed_factors else 1.0 for f in fit.factors])
    return Coding(coding.centre, coding.step * turn)


def coding_findings(
    levels: Path, coding: Coding, optimum: Mapping[str, Printed], fit: Fit
) -> Iterator[Finding]:
    """A sentence for every factor whose levels are printed the wrong way round."""
    place = np.array([optimum[f.path].value if f.path in optimum else np.nan for f in fit.factors])
    said, meant = (
        float(fit.predict(way.coded(place)[None, :])[0]) for way in (coding, with_reversals(coding, fit))
    )
    for k, factor in enumerate(fit.factors):
        if factor.path not in coding.reversed_factors:
            continue
        low, high = coding.centre[k] - coding.step[k], coding.centre[k] + coding.step[k]
        yield Finding(
            "coding",
            f"{levels.name}: {factor.path} is printed -1 = {low:g}, +1 = {high:g}; the published optimum "
            f"needs it reversed (there the surface gives {meant:.4g}, in the printed coding {said:.4g})",
            table=levels.name,
            column=factor.path,
            found=meant,
        )


def optimum_findings(
    coding: Coding, optimum: Mapping[str, Printed], best: Optimisation, fit: Fit
) -> Iterator[Finding]:
    """The published optimum beside the recomputed one."""
    right = with_reversals(coding, fit)
    found = right.natural(best.optima[0].coded)
    said = ", ".join(f"{f.path} = {optimum[f.path].text}" for f in fit.factors if f.path in optimum)
    ours = ", ".join(f"{f.path} = {value:.5g}" for f, value in zip(fit.factors, found, strict=True))
    yield Finding(
        "optimum",
        f"published {said}; recomputed {ours} with {fit.response} = {nearest(best, fit):.4g}",
        printed=said,
        found=nearest(best, fit),
    )


def same_point_findings(path: Path, coding: Coding, fit: Fit) -> Iterator[Finding]:
    """Runs of another table that contradict this one: at a point of the design, or inside it."""
    columns = read_columns(path)
    natural = np.column_stack([column_numbers(columns, f.path, str(path)) for f in fit.factors])
    points, values = coding.coded(natural), column_numbers(columns, fit.response, str(path))
    for row, (point, value) in enumerate(zip(points, values, strict=True)):
        place = ", ".join(f"{f.path} = {v:g}" for f, v in zip(fit.factors, natural[row], strict=True))
        finding = contradiction(fit, point, float(value))
        if finding is not None:
            kind, here, p = finding
            yield Finding(
                kind,
                f"{place} gives {value:g} in {path.name} (row {row + 1}) and {here} (p = {p:.1g})",
                table=path.name,
                row=row + 1,
                printed=f"{value:g}",
                found=p,
            )


def contradiction(fit: Fit, point: Floats, value: float) -> tuple[Kind, str, float] | None:
    """Value of this table at the point of another's run, and the p value, where the two contradict."""
    same = np.all(np.abs(fit.coded - point) < SAME_PLACE, axis=1)
    pure = replicate_error(fit)
    if same.any():
        here, error, df = float(fit.values[same].mean()), pure.mean_square, pure.df
        variance = error * (1.0 + 1.0 / same.sum())
        words = f"{', '.join(f'{v:.2f}' for v in fit.values[same])} here, mean {here:.2f}"
    elif np.all(np.abs(point) <= 1.0 + SAME_PLACE):
        here, df = float(fit.predict(point[None, :])[0]), fit.df_error
        variance = fit.ms_error * (1.0 + float(fit.leverage(point[None, :])[0]))
        words = f"{here:.2f} by the surface fitted here"
    else:
        return None
    if not df or not variance > 0.0:
        return None
    p = 2.0 * float(stats.t.sf(abs(value - here) / sqrt(variance), df))
    return ("same point" if same.any() else "prediction", words, p) if p < UNLIKELY else None


def relative_errors(path: Path, target: Printed | None, fit: Fit) -> Iterator[Finding]:
    """Printed relative errors of another table's runs against the target."""
    columns = read_columns(path)
    if target is None or ERROR not in columns or fit.response not in columns:
        return
    values = column_numbers(columns, fit.response, str(path))
    for row, (text, value) in enumerate(zip(columns[ERROR], values, strict=True)):
        found = 100.0 * abs(float(value) - target.value) / target.value
        printed = parse_printed(text)
        if printed is not None and not printed.agrees(found):
            cut = ", cut off instead of rounded" if printed.cut_off(found) else ""
            sentence = (
                f"{path.name}: row {row + 1}, relative error is printed {text}; "
                f"the run gives {found:.4g}{cut}"
            )
            yield Finding("number", sentence, path.name, ERROR, row + 1, text, found)


def test_findings(claims: Claims) -> Iterator[Finding]:
    """The printed p value of the confirmation runs against both t-tests."""
    claim = claims.t_test
    if claim is None:
        return
    wanted = Sample(claim.mean, claim.sd, claim.n)
    welch, student = confirm(claim.runs, wanted), confirm(claim.runs, wanted, pooled=True)
    if not (claim.p.agrees(welch.p) or claim.p.agrees(student.p)):
        yield Finding(
            "number",
            f"t-test: p is printed {claim.p.text}; Student's test gives {student.p:.4g}, Welch's "
            f"{welch.p:.4g}; {len(claim.runs)} runs notice a difference of {welch.resolve:.3g} with a power "
            f"of {welch.power:.2f}",
            printed=claim.p.text,
            found=welch.p,
        )
