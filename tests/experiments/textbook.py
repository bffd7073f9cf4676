"""Textbook experiments whose analysis is printed elsewhere."""

from itertools import product

import numpy as np
import pytest

from taichi_erosion.experiments.anova import Row, anova
from taichi_erosion.experiments.design import Design, Factor, stack_parts, to_coded
from taichi_erosion.experiments.fit import Fit, model_terms

FULL = (*model_terms(3, "interactions"), (1, 1, 1))  # of three factors in two levels


def unit_factors(names: str) -> list[Factor]:
    return [Factor(name, -1.0, 1.0) for name in names]


def rows_of(fit: Fit) -> dict[str, Row]:
    return {row.source: row for row in anova(fit)}


def printed(value: float, digits: int) -> object:
    """What agrees with a number printed with so many decimals."""
    return pytest.approx(value, abs=0.5000001 * 10.0**-digits)


def tool_life() -> Design:
    """Life of a machine tool [h]: cutting speed A, geometry B, angle C; a 2^3 with three repeats.

    Montgomery (2012), Design and Analysis of Experiments, 8th ed., problem 6.1.
    """
    lives = [
        (22, 31, 25), (32, 43, 29), (35, 34, 50), (55, 47, 46),
        (44, 45, 38), (40, 37, 36), (60, 50, 54), (39, 41, 47),
    ]  # fmt: skip
    corners = np.array([point[::-1] for point in product((-1.0, 1.0), repeat=3)])
    design = stack_parts("tool life", unit_factors("ABC"), [("factorial", np.repeat(corners, 3, axis=0))])
    return design.with_responses(life=np.ravel(lives))


def smell() -> Design:
    """Odour of a chemical: temperature T, gas-liquid ratio R, packing height H; a Box-Behnken design.

    John (1971), Statistical Design and Analysis of Experiments; analysed in the manual of SAS/STAT, RSREG.
    """
    rows = np.array([
        (66, 40, 0.3, 4), (39, 120, 0.3, 4), (43, 40, 0.7, 4), (49, 120, 0.7, 4), (58, 40, 0.5, 2),
        (17, 120, 0.5, 2), (-5, 40, 0.5, 6), (-40, 120, 0.5, 6), (65, 80, 0.3, 2), (7, 80, 0.7, 2),
        (43, 80, 0.3, 6), (-22, 80, 0.7, 6), (-31, 80, 0.5, 4), (-35, 80, 0.5, 4), (-26, 80, 0.5, 4),
    ])  # fmt: skip
    factors = [Factor("T", 40.0, 120.0), Factor("R", 0.3, 0.7), Factor("H", 2.0, 6.0)]
    design = stack_parts("smell", factors, [("edge", to_coded(factors, rows[:, 1:]))])
    return design.with_responses(odour=rows[:, 0])
