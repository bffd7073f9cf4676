"""Figures of designed experiments show what the analysis says."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from taichi_erosion.experiments.audit import audit_table
from taichi_erosion.experiments.design import Factor
from taichi_erosion.experiments.fit import Fit, term_label
from taichi_erosion.report import design_figures as figures

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "doe" / "hao2022"
RANGES = (Factor("Ct", 0.64, 0.80), Factor("Gt", 0.15, 0.31), Factor("It", 3.1, 3.5, "J m-2"))
RUN_ORDER, CENTRE = np.arange(1, 18), np.zeros(3)


@cache
def surface() -> Fit:
    """The published response surface in natural units; -1 is the low level of every factor."""
    return replace(audit_table(FOLDER / "table_8.csv").fit, factors=RANGES)


def test_every_pair_of_factors_has_its_contours():
    drawn = figures.contour_figure(surface(), {}, "deg", CENTRE, 25.0).axes
    assert [(a.get_xlabel(), a.get_ylabel()) for a in drawn] == [("Ct", "Gt"), ("Ct", "It"), ("Gt", "It")]
    assert (*drawn[0].get_xlim(), *drawn[0].get_ylim()) == pytest.approx((0.64, 0.80, 0.15, 0.31))


def test_residual_panels_show_every_run():
    normal, level, order, influence = figures.residual_figure(surface(), RUN_ORDER).axes
    assert all(len(axes.lines[0].get_xdata()) == 17 for axes in (normal, level, order))
    assert influence.get_xlabel() == "run order"


def test_names_replace_whole_factors_only():
    assert term_label("a*ab^2", {"a": "x"}) == "x \N{MULTIPLICATION SIGN} ab^2"
