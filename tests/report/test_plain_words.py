"""Words of a laboratory: stretches of a condition, names, digits."""

import numpy as np
import pytest

from taichi_erosion.report.lead import stretch_words
from taichi_erosion.report.measured_table import Condition
from taichi_erosion.report.plain_words import Stretch, between, failing_stretch, short, words_of
from taichi_erosion.report.strength_words import engineering, leaves

DIAMETER = Condition("diameter", "grains.size.diameter", "mm", 1e-3)


def test_the_stretch_with_most_misfit_is_found_and_its_end_lies_between_two_levels():
    levels = [0.1, 0.1, 0.2, 0.4, 0.8, 1.6]
    found = failing_stretch(levels, [5.0, 4.0, 3.0, -0.5, 0.3, -0.8])
    assert found == Stretch(1, None, 0.3)
    assert stretch_words(DIAMETER, found) == "Grains finer than 0.3 mm"


def test_a_stretch_holds_no_level_that_lies_clearly_on_the_other_side():
    # the whole lower half is too high on average, but at its end the model is too low by 3 sd
    found = failing_stretch([1.0, 2.0, 3.0, 4.0], [-9.0, -8.0, 3.0, 0.0])
    assert found == Stretch(-1, None, 2.5)


def test_a_misfit_in_the_middle_is_told_with_both_ends():
    found = failing_stretch([1.0, 2.0, 3.0, 4.0], [0.1, 6.0, -0.2, 0.1])
    assert stretch_words(DIAMETER, found) == "Grains of 1.5 mm to 2.5 mm"


def test_no_residual_is_no_stretch():
    assert failing_stretch([1.0, np.nan], [np.nan, 3.0]) is None
    assert failing_stretch([], []) is None


def test_many_levels_take_no_long_time():
    x = np.linspace(0.0, 1.0, 5000)
    assert failing_stretch(list(x), list(np.where(x > 0.9, 3.0, 0.0))).low == pytest.approx(0.9, abs=0.01)


@pytest.mark.parametrize(
    ("inside", "outside", "end"), [(0.228, 0.24, 0.23), (0.005, 0.01, 0.008), (1.0, 9.0, 5.0)]
)
def test_an_end_is_as_short_as_two_levels_allow(inside, outside, end):
    assert between(inside, outside) == between(outside, inside) == end


@pytest.mark.parametrize(
    ("value", "text"), [(0.0297, "0.030"), (111.3, "110"), (3.2, "3.2"), (0.0, "0"), (0.0000123, "1.2e-05")]
)
def test_numbers_have_two_digits(value, text):
    assert short(value) == text


def test_an_observable_without_words_of_its_own_is_called_higher_or_lower():
    assert words_of("crust_strength").above == "have a higher crust strength than the model says"


def test_conditions_stand_in_the_unit_of_the_table():
    assert DIAMETER.shown(2.5e-4) == pytest.approx(0.25)
    assert Condition("temperature", unit="degC", origin=273.15).shown(293.15) == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("value", "text"), [(3.6e-5, "36 µN"), (0.0, "0 N"), (6.5e-8, "65 nN"), (2.0, "2.0 N")]
)
def test_forces_have_a_prefix(value, text):
    assert engineering(value, "N") == text


def test_numbers_of_a_scene_are_found_at_any_depth():
    assert dict(leaves({"a": {"b": [1.0, {"c": 2.0}]}, "d": "word"}, "")) == {"a.b.0": 1.0, "a.b.1.c": 2.0}
