"""Evidence after a change of the errors, by linear steps and by refits, against sums over a dense grid."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.data.linear_algebra import log_sum_exp
from taichi_erosion.evidence.data.measurement_noise import NoiseLevelPrior
from taichi_erosion.evidence.inference.map_fit import fit
from taichi_erosion.evidence.inference.marginal_likelihood import expand
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem, prepare
from taichi_erosion.evidence.inference.robustness.error_accounts import (
    OUTLIER,
    Reference,
    reference_evidence,
    settled_references,
    with_variances,
)
from taichi_erosion.evidence.inference.robustness.linear_steps import TRUSTED
from tests.evidence.inference.robustness.test_reweighing import COUNT, STEEP, curved_problem
from tests.evidence.linear_study import LEVEL_SD

LEVELS = np.linspace(-1.5, 1.5, 1501)  # prior sd; one step is half of the least posterior sd
STRENGTHS = np.linspace(0.0, 3.0, 1501)


def prepared_curve(acting: dict[str, float]) -> PreparedProblem:
    """The curved problem with exactly known scatter."""
    problem = curved_problem(acting)
    prepared = prepare(problem, problem.measurements, 1)
    return replace(prepared, doubt=NoiseLevelPrior(np.ones(1), np.zeros(1)))


def rise_reference(prepared: PreparedProblem) -> Reference:
    """The rise fitted with the errors of the problem."""
    best = fit(prepared, ("rise",), [np.array([0.0, 1.0])])
    return Reference(expand(prepared, best), 0.0)


def dense_evidence(prepared: PreparedProblem, scale: float) -> float:
    """Ln of the sum of likelihood times prior over a grid of level and strength, up to a constant."""
    rows = prepared.rows
    rise = np.log1p(STRENGTHS[:, np.newaxis] * np.exp(STEEP * rows.conditions["x"]))
    gap, weight = rows.z - rise, 1.0 / prepared.variance
    level = LEVEL_SD * LEVELS[:, np.newaxis]
    squares = (gap**2) @ weight - 2.0 * level * (gap @ weight) + level**2 * weight.sum()
    logs = -0.5 * (squares + LEVELS[:, np.newaxis] ** 2 + (STRENGTHS / scale) ** 2)
    return float(log_sum_exp(logs.ravel())) - 0.5 * float(np.sum(np.log(prepared.variance)))


@pytest.mark.parametrize("share", [0.2, 0.25, 1.0 / 3.0, 0.5])
def test_evidence_after_a_change_is_that_of_a_dense_grid_where_a_linear_step_misleads(share):
    prepared = prepared_curve({"bend": 3.0})
    reference, scale = rise_reference(prepared), prepared.candidate("rise").prior_scale
    off = np.where(np.arange(COUNT) < share * COUNT, 1.0 + OUTLIER**2, 1.0)
    now = with_variances(prepared, off)
    before = reference_evidence(prepared, [reference])
    wanted = dense_evidence(now, scale) - dense_evidence(prepared, scale)
    linear = reference_evidence(now, [reference]) - before
    settled = reference_evidence(now, settled_references(prepared, now, [reference])) - before
    assert linear > wanted + 20.0
    assert settled == pytest.approx(wanted, abs=TRUSTED), "Laplace's method about the new fit"


def test_a_reference_whose_step_is_small_is_kept():
    prepared = prepared_curve({"rise": 1.0})
    reference = rise_reference(prepared)
    now = with_variances(prepared, np.where(np.arange(COUNT) == 3, 2.0, 1.0))
    (same,) = settled_references(prepared, now, [reference])
    assert same is reference
