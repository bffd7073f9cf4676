"""Figures of designed experiments show what the analysis says."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from doe.hao2022 import tables as hao2022
from doe.hao2022.figures import half_normal, pareto
from taichi_erosion.experiments.anova import effect_limits
from taichi_erosion.experiments.audit.examine import Audit, audit
from taichi_erosion.experiments.design import grid_points
from taichi_erosion.experiments.design_table import Factor, arranged
from taichi_erosion.experiments.fit import Fit, fit_model
from taichi_erosion.experiments.terms import model_terms, term_label
from taichi_erosion.report import design_figures as figures

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "doe" / "hao2022"
RUN_ORDER = np.arange(1, 18)


@cache
def audited(table: str) -> Audit:
    return audit(FOLDER / table)


def screening() -> Fit:
    return hao2022.fit_of(audited(hao2022.SCREENING))


def surface() -> Fit:
    return hao2022.surface_fit(audited(hao2022.SURFACE))


@pytest.fixture(autouse=True)
def close_figures() -> Iterator[None]:
    yield
    plt.close("all")


def words(figure: Figure) -> list[str]:
    return [text.get_text().strip() for axes in figure.axes for text in axes.texts]


def test_a_half_normal_plot_names_the_effects_beyond_their_limit():
    figure = half_normal(screening(), {"Gt": "steel"}, "deg")
    assert words(figure) == ["It (\N{MINUS SIGN})", "Ct (\N{MINUS SIGN})", "steel (+)"]


def test_a_pareto_chart_has_a_bar_for_every_effect_and_both_limits():
    (axes,) = pareto(screening(), {}, "deg").axes
    assert len(axes.patches) == 9
    assert [text.get_text() for text in axes.get_yticklabels()][-1] == "Gt"
    limits = effect_limits(screening())
    assert [float(np.ravel(line.get_xdata())[0]) for line in axes.lines] == [limits.single, limits.bonferroni]


def test_a_saturated_design_is_judged_by_lenths_limits():
    made = arranged(
        "factorial", [Factor(name, -1.0, 1.0) for name in "abc"], [("factorial", grid_points(3, 2))]
    )
    terms = (*model_terms(3, "interactions"), (1, 1, 1))
    values = 10.0 * made.coded[:, 0] + np.array([0.1, -0.2, 0.05, 0.1, -0.1, 0.2, 0.15, -0.3])
    fit = fit_model(made.with_responses(y=values), "y", terms)
    figure = half_normal(fit, {}, "1")
    assert words(figure) == ["a (+)"]
    texts = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert texts == ["Lenth, one effect", "Lenth, all"]


def test_every_pair_of_factors_has_its_surface_and_its_contours():
    assert len(figures.response_surfaces(surface(), {}, "deg").axes) == 3
    drawn = figures.contours(surface(), {}, "deg", target=25.0).axes
    assert [(a.get_xlabel(), a.get_ylabel()) for a in drawn] == [("Ct", "Gt"), ("Ct", "It"), ("Gt", "It")]


def test_contours_are_drawn_in_natural_units():
    for axes in figures.contours(surface(), {}, "deg").axes[:1]:
        assert axes.get_xlim() == pytest.approx((0.64, 0.80))
        assert axes.get_ylim() == pytest.approx((0.15, 0.31))


def test_a_perturbation_plot_meets_in_the_chosen_point():
    at = np.array([0.5, -0.5, 0.0])
    (axes,) = figures.perturbation(surface(), {}, "deg", at).axes
    there = float(surface().predict(at[None, :])[0])
    for line, level in zip(axes.lines, at, strict=True):
        assert np.interp(level, line.get_xdata(), line.get_ydata()) == pytest.approx(there, abs=1e-9)


def test_residual_panels_and_predictions_show_every_run():
    normal, level, order, influence = figures.residuals(surface(), RUN_ORDER).axes
    assert all(len(axes.lines[0].get_xdata()) == 17 for axes in (normal, level, order))
    assert influence.get_xlabel() == "run order"
    (axes,) = figures.predicted_against_actual(surface(), "deg").axes
    assert len(axes.lines[1].get_xdata()) == 17


def test_names_replace_whole_factors_only():
    assert term_label("a*ab^2", {"a": "x"}) == "x \N{MULTIPLICATION SIGN} ab^2"


def test_a_fit_in_natural_units_predicts_as_in_coded_ones():
    coded = hao2022.fit_of(audited(hao2022.SURFACE))
    assert replace(coded, factors=hao2022.RANGES).predict(coded.coded) == pytest.approx(
        coded.fitted, abs=1e-9
    )
