"""Confounded effects: separations by plane geometry, groups, and parameters that imitate an effect."""

import numpy as np
import pytest

from taichi_erosion.evidence.inference.confounding import absorbed_by, confounded_effects, separations
from taichi_erosion.evidence.inference.verdict_levels import SEPARATION
from tests.evidence.linear_study import linear_problem, screened


def even(x):
    return x**2 - np.mean(np.linspace(-1.0, 1.0, 24) ** 2)  # orthogonal to the level and to x


def turned(angle: float):
    """A shape at an angle to x in the plane of two orthogonal shapes of equal norm."""
    x = np.linspace(-1.0, 1.0, 24)
    ratio = np.linalg.norm(x) / np.linalg.norm(even(x))
    return lambda at: np.cos(angle) * at + np.sin(angle) * ratio * even(at)


SHAPES = {"x": lambda x: x, "near": turned(0.1), "far": turned(0.9), "opposite": lambda x: -x}
X_NORM = float(np.linalg.norm(np.linspace(-1.0, 1.0, 24))) / 0.1  # sd, at strength 1


@pytest.fixture(scope="module")
def study():
    return screened(linear_problem(SHAPES, {}))


def test_two_effects_are_the_norm_times_the_sine_of_their_angle_apart(study):
    names, distance = separations(*study, dict.fromkeys(SHAPES, 1.0))
    first = names.index("x")
    for name, angle in (("near", 0.1), ("far", 0.9)):
        # strengths on a grid, closest near 0: the nearest of them is within 2 % of the norm
        exact = X_NORM * np.sin(angle)
        assert distance[first, names.index(name)] == pytest.approx(exact, abs=0.02 * X_NORM)


def test_an_effect_and_its_opposite_are_no_twins(study):
    names, distance = separations(*study, dict.fromkeys(SHAPES, 1.0))
    # the nearest strength is 0, so the whole norm lies between them, at the grid point nearest to strength 1
    assert distance[names.index("x"), names.index("opposite")] == pytest.approx(X_NORM, rel=0.03)


def test_effects_closer_than_the_limit_form_a_group_and_the_limit_is_in_sd(study):
    weak = dict.fromkeys(SHAPES, 0.5 * SEPARATION / (X_NORM * np.sin(0.1)))
    groups = confounded_effects(*study, weak)
    assert "near" in groups["x"]
    assert "x" in groups["near"]
    strong = confounded_effects(*study, dict.fromkeys(SHAPES, 1.0))
    assert all(others == () for others in strong.values())


def test_an_effect_that_a_number_imitates_is_told_with_its_number():
    prepared, found = screened(linear_problem({"lift": lambda x: 1.0 + 0.2 * x, "slope": lambda x: x}, {}))
    assert absorbed_by(prepared, found) == {"lift": "level"}
    assert found.signature("slope").absorption == pytest.approx(0.0, abs=1e-6)
