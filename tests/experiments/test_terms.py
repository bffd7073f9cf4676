"""Terms are read as papers print them."""

import pytest

from taichi_erosion.experiments.terms import parse_term, term_name


@pytest.mark.parametrize("text", ["A*C", "AC", "CA", "A C"])
def test_an_interaction_is_read_however_it_is_printed(text):
    assert parse_term(text, ["A", "B", "C"]) == (1, 0, 1)


@pytest.mark.parametrize("text", ["B^2", "B2", "B\u00b2"])
def test_a_square_is_read_however_it_is_printed(text):
    assert term_name(parse_term(text, ["A", "B", "C"]), ["A", "B", "C"]) == "B^2"
