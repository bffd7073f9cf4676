"""A design survives a file, a change of units and a shuffle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from textbook import full_factorial, spread_design, unit_factors

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments import design
from taichi_erosion.experiments.design_table import (
    Factor,
    design_text,
    read_design,
    run_order,
    to_coded,
    to_natural,
)


def factors(count: int) -> list[Factor]:
    return unit_factors("ABCDEFGHIJKLMNOPQRSTUVWXYZ"[:count])


@given(st.integers(0, 2**31), st.integers(1, 4))
def test_a_random_order_is_a_permutation_that_keeps_blocks_together(seed, blocks):
    block = np.repeat(np.arange(1, blocks + 1), 5)
    turns = run_order(block, seed)
    assert sorted(turns) == list(range(1, len(block) + 1))
    assert np.all(np.diff(block[np.argsort(turns)]) >= 0)


def test_a_seed_shuffles_the_turns_and_never_the_rows():
    standard, shuffled = (design.box_behnken(factors(3), seed=seed) for seed in (None, 3))
    assert np.array_equal(standard.coded, shuffled.coded)
    assert standard.run_order.tolist() == list(range(1, 18))
    assert shuffled.run_order.tolist() != standard.run_order.tolist()


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6)), min_size=1, max_size=4))
def test_coded_levels_come_back_from_natural_units(ranges):
    some = [Factor(f"f{k}", low, low + width) for k, (low, width) in enumerate(ranges)]
    levels = np.linspace(-1.0, 1.0, 5)[:, None] * np.ones(len(some))
    natural = to_natural(some, levels)
    assert np.array_equal(natural[[0, -1]], [[f.low for f in some], [f.high for f in some]])
    # a centre of 1e6 beside a range of 1e-3 leaves seven digits of the level
    assert np.allclose(to_coded(some, natural), levels, atol=1e-6)


def test_a_design_comes_back_from_its_file_to_the_bit(tmp_path):
    ranges = [
        Factor("contact.soil-soil.restitution", 0.4, 0.8),
        Factor("grains.size.median", 1e-4, 0.1 + 0.2, "m"),
    ]
    made = spread_design(ranges, 7).with_responses(angle=[1.0, np.nan, *range(5)])
    (tmp_path / "d.csv").write_text(design_text(made), encoding="utf-8")
    back = read_design(tmp_path / "d.csv")
    assert back.factors == made.factors
    assert np.array_equal(back.coded, made.coded)
    assert np.array_equal(back.natural, made.natural)
    assert np.array_equal(back.run_order, made.run_order)
    assert back.kinds == made.kinds
    assert np.array_equal(back.responses["angle"], made.responses["angle"], equal_nan=True)


def test_a_table_in_which_only_the_natural_value_was_changed_is_refused(tmp_path):
    path = tmp_path / "d.csv"
    text = design_text(full_factorial([Factor("a", 0.0, 4.0)]))
    path.write_text(text.replace("factorial,0.0,-1.0", "factorial,1.0,-1.0"))
    with pytest.raises(BadInput, match=r"row 1, a = 1 does not belong to the coded level -1"):
        read_design(path)
