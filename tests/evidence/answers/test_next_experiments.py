"""Design of the next experiments: covariance updates, the choice, the chance of deciding."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from taichi_erosion.evidence.answers.discover import discover, nameless_discovery
from taichi_erosion.evidence.answers.next_experiments import (
    OUTCOMES,
    DesignPool,
    RivalPrediction,
    bordered,
    decision_chance,
    distances,
    greedy_design,
    log_error_bound,
    mean_variance,
    next_experiments,
    pair_chance,
    proposals,
    settings_of,
    value_chance,
)
from taichi_erosion.evidence.data.findings import PlausibleHypothesis
from taichi_erosion.evidence.data.problem import Budget, Laboratory
from taichi_erosion.evidence.inference.prepared_problem import prepare
from taichi_erosion.evidence.inference.verdict_levels import DECIDED
from tests.evidence.linear_study import linear_problem


def pool(variance: list[float], cost: list[float] | None = None) -> DesignPool:
    size = len(variance)
    rows = SimpleNamespace(size=size, which=np.arange(size))
    share = np.zeros((size, 1))
    return DesignPool(None, rows, np.array(variance), np.array(cost or [1.0] * size), share)


def rival(mean: list[float], weight: float = 0.5, root: np.ndarray | None = None) -> RivalPrediction:
    size = len(mean)
    return RivalPrediction("r", weight, np.array(mean), np.zeros((size, 1)) if root is None else root)


def test_a_covariance_conditioned_on_chosen_measurements_is_that_of_the_joint_normal():
    root = np.random.default_rng(1).standard_normal((5, 3))
    whole = root @ root.T
    found = bordered(pool([0.7] * 5), [root], [2, 4])
    for at in (0, 1, 3):
        joint = whole[np.ix_([2, 4, at], [2, 4, at])] + 0.7 * np.eye(3)
        assert found.log_volume[at] == pytest.approx(np.linalg.slogdet(joint)[1])
        assert found.conditional[at] == pytest.approx(np.linalg.det(joint) / np.linalg.det(joint[:2, :2]))
    again = bordered(pool([0.7] * 5), [root], [2]).conditional[2]
    alone = 1.0 / (1.0 / whole[2, 2] + 1.0 / 0.7)
    assert again == pytest.approx(alone + 0.7), "a repeat has its own scatter"


def test_the_distance_of_two_explanations_is_that_of_bhattacharyya():
    generator = np.random.default_rng(2)
    rivals = [
        rival(list(generator.standard_normal(4)), root=generator.standard_normal((4, 2))) for _ in range(2)
    ]
    at = [1, 3, 0]
    one, other = (each.root[at] @ each.root[at].T + np.diag([0.5, 0.8, 1.2]) for each in rivals)
    middle, gap = 0.5 * (one + other), (rivals[0].mean - rivals[1].mean)[at]
    exact = 0.125 * gap @ np.linalg.solve(middle, gap)
    exact += 0.5 * np.log(np.linalg.det(middle) / np.sqrt(np.linalg.det(one) * np.linalg.det(other)))
    found = distances(pool([1.2, 0.5, 1.0, 0.8]), rivals, [1, 3])
    assert found[0, 1, 0] == pytest.approx(exact)


def test_the_bound_holds_for_the_share_of_wrong_decisions():
    rivals = [rival([0.0]), rival([2.0])]
    bound = np.exp(log_error_bound(rivals, distances(pool([1.0]), rivals, [])))[0]
    wrong = stats.norm.sf(1.0)  # beyond the middle of two means that are 2 sd apart
    assert wrong < bound < 0.5


def test_a_pair_that_is_separated_asks_for_nothing_more():
    # the first measurement tells c from both others; then a and b are what is left, at the second
    rivals = [rival([0.0, 0.0, 0.0], 0.34), rival([0.1, 1.5, 0.1], 0.33), rival([20.0, 0.0, 19.0], 0.33)]
    assert greedy_design(pool([1.0, 1.0, 1.0]), rivals)[:2] == [0, 1]


def test_the_measurement_with_the_largest_difference_for_its_noise_and_cost_comes_first():
    rivals = [rival([0.0, 0.0, 0.0]), rival([1.0, 2.0, 2.1])]
    assert greedy_design(pool([1.0, 1.0, 1.0]), rivals)[0] == 2
    assert greedy_design(pool([1.0, 1.0, 9.0]), rivals)[0] == 1
    assert greedy_design(pool([1.0, 1.0, 1.0], [0.1, 1.0, 1.0]), rivals)[0] == 0


def test_a_difference_that_a_rival_may_refit_away_is_worth_less():
    loose = np.array([[0.0], [10.0]])  # both say the second only to ten
    rivals = [rival([0.0, 0.0], root=loose), rival([1.0, 3.0], root=loose)]
    assert greedy_design(pool([1.0, 1.0]), rivals)[0] == 0


def test_rivals_that_predict_the_same_ask_for_nothing():
    assert greedy_design(pool([1.0, 1.0]), [rival([1.0, 2.0]), rival([1.0, 2.0])]) == []


@pytest.mark.parametrize("gap", [1.0, 2.5, 4.0])
def test_the_chance_of_deciding_between_two_is_that_of_a_likelihood_ratio(gap):
    rivals, both = [rival([0.0]), rival([gap])], pool([1.0])
    # ln L1 / L2 ~ N(gap^2 / 2, gap^2) must exceed ln 9
    exact = stats.norm.sf((np.log(DECIDED / (1.0 - DECIDED)) - 0.5 * gap**2) / gap)
    sd = np.sqrt(exact * (1.0 - exact) / (2 * OUTCOMES))
    assert decision_chance(both, rivals, [0], seed=1) == pytest.approx(exact, abs=4.0 * sd + 1e-3)


def test_an_experiment_is_proposed_where_two_effects_differ_most():
    # measured on [-1, 1] a slope and a cube are alike; they part at the end of a wider range
    shapes = {"slope": lambda x: x, "cube": lambda x: 0.7 * x + 0.4 * x**3}
    problem = linear_problem(shapes, {"slope": 0.25}, sd=0.1)
    found = discover(problem, 1, Budget(), lambda stage, share: None)
    assert {"slope", "cube"} <= {*found.named, *found.group} or found.verdict == "not_testable"
    told = next_experiments(problem, found, Laboratory(ranges={"x": (-3.0, 3.0)}))
    first, *others = told.experiments
    assert abs(first.conditions["x"]) == pytest.approx(3.0)
    assert first.chance > 0.2
    assert "To tell" in told.sentence
    settings = np.array([each.conditions["x"] for each in (first, *others)])
    gaps = np.abs(settings[:, np.newaxis] - settings)[~np.eye(settings.size, dtype=bool)]
    assert gaps.min() > 0.02 * 6.0, "no setting is proposed twice"
    measured = problem.measurements.conditions["x"]
    assert np.abs(settings[:, np.newaxis] - measured).min() > 0.02 * 6.0, "nor one that is measured already"


def answer(problem, **changes):
    """An answer of `discover` with made-up explanations, for the planner alone."""
    return replace(discover(problem, 1, Budget("quick"), lambda stage, share: None), **changes)


def explanation(probability: float, **strengths: float) -> PlausibleHypothesis:
    return PlausibleHypothesis(tuple(strengths), probability, {"level": 0.0}, strengths)


SHAPES = {"slope": lambda x: x, "cube": lambda x: x**3, "step": lambda x: np.where(x > 2.0, 1.0, 0.0)}
WIDE = Laboratory(ranges={"x": (-3.0, 3.0)})


def test_the_named_effect_is_told_from_its_real_runner_up():
    problem = linear_problem(SHAPES, {"slope": 1.0}, sd=0.1)
    live = (explanation(0.7, slope=1.0), explanation(0.25, cube=1.3), explanation(1e-4))
    found = answer(problem, verdict="present", named=("slope",), survivors=live)
    told = next_experiments(problem, found, WIDE)
    assert set(told.explanations) == {"slope", "cube"}, "an explanation that is excluded asks for nothing"
    assert told.sentence.startswith("To tell slope from cube")
    assert all(set(each.predictions) == {"slope", "cube"} for each in told.experiments)


def test_one_explanation_alone_asks_for_nothing_and_says_so():
    problem = linear_problem(SHAPES, {"slope": 1.0}, sd=0.1)
    live = (explanation(0.999, slope=1.0), explanation(1e-5))
    told = next_experiments(problem, answer(problem, named=("slope",), survivors=live), WIDE)
    assert told.experiments == ()
    assert told.sentence.startswith("One explanation is left: slope")


def test_what_nothing_within_the_ranges_tells_apart_is_said():
    # the step begins at x = 2, outside of the range: it and the bare model predict the same
    problem = linear_problem(SHAPES, {}, sd=0.1)
    live = (explanation(0.6), explanation(0.3, step=1.0))
    found = answer(problem, verdict="present", effects={}, survivors=live)
    told = next_experiments(problem, found, Laboratory(ranges={"x": (-1.5, 1.5)}))
    assert told.experiments == ()
    assert told.sentence.startswith(
        "Nothing that can be measured within the stated ranges tells nothing missing from step"
    )


def test_explanations_that_differ_in_their_uncertainty_alone_ask_for_no_measurement():
    sharp, wide = rival([0.0] * 8), rival([0.0] * 8, root=4.0 * np.eye(8))
    same = (replace(sharp, name="slope"), replace(wide, name="cube"))
    both = pool([1.0] * 8)
    found = SimpleNamespace(seed=1, probabilities={})
    chosen = greedy_design(both, list(same))
    assert pair_chance(both, same, chosen, 1) > 0.5, "their widths alone would decide"
    assert value_chance(both, same, chosen, 1) == 0.0
    told = proposals(both, list(same), found)
    assert told.experiments == ()
    assert told.sentence.startswith(
        "Beside slope, cube predicts the same values and differs in uncertainty alone"
    )


def test_an_effect_that_no_setting_lets_act_is_no_rival():
    problem = linear_problem(SHAPES, {}, sd=0.1)
    never = tuple(
        replace(c, mask=lambda at: at["x"] > 5.0) if c.name == "step" else c for c in problem.candidates
    )
    live = (explanation(0.5), explanation(0.3, slope=0.3), explanation(0.2, step=1.0))
    found = answer(replace(problem, candidates=never), verdict="present", survivors=live)
    told = next_experiments(replace(problem, candidates=never), found, WIDE)
    assert "step" not in told.explanations


def test_all_hidden_effects_are_compared_and_those_told_best_are_named_whatever_their_order():
    # nine steps lie outside of the ranges; of the others one is twice as large
    far = {f"far_{k}": lambda x: np.where(x > 4.0, 1.0, 0.0) for k in range(9)}
    near = {"slope": lambda x: x, "steep": lambda x: 2.0 * x}
    problem = linear_problem(far | near, {}, sd=0.1)
    found = nameless_discovery(problem, 1, lambda stage, share: None)
    effects = {n: replace(each, status="not_testable", probability=0.05) for n, each in found.effects.items()}
    live = (PlausibleHypothesis((), 0.05, {"level": 0.0}, {}),)
    found = replace(found, verdict="not_testable", effects=effects, survivors=live)
    told = next_experiments(problem, found, WIDE)
    assert told.explanations.keys() == {"none", *far, *near}
    assert told.sentence.startswith("To tell nothing missing from")
    separated, alike = told.sentence.split(" Nothing that can be measured")
    assert all(name in separated for name in near)
    assert all(name in alike for name in far)
    assert list(told.experiments[0].predictions)[:3] == ["none", "steep", "slope"]


def test_more_repeats_than_behind_a_row_make_a_mean_more_certain_and_as_many_leave_it():
    problem = linear_problem(SHAPES, {}, sd=0.3)
    table = replace(problem.measurements, n=np.full(problem.measurements.size, 4.0))
    prepared = prepare(replace(problem, measurements=table), table, 1)
    # a row is the mean of 4: its variance is 0.3^2 / 4, that of 4 new repeats is the same, of 12 a third
    assert mean_variance(prepared, 0, 4) == pytest.approx(0.09 / 4.0, rel=0.05)
    assert mean_variance(prepared, 0, 12) == pytest.approx(0.09 / 12.0, rel=0.05)


def test_a_condition_that_an_observable_has_not_is_not_varied():
    problem = linear_problem(SHAPES, {}, sd=0.1)
    nothing = np.full(problem.measurements.size, np.nan)
    table = replace(problem.measurements, conditions=problem.measurements.conditions | {"wind": nothing})
    prepared = prepare(replace(problem, measurements=table), table, 1)
    settings, share = settings_of(prepared, Laboratory(ranges={"wind": (0.0, 10.0)}), 0)
    assert np.all(np.isnan(settings["wind"]))
    assert np.ptp(settings["x"]) > 1.5
    assert share.shape[0] == settings["x"].size
