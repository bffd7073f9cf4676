"""Hao, Tong, Chen & Liu (2022): every printed number of their designs recomputed, and what an audit finds.

Rev. Bras. Eng. Agric. Ambient. 26(8), 564, doi 10.1590/1807-1929/agriambi.v26n8p564-570.
"""

import csv
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.experiments.anova import Row, anova, curvature
from taichi_erosion.experiments.audit.examine import Audit, audit
from taichi_erosion.experiments.audit.published import Finding, parse_printed
from taichi_erosion.experiments.design_table import Factor, to_natural
from taichi_erosion.experiments.fit import Fit, quality
from taichi_erosion.experiments.optimise import Goal, Optimisation, optimise

FOLDER = Path(__file__).parents[3] / "doe" / "hao2022"
MEASURED = 33.52  # deg
# -1 is the low level of every factor; the coding that the published optimum needs
NATURAL = [Factor("Ct", 0.64, 0.80), Factor("Gt", 0.15, 0.31), Factor("It", 3.1, 3.5)]


def lines(table: int) -> list[dict[str, str]]:
    with (FOLDER / f"table_{table}.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


@cache
def audited(table: int) -> Audit:
    return audit(FOLDER / f"table_{table}.csv")


@cache
def best() -> Optimisation:
    return optimise([fitted(8)], [Goal("repose_angle", MEASURED)])


def fitted(table: int) -> Fit:
    """Table 4 with its one wrong cell changed, or table 8."""
    found = audited(table).fit
    assert found is not None
    return found


def variance(table: int) -> dict[str, Row]:
    return {row.source: row for row in anova(fitted(table))}


def found_in(table: int, kind: str) -> list[Finding]:
    return [finding for finding in audited(table).findings if finding.kind == kind]


def agrees(text: str, value: float) -> bool:
    printed = parse_printed(text)
    return printed is not None and printed.agrees(value)


@pytest.mark.parametrize("line", lines(5), ids=lambda line: line["source"])
def test_every_sum_of_squares_f_and_p_of_table_5_comes_out(line):
    row = variance(4)[line["source"]]
    assert agrees(line["sum of squares"], row.sum_of_squares)
    assert agrees(line["F value"], row.f)
    assert agrees(line["p value"], row.p)


def test_table_5_counts_curvature_as_noise_and_agrees_with_one_cell_changed_and_a_quarter_without():
    assert variance(4)["Residual"].df == 3
    assert variance(4)["Residual"].mean_square == pytest.approx(25.70, abs=0.005)
    bend = curvature(fitted(4))
    assert bend.sum_of_squares == pytest.approx(45.6, abs=0.05)
    assert (bend.df_error, bend.ms_error) == (2, pytest.approx(15.8, abs=0.05))
    comparisons = audited(4).comparisons
    assert len(comparisons) == 36
    assert all(comparison.agrees for comparison in comparisons)
    # the nine degrees of freedom agree in any case
    assert audited(4).agree_as_printed == 9


@pytest.mark.parametrize("line", lines(9), ids=lambda line: line["source"])
def test_every_number_of_table_9_comes_out_but_the_lack_of_fit_sum(line):
    """Its columns 'Mean square' and 'Sum of square' hold each other's numbers."""
    source = {"Sum": "Total"}.get(line["source"], line["source"])
    # `CtGt` and `Ct2` as this project writes them
    fitted_name = f"{source[:2]}^2" if source.endswith("2") else f"{source[:2]}*{source[2:]}"
    row = variance(8)[source if source in variance(8) else fitted_name]
    assert agrees(line["Degree of freedom"], row.df)
    assert agrees(line["Mean square"], row.sum_of_squares) == (source != "Lack of fit")
    if line["Sum of square"]:
        assert agrees(line["Sum of square"], row.mean_square)
    if line["P value"]:
        assert agrees(line["P value"], row.p)


def test_the_figures_of_merit_of_table_9_and_the_regression_with_one_sign_changed_come_out():
    merit = quality(fitted(8))
    values = (merit.r2, merit.r2_adjusted, merit.cv, merit.adequate_precision)
    assert all(map(agrees, ("0.9883", "0.9731", "3.55", "32.9751"), values))
    assert merit.r2_predicted == pytest.approx(0.9073, abs=5e-5)
    printed = {
        "Ct": "-0.8187", "Gt": "5.64", "It": "0.7313", "Ct*Gt": "-0.4675", "Ct*It": "-0.615",
        "Gt*It": "-1.27", "Ct^2": "0.8985", "Gt^2": "-0.3940", "It^2": "-5.64",
    }  # fmt: skip
    fit = fitted(8)
    assert agrees("25.90", fit.coefficients[0])
    found = dict(zip(fit.names, fit.coefficients[1:], strict=True))
    assert found.keys() == printed.keys()
    assert all(agrees(text, found[name]) for name, text in printed.items())


def test_the_published_optimum_comes_out_to_the_printed_digits():
    """The coded optimum in two decimals, (-1, 1, 0.01), is the published one in natural units."""
    coded = np.round(best().optima[0].coded, 2)
    assert to_natural(NATURAL, coded) == pytest.approx([0.64, 0.31, 3.302], abs=1e-9)
    # unrounded it is 3.3013: a difference that moves the angle by less than its fourth digit
    exact = to_natural(NATURAL, best().optima[0].coded)
    assert exact == pytest.approx([0.64, 0.31, 3.3013], abs=5e-5)
    angles = fitted(8).predict(np.array([coded, best().optima[0].coded]))
    assert angles[0] == pytest.approx(angles[1], abs=1e-4)


def test_the_audit_finds_the_sign_of_ct_gt_and_no_other_and_the_target_out_of_reach():
    (finding,) = found_in(8, "sign")
    assert (finding.column, finding.printed) == ("CtGt", "0.4675")
    assert finding.found == pytest.approx(-0.4675, abs=1e-9)
    (finding,) = found_in(8, "target")
    assert finding.found == pytest.approx(33.32, abs=0.005)
    # by a grid of 101 levels: it misses the top by less than 5.64 0.01^2
    ticks = np.linspace(-1.0, 1.0, 101)
    grid = np.array(np.meshgrid(ticks, ticks, ticks)).reshape(3, -1).T
    assert fitted(8).predict(grid).max() == pytest.approx(best().reach["repose_angle"].high, abs=6e-4)


def test_the_command_says_all_this_in_one_document(capsys):
    assert main(["audit", str(FOLDER / "table_4.csv"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["cell"] == {"row": 7, "column": "Et", "printed": -1.0, "restored_by": 1.0}
    assert found["printed_numbers"] == {"compared": 36, "agree": 36, "agree_as_printed": 9}
