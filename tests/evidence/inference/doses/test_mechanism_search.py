"""A mechanism that no list holds is found on the reduced model, with its law; nothing is found in a null."""

from dataclasses import replace

import numpy as np
import pytest

from doe.trials.reduced.beyond import Truth, draw, measured
from taichi_erosion.evidence.answers.compare import no_progress
from taichi_erosion.evidence.answers.discover import discover
from taichi_erosion.evidence.answers.mechanism_experiments import mechanism_experiments
from taichi_erosion.evidence.data.findings import Discovery
from taichi_erosion.evidence.data.problem import Candidate, Laboratory, Problem
from taichi_erosion.evidence.inference import verdict_levels as levels
from taichi_erosion.evidence.inference.doses.mechanism_search import near_the_best
from taichi_erosion.evidence.models import reduced, reduced_places

WET = Truth("outside", "rolling_friction", "moisture", "power", 5.0, 0.7, dict(reduced.PARAMETERS))
NOTHING = Truth("null", parameters=dict(reduced.PARAMETERS))
PLACES = ("rolling_friction", "sliding_friction", "contact_pull")


def problem_of(truth: Truth, seed: int = 5) -> Problem:
    """A study of 16 set-ups with three observables; few candidates and mechanisms keep it short."""
    generator = np.random.default_rng(seed)
    conditions = {
        "moisture": np.tile(0.01 * np.arange(4), 4),
        "diameter": np.repeat([1.5e-4, 2.5e-4, 4e-4, 6e-4], 4),
        "u_star": np.full(16, 0.6),
    }
    bare, _ = draw(5, 0)
    table = measured(generator, truth, conditions, 0.7)
    return replace(
        bare,
        measurements=table,
        mechanisms=tuple(each for each in bare.mechanisms if each.name in PLACES),
        candidates=(Candidate("liquid_bridge"), Candidate("gusts")),
        vault=replace(bare.vault, rows=np.zeros(0, dtype=np.int64)),
    )


@pytest.fixture(scope="module")
def wet() -> Discovery:
    """Answer where a factor of rolling friction grows with moisture."""
    problem = problem_of(WET)
    return discover(problem, 1, problem.budget, no_progress)


def test_an_unlisted_mechanism_is_named_with_its_law(wet):
    found = wet
    assert found.verdict == "outside_library"
    assert found.beyond is not None
    assert found.beyond.group[0] == "rolling_friction"
    best = found.beyond.mechanisms[0]
    assert best.p_one_dose > 0.01
    assert best.log_bayes_factor > found.beyond.log_bayes_listed + 3.0
    law = found.beyond.law
    assert law is not None
    assert law.form == "power"
    assert law.exponents["moisture"].low < 0.7 < law.exponents["moisture"].high
    words = " ".join(found.sentences)
    assert "acts like a factor of rolling friction" in words
    assert "caused" not in words


def test_in_a_null_no_mechanism_is_asked_for():
    problem = problem_of(NOTHING)
    found = discover(problem, 1, problem.budget, no_progress)
    assert found.beyond is None
    assert found.verdict in ("none_detected", "not_testable")


def test_a_model_without_places_for_mechanisms_gets_no_such_answer():
    problem = replace(problem_of(WET), mechanisms=())
    found = discover(problem, 1, problem.budget, no_progress)
    assert (found.verdict, found.beyond) == ("outside_library", None)


def test_forms_are_zero_where_a_condition_that_reaches_zero_is_zero():
    from taichi_erosion.evidence.inference.doses.dose_forms import forms_of

    conditions = {"moisture": np.array([0.0, 0.01, 0.02, 0.04]), "diameter": np.array([1.0, 2.0, 3.0, 4.0])}
    for form in forms_of(conditions):
        if form.conditions == ("moisture",):
            numbers = np.array([1.0, *form.starts[0]])
            assert form.dose(conditions, numbers)[0] == pytest.approx(0.0, abs=1e-9)


EXPONENT = 0.7  # of moisture, by which the strength of a listed effect varies


