"""Every mechanism has a dose and is no listed effect: contract in tests/effect_library/test_contract.py."""

from dataclasses import fields

import pytest

from taichi_erosion.effect_library import effect_titles, load_library
from taichi_erosion.mechanisms import library
from taichi_erosion.mechanisms.law import params_at

BASIS = library.load_mechanisms()


@pytest.mark.parametrize("name", BASIS)
def test_the_first_parameter_of_a_mechanism_is_its_dimensionless_dose(name):
    first = fields(BASIS[name].params)[0]
    assert (first.name, first.metadata["unit"]) == (library.DOSE, "1")
    low, high = library.dose_range(BASIS[name])
    assert low <= 0.0 < high


def test_mechanisms_are_not_listed_as_effects_and_share_no_name_with_them():
    assert len(BASIS) == 17
    assert not set(BASIS) & set(load_library())


def test_a_file_of_a_mechanism_is_an_effect_file():
    path = library.mechanism_file("rolling_friction")
    assert load_library([path])["rolling_friction"].title == "a factor of rolling friction"


def test_titles_and_doses_that_are_read_without_the_compiler_are_those_of_the_records():
    assert effect_titles() == {name: effect.title for name, effect in load_library().items()}
    titles = {name: row["title"] for name, row in library.mechanism_rows().items()}
    assert titles == {name: each.title for name, each in BASIS.items()}
    doses = {name: fields(each.params)[0].metadata["meaning"] for name, each in BASIS.items()}
    assert {name: row[library.DOSE][-1] for name, row in library.mechanism_rows().items()} == doses


def test_a_law_gives_no_dose_beyond_the_range_of_its_mechanism():
    assert params_at(BASIS["contact_pull"], -3.0).dose == 0.0
    assert params_at(BASIS["sliding_friction"], -2.5).dose == library.dose_range(BASIS["sliding_friction"])[0]
    assert params_at(BASIS["sliding_friction"], 0.5).dose == 0.5
