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
