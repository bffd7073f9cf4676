"""Doses of mechanisms against closed forms: a model linear in the dose has an exact marginal likelihood."""

import numpy as np
import pytest

from taichi_erosion.evidence.data.problem import Measurements, Mechanism, Parameter, Problem
from taichi_erosion.evidence.inference.doses.dose_inference import (
    condition_sets,
    curvature,
    dose_evidence,
    dose_priors,
    first_fit,
    left_p,
    one_dose_p,
)
from taichi_erosion.evidence.inference.doses.dose_path import dose_path
from taichi_erosion.evidence.inference.doses.dose_search import dose_searches
from taichi_erosion.evidence.models.prepared_problem import PreparedProblem, prepare

SD, SETS = 0.1, 12
WEIGHTS = {"angle": 2.0, "height": -0.7}  # change of each observable per dose
PULL = Mechanism("pull", -5.0, 5.0)


def linear_problem(truth: dict[str, np.ndarray], seed: int = 0) -> Problem:
    """Two observables of the same sets of conditions: level + weight times dose(c), which the model lacks."""
    column = np.linspace(0.0, 1.0, SETS)

    def model(observable, conditions, parameters, effects, seeds):
        value = parameters["level"] + WEIGHTS[observable] * effects.get("pull", 0.0)
        return np.repeat(np.full((1, conditions["c"].size), value), len(seeds), axis=0)

    noise = SD * np.random.default_rng(seed).standard_normal((len(WEIGHTS), SETS))
    value = [WEIGHTS[name] * truth[name] + noise[k] for k, name in enumerate(WEIGHTS)]
    size = SETS * len(WEIGHTS)
    table = Measurements(
        observable=tuple(name for name in WEIGHTS for _ in range(SETS)),
        value=np.concatenate(value),
        sd=np.full(size, SD),
        n=np.ones(size),
        group=tuple(f"g{k}" for _ in WEIGHTS for k in range(SETS)),
        unit=("1",) * size,
        conditions={"c": np.tile(column, len(WEIGHTS))},
        censored=np.zeros(size, dtype=np.bool_),
        limit=np.full(size, np.nan),
        source=("made",) * size,
    )
    level = Parameter("level", 0.0, -2.0, 2.0)  # a start of 0: normal prior, sd 1
    return Problem(table, {}, (level,), (), model, mechanisms=(PULL,))


def same(doses: np.ndarray) -> dict[str, np.ndarray]:
    return dict.fromkeys(WEIGHTS, doses)


def prepared_linear(truth: dict[str, np.ndarray], seed: int = 0) -> PreparedProblem:
    problem = linear_problem(truth, seed)
    return prepare(problem, problem.measurements, 1)


def log_normal(z: np.ndarray, covariance: np.ndarray) -> float:
    """Ln density of a normal distribution about 0."""
    squares = float(z @ np.linalg.solve(covariance, z))
    return -0.5 * (squares + np.linalg.slogdet(covariance)[1] + z.size * np.log(2.0 * np.pi))


DOSES = np.linspace(0.0, 1.0, SETS) ** 2


def test_evidence_and_doses_of_a_linear_model_are_the_exact_ones():
    prepared = prepared_linear(same(DOSES))
    path = dose_path(prepared, PULL, np.zeros(1))
    sets, prior = condition_sets(prepared), dose_priors(prepared, condition_sets(prepared))[0]
    search = dose_searches(prepared, path, sets, [(prior, 1.0)])
    (fit,) = search.fits(search.run(search.start(), 20))

    weights = np.array([WEIGHTS[prepared.rows.observables[k].name] for k in prepared.rows.which])
    kernel = prior.factor @ prior.factor.T
    signal = np.outer(weights, weights) * kernel[np.ix_(sets.index, sets.index)]
    level = np.ones((weights.size, weights.size))
    for factor, found in zip(prepared.doubt.factor, fit.log_evidence, strict=True):
        total = signal + level + factor**2 * np.diag(prepared.variance)
        exact = log_normal(prepared.rows.z, total)
        constant = 0.5 * weights.size * np.log(2.0 * np.pi) + np.log(prepared.sd).sum()
        assert found == pytest.approx(exact + constant, rel=1e-5)

    total = signal + level + np.diag(prepared.variance)
    cross = kernel[:, sets.index] * weights
    mean = cross @ np.linalg.solve(total, prepared.rows.z)
    covariance = kernel - cross @ np.linalg.solve(total, cross.T)
    np.testing.assert_allclose(fit.doses, mean, atol=1e-5)
    np.testing.assert_allclose(fit.covariance, covariance, atol=1e-5)
    found = dose_evidence(prepared, path, fit)
    assert curvature(prepared, found) == pytest.approx(0.0, abs=1e-6)


def test_one_dose_for_all_observables_is_accepted_where_it_is_true_and_refused_where_not():
    def chance(truth: dict[str, np.ndarray], seed: int) -> tuple[float, float]:
        prepared = prepared_linear(truth, seed)
        path = dose_path(prepared, PULL, np.zeros(1))
        found = dose_evidence(prepared, path, first_fit(prepared, path))
        return one_dose_p(prepared, found), left_p(found.best)

    true = [chance(same(DOSES), seed)[0] for seed in range(10)]
    assert min(true) > 0.005
    assert np.mean(true) == pytest.approx(0.5, abs=0.3)
    one, left = chance({"angle": DOSES, "height": -DOSES}, 0)
    assert one < 1e-6
    assert left < 1e-3
