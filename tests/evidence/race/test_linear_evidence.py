"""Evidence of linear rows against the density of a normal distribution, its slopes against differences."""

from dataclasses import replace

import numpy as np
import pytest

from taichi_erosion.evidence.race.linear_evidence import LinearRows, Scales, one_scale, row_evidence
from taichi_erosion.evidence.race.priors import BAD_SD

SCALES = sum(
    (one_scale("level", cauchy=0.25), one_scale("smooth", normal=0.3), one_scale("first", doubt=0.35)),
    Scales.empty(),
) + one_scale("second", doubt=0.2)
U = np.array([0.3, -0.4, 0.1, -0.2])


def rows(seed: int = 0, size: int = 14) -> LinearRows:
    """Two slopes, a level, three smooth columns; two scatters and two rows without one."""
    random = np.random.default_rng(seed)
    scatter = np.array([0] * 6 + [1] * (size - 8) + [-1] * 2)
    block = np.array([-1, -1, 0, 1, 1, 1])
    columns, y = random.standard_normal((size, block.size)), random.standard_normal(size)
    return LinearRows(y, columns, block, scatter, SCALES, np.ones(size), np.full((size, 2), np.nan))


def covariance(table: LinearRows, u: np.ndarray) -> np.ndarray:
    tau = np.array([1.0, 1.0, *np.exp(u[[0, 1, 1, 1]])])
    kappa = np.append(np.exp(u[2:]), 1.0)[table.scatter]
    return (table.columns * tau**2) @ table.columns.T + np.diag(kappa**2 / table.weight)


def test_likelihood_is_that_of_a_normal_distribution():
    table = replace(rows(), weight=np.linspace(0.5, 2.0, 14))
    cov = covariance(table, U)
    expected = -0.5 * table.y @ np.linalg.solve(cov, table.y) - 0.5 * np.linalg.slogdet(2.0 * np.pi * cov)[1]
    found = table.at_scales(U).log_likelihood - 0.5 * 14 * np.log(2.0 * np.pi)
    assert found == pytest.approx(expected, abs=1e-9)


def test_posterior_and_residual_are_those_of_the_covariance():
    table, (g, h) = rows(), np.random.default_rng(1).standard_normal((2, 14))
    now, inverse = table.at_scales(U), np.linalg.inv(covariance(rows(), U))
    residual, diagonal = now.whitened
    np.testing.assert_allclose(residual, inverse @ table.y, atol=1e-10)
    np.testing.assert_allclose(diagonal, np.diag(inverse), atol=1e-10)
    along, gram = now.project(np.column_stack([g, h]))
    np.testing.assert_allclose(along, [g @ inverse @ table.y, h @ inverse @ table.y], atol=1e-10)
    assert gram[0, 1] == pytest.approx(g @ inverse @ h, abs=1e-10)


def test_slopes_and_expected_curvature():
    table = rows()
    gradient, curvature = table.at_scales(U).gradient_and_curvature()
    steps = np.eye(4) * 1e-5
    numeric = [(table.at_scales(U + h).value - table.at_scales(U - h).value) / 2e-5 for h in steps]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-5, atol=1e-6)
    inverse = np.linalg.inv(covariance(table, U))
    slopes = [(covariance(table, U + h) - covariance(table, U - h)) / 2e-5 for h in steps]
    expected = [[0.5 * np.trace(inverse @ a @ inverse @ b) for b in slopes] for a in slopes]
    bend = np.diag(np.maximum(SCALES.log_prior_of_scales(U)[2], 0.02))
    np.testing.assert_allclose(curvature - bend, expected, rtol=1e-5, atol=1e-7)


def test_a_level_is_integrated_over_its_heavy_tail():
    size = 12
    offset = LinearRows(
        np.full(size, 6.0) + np.linspace(-1.0, 1.0, size),
        np.ones((size, 1)),
        np.array([0]),
        np.zeros(size, dtype=np.int64),
        one_scale("level", cauchy=0.25) + one_scale("scatter", doubt=0.35),
        np.ones(size),
        np.full((size, 2), np.nan),
    )
    far, near = (row_evidence(t, t.scales.initial, 20) for t in (offset, replace(offset, y=offset.y - 6.0)))
    # a level of six standard errors costs its prior, not its misfit of 430 / 2
    assert 1.0 < near.log_evidence - far.log_evidence < 8.0
    assert far.solution.u[0] > 0.5


def test_one_bad_row_is_found_and_weighs_little():
    table = rows(size=24)
    clean = row_evidence(table, table.scales.initial, 20)
    y = table.y.copy()
    y[9] += 12.0
    dirty = row_evidence(replace(table, y=y), table.scales.initial, 20)
    assert (clean.bad, dirty.bad) == ({}, {9: 0})
    assert dirty.solution.rows.weight[9] == pytest.approx(BAD_SD[0] ** -2)
    np.testing.assert_allclose(dirty.solution.centre[:2], clean.solution.centre[:2], atol=0.25)
    assert clean.log_evidence - dirty.log_evidence < 12.0


@pytest.mark.parametrize(("gap", "way"), [(60.0, 2), (-1000.0, 3)])
def test_a_slip_of_the_decimal_point_is_moved_back_and_is_no_scatter(gap, way):
    table = replace(rows(size=24), slips=np.full((24, 2), [60.0, -1000.0]))
    clean = row_evidence(table, table.scales.initial, 20)
    slip = row_evidence(replace(table, y=table.y + gap * (np.arange(24) == 9)), table.scales.initial, 20)
    assert (clean.bad, slip.bad) == ({}, {9: way})
    np.testing.assert_allclose(slip.solution.u, clean.solution.u, atol=1e-2)
    assert clean.log_evidence - slip.log_evidence == pytest.approx(np.log(999.0), abs=0.1)
