"""Named designs are those of the textbooks, in their order, and survive a file and a shuffle."""

import numpy as np
import pyDOE3
import pytest
from hypothesis import given
from hypothesis import strategies as st
from textbook import unit_factors

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments import design
from taichi_erosion.experiments.design import CYCLES, TOGETHER, plackett_burman_points
from taichi_erosion.experiments.design_table import (
    Factor,
    read_design,
    run_order,
    to_coded,
    to_natural,
    write_design,
)
from taichi_erosion.experiments.terms import alias_table, aliases, model_matrix, model_terms

# Plackett & Burman (1946) as printed, for example, in Plasun (1999), table 3.6
TWELVE = """
+ + - + + + - - - + -
- + + - + + + - - - +
+ - + + - + + + - - -
- + - + + - + + + - -
- - + - + + - + + + -
- - - + - + + - + + +
+ - - - + - + + - + +
+ + - - - + - + + - +
+ + + - - - + - + + -
- + + + - - - + - + +
+ - + + + - - - + - +
- - - - - - - - - - -
"""


def same_points(ours: np.ndarray, theirs: np.ndarray) -> bool:
    return sorted(map(tuple, np.round(ours, 9) + 0.0)) == sorted(map(tuple, np.round(theirs, 9) + 0.0))


def factors(count: int) -> list[Factor]:
    return unit_factors("ABCDEFGHIJKLMNOPQRSTUVWXYZ"[:count])


def test_the_twelve_runs_of_plackett_and_burman_stand_as_printed():
    printed = [[1.0 if sign == "+" else -1.0 for sign in line.split()] for line in TWELVE.split("\n")[1:-1]]
    assert np.array_equal(design.plackett_burman(factors(11), centre_points=0).coded, printed)


@pytest.mark.parametrize("runs", CYCLES)
def test_every_plackett_burman_design_is_orthogonal_and_balanced(runs):
    points = plackett_burman_points(runs - 1)
    assert np.array_equal(points.T @ points, runs * np.eye(runs - 1))
    assert not points.sum(axis=0).any()


@pytest.mark.parametrize("count", [3, 7, 11, 15, 19, 23])
def test_plackett_burman_designs_have_the_size_of_an_independent_generator(count):
    assert plackett_burman_points(count).shape == pyDOE3.pbdesign(count).shape


def test_a_fold_over_frees_main_effects_of_two_factor_interactions():
    plain = aliases(design.plackett_burman(factors(7), centre_points=0))
    folded = aliases(design.plackett_burman(factors(7), centre_points=0, fold_over=True))
    assert all(plain.values())
    assert not any(folded.values())


def test_a_fold_over_is_a_block_of_its_own_with_its_own_centre():
    folded = design.plackett_burman(factors(7), centre_points=2, fold_over=True, seed=4)
    assert folded.blocks.tolist() == [1] * 10 + [2] * 10
    assert folded.kinds == (("factorial",) * 8 + ("centre",) * 2) * 2
    assert np.array_equal(folded.coded[:8], -folded.coded[10:18])


def test_the_box_behnken_design_of_three_factors_stands_in_design_experts_order():
    # Hao et al. (2022), table 8, which Design-Expert wrote
    wanted = [
        (-1, -1, 0), (1, -1, 0), (-1, 1, 0), (1, 1, 0), (-1, 0, -1), (1, 0, -1), (-1, 0, 1), (1, 0, 1),
        (0, -1, -1), (0, 1, -1), (0, -1, 1), (0, 1, 1), *[(0, 0, 0)] * 5,
    ]  # fmt: skip
    assert np.array_equal(design.box_behnken(factors(3)).coded, wanted)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_box_behnken_points_are_those_of_an_independent_generator(count):
    ours = design.box_behnken(factors(count), centre_points=0).coded
    assert same_points(ours, pyDOE3.bbdesign(count, center=0))


@pytest.mark.parametrize("count", [6, 7])
def test_larger_box_behnken_designs_are_the_blocks_of_the_1960_paper(count):
    # 6 factors: blocks of 3, every factor in 3 blocks; 7 factors: any two factors meet in exactly one block
    blocks = [set(letters) for letters in TOGETHER[count]]
    names = "ABCDEFG"[:count]
    assert len(design.box_behnken(factors(count), centre_points=6)) == {6: 54, 7: 62}[count]
    assert all(sum(name in block for block in blocks) == 3 for name in names)
    meetings = {sum({a, b} <= block for block in blocks) for a in names for b in names if a < b}
    assert meetings == ({1} if count == 7 else {1, 2})


@pytest.mark.parametrize("count", [2, 3, 4])
def test_central_composite_points_are_those_of_an_independent_generator(count):
    ours = design.central_composite(factors(count), centre_points=8).coded
    theirs = pyDOE3.ccdesign(count, center=(4, 4), alpha="rotatable", face="circumscribed")
    assert same_points(ours, theirs)


