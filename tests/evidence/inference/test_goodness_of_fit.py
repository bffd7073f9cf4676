"""Goodness of fit: chances against closed forms, and the place of a misfit in words."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.data.problem import Observable
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.evidence.data.transforms import from_scale, to_scale
from taichi_erosion.evidence.inference.goodness_of_fit import (
    axis_bins,
    chi_square,
    failing_range,
    holm,
    misfit_places,
    observable_misfits,
    place_sentence,
    projection_traces,
    quadratic_form_p,
    rows_table,
    run_from,
    told_residual,
    worst_row,
)
from taichi_erosion.evidence.inference.map_fit import fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand
from tests.evidence.one_heap_study import calibrated, heaps


def test_a_quadratic_form_of_equal_weights_is_chi_square():
    for value in (2.0, 7.0, 20.0):
        assert quadratic_form_p(3.0 * value, 3.0 * np.eye(5)) == pytest.approx(stats.chi2.sf(value, 5))
    assert quadratic_form_p(1.0, np.zeros((3, 3))) == 1.0, "nothing is left to test"


def test_powers_of_what_calibration_leaves_have_the_traces_of_the_whole_matrix():
    basis = np.linalg.qr(np.random.default_rng(2).standard_normal((9, 3)))[0][:7]  # rows of a larger basis
    matrix = np.eye(7) - basis @ basis.T
    powers = [np.trace(np.linalg.matrix_power(matrix, k)) for k in (1, 2, 3)]
    assert projection_traces(basis) == pytest.approx(tuple(powers))


def test_beside_a_number_at_its_bound_places_are_told_as_figures_show_them():
    rows = SimpleNamespace(z=np.array([2.0, 1.0, 0.5]), censored=np.array([False, False, True]))
    prepared: Any = SimpleNamespace(rows=rows, sd=np.array([0.5, 0.5, 0.5]))
    expansion: Any = SimpleNamespace(mean=np.array([1.0, 2.0, 2.0]))
    shifted = np.array([4.0, 1.0, 0.0])  # by an error that the rows share
    free: Any = SimpleNamespace(own=shifted, stuck=np.array([False]))
    stuck: Any = SimpleNamespace(own=shifted, stuck=np.array([True]))
    assert told_residual(prepared, expansion, free).tolist() == shifted.tolist()
    assert told_residual(prepared, expansion, stuck).tolist() == [2.0, -2.0, 0.0]


def test_holm_multiplies_by_the_tests_that_are_left():
    assert holm([0.01, 0.04, 0.02]) == pytest.approx([0.03, 0.04, 0.04])


def test_an_axis_of_few_values_is_told_by_the_value_where_the_model_fails():
    column = np.repeat([1.0, 2.0, 4.0, 8.0], 4)
    free = np.where(column == 2.0, 3.0, 0.0)
    assert failing_range("size", column, free, TableUnits()) == "too low at size = 2"


def test_a_place_that_does_not_fail_is_told_as_none():
    assert place_sentence("angle", "size", "too low", 0.02) == "angle: no misfit seen along size (p = 0.02)"
    assert place_sentence("angle", "level", "too low on average", 1e-20) == (
        "angle: the model is too low on average (p < 1e-16)"
    )


def test_a_flux_of_which_only_rounding_is_left_is_none():
    flux = Observable("flux", "log_floor", floor=2e-4)
    assert from_scale(flux, to_scale(flux, np.array([0.0, 1e-12]))) == pytest.approx([0.0, 1e-12], rel=1e-3)
    assert np.all(from_scale(flux, np.log([2e-4 * (1.0 - 1e-15)])) == 0.0)


def test_rows_of_one_value_are_in_one_bin():
    column = np.repeat([0.0, 0.005, 0.01], [3, 4, 3])
    free = np.array([-1.0] * 3 + [5.0] * 4 + [6.0] * 3)
    bins = axis_bins(column, free)
    assert [(each.low, each.high, each.count) for each in bins] == [
        (0, 0, 3),
        (0.005, 0.005, 4),
        (0.01, 0.01, 3),
    ]
    assert failing_range("moisture", column, free, TableUnits()) == (
        "too high at moisture = 0 and too low from moisture = 0.005: measured less model rises with moisture"
    )


@pytest.mark.parametrize("seed", range(5))
def test_what_is_told_of_a_range_is_true_at_every_level_inside(seed):
    random = np.random.default_rng(seed)
    column = np.sort(random.integers(0, 12, 40) / 10.0)
    free = 3.0 * np.sin(4.0 * column + seed) + 0.1 * random.standard_normal(40)
    bins = axis_bins(column, free)
    worst = int(np.argmax([abs(each.size) for each in bins]))
    low, high = run_from(bins, worst)
    inside = (column >= bins[low].low) & (column <= bins[high].high)
    assert np.sign(free[inside].mean()) == np.sign(bins[worst].mean)
    assert all(np.sign(each.mean) == np.sign(bins[worst].mean) for each in bins[low : high + 1])


def test_two_levels_are_judged():
    column, free = np.repeat([1.0, 2.0], 6), np.repeat([-2.0, 2.0], 6)
    words = failing_range("diameter", column, free, TableUnits())
    assert words.startswith("too high at diameter = 1 and too low at diameter = 2")


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
