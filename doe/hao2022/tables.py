"""The page about the designed experiments of Hao et al. (2022): what comes out, and what an audit finds."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt

from doe.common.pages import RESULTS, write_pages
from doe.hao2022.figures import half_normal, pareto
from taichi_erosion.experiments.anova import anova
from taichi_erosion.experiments.audit.examine import Audit, Comparison, audit
from taichi_erosion.experiments.design_table import Factor
from taichi_erosion.experiments.fit import Fit
from taichi_erosion.experiments.optimise import Goal, Optimisation, optimise
from taichi_erosion.report.design_figures import contours
from taichi_erosion.report.markdown import markdown_table

PICTURES = {
    "effects": "pictures/hao2022_effects.png",
    "half_normal": "pictures/hao2022_half_normal.png",
    "surface": "pictures/hao2022_surface.png",
}
SCREENING, SURFACE = "table_4.csv", "table_8.csv"
TARGET = 33.52  # deg, measured angle of repose
EXACT = 12  # figures that rounding errors of a fit do not reach
UNIT = "deg"
# -1 is the low level of every factor: the coding that the published optimum needs
RANGES = (Factor("Ct", 0.64, 0.80), Factor("Gt", 0.15, 0.31), Factor("It", 3.1, 3.5, "J m-2"))
NAMES = {
    "At": "shear modulus",
    "Bt": "Poisson's ratio",
    "Ct": "restitution, soil on soil",
    "Dt": "sliding friction, soil on soil",
    "Et": "rolling friction, soil on soil",
    "Ft": "restitution, soil on steel",
    "Gt": "sliding friction, soil on steel",
    "Ht": "rolling friction, soil on steel",
    "It": "surface energy",
}
DOTS_PER_INCH = 110


def fit_of(result: Audit) -> Fit:
    """The fitted model of a table that carries one."""
    if result.fit is None:
        raise ValueError(f"{result.table.name}: no model was fitted")
    return result.fit


def surface_fit(result: Audit) -> Fit:
    """The response surface in natural units."""
    return replace(fit_of(result), factors=RANGES)


def best_point(result: Audit) -> Optimisation:
    """Where the surface comes nearest to the measured angle."""
    fit = surface_fit(result)
    return optimise([fit], [Goal(fit.response, "target", TARGET)])


def figures(value: float, count: int) -> str:
    """So many figures of a value; the last bits, in which processors differ, turn no tie over."""
    return f"{float(f'{value:.{EXACT}g}'):.{count}g}"


def comparison_table(comparisons: Sequence[Comparison]) -> str:
    """Every printed number that is compared, line by line, beside the recomputed one."""
    rows = [
        (
            f"{c.source}, {c.quantity.replace('_', ' ')}",
            c.printed.text,
            figures(c.found, 6),
            "yes" if c.agrees else "**no**",
        )
        for c in comparisons
        if c.quantity != "df"
    ]
    return markdown_table(("number", "printed", "recomputed", "agrees"), rows)


def finding_list(result: Audit) -> str:
    """What the audit says, finding by finding."""
    return "".join(f"- **{finding.kind}**: {finding.sentence}\n" for finding in result.findings)


def variance_table(fit: Fit) -> str:
    """Recomputed analysis of variance."""
    rows = [
        (
            row.source,
            figures(row.sum_of_squares, 5),
            str(row.df),
            *(shown(x) for x in (row.mean_square, row.f, row.p)),
        )
        for row in anova(fit)
    ]
    return markdown_table(("source", "sum of squares", "df", "mean square", "F", "p"), rows)


def shown(value: float) -> str:
    """A number that may be missing."""
    return "" if value != value else f"{value:.4g}"


def tables(screening: Audit, surface: Audit) -> dict[str, str]:
    """All tables of the page by the name of their mark."""
    return {
        "audit of table 4": finding_list(screening),
        "audit of table 8": finding_list(surface),
        "numbers of table 5": comparison_table(screening.comparisons),
        "numbers of table 9": comparison_table(surface.comparisons),
        "variance of table 8": variance_table(surface_fit(surface)),
    }


def draw(screening: Audit, surface: Audit, docs: Path) -> None:
    """Effects of the screening, and the surface at its best point."""
    best = best_point(surface).optima[0].coded
    figures = {
        "effects": pareto(fit_of(screening), NAMES, UNIT),
        "half_normal": half_normal(fit_of(screening), NAMES, UNIT),
        "surface": contours(surface_fit(surface), NAMES, UNIT, best, TARGET),
    }
    for name, figure in figures.items():
        file = docs / PICTURES[name]
        file.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(file, dpi=DOTS_PER_INCH, metadata={"Software": None})
        plt.close(figure)


def publish(folder: Path, docs: Path) -> None:
    """Audit both tables, draw the figures and fill the page."""
    screening, surface = audit(folder / SCREENING), audit(folder / SURFACE)
    draw(screening, surface, docs)
    write_pages((docs / RESULTS, folder / "README.md"), tables(screening, surface))
