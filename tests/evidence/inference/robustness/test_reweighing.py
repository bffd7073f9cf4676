"""Hypotheses without some rows, against fits of the shorter table, in a model that bends with a strength."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.data.problem import Observable, Problem
from taichi_erosion.evidence.inference.pipeline import FittedHypotheses, account
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.inference.refit import total_evidence
from taichi_erosion.evidence.inference.robustness.linear_steps import evidence_by_factor
from taichi_erosion.evidence.inference.robustness.variants import (
    Change,
    expansion_after,
    reweighed,
    shortened,
    without_rows,
)
from tests.evidence.linear_study import linear_problem

SD, COUNT = 0.1, 36
STEEP = 4.0  # of the rise, whose strength acts through a logarithm: ln(1 + strength e^(4 x))
CLOSE = 0.8  # ln evidence of two fits of one hypothesis, whose paths and slopes are made anew


def curved_problem(acting: dict[str, float]) -> Problem:
    """A level, a bend linear in its strength and a rise that is not; three groups along x."""
    plain = linear_problem({"bend": np.square, "rise": np.abs}, {}, sd=SD, count=COUNT)

    def model(observable, conditions, parameters, effects, seeds):
        x = conditions["x"]
        rise = np.log1p(effects.get("rise", 0.0) * np.exp(STEEP * x))
        value = parameters["level"] + effects.get("bend", 0.0) * x**2 + rise
        return np.repeat(value[np.newaxis], seeds.size, axis=0)

    table = plain.measurements
    exact = model("y", table.conditions, {"level": 0.0}, acting, np.ones(1))[0]
    noise = SD * np.random.default_rng(4).standard_normal(COUNT)
    group = tuple(("left", "middle", "right")[3 * k // COUNT] for k in range(COUNT))
    return replace(plain, measurements=replace(table, value=exact + noise, group=group), model=model)


def fitted(problem: Problem) -> FittedHypotheses:
    return account(prepare(problem, problem.measurements, 1), 1, no_progress).fitted


def evidence(found: FittedHypotheses) -> dict[tuple[str, ...], float]:
    """Ln evidence of all hypotheses within the list."""
    items = [item for item in (found.base, *found.refits) if not item.fit.beyond]
    return {item.names: total_evidence(found.prepared, item) for item in items}


def linear_change(whole: FittedHypotheses, names: tuple[str, ...], kept: np.ndarray) -> float:
    """Ln evidence of a hypothesis on the kept rows by the linear step alone."""
    before, item = whole.prepared, whole.of(names)
    now = shortened(before, kept)
    change = Change(before, now, kept, whole.family.rescaled(before.white, now.white, kept))
    more = evidence_by_factor(now, expansion_after(change, item.expansion))
    less = evidence_by_factor(before, item.expansion)
    scored = replace(item.scored, log_evidence=item.scored.log_evidence + more - less)
    return total_evidence(now, replace(item, scored=scored))


@pytest.mark.parametrize("name", ["left", "middle", "right"])
def test_hypotheses_without_a_group_have_the_evidence_of_the_shorter_table(name):
    problem = curved_problem({"bend": 3.0})
    whole, table = fitted(problem), problem.measurements
    gone = np.array(table.group) == name
    cheap = evidence(without_rows(whole, gone))
    anew = evidence(fitted(replace(problem, measurements=table.rows(~gone))))
    for names, wanted in anew.items():
        if wanted > max(anew.values()) - 8.0:
            assert cheap[names] == pytest.approx(wanted, abs=CLOSE)
    assert cheap[()] == pytest.approx(anew[()], abs=0.05), "the bare model is linear"


def test_a_hypothesis_far_from_linear_is_fitted_again():
    problem = curved_problem({"bend": 3.0})
    whole, table = fitted(problem), problem.measurements
    gone = np.array(table.group) == "left"
    wanted = evidence(fitted(replace(problem, measurements=table.rows(~gone))))[("rise",)]
    assert evidence(whole)[("rise",)] < -80.0, "it fits the whole table badly"
    assert linear_change(whole, ("rise",), ~gone) > wanted + 5.0, "the linear step predicts too much"
    assert evidence(without_rows(whole, gone))[("rise",)] == pytest.approx(wanted, abs=0.1)


@pytest.mark.parametrize("acting", [{}, {"bend": 3.0}])
def test_rows_that_are_left_out_say_nothing_on_the_noise(acting):
    whole = fitted(curved_problem(acting))
    gone = np.arange(COUNT) < COUNT // 2
    cheap = without_rows(whole, gone)
    table = curved_problem(acting).measurements.rows(~gone)
    anew = fitted(replace(curved_problem(acting), measurements=table))
    bare, wanted = (found.base.scored.log_evidence for found in (cheap, anew))
    assert bare == pytest.approx(wanted, abs=0.001), "of the bare model at every factor of the noise"
    if not acting:
        assert cheap.posterior.noise_weight == pytest.approx(anew.posterior.noise_weight, abs=0.01)


def test_a_pair_fitted_again_reaches_the_fit_of_the_shorter_table():
    problem = curved_problem({"bend": 3.0})
    gone, pair = np.arange(COUNT) < COUNT // 2, ("bend", "rise")
    table = problem.measurements.rows(~gone)
    wanted = evidence(fitted(replace(problem, measurements=table)))[pair]
    found = evidence(without_rows(fitted(problem), gone))[pair]
    assert found == pytest.approx(wanted, abs=0.1), "from one start and the prior it ends 1.8 below"


def test_a_wider_tolerance_gives_the_evidence_of_the_study_that_declares_it():
    problem = curved_problem({"bend": 0.5})
    whole = fitted(problem)
    wide = replace(problem, observables={"y": Observable("y", sd_numerical=0.2)})
    prepared = prepare(wide, wide.measurements, 1)
    cheap = evidence(reweighed(whole, whole.prepared.with_rows(prepared.rows)))
    anew = evidence(fitted(wide))
    assert cheap[("bend",)] - cheap[()] == pytest.approx(anew[("bend",)] - anew[()], abs=0.1)


def test_a_hypothesis_whose_model_fails_stays_without_a_probability():
    whole = fitted(curved_problem({"bend": 3.0}))
    failed = whole.of(("rise",))
    nowhere = replace(failed.expansion, mean=np.full(COUNT, np.nan))
    scored = replace(failed.scored, expansion=nowhere, likelihoods=(), log_evidence=np.full(10, -np.inf))
    refits = [replace(each, scored=scored) if each is failed else each for each in whole.refits]
    left = without_rows(replace(whole, refits=refits), np.arange(COUNT) < 6)
    assert left.posterior.probability["rise"] == 0.0
    assert left.posterior.probability["bend"] > 0.9
