"""Estimates with averaged intervals: what moved a number, what the measurements leave of it, correlations."""

import numpy as np
import pytest

from taichi_erosion.evidence.data.findings import Estimate
from taichi_erosion.evidence.data.problem import Progress
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.intervals.estimates import (
    averaged,
    calibrated_numbers,
    correlations,
    estimates_alone,
    parted,
    remarked,
)
from taichi_erosion.evidence.inference.map_fit import fit, fit_base
from taichi_erosion.evidence.inference.marginal_likelihood import expand, score
from taichi_erosion.evidence.inference.model_discrepancy import discrepancy_gain, kernels
from taichi_erosion.evidence.inference.pipeline import analyse
from taichi_erosion.evidence.inference.posterior import Hypothesis
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.inference.refit import FittedHypothesis
from tests.evidence.linear_study import LEVEL_SD, linear_problem

SHAPES = {"rise": lambda x: 1.0 + x, "bend": lambda x: x**2}


def silent(_: str, __: float) -> None:
    """Progress that is not shown."""


quiet: Progress = silent


def bare(problem):
    """The bare model calibrated."""
    return fit_base(prepare(problem, problem.measurements, 1))


def test_a_number_that_the_rows_say_nothing_of_is_not_identified():
    vague, sharp = (linear_problem(SHAPES, {}, sd=sd) for sd in (100.0, 0.1))
    for problem, told in ((vague, True), (sharp, False)):
        prepared, best, _ = bare(problem)
        (number,) = estimates_alone(prepared, score(prepared, expand(prepared, best)))[1].values()
        assert (number.prior_share > levels.UNIDENTIFIED) is told
        assert (
            "not identified by these measurements: the interval is about as wide as" in number.remark
        ) is told


def test_a_number_that_an_effect_moved_is_read_as_effective():
    number = Estimate(1.0, 0.9, 1.1, False)
    moved = remarked(number, -0.8, 0.1, ("rise",))
    assert moved.remark == "moved by 0.8 prior sd when rise entered: read it as an effective number"
    back = remarked(number, -4.0, 0.1, ("rise",), returned=True)
    way = "moved by 4 prior sd when rise entered, back to near its start"
    assert back.remark == f"{way}: before, it stood in for what was missing"
    assert remarked(number, 0.2, 0.1, ("rise",)).remark == ""
    assert remarked(number, np.nan, 0.1, ()).remark == ""


def test_correlations_are_those_of_the_normal_equations():
    problem = linear_problem(SHAPES, {"rise": 1.0})
    prepared, base, _ = bare(problem)
    best = fit(prepared, ("rise",), [np.append(base.x, 0.9)])
    (found,) = correlations(prepared, expand(prepared, best))
    x = problem.measurements.conditions["x"]
    design = np.column_stack([1.0 + x, LEVEL_SD * np.ones(x.size)]) / prepared.sd[:, np.newaxis]
    covariance = np.linalg.inv(design.T @ design + np.diag([0.0, 1.0]))
    exact = covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])
    assert (found.first, found.second) == ("rise", "level")
    assert found.value == pytest.approx(exact, abs=1e-3)


def test_what_is_rejected_counts_with_a_discrepancy_and_sets_have_a_share_of_it():
    prepared, base, _ = bare(linear_problem(SHAPES, {}))
    expansion = expand(prepared, base)
    item = FittedHypothesis(
        score(prepared, expansion), discrepancy_gain(prepared, expansion, kernels(prepared))
    )
    evidence = item.scored.log_evidence
    plain, smooth = parted(Hypothesis((), False, -1.0, evidence, rejected=True), item)
    assert np.all(plain == -np.inf)
    assert smooth == pytest.approx(evidence - 1.0)
    plain, smooth = parted(Hypothesis(("rise", "bend"), False, -1.0, evidence), item)
    assert np.logaddexp(plain, smooth) == pytest.approx(evidence - 1.0)
    rest = levels.PRIOR_REMAINDER
    assert smooth - plain == pytest.approx(np.log(rest / (1.0 - rest)) + item.gain)


def test_an_effect_that_calibration_absorbs_widens_the_interval_of_a_number():
    """The effect "lift" acts like the level: nothing shows it, and the level may be lower by its action."""
    shapes = {"lift": lambda x: 2.0 + 0.0 * x, "bend": lambda x: x**2}
    widths = []
    for listed in (shapes, {"bend": shapes["bend"]}):
        problem = linear_problem(listed, {})
        found = analyse(prepare(problem, problem.measurements, 1), 1, quiet)
        (number,) = calibrated_numbers(averaged(found), found.final).values()
        widths.append(number.high - number.low)
    assert widths[0] > 1.5 * widths[1]
