"""A response that bends between corners and centre is neither noise nor an effect."""

import numpy as np
import pytest

from taichi_erosion.campaign.calibration_steps import effects_and_limits, mean_centre_response
from taichi_erosion.experiments.anova import effects
from taichi_erosion.experiments.design import Factor, plackett_burman
from taichi_erosion.experiments.fit import fit_model, model_terms

FACTORS = tuple(Factor(f"f{k}", 0.0, 1.0) for k in range(9))
SLOPE = 3.0  # response per coded unit of the first factor
BEND = 15.0  # response of the centre above the plane
NOISE = 0.5


def screened(centre_points: int = 4, seed: int = 3):
    design = plackett_burman(FACTORS, centre_points=centre_points)
    noise = NOISE * np.random.default_rng(seed).normal(size=len(design))
    centre = np.array([kind == "centre" for kind in design.kinds])
    return design.with_responses(angle=20.0 + SLOPE * design.coded[:, 0] + BEND * centre + noise)


def test_a_bent_response_leaves_effects_and_their_certainty_alone():
    fit = fit_model(screened(), "angle", model_terms(9, "linear"))
    found, limits = effects_and_limits(fit)
    # standard error of an effect of 12 runs: 2 sd / sqrt(12)
    assert found[0].value == pytest.approx(2.0 * SLOPE, abs=4.0 * 2.0 * NOISE / 12**0.5)
    assert found[0].p < 0.01
    assert effects(fit)[0][0].p > 0.1  # where the bend counts as noise, nothing is seen
    assert limits["bonferroni"] < found[0].value


def test_idle_factors_seldom_pass_the_limit_of_all_at_once():
    passed = 0
    for seed in range(100):
        found, limits = effects_and_limits(fit_model(screened(seed=seed), "angle", model_terms(9, "linear")))
        passed += max(abs(one.value) for one in found[1:]) > limits["bonferroni"]
    assert passed <= 11  # at most one in twenty is expected; more than 11 of 100 come by chance once in 200


def test_a_path_begins_at_the_centre_and_not_at_the_mean_of_the_corners():
    assert mean_centre_response(screened(), "angle", 20.0) == pytest.approx(20.0 + BEND, abs=3.0 * NOISE)
    assert mean_centre_response(screened(centre_points=0), "angle", 20.0) == 20.0
