"""Sets of effects on a linear study: the evidence of three is an integral, and the steps find what acts."""

from itertools import product

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.inference.map_fit import fit
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.inference.pipeline import analyse
from taichi_erosion.evidence.inference.posterior import strength_estimates
from taichi_erosion.evidence.models.prepared_problem import prepare
from tests.evidence.linear_study import LEVEL_SD, linear_problem

SHAPES = {
    "slope": lambda x: x,
    "bend": lambda x: x**2,
    "wave": lambda x: np.sin(4.0 * x),
    "step": lambda x: (x > 0.3).astype(float),
    "spike": lambda x: np.exp(-(((x + 0.5) / 0.1) ** 2)),
}
THREE = {"bend": 0.7, "wave": 1.2, "spike": 1.0}
CONSTANT = 0.5 * 24 * np.log(2.0 * np.pi)  # left out of every evidence alike


def normal_integral(problem: Problem, names: list[str], sd: float, spread: dict[str, float]) -> float:
    """Ln evidence by a sum over a fine grid of strengths about those that act, prior half-normal."""
    x, z = problem.measurements.conditions["x"], problem.measurements.value
    covariance = sd**2 * np.eye(24) + LEVEL_SD**2
    inverse = np.linalg.inv(covariance)
    grids = [np.linspace(max(THREE[n] - spread[n], 0.0), THREE[n] + spread[n], 41) for n in names]
    scale, prior = 1.5, []
    for grid in grids:
        density = stats.norm.pdf(grid / scale) / scale / (stats.norm.cdf(3.0 / scale) - 0.5)
        prior.append(density * np.gradient(grid))
    total = 0.0
    for places in product(range(41), repeat=len(names)):
        mean = sum(grids[k][i] * SHAPES[n](x) for k, (n, i) in enumerate(zip(names, places, strict=True)))
        share = np.prod([prior[k][i] for k, i in enumerate(places)])
        total += share * np.exp(-0.5 * (z - mean) @ inverse @ (z - mean))
    return float(np.log(total) - 0.5 * np.linalg.slogdet(covariance)[1])


def test_the_evidence_of_three_effects_is_the_integral_over_their_priors():
    problem = linear_problem(SHAPES, THREE, sd=0.3)
    prepared = prepare(problem, problem.measurements, 1)
    names = tuple(THREE)
    best = fit(prepared, names, [np.array([0.0, *THREE.values()])])
    found = score(prepared, expand(prepared, best))
    assert prepared.doubt.factor[0] == 1.0
    exact = normal_integral(problem, list(names), 0.3, {"bend": 1.4, "wave": 0.8, "spike": 1.2})
    # strengths are uncertain by 0.1 to 0.3: their ranges end at 0 for two of the three
    assert found.log_evidence[0] == pytest.approx(exact, abs=0.1)


@pytest.mark.parametrize("truth", [THREE, {"slope": 1.0, "bend": 0.8, "wave": 0.9, "step": 1.1}])
def test_three_and_four_effects_are_found_and_their_strengths_held(truth):
    problem = linear_problem(SHAPES, truth, sd=0.03, seed=3)
    found = analyse(prepare(problem, problem.measurements, 1), 1, no_progress)
    assert found.decision.verdict == "present"
    assert set(found.decision.named) == set(truth)
    assert found.posterior.probability["+".join(n for n in SHAPES if n in truth)] > 0.9
    strengths = strength_estimates(found.fitted.prepared, found.final.scored)
    for name, strength in truth.items():
        assert strengths[name].value == pytest.approx(strength, abs=0.15)
    subsets = [item.names for item in found.fitted.refits if len(item.names) == len(truth) - 1]
    assert all(tuple(n for n in SHAPES if n in truth and n != out) in subsets for out in truth), "backward"


def test_one_effect_that_explains_the_rows_is_not_joined_by_others():
    problem = linear_problem(SHAPES, {"wave": 1.0}, sd=0.05, seed=4)
    found = analyse(prepare(problem, problem.measurements, 1), 1, no_progress)
    assert found.decision.named == ("wave",)
    assert max(len(item.names) for item in found.fitted.refits) <= 2
