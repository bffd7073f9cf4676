"""Named designs are those of the textbooks, in their order; they survive a file and a change of units."""

import io

import numpy as np
import pandas as pd
import pyDOE3
import pytest
from hypothesis import given
from hypothesis import strategies as st
from textbook import unit_factors

from taichi_erosion.experiments import design

# Plackett & Burman (1946); printed, for example, in Plasun (1999), table 3.6
FIRST_OF_TWELVE = np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, -1.0])


def test_the_twelve_runs_of_plackett_and_burman_stand_as_printed():
    # each row is the one above, turned to the right; the last has low levels alone
    printed = [*(np.roll(FIRST_OF_TWELVE, turn) for turn in range(11)), -np.ones(11)]
    assert np.array_equal(design.plackett_burman(unit_factors("ABCDEFGHIJK"), centre_points=0).coded, printed)


@pytest.mark.parametrize("runs", design.CYCLES)
def test_every_plackett_burman_design_is_orthogonal_and_balanced(runs):
    factors = [design.Factor(f"f{k}", 0.0, 1.0) for k in range(runs - 1)]
    points = design.plackett_burman(factors, centre_points=0).coded
    assert np.array_equal(points.T @ points, runs * np.eye(runs - 1))
    assert not points.sum(axis=0).any()


def test_the_box_behnken_design_of_three_factors_stands_in_design_experts_order():
    # Hao et al. (2022), table 8, which Design-Expert wrote
    wanted = [
        (-1, -1, 0), (1, -1, 0), (-1, 1, 0), (1, 1, 0), (-1, 0, -1), (1, 0, -1), (-1, 0, 1), (1, 0, 1),
        (0, -1, -1), (0, 1, -1), (0, -1, 1), (0, 1, 1), *[(0, 0, 0)] * 5,
    ]  # fmt: skip
    assert np.array_equal(design.box_behnken(unit_factors("ABC")).coded, wanted)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_box_behnken_points_are_those_of_an_independent_generator(count):
    ours = design.box_behnken(unit_factors("ABCDE"[:count]), centre_points=0).coded
    theirs = pyDOE3.bbdesign(count, center=0)
    assert sorted(map(tuple, np.round(ours, 9) + 0.0)) == sorted(map(tuple, np.round(theirs, 9) + 0.0))


@pytest.mark.parametrize("count", [2, 3, 4])
@pytest.mark.parametrize(
    ("axial", "distance"),
    [
        ("rotatable", {2: 2**0.5, 3: 8**0.25, 4: 2.0}),  # F^(1/4), F = 2^k
        ("spherical", {2: 2**0.5, 3: 3**0.5, 4: 2.0}),  # sqrt(k)
        ("faced", {2: 1.0, 3: 1.0, 4: 1.0}),
    ],
)
def test_central_composite_points_are_those_of_the_textbook(count, axial, distance):
    made = design.central_composite(unit_factors("ABCDE"[:count]), axial=axial)
    star = distance[count] * np.repeat(np.eye(count), 2, axis=0) * np.tile([[-1.0], [1.0]], (count, 1))
    wanted = [*design.factorial_points(count, 2), *star, *np.zeros((5, count))]
    assert np.allclose(made.coded, wanted, rtol=0.0, atol=1e-12)
    assert made.kinds == ("factorial",) * 2**count + ("axial",) * 2 * count + ("centre",) * 5


@pytest.mark.parametrize("seed", [0, 1])
def test_a_latin_hypercube_has_one_run_in_every_slice_of_every_factor(seed):
    made = design.latin_hypercube(unit_factors("ABC"), 10, seed, centre_points=2)
    slices = np.floor((made.coded[:10] + 1.0) * 5.0).astype(int)
    assert all(sorted(column) == list(range(10)) for column in slices.T)
    assert made.kinds == ("space",) * 10 + ("centre",) * 2
    assert not made.coded[10:].any()


def test_a_steepest_path_follows_the_gradient_and_ends_at_a_limit():
    ranges = [design.Factor("a", 0.0, 2.0), design.Factor("b", 10.0, 30.0)]
    path = design.steepest_ascent(ranges, [-3.0, 1.5], steps=5, step=0.5, limits={"a": (0.0, 9.0)})
    # a: half range 1, full step 0.5 down; b: half range 10, half of a step up
    assert np.allclose(path.natural, [(1.0, 20.0), (0.5, 22.5), (0.0, 25.0)])
    assert path.kinds == ("path",) * 3


def test_a_seed_shuffles_the_turns_and_never_the_rows():
    standard, shuffled = (design.box_behnken(unit_factors("ABC"), seed=seed) for seed in (None, 3))
    assert np.array_equal(standard.coded, shuffled.coded)
    assert standard.run_order.tolist() == list(range(1, 18))
    assert shuffled.run_order.tolist() != standard.run_order.tolist()


@given(st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6)), min_size=1, max_size=4))
def test_coded_levels_come_back_from_natural_units(ranges):
    some = [design.Factor(f"f{k}", low, low + width) for k, (low, width) in enumerate(ranges)]
    levels = np.linspace(-1.0, 1.0, 5)[:, None] * np.ones(len(some))
    natural = design.to_natural(some, levels)
    assert np.array_equal(natural[[0, -1]], [[f.low for f in some], [f.high for f in some]])
    # a centre of 1e6 beside a range of 1e-3 leaves seven digits of the level
    assert np.allclose(design.to_coded(some, natural), levels, atol=1e-6)


def test_a_design_comes_back_from_its_file_to_the_bit():
    median = design.Factor("grains.size.median", 1e-4, 0.1 + 0.2, "m")
    ranges = [design.Factor("contact.soil-soil.restitution", 0.4, 0.8), median]
    made = design.latin_hypercube(ranges, 7, seed=1).with_responses(angle=[1.0, np.nan, *range(5)])
    back = pd.read_csv(io.StringIO(design.design_csv(made)), dtype=str)
    assert "grains.size.median [m] 0.0001..0.30000000000000004" in back
    columns = np.column_stack([made.run_order, made.natural, made.coded, made.responses["angle"]])
    assert np.array_equal(back.drop(columns=["run", "point"]).astype(float), columns, equal_nan=True)
    assert tuple(back["point"]) == made.kinds
