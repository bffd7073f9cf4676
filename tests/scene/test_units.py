"""Units are read as printed, compared by kind, and converted by one factor."""

from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_erosion.scene.schema import units

NO_UNITS = {"grad": "deg", "F": "degF", "MM": "'mm'", "kg/m s": "kg/(m s)", "m" * 61: ""}
# a temperature that does not count from absolute zero has no factor
NO_UNITS |= dict.fromkeys("degC wet m/ (m m) () m--2 m99 / €".split(), "")
FACTORS = [("mm", "m", 1e-3), ("deg", "rad", pi / 180.0), ("°", "deg", 1.0), ("%", "kg/kg", 0.01)]
FACTORS += [("g/(m s)", "kg m-1 s-1", 1e-3), ("kg m^-1 s⁻¹", "kg/m/s", 1.0), ("mJ/m2", "N/m", 1e-3)]
FACTORS += [("1", "-", 1.0), ("µC/kg", "C kg-1", 1e-6)]
OTHER_KINDS = [("deg", "1", None), ("kg/(m s)", "kg/m", None)]


@pytest.mark.parametrize(("source", "target", "factor"), [*FACTORS, *OTHER_KINDS])
def test_a_unit_is_converted_by_its_factor_where_the_kind_is_the_same(source, target, factor):
    # ten digits: factors are products of a few roundings
    wanted = factor and pytest.approx(factor, rel=1e-10)
    assert units.conversion_factor(units.parse_unit(source), units.parse_unit(target)) == wanted


@pytest.mark.parametrize(("text", "hint"), NO_UNITS.items())
def test_what_is_no_unit_or_could_mean_two_is_refused_with_what_may_have_been_meant(text, hint):
    with pytest.raises(units.UnknownUnit) as caught:
        units.parse_unit(text)
    assert hint in caught.value.hint


def test_units_that_need_no_dictionary_are_those_of_the_dictionary(monkeypatch):
    known = dict(units.USUAL)
    monkeypatch.setattr("taichi_erosion.scene.schema.units.USUAL", {"1": known["1"]})
    assert {name: units.unit_from_registry.__wrapped__(name) for name in known} == known


@given(st.text(alphabet="mkgsPaN%/() -^*·0123456789°µ⁻¹", max_size=20))
def test_any_text_is_a_unit_or_refused(text):
    try:
        unit = units.parse_unit(text)
    except units.UnknownUnit:
        return
    assert unit.factor > 0.0


@pytest.mark.parametrize(
    ("text", "number", "kelvin"),
    [("degC", 20.0, 293.15), ("℃", 0.0, 273.15), ("°F", 50.0, 283.15), ("K", 3.0, 3.0)],
)
def test_a_temperature_is_counted_from_the_zero_of_its_scale(text, number, kelvin):
    scale = units.scale_between(text, units.parse_unit("K"))
    assert scale.to_use(number) == pytest.approx(kelvin, rel=1e-12)
    assert scale.to_unit_of_table(kelvin) == pytest.approx(number, abs=1e-10)
