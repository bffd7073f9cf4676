"""A design survives a file, a change of units and a shuffle."""

import io

import numpy as np
import pandas as pd
from hypothesis import given
from hypothesis import strategies as st
from textbook import unit_factors

from taichi_erosion.experiments import design
from taichi_erosion.experiments.design_table import Factor, design_frame, design_text, to_coded, to_natural


def test_a_seed_shuffles_the_turns_and_never_the_rows():
    standard, shuffled = (design.box_behnken(unit_factors("ABC"), seed=seed) for seed in (None, 3))
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


def test_a_design_comes_back_from_its_file_to_the_bit():
    median = Factor("grains.size.median", 1e-4, 0.1 + 0.2, "m")
    ranges = [Factor("contact.soil-soil.restitution", 0.4, 0.8), median]
    made = design.latin_hypercube(ranges, 7, seed=1).with_responses(angle=[1.0, np.nan, *range(5)])
    frame = design_frame(made)
    back = pd.read_csv(io.StringIO(design_text(made)), dtype=str).astype(frame.dtypes)
    pd.testing.assert_frame_equal(back, frame, check_exact=True)
    assert "grains.size.median [m] 0.0001..0.30000000000000004" in back
