"""Words of a laboratory: stretches of a condition, names, digits."""

import pytest

from taichi_erosion.evidence.data.number_words import short
from taichi_erosion.evidence.data.table_units import TableUnits
from taichi_erosion.report.results import Condition, MeasuredTable
from taichi_erosion.report.sentences import engineering, leaves, subject_words
from taichi_erosion.report.words import samples_words
from taichi_erosion.scene.schema.units import Scale

DIAMETER = Condition("diameter", "grains.size.diameter", "mm", 1e-3)


class Study:
    """Results of a study with diameters in mm, as far as a sentence needs them."""

    table = MeasuredTable({"diameter": DIAMETER})
    units = TableUnits(conditions={"diameter": Scale("mm", 1e-3)})


@pytest.mark.parametrize(
    ("low", "high", "level", "words"),
    [
        (None, 0.2e-3, None, "Grains up to 0.2 mm"),
        (0.4e-3, None, None, "Grains from 0.4 mm"),
        (0.2e-3, 0.4e-3, None, "Grains of 0.2 mm to 0.4 mm"),
        (None, 0.1e-3, 0.1e-3, "Grains of 0.1 mm"),
        (None, None, None, "The samples"),
    ],
)
def test_the_ends_of_a_stretch_are_those_that_its_sentence_tells(low, high, level, words):
    stretch = {"sign": 1, "low": low, "high": high, "level": level}
    assert subject_words(Study(), "diameter", stretch) == words
    if words != "The samples":
        assert all(end in words for end in (f"{1e3 * each:g} mm" for each in (low, high) if each))


@pytest.mark.parametrize(
    ("value", "text"), [(0.0297, "0.030"), (111.3, "110"), (3.2, "3.2"), (0.0, "0"), (0.0000123, "1.2e-05")]
)
def test_numbers_have_two_digits(value, text):
    assert short(value) == text


def test_a_condition_without_words_of_its_own_is_called_by_its_name():
    assert samples_words("pore_volume", "conditions.pore_volume") == "Samples with pore volume"
    assert samples_words("size", "grains.size.diameter") == "Grains"


def test_conditions_stand_in_the_unit_of_the_table():
    assert DIAMETER.shown(2.5e-4) == pytest.approx(0.25)
    assert Condition("temperature", unit="degC", origin=273.15).shown(293.15) == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("value", "text"), [(3.6e-5, "36 µN"), (0.0, "0 N"), (6.5e-8, "65 nN"), (2.0, "2 N")]
)
def test_forces_have_a_prefix(value, text):
    assert engineering(value, "N") == text


def test_numbers_of_a_scene_are_found_at_any_depth():
    assert dict(leaves({"a": {"b": [1.0, {"c": 2.0}]}, "d": "word"}, "")) == {"a.b.0": 1.0, "a.b.1.c": 2.0}
