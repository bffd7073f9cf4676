"""Goodness of fit: chances against closed forms, and the place of a misfit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.inference.goodness_of_fit import (
    chi_square,
    holm,
    misfit_places,
    observable_misfits,
    quadratic_form_p,
    rows_table,
    worst_row,
)
from taichi_erosion.evidence.inference.map_fit import fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand
from tests.evidence.one_heap_study import calibrated, heaps


def test_a_quadratic_form_of_equal_weights_is_chi_square():
    for value in (2.0, 7.0, 20.0):
        assert quadratic_form_p(3.0 * value, 3.0 * np.eye(5)) == pytest.approx(stats.chi2.sf(value, 5))
    assert quadratic_form_p(1.0, np.zeros((3, 3))) == 1.0, "nothing is left to test"


def test_holm_multiplies_by_the_tests_that_are_left():
    assert holm([0.01, 0.04, 0.02]) == pytest.approx([0.03, 0.04, 0.04])


def test_a_misfit_of_one_observable_is_not_told_of_another_one_of_its_heaps():
    problem = heaps(5)
    table = problem.measurements
    bent = table.value + np.where(
        np.array(table.observable) == "angle", 0.3 * table.conditions["x"] ** 2, 0.0
    )
    prepared = calibrated(replace(problem, measurements=replace(table, value=bent)))
    prepared, best, _ = fit_base(prepared, weighted=True)
    expansion = expand(prepared, best)
    places = misfit_places(prepared, expansion)
    assert min(place.p for place in places if place.observable == "angle") < 1e-6
    assert min(place.p for place in places if place.observable == "width") > 0.05
    shown = rows_table(prepared, expansion)
    own = (shown.measured - shown.predicted - shown.shift) / shown.residual_error
    np.testing.assert_allclose(shown.residual, own, rtol=1e-6, atol=1e-9)
    each = observable_misfits(prepared, expansion, shown)
    assert each["angle"].p < 1e-6
    assert each["width"].p > 0.05
    assert each["width"].chi2 == pytest.approx(float(np.sum(shown.residual[prepared.rows.which == 1] ** 2)))
    errors = prepared.rows.z - expansion.mean
    covariance = (
        np.diag(prepared.variance) + prepared.rows.covariance + prepared.rows.shared @ prepared.rows.shared.T
    )
    whole = float(errors @ np.linalg.solve(covariance, errors))
    assert chi_square(prepared, expansion) <= whole  # without the sizes of shared errors


def test_the_row_that_is_off_is_found_beside_its_heap():
    problem = heaps(6)
    table, off = problem.measurements, 4
    value = table.value.copy()
    value[3 * off : 3 * off + 3] += 0.6  # three heaps of one condition: ten sd of their mean
    prepared = calibrated(replace(problem, measurements=replace(table, value=value)))
    prepared, best, _ = fit_base(prepared, weighted=True)
    found = worst_row(prepared, expand(prepared, best))
    assert found.observable == "angle"
    assert found.conditions["x"] == pytest.approx(np.linspace(-1.0, 1.0, 10)[off])
    assert found.p_without > 0.01
