"""Words of a laboratory: stretches of a condition, names, digits."""

import pytest

from taichi_erosion.evidence.data.number_words import short
from taichi_erosion.report.lead import subject_words
from taichi_erosion.report.measured_table import Condition, MeasuredTable
from taichi_erosion.report.plain_words import between, words_of
from taichi_erosion.report.strength_words import engineering, leaves

DIAMETER = Condition("diameter", "grains.size.diameter", "mm", 1e-3)


class Study:
    """Results of a study whose diameters were measured at these levels, as far as a sentence needs them."""

    table = MeasuredTable({"diameter": DIAMETER})
    discovery = adoption = None

    def __init__(self, *levels: float) -> None:
        conditions = {"diameter": [1e-3 * level for level in levels]}
        self.comparison = {"rows": {"observable": ["angle"] * len(levels), "conditions": conditions}}


@pytest.mark.parametrize(
    ("low", "high", "words"),
    [
        (None, 0.2e-3, "Grains finer than 0.3 mm"),
        (0.4e-3, None, "Grains coarser than 0.3 mm"),
        (0.2e-3, 0.4e-3, "Grains of 0.15 mm to 0.6 mm"),
        (None, None, "The samples"),
    ],
)
def test_the_ends_of_a_stretch_lie_between_two_measured_levels(low, high, words):
    stretch = {"sign": 1, "low": low, "high": high}
    assert subject_words(Study(0.1, 0.2, 0.4, 0.8), "angle", "diameter", stretch) == words


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
