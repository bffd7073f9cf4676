"""Hao, Tong, Chen & Liu (2022): every printed number of their designs recomputed, and what an audit finds.

Rev. Bras. Eng. Agric. Ambient. 26(8), 564, doi 10.1590/1807-1929/agriambi.v26n8p564-570.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.cli.main import main
from taichi_erosion.experiments.anova import anova, curvature_test
from taichi_erosion.experiments.audit import Audit, audit_table
from taichi_erosion.experiments.design import Factor, to_natural
from taichi_erosion.experiments.fit import Fit, figures_of_merit
from taichi_erosion.experiments.optimise import Goal, Optimisation, optimise

FOLDER = Path(__file__).parents[3] / "doe" / "hao2022"
MEASURED = 33.52  # deg
# -1 is the low level of every factor; the coding that the published optimum needs
NATURAL = [Factor("Ct", 0.64, 0.80), Factor("Gt", 0.15, 0.31), Factor("It", 3.1, 3.5)]


@cache
def audited(table: int) -> Audit:
    return audit_table(FOLDER / f"table_{table}.csv")


@cache
def best() -> Optimisation:
    return optimise([fitted(8)], [Goal("repose_angle", MEASURED)])


def fitted(table: int) -> Fit:
    """Table 4 with its one wrong cell changed, or table 8."""
    found = audited(table).fit
    assert found is not None
    return found


def test_table_5_counts_curvature_as_noise():
    residual = next(row for row in anova(fitted(4)) if row.source == "Residual")
    assert (residual.df, residual.mean_square) == (3, pytest.approx(25.70, abs=0.005))
    bend = curvature_test(fitted(4))
    assert bend.sum_of_squares == pytest.approx(45.6, abs=0.05)
    assert (bend.df_error, bend.ms_error) == (2, pytest.approx(15.8, abs=0.05))


def test_every_number_of_table_9_and_of_the_regression_comes_out_but_two():
    """Columns 'Mean square' and 'Sum of square' of the table hold each other's numbers."""
    comparisons = audited(8).comparisons
    assert len(comparisons) == 66
    wrong = {(one.table, one.source, one.quantity): one.printed.text for one in comparisons if not one.agrees}
    residual = {("table_9.csv", "Lack of fit", "sum_of_squares"): "2.41"}
    assert wrong == residual | {("equation", "CtGt", "coefficient"): "0.4675"}
    assert figures_of_merit(fitted(8)).r2_predicted == pytest.approx(0.9073, abs=5e-5)


def test_the_published_optimum_comes_out_to_the_printed_digits():
    """The coded optimum in two decimals, (-1, 1, 0.01), is the published one in natural units."""
    coded = np.round(best().optima[0].coded, 2)
    assert to_natural(NATURAL, coded) == pytest.approx([0.64, 0.31, 3.302], abs=1e-9)
    # unrounded it is 3.3013: a difference that moves the angle by less than its fourth digit
    assert to_natural(NATURAL, best().optima[0].coded) == pytest.approx([0.64, 0.31, 3.3013], abs=5e-5)
    angles = fitted(8).predict(np.array([coded, best().optima[0].coded]))
    assert angles[0] == pytest.approx(angles[1], abs=1e-4)


def test_the_audit_finds_headings_a_number_a_sign_and_the_target_out_of_reach_and_nothing_else():
    *headings, number, sign, target = audited(8).findings
    assert [one.column for one in headings] == ["Mean square", "Sum of square"]
    assert (number.kind, number.column, number.printed) == ("number", "Lack of fit", "2.41")
    assert (sign.kind, sign.column, sign.printed) == ("sign", "CtGt", "0.4675")
    assert target.kind == "target"
    assert (sign.found, target.found) == pytest.approx((-0.4675, 33.32), abs=0.005)
    # by a grid of 101 levels: it misses the top by less than 5.64 0.01^2
    ticks = np.linspace(-1.0, 1.0, 101)
    grid = np.array(np.meshgrid(ticks, ticks, ticks)).reshape(3, -1).T
    assert fitted(8).predict(grid).max() == pytest.approx(best().reach["repose_angle"].high, abs=6e-4)


def test_all_of_table_5_agrees_with_one_cell_changed(capsys):
    assert main(["audit", str(FOLDER / "table_4.csv"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["cell"] == {"row": 7, "column": "Et", "printed": -1.0, "restored_by": 1.0}
    assert found["printed_numbers"] == {"compared": 36, "agree": 36}
