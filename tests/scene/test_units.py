"""Units are read as printed, compared by kind, and converted by one factor."""

from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taichi_erosion.scene.schema.units import UnknownUnit, conversion, parse_unit


@pytest.mark.parametrize(
    ("source", "target", "factor"),
    [
        ("mm", "m", 1e-3),
        ("µm", "um", 1.0),
        ("deg", "rad", pi / 180.0),
        ("°", "deg", 1.0),
        ("%", "kg/kg", 0.01),
        ("g/(m s)", "kg m-1 s-1", 1e-3),
        ("kg m⁻¹ s⁻¹", "kg/m/s", 1.0),
        ("g/cm3", "kg m^-3", 1e3),
        ("km/h", "m/s", 1.0 / 3.6),
        ("hPa", "Pa", 100.0),
        ("mJ/m2", "N/m", 1e-3),
        ("1", "-", 1.0),
    ],
)
def test_a_unit_is_converted_by_its_factor(source, target, factor):
    # ten digits: factors are products of a few roundings
    assert conversion(parse_unit(source), parse_unit(target)) == pytest.approx(factor, rel=1e-10)


@pytest.mark.parametrize(
    ("source", "target"), [("deg", "1"), ("m/s", "m"), ("Pa", "N"), ("kg/(m s)", "kg/m")]
)
def test_quantities_of_different_kind_are_not_converted(source, target):
    assert conversion(parse_unit(source), parse_unit(target)) is None


@pytest.mark.parametrize(
    "text", ["furlong", "kg/m s", "m/", "(m", "m)", "()", "m--2", "m99", "/", "m" * 61, "€"]
)
def test_what_is_no_unit_or_could_mean_two_is_refused(text):
    with pytest.raises(UnknownUnit):
        parse_unit(text)


@given(st.text(alphabet="mkgsPaN%/() -^*·0123456789°µ⁻¹", max_size=20))
def test_any_text_is_a_unit_or_refused(text):
    try:
        unit = parse_unit(text)
    except UnknownUnit:
        return
    assert unit.factor > 0.0
