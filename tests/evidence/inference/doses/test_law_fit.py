"""Laws of doses against the exact model: least squares of all numbers at once, and integrals over a grid."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import optimize

from taichi_erosion.evidence.data.problem import Measurements, Mechanism, Observable, Parameter, Problem
from taichi_erosion.evidence.inference.doses.dose_forms import Form, power_form
from taichi_erosion.evidence.inference.doses.dose_laws import (
    FittedForm,
    descended,
    fitted_form,
    form_slopes,
    law_part,
    rows_about,
    settled_form,
)
from taichi_erosion.evidence.inference.doses.dose_path import around, dose_nodes, dose_path, moved_path
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare

STRESS = Mechanism("stress", -0.9, 3.0)
SETS, TYPICAL, EXPONENT, LEVEL = 14, -0.45, -0.6, 1.2  # level of the hidden number, in prior sd
PRIOR_SD = 0.3
SD = {"threshold": 0.02, "angle": 0.5}
GRID = 25  # values of each number


def threshold(number: float, dose: np.ndarray) -> np.ndarray:
    """A threshold that a factor 1 + D of the stress lowers: the number can take over the level of D."""
    return number / np.sqrt(1.0 + dose)


def angle(number: float, dose: np.ndarray) -> np.ndarray:
    return number * (20.0 - 6.0 * dose)


MODELS = {"threshold": threshold, "angle": angle}


def prepared_power(seed: int) -> PreparedProblem:
    """Two observables of a mechanism whose dose is a power of c, far from the start of the number."""
    column = np.geomspace(0.5, 2.5, SETS)
    truth, drawn = TYPICAL * column**EXPONENT, np.random.default_rng(seed)

    def model(observable, conditions, parameters, effects, seeds):
        dose = np.full(conditions["c"].size, effects.get("stress", 0.0))
        value = MODELS[observable](parameters["number"], dose)
        return np.repeat(value[np.newaxis], len(seeds), axis=0)

    number, value, sd = float(np.exp(PRIOR_SD * LEVEL)), [], []
    for name, exact in MODELS.items():
        mean = exact(number, truth)
        own = SD[name] * (mean if name == "threshold" else np.ones(SETS))
        value.append(mean + own * drawn.standard_normal(SETS))
        sd.append(own)
    size = SETS * len(MODELS)
    table = Measurements(
        observable=tuple(name for name in MODELS for _ in range(SETS)),
        value=np.concatenate(value),
        sd=np.concatenate(sd),
        n=np.ones(size),
        group=tuple(f"g{k}" for _ in MODELS for k in range(SETS)),
        unit=("1",) * size,
        conditions={"c": np.tile(column, len(MODELS))},
        censored=np.zeros(size, dtype=np.bool_),
        limit=np.full(size, np.nan),
        source=("made",) * size,
    )
    parameter = Parameter("number", 1.0, 0.1, 10.0, PRIOR_SD)
    observables = {"threshold": Observable("threshold", "log"), "angle": Observable("angle")}
    problem = Problem(table, observables, (parameter,), (), model, mechanisms=(STRESS,))
    return prepare(problem, table, 1)


def residual(prepared: PreparedProblem, form: Form, x: float, numbers: np.ndarray) -> np.ndarray:
    """Whitened residual of the exact model."""
    dose = form.dose(prepared.rows.conditions, numbers)
    mean = np.empty(dose.size)
    for observable, rows in prepared.by_observable():
        value = MODELS[observable.name](np.exp(PRIOR_SD * x), dose[rows])
        mean[rows] = np.log(value) if observable.transform == "log" else value
    return (prepared.rows.z - mean) / prepared.sd


def settled_power(prepared: PreparedProblem, form: Form) -> FittedForm:
    """The form fitted from a path at the prior mean, far from the best number."""
    path = dose_path(prepared, STRESS, np.zeros(1))
    rows = rows_about(prepared, path, np.full(prepared.rows.size, -0.3))

    def remake(x, dose, like):
        exact = like is None
        made = dose_path(prepared, STRESS, x, near=dose) if exact else moved_path(prepared, like, x)
        return rows_about(prepared, made, dose)

    first = fitted_form(law_part(rows, np.ones(prepared.rows.size, dtype=np.bool_)), form)
    return settled_form(prepared, first, remake)


def log_integral(prepared: PreparedProblem, form: Form, numbers: np.ndarray, x: float) -> float:
    """Ln of the integral over the calibrated number, which the measurements determine to 0.02 prior sd."""
    step, curvature = 1e-4, 1.0
    for _ in range(4):
        left = residual(prepared, form, x, numbers)
        slope = (residual(prepared, form, x + step, numbers) - left) / step
        curvature = float(slope @ slope) + 1.0
        x -= (float(slope @ left) + x) / curvature
    left = residual(prepared, form, x, numbers)
    return -0.5 * (float(left @ left) + x**2 + np.log(curvature))


@pytest.mark.parametrize("seed", range(3))
def test_a_law_has_the_numbers_of_a_fit_of_everything_at_once(seed):
    prepared = prepared_power(seed)
    form = power_form({"c": prepared.rows.conditions["c"]})
    found = settled_power(prepared, form)

    def everything(theta):
        return np.concatenate([residual(prepared, form, theta[0], theta[1:]), theta[:1]])

    best = optimize.least_squares(everything, [LEVEL, TYPICAL, EXPONENT], x_scale=[1.0, 0.1, 0.1])
    sd = np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(found.numbers - best.x[1:]) < 0.15 * sd)
    assert found.misfit == pytest.approx(2.0 * best.cost, abs=0.1)


def test_the_interval_of_an_exponent_is_that_of_an_integral_over_a_grid():
    prepared = prepared_power(0)
    form = power_form({"c": prepared.rows.conditions["c"]})
    found = settled_power(prepared, form)
    sd = np.sqrt(np.diag(found.covariance))
    spans = [found.numbers[k] + np.linspace(-5.0, 5.0, GRID) * sd[k] for k in range(2)]
    log = np.empty((GRID, GRID))
    for i, a in enumerate(spans[0]):
        for j, p in enumerate(spans[1]):
            log[i, j] = log_integral(prepared, form, np.array([a, p]), float(found.rows.path.x[0]))
    weight = np.exp(log - log.max()).sum(axis=0)
    share = np.cumsum(weight) / weight.sum()
    low, high = np.interp([0.05, 0.95], share, spans[1])
    assert 3.29 * sd[1] == pytest.approx(high - low, rel=0.2)


class SamePart:
    """Residuals of two numbers that do the same, slow to fit: their fourth power."""

    rows: Any = None

    def residual(self, form: Form, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        both = numbers.sum()
        return np.full(3, 1e6 * both**4), np.full((3, 2), 4e6 * both**3)


def test_numbers_that_do_the_same_are_fitted_together():
    form: Any = SimpleNamespace(low=(-100.0,) * 2, high=(100.0,) * 2, size=2)
    part: Any = SamePart()
    found = descended(part, form, np.array([15.0, 5.0]))
    assert abs(found.numbers.sum()) < 0.02 * 20.0


def test_slopes_of_a_form_are_its_derivatives():
    conditions = {"c": np.array([0.5, 1.0, 2.0])}
    form = power_form(conditions)
    dose, slopes = form_slopes(form, conditions, np.array([2.0, 0.7]))
    np.testing.assert_allclose(dose, 2.0 * conditions["c"] ** 0.7, rtol=1e-12)
    exact = np.column_stack([dose / 2.0, dose * np.log(conditions["c"])])
    np.testing.assert_allclose(slopes, exact, rtol=1e-5, atol=1e-6)


def test_a_path_is_exact_about_the_doses_that_are_asked():
    prepared = prepared_power(0)
    doses = np.linspace(-0.85, -0.6, prepared.rows.size)
    (rows,) = (chosen for observable, chosen in prepared.by_observable() if observable.name == "threshold")
    errors = []
    for near in (None, doses):
        change, _ = dose_path(prepared, STRESS, np.zeros(1), near=near).change(doses)
        errors.append(np.max(np.abs(change + 0.5 * np.log1p(doses))[rows] / prepared.sd[rows]))
    assert errors[0] > 0.5
    assert errors[1] < 0.1


def test_a_path_that_is_moved_is_nearly_the_one_made_there():
    prepared, doses = prepared_power(0), np.linspace(-0.5, 1.0, SETS * len(MODELS))
    path, there = dose_path(prepared, STRESS, np.zeros(1), near=doses), np.full(1, 0.5)
    moved, exact = moved_path(prepared, path, there), dose_path(prepared, STRESS, there, near=doses)
    gap, stale = ((each.change(doses)[0] - exact.change(doses)[0]) / prepared.sd for each in (moved, path))
    assert np.max(np.abs(gap)) < 0.1 * np.max(np.abs(stale))
    np.testing.assert_array_equal(moved.bare, exact.bare)


def test_nodes_around_doses_hold_them_or_are_the_nearest():
    nodes = dose_nodes(Mechanism("m", -0.9, 9.0))
    kept = around(nodes, np.array([0.5, 1.5]))
    assert kept[0] <= 0.5
    assert kept[-1] >= 1.5
    assert around(nodes, np.array([50.0])).tolist() == nodes[-2:].tolist()
    assert around(nodes, np.array([-50.0])).tolist() == nodes[:2].tolist()
