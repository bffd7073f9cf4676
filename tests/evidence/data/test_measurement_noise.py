"""Scatter of the laboratory out of few repeats, wrong values among them, and what they say of a model."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from doe.trials.reduced.families import FAMILIES
from taichi_erosion.evidence.data import measurement_noise
from taichi_erosion.evidence.data.comparison_rows import comparison_rows
from taichi_erosion.evidence.data.problem import Bools, Floats, Problem

ROWS, REPEATS, GROUPS = 12, 3, 8
FREEDOM = np.full(ROWS, REPEATS - 1.0)
EVEN = np.ones((1, ROWS))
CELL = np.repeat(np.arange(float(GROUPS)), REPEATS)


def sample_variances(random: np.random.Generator, sd: np.ndarray, repeats: int = REPEATS) -> np.ndarray:
    return np.var(sd * random.standard_normal((repeats, sd.size)), axis=0, ddof=1)


def test_rows_of_one_scatter_share_one_variance():
    variance, freedom = measurement_noise.moderate_variance(
        sample_variances(np.random.default_rng(1), np.full(ROWS, 2.0)), FREEDOM, EVEN
    )
    assert np.ptp(variance) == 0.0
    assert freedom == ROWS * (REPEATS - 1)
    # a pooled variance of 24 degrees of freedom has a relative sd of sqrt(2 / 24)
    assert variance[0] == pytest.approx(4.0 * 24 / 22, rel=3.0 * np.sqrt(2.0 / 24.0))


def test_rows_that_differ_beyond_chance_keep_their_own_variance():
    sd = np.where(np.arange(ROWS) < ROWS // 2, 1.0, 10.0)
    variance, _ = measurement_noise.moderate_variance(
        sample_variances(np.random.default_rng(2), sd, 10), np.full(ROWS, 9.0), EVEN
    )
    assert variance[: ROWS // 2].max() < 0.2 * variance[ROWS // 2 :].min()


def test_scatter_that_grows_with_the_value_is_seen():
    value = np.geomspace(1.0, 8.0, ROWS)
    shapes = np.array([np.ones(ROWS), value])
    grown = measurement_noise.likeliest_scatter_shape(
        sample_variances(np.random.default_rng(3), 0.1 * value), FREEDOM, shapes
    )
    flat = measurement_noise.likeliest_scatter_shape(
        sample_variances(np.random.default_rng(3), np.ones(ROWS)), FREEDOM, shapes
    )
    assert np.all(np.diff(grown)[2:] > 0.0)
    assert np.ptp(flat) == 0.0


@pytest.mark.parametrize("spread", [0.0, 0.5])
def test_weights_out_of_three_repeats_make_no_outliers(spread):
    random, beyond, sets = np.random.default_rng(4), 0, 300
    for _ in range(sets):
        repeats = np.exp(spread * random.standard_normal(ROWS)) * random.standard_normal((REPEATS, ROWS))
        variance, _ = measurement_noise.moderate_variance(np.var(repeats, axis=0, ddof=1), FREEDOM, EVEN)
        beyond += int(np.sum(np.abs(repeats.mean(axis=0)) > 3.0 * np.sqrt(variance / REPEATS)))
    # over its own sd of three repeats a residual lies beyond 3 sd in 9.5 % of rows: less than a third of that
    assert beyond < 0.03 * sets * ROWS


def with_value(problem: Problem, row: int, value: float) -> Problem:
    """A problem with another value in one cell of its table."""
    values = problem.measurements.value.copy()
    values[row] = value
    return replace(problem, measurements=replace(problem.measurements, value=values))


def disagreeing(z: Floats, cell: Floats, stated: bool) -> Bools:
    """By cell, whether its repeats differ by more than chance."""
    return measurement_noise.gross_groups(*measurement_noise.group_repeats(z, np.ones(z.size), cell), stated)


@pytest.fixture(scope="module")
def laboratory() -> tuple[Problem, int]:
    """A study with repeats of the angle of repose, and a visible row that repeats an earlier one."""
    table = (problem := FAMILIES["clean"](4242, 1).problem).measurements
    settings = pd.DataFrame({"observable": table.observable, **table.conditions})
    again = settings.duplicated() & (settings["observable"] == "repose_angle")
    return problem, int(np.setdiff1d(np.flatnonzero(again), problem.vault.rows)[-1])


@pytest.mark.parametrize("stated", [True, False])
def test_sound_repeats_do_not_disagree(stated):
    random, off = np.random.default_rng(5), 0
    for _ in range(200):
        off += int(disagreeing(random.standard_normal(CELL.size), CELL, stated).any())
    assert off <= 1  # at a family-wise chance of 1e-4 each


@pytest.mark.parametrize("stated", [True, False])
def test_two_wrong_values_do_not_hide_one_another(stated):
    z = np.random.default_rng(6).standard_normal(CELL.size)
    z[[0, 7]] += [60.0, -50.0]
    assert np.flatnonzero(disagreeing(z, CELL, stated)).tolist() == [0, 2]
    pairs = np.array([31.2, 31.9, 33.0, 32.6, 35.1, 65.2, 37.0, 36.6, 38.1, 38.9])
    assert np.flatnonzero(disagreeing(pairs, np.repeat(np.arange(5.0), 2), stated)).tolist() == [2]


def test_empty_traps_that_agree_exactly_are_no_standard_for_the_others():
    """Values rounded to 0.1 without a stated sd; most pairs are equal, and half of them 0."""
    z = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 2.1, 2.1, 3.0, 3.1, 4.0, 4.2])
    shapes, cell = np.array([np.ones(z.size), z]), np.repeat(np.arange(6.0), 2)
    found = measurement_noise.measurement_scatter(z, np.full(z.size, np.nan), np.ones(z.size), cell, shapes)
    assert not found.off.any()
    assert found.own_freedom == 6.0


@pytest.mark.parametrize("response", [0.0, 2.0])
def test_blocks_that_each_hold_every_set_up_once_state_the_scatter(response):
    set_up, block = map(np.ravel, np.meshgrid(np.arange(6.0), np.arange(4.0)))
    error = 0.5 * np.array([1, -1, 0, 0, -1, 1])[set_up.astype(int)] * (-1.0) ** block
    blocks = np.array([0.0, 5.0, -2.0, 9.0])[block.astype(int)] + response * set_up * (block == 1.0)
    args = 3.0 * set_up + blocks + error, np.full(24, np.nan), np.ones(24), np.arange(24.0), np.ones((1, 24))
    same, sample = np.zeros(24), np.minimum(block, 1.0)
    by_blocks = np.array([24.0 * set_up + block, same, block, set_up])  # samples, of which one responds more
    designs = [(by_blocks, 12.0), (np.array([set_up, block, same, set_up]), 15.0)][: 2 - bool(response)]
    for design, freedom in designs:
        scatter = measurement_noise.measurement_scatter(*args, design)
        assert (*scatter.pure, scatter.by_blocks) == (pytest.approx(freedom - 2.0), freedom, freedom == 12.0)
        assert scatter.variance[0] == pytest.approx(16 * 0.25 / (freedom - 2.0))
    for design in (None, np.array([np.arange(24.0), same, sample, set_up])):  # of two soils it may be theirs
        assert np.isnan(measurement_noise.measurement_scatter(*args, design).variance).all()


def test_scatter_that_is_larger_everywhere_is_no_disagreement():
    assert not disagreeing(4.0 * np.random.default_rng(7).standard_normal(CELL.size), CELL, True).any()


def test_a_mistyped_cell_is_found_and_leaves_the_scatter_of_the_others(laboratory):
    problem, row = laboratory
    wrong = with_value(problem, row, problem.measurements.value[row] + 30.0)
    before, after = (comparison_rows(each, each.measurements) for each in (problem, wrong))
    (found,) = after.unmerged
    assert not before.unmerged
    assert (found.suspects, found.gap) == ((row + 2,), pytest.approx(30.0, abs=3.0))
    # a row of its own; its sound repeats stay merged
    assert [after.lines[k] for k in np.flatnonzero(after.rows_to_check)] == [(row + 2,)]
    same = {lines: variance for lines, variance in zip(before.lines, before.variance, strict=True)}
    pairs = zip(after.lines, after.variance, strict=True)
    ratio = [variance / same[lines] for lines, variance in pairs if lines in same]
    assert ratio == pytest.approx(np.ones(before.size - 1), abs=0.1)


@pytest.mark.parametrize("off", [30.0, -15.0])
def test_of_a_pair_the_row_far_from_its_neighbours_is_to_be_checked(laboratory, off):
    problem, row = laboratory
    table = problem.measurements
    here = np.all([column == column[row] for column in table.conditions.values()], axis=0)
    third = np.flatnonzero(here & (np.array(table.observable) == "repose_angle"))
    left = np.delete(np.arange(table.size), next(each for each in third if each != row))
    pair = replace(with_value(problem, row, table.value[row] + off).measurements.pick_rows_at(left), line=())
    (found,) = comparison_rows(problem, pair).unmerged
    assert (len(found.lines), found.suspects) == (2, (int(np.flatnonzero(left == row)[0]) + 2,))


def test_lack_of_fit_has_the_size_of_its_level_and_sees_a_misfit():
    random, chances = np.random.default_rng(8), []
    for size in (0.0, 6.0):
        p = []
        for _ in range(400):
            z = 3.0 * random.standard_normal(CELL.size) + size * np.sin(CELL)  # the model is 0
            error, freedom = measurement_noise.pure_error_squares(z, np.ones(z.size), CELL)
            squares = float(z @ z) - error
            p.append(measurement_noise.lack_of_fit_p_value([(squares, z.size - freedom, error, freedom)]))
        chances.append(float(np.mean(np.array(p) < 0.05)))
    assert chances[0] == pytest.approx(0.05, abs=3.0 * np.sqrt(0.05 * 0.95 / 400))
    assert chances[1] > 0.9
    # equal repeats tell no scatter, whatever digit a mean loses
    assert measurement_noise.pure_error_squares(np.full(6, np.log(0.23)), np.ones(6), np.zeros(6)) == (0.0, 5)
    assert np.isnan(measurement_noise.lack_of_fit_p_value([(0.01, 1.0, 0.0, 2.0)]))
