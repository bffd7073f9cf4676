"""Errors that nobody stated, against closed forms and against tables in which they were put."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.data.findings import NONE, Discovery
from taichi_erosion.evidence.data.measurement_noise import NoiseLevelPrior
from taichi_erosion.evidence.data.problem import Problem
from taichi_erosion.evidence.inference.prepared_problem import PreparedProblem
from taichi_erosion.evidence.inference.robustness.error_accounts import (
    TAUS,
    ErrorAccount,
    Reference,
    error_accounts,
    unstated_sources,
)
from taichi_erosion.evidence.inference.robustness.linear_steps import linear_evidence
from tests.evidence.linear_study import LEVEL_SD, linear_problem, screened

SD, COUNT = 0.1, 48  # of a row, and rows
SHAPES = {"bend": lambda x: x**2, "wave": lambda x: np.sin(3.0 * x)}


def sharing(problem: Problem, tau: float, seed: int, source: bool = False) -> Problem:
    """The problem with an error of `tau` row sd that every group of rows has in common, or source B."""
    table = problem.measurements
    error = tau * SD * np.random.default_rng(seed).standard_normal(12)
    second = np.arange(table.size) % 2 == 1
    shift = tau * SD * second if source else error[np.arange(table.size) % 12]
    names = tuple("laboratory B" if other else "laboratory A" for other in second)
    return replace(
        problem,
        measurements=replace(table, value=table.value + shift, source=names if source else table.source),
    )


def with_rows_off(problem: Problem, rows: list[int], size: float) -> Problem:
    value = problem.measurements.value.copy()
    value[rows] += size * SD
    return replace(problem, measurements=replace(problem.measurements, value=value))


def with_silent_source(problem: Problem, factor: float) -> Problem:
    """The problem with every other row from laboratory B, which states no sd and scatters by more."""
    table = problem.measurements
    second = np.arange(table.size) % 2 == 1
    more = SD * factor * np.random.default_rng(2).standard_normal(table.size) * second
    names = tuple("laboratory B" if other else "laboratory A" for other in second)
    sd = np.where(second, np.nan, table.sd)
    return replace(problem, measurements=replace(table, value=table.value + more, sd=sd, source=names))


def answer(problem: Problem) -> Discovery:
    return discover(problem, 3, problem.budget, no_progress)


def accounts(problem: Problem) -> tuple[PreparedProblem, dict[str, ErrorAccount]]:
    prepared, found = screened(problem)
    tried = error_accounts(prepared, [Reference(found.base, 0.0)])
    return prepared, {each.kind: each for each in tried}


@pytest.mark.parametrize("tau", [0.5, 3.0])
def test_the_evidence_with_batches_is_the_density_of_one_multivariate_normal(tau):
    problem = linear_problem(SHAPES, {}, count=24)
    prepared, found = screened(problem)
    labels = np.array(problem.measurements.group)
    batches = tau * SD * (labels[:, np.newaxis] == np.unique(labels)).astype(float)
    known = NoiseLevelPrior(np.ones(1), np.zeros(1))
    there = replace(prepared, rows=replace(prepared.rows, shared=batches), doubt=known)
    slope = found.base.jacobian
    centre = found.base.mean - slope @ found.base.fit.x
    covariance = np.diag(prepared.variance) + slope @ slope.T + batches @ batches.T
    exact = stats.multivariate_normal(centre, covariance).logpdf(prepared.rows.z)
    exact += 0.5 * prepared.rows.size * np.log(2.0 * np.pi)  # left out of every evidence
    assert linear_evidence(there, found.base) == pytest.approx(exact, rel=1e-9)
    assert np.ptp(slope) < 1e-6 * LEVEL_SD, "the level is the only number"


def test_the_sd_of_a_batch_is_its_posterior_mean_in_a_balanced_layout():
    tau = 3.0
    prepared, found = accounts(sharing(linear_problem(SHAPES, {}, sd=SD, count=COUNT), tau, seed=5))
    (shared,) = found["batch"].shared
    labels = np.array(prepared.rows.group)
    sizes = np.unique(labels, return_counts=True)[1]
    assert set(sizes) == {4}, "balanced"
    means = np.array([prepared.rows.z[labels == name].mean() for name in np.unique(labels)])
    between = 4.0 * np.sum((means - means.mean()) ** 2) / SD**2  # ~ (1 + 4 tau^2) chi^2(11)
    within = np.sum(
        [(prepared.rows.z[labels == n] - m) ** 2 for n, m in zip(np.unique(labels), means, strict=True)]
    )
    factor, grid = prepared.doubt.factor[:, np.newaxis], np.array(TAUS)
    scale = 1.0 + 4.0 * grid**2 / factor**2  # tau is in stated sd
    logs = prepared.doubt.log_weight[:, np.newaxis] - 47.0 * np.log(factor)
    logs = logs - 5.5 * np.log(scale) - 0.5 * (between / scale + within / SD**2) / factor**2
    weight = np.exp(logs - logs.max()).sum(axis=0)
    expected = np.sqrt(weight @ grid**2 / weight.sum())
    assert shared.tau == pytest.approx(expected, rel=0.2)  # the noise factor scales tau too in the estimate
    assert expected == pytest.approx(tau, rel=0.5), "twelve batches know it no better"


def test_nothing_but_noise_has_no_account_that_matters():
    problem = linear_problem(SHAPES, {}, sd=SD, count=COUNT)
    _, found = accounts(sharing(problem, 0.0, seed=5, source=True))
    assert all(each.gain < 0.0 for each in found.values())
    assert answer(problem).errors == ()


def test_batches_are_not_taken_for_an_effect_nor_for_something_unlisted():
    problem = sharing(linear_problem(SHAPES, {}, sd=SD, count=COUNT), 3.0, seed=5)
    found = answer(problem)
    assert found.named == found.group == ()
    assert found.probabilities[NONE] > 0.5
    assert [each.kind for each in found.errors] == ["batch"]
    assert "rows of one group share an error of" in found.sentences[0]


@pytest.mark.parametrize("acting", [{}, {"bend": 1.0}], ids=["nothing", "bend"])
def test_a_source_that_reads_higher_is_told_with_its_size(acting):
    problem = sharing(linear_problem(SHAPES, acting, sd=SD, count=COUNT), 5.0, 0, source=True)
    found = answer(problem)
    assert found.named == tuple(acting)
    (told,) = found.errors
    assert told.sentence.startswith("y: laboratory B reads 0.")
    low, high = (float(word) for word in told.sentence.split("(")[1].split(")")[0].split(" to "))
    assert low < 0.5 < high
    assert high - low < 0.2, "48 rows know it to 0.05"


@pytest.mark.parametrize("acting", [{}, {"bend": 1.0}], ids=["nothing", "bend"])
def test_rows_that_are_off_do_not_change_the_answer(acting):
    problem = linear_problem(SHAPES, acting, sd=SD, count=COUNT)
    plain, found = answer(problem), answer(with_rows_off(problem, [17, 30], 9.0))
    assert (found.verdict, found.named) == (plain.verdict, plain.named)
    assert [each.kind for each in found.errors] == ["rows", "rows"]
    assert "x = -0.277" in found.errors[0].sentence
    assert "sd above every plausible explanation" in found.errors[0].sentence
    assert "with errors as stated the likeliest is" in found.sentences[2]


def test_scatter_that_grows_along_a_condition_is_told():
    problem = linear_problem(SHAPES, {}, sd=SD, count=COUNT)
    table = problem.measurements
    noise = (table.value - 0.0) * 6.0 ** (0.5 * (table.conditions["x"] + 1.0))
    found = answer(replace(problem, measurements=replace(table, value=noise)))
    assert found.named == ()
    assert found.verdict != "outside_library"
    (told,) = found.errors
    assert "grows" in told.sentence
    assert "x" in told.sentence


@pytest.mark.parametrize("acting", [{}, {"bend": 1.0}], ids=["nothing", "bend"])
def test_the_scatter_of_a_source_that_states_none_is_found_and_told(acting):
    problem = with_silent_source(linear_problem(SHAPES, acting, sd=SD, count=COUNT), 10.0)
    found = answer(problem)
    assert found.named == tuple(acting)
    assert found.verdict != "outside_library"
    (told,) = found.errors
    factor = re.match(r"y: laboratory B states no scatter; .*, ([\d.]+) times the median", told.sentence)
    assert factor
    assert 7.0 < float(factor[1]) < 14.0, "24 rows know their sd of 10 to 15 %, the grid in octaves to 20 %"


def test_a_source_without_sd_that_scatters_as_the_others_is_told_of_nothing():
    found = answer(with_silent_source(linear_problem(SHAPES, {"bend": 1.0}, sd=SD, count=COUNT), 0.0))
    assert found.named == ("bend",)
    assert found.errors == ()


def test_a_source_that_states_an_sd_of_one_row_states_its_scatter():
    problem = with_silent_source(linear_problem(SHAPES, {}, sd=SD, count=COUNT), 10.0)
    sd = problem.measurements.sd.copy()
    sd[1] = SD
    prepared, found = screened(replace(problem, measurements=replace(problem.measurements, sd=sd)))
    assert list(unstated_sources(prepared)) == []
    assert not any(each.unstated for each in error_accounts(prepared, [Reference(found.base, 0.0)]))


@pytest.mark.slow
def test_a_level_keeps_its_coverage_under_student_errors_once_rows_are_off():
    """The 90 % interval over 300 draws of 24 rows with errors of three degrees of freedom, scale one sd."""
    rng, hits = np.random.default_rng(11), 0
    for _ in range(300):
        problem = linear_problem(SHAPES, {}, sd=SD, seed=None)
        errors = SD * rng.standard_t(3, 24)
        table = replace(problem.measurements, value=problem.measurements.value + errors)
        prepared, found = accounts(replace(problem, measurements=table))
        there = found["rows"].prepared if "rows" in found else prepared
        weight = 1.0 / there.variance
        mean, sd = np.sum(weight * there.rows.z) / weight.sum(), 1.0 / np.sqrt(weight.sum())
        left = np.sum(weight * (there.rows.z - mean) ** 2) / 23.0
        hits += bool(abs(mean) < stats.t.ppf(0.95, 23) * sd * np.sqrt(max(left, 1.0)))
    assert 0.85 < hits / 300 < 0.95  # three binomial sd of 0.017 about 0.9