def test_a_rotatable_design_predicts_equally_well_in_every_direction():
    points = design.central_composite(factors(3)).coded
    matrix = model_matrix(points, model_terms(3, "quadratic"))
    directions = np.random.default_rng(1).normal(size=(20, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    there = model_matrix(directions, model_terms(3, "quadratic"))
    variance = np.einsum("ij,jk,ik->i", there, np.linalg.inv(matrix.T @ matrix), there)
    # the same to rounding: a condition number of 30 leaves 14 digits
    assert np.ptp(variance) < 1e-12


def test_a_full_factorial_stands_in_yates_order():
    wanted = [(-1, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (1, 1)]
    assert np.array_equal(design.full_factorial(factors(2), (2, 3)).coded, wanted)


def test_the_half_of_a_two_to_the_four_has_montgomerys_aliases():
    # Montgomery (2017), example 8.1: I = ABCD
    table = alias_table(design.fractional_factorial(factors(4), "a b c abc"))
    assert table == [
        "I = A*B*C*D", "A = B*C*D", "B = A*C*D", "C = A*B*D", "D = A*B*C",
        "A*B = C*D", "A*C = B*D", "A*D = B*C",
    ]  # fmt: skip


def test_a_quarter_fraction_has_montgomerys_defining_relation():
    # Montgomery (2017), example 8.4: a 2^(6-2) with E = ABC, F = BCD has I = ABCE = BCDF = ADEF
    table = alias_table(design.fractional_factorial(factors(6), "a b c d abc bcd"))
    assert set(table[0].removeprefix("I = ").split(" = ")) == {"A*B*C*E", "B*C*D*F", "A*D*E*F"}
    assert any(chain.startswith("A*B = C*E") for chain in table)


def test_a_negative_generator_changes_the_sign_of_its_alias():
    assert "A = -B*C" in alias_table(design.fractional_factorial(factors(3), "a b -ab"))


def test_main_effects_of_twelve_runs_share_a_third_with_every_foreign_interaction():
    # Montgomery (2017), 8.6.3
    found = aliases(design.plackett_burman(factors(11), centre_points=0))
    assert all(len(shares) == 45 for shares in found.values())
    assert all(abs(abs(share) - 1 / 3) < 1e-12 for shares in found.values() for _, share in shares)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_latin_hypercube_has_one_run_in_every_slice(seed):
    points = design.latin_hypercube(factors(3), 10, seed).coded
    slices = np.floor((points + 1.0) * 5.0).astype(int)
    assert all(sorted(column) == list(range(10)) for column in slices.T)


def test_a_sobol_design_fills_every_half_equally_and_repeats_with_its_seed():
    points = design.sobol(factors(3), 16, 5).coded
    assert np.array_equal(np.sum(points < 0.0, axis=0), [8, 8, 8])
    assert np.array_equal(points, design.sobol(factors(3), 16, 5).coded)
    assert not np.array_equal(points, design.sobol(factors(3), 16, 6).coded)
    with pytest.raises(BadInput, match="power of two"):
        design.sobol(factors(3), 12, 5)


def test_d_optimal_runs_beat_every_exchange_of_one_of_them():
    start = design.full_factorial(factors(2))
    terms = model_terms(2, "quadratic")
    grown = design.augmented(start, terms, 3)

    def determinant(points: np.ndarray) -> float:
        matrix = model_matrix(points, terms)
        return float(np.linalg.det(matrix.T @ matrix))

    best = determinant(grown.coded)
    for row in range(4, 7):
        for level in design.grid_points(2):
            other = grown.coded.copy()
            other[row] = level
            assert determinant(other) <= best * (1.0 + 1e-9)
    assert grown.blocks.tolist() == [1] * 4 + [2] * 3


def test_added_runs_repair_a_design_that_could_not_carry_the_model():
    terms = model_terms(3, "quadratic")
    with pytest.raises(BadInput, match="add more"):
        design.augmented(design.full_factorial(factors(3)), terms, 1)
    grown = design.augmented(design.full_factorial(factors(3)), terms, 4)
    assert np.linalg.matrix_rank(model_matrix(grown.coded, terms)) == 10


def test_a_steepest_path_follows_the_gradient_and_ends_at_a_limit():
    ranges = [Factor("a", 0.0, 2.0), Factor("b", 10.0, 30.0)]
    path = design.steepest_path(ranges, {"a": -3.0, "b": 1.5}, steps=5, step=0.5, limits={"a": (0.0, 9.0)})
    # a: half range 1, full step 0.5 down; b: half range 10, half of a step up
    assert np.allclose(path.natural, [(1.0, 20.0), (0.5, 22.5), (0.0, 25.0)])
    assert path.kinds == ("path",) * 3


def test_a_step_backwards_descends():
    up, down = (design.steepest_path(factors(2), [2.0, 1.0], 3, step) for step in (0.4, -0.4))
    assert np.array_equal(up.coded, -down.coded)


def test_a_flat_plane_has_no_steepest_path():
    with pytest.raises(BadInput, match="slope"):
        design.steepest_path(factors(2), [0.0, 0.0])


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
    made = design.latin_hypercube(ranges, 7, 3).with_responses(angle=[1.0, np.nan, *range(5)])
    write_design(made, tmp_path / "d.csv")
    back = read_design(tmp_path / "d.csv")
    assert back.factors == made.factors
    assert np.array_equal(back.coded, made.coded)
    assert np.array_equal(back.natural, made.natural)
    assert np.array_equal(back.run_order, made.run_order)
    assert back.kinds == made.kinds
    assert np.array_equal(back.responses["angle"], made.responses["angle"], equal_nan=True)


def test_a_table_in_which_only_the_natural_value_was_changed_is_refused(tmp_path):
    path = tmp_path / "d.csv"
    write_design(design.full_factorial([Factor("a", 0.0, 4.0)]), path)
    path.write_text(path.read_text().replace("factorial,0.0,-1.0", "factorial,1.0,-1.0"))
    with pytest.raises(BadInput, match=r"row 1, a = 1 does not belong to the coded level -1"):
        read_design(path)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Factor("a", 1.0, 1.0), "low < high"),
        (lambda: design.box_behnken(factors(2)), "at least 3"),
        (lambda: design.plackett_burman([*factors(3), *factors(1)]), "named twice"),
        (lambda: design.plackett_burman([Factor(f"f{k}", 0.0, 1.0) for k in range(36)]), "at most 35"),
        (lambda: design.fractional_factorial(factors(3), "a b"), "one word"),
    ],
)
def test_impossible_designs_are_refused_in_one_line(make, words):
    with pytest.raises(BadInput, match=words):
        make()