def varying_strength(problem: Problem, seed: int) -> Problem:
    """The table of a laboratory in which bridges grow with another power of moisture than in the list."""
    table, generator = problem.measurements, np.random.default_rng(seed)
    value = table.value.copy()
    for row, name in enumerate(table.observable):
        own = {condition: column[row : row + 1] for condition, column in table.conditions.items()}
        strength = 1.2 * float(own["moisture"][0] / 0.02) ** EXPONENT
        exact = reduced_places.expected(name, own, dict(reduced.PARAMETERS), {"liquid_bridge": strength})
        value[row] = exact[0] + table.sd[row] * generator.standard_normal()
    return replace(problem, measurements=replace(table, value=value))


def test_another_power_of_a_named_effect_is_told():
    problem = replace(varying_strength(problem_of(NOTHING), 3), mechanisms=())
    found = discover(problem, 1, problem.budget, no_progress)
    assert found.trend is not None
    assert (found.trend.effect, found.trend.condition) == ("liquid_bridge", "moisture")
    assert found.trend.exponent is not None
    assert found.trend.exponent.low < EXPONENT < found.trend.exponent.high
    assert any("varies as moisture^" in sentence for sentence in found.sentences)


def test_a_listed_effect_of_its_own_law_has_one_strength():
    truth = Truth("listed", "liquid_bridge", size=1.2, parameters=dict(reduced.PARAMETERS))
    problem = problem_of(truth)
    found = discover(problem, 1, problem.budget, no_progress)
    assert (found.verdict, list(found.named), found.trend) == ("present", ["liquid_bridge"], None)
    assert found.beyond is not None
    assert (found.beyond.group, found.beyond.withdrawn) == ((), False)
    assert found.beyond.named_odds < 1.0 / levels.MECHANISM_ODDS
    assert any("better than liquid_bridge" in sentence for sentence in found.sentences)


OPENED = 0xE082A3A315FB766664E214EE777AA1E0  # of case 286 of the set `fourth` of the trial `beyond`


@pytest.mark.slow
def test_errors_that_nobody_stated_do_not_hold_a_name_against_a_mechanism():
    """Four rows that count as off let `liquid_bridge` explain a weight that grows with moisture."""
    problem, truth = draw(OPENED)
    places = tuple(each for each in problem.mechanisms if each.name in ("grain_weight", "drag"))
    found = discover(replace(problem, mechanisms=places), 286, problem.budget, no_progress)
    assert (truth.name, found.verdict, found.named) == ("grain_weight", "outside_library", ())
    assert (found.errors_probability, found.p_misfit_after) == (0.0, found.p_misfit)
    assert found.beyond is not None
    assert (found.beyond.group, found.beyond.named) == (("grain_weight",), ("liquid_bridge",))
    assert found.beyond.withdrawn


def test_mechanisms_are_fitted_on_where_they_come_near_the_best_or_the_name():
    gains = np.array([100.0, 60.0, 45.0, 10.0])
    assert near_the_best(gains, -np.inf, 0.5).tolist() == [0, 1, 2]
    assert near_the_best(gains, 200.0, 0.5).tolist() == [0]
    assert near_the_best(np.array([4.0, -3.0]), 6.0, 0.75).tolist() == [0, 1]


@pytest.mark.slow
def test_a_mechanism_withdraws_the_name_of_an_effect_that_imitates_it():
    truth = Truth("outside", "contact_pull", "moisture", "exponential", 2.2, 1.2, dict(reduced.PARAMETERS))
    problem = problem_of(truth)
    bare = discover(replace(problem, mechanisms=()), 1, problem.budget, no_progress)
    found = discover(problem, 1, problem.budget, no_progress)
    assert "liquid_bridge" in (*bare.named, *bare.group) or bare.verdict == "outside_library"
    assert found.verdict == "outside_library"
    assert found.beyond is not None
    assert found.beyond.group[0] == "contact_pull"


def test_next_tells_the_mechanisms_apart_that_are_left(wet):
    both = ("rolling_friction", "sliding_friction")
    found = replace(wet, beyond=replace(wet.beyond, group=both))
    told = mechanism_experiments(problem_of(WET), found, Laboratory(ranges={"moisture": (0.0, 0.05)}))
    assert told is not None
    titles = {"a factor of sliding friction", "a factor of rolling friction"}
    assert set(told.explanations) == titles
    assert told.sentence
    for experiment in told.experiments:
        assert set(experiment.predictions) == titles
        assert all(sd > 0.0 for _, sd in experiment.predictions.values())
