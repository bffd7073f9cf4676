"""Diameters follow the stated distribution."""

from math import sqrt
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter
from scipy.stats import kstest, truncnorm

from taichi_erosion.scene.preparation import sizes
from taichi_erosion.scene.preparation.fill import stream
from taichi_erosion.scene.schema.grains import Size

MANY = 200_000
COARSE = {"law": "sieve", "table": "hao2022", "low": 0.25e-3, "high": 2e-3, "scale": 4.0}
NARROW = {"law": "sieve", "rows": ((1e-3, 2e-3, 30.0), (2e-3, 3e-3, 60.0), (4e-3, 5e-3, 10.0))}
BROAD = {"law": "lognormal", "median": 1e-3, "sigma_log": 0.4, "low": 0.4e-3, "high": 2e-3}


def size_of(table: dict[str, Any]) -> Any:
    return TypeAdapter(Size).validate_python(table)


def drawn(table: dict[str, Any], count: int = MANY, seed: int = 1) -> np.ndarray:
    return sizes.sample_diameters(size_of(table), count, stream(seed, "diameters"))


@pytest.mark.parametrize("table", [COARSE, NARROW])
def test_the_mass_on_each_sieve_is_that_of_the_table(table: dict[str, Any]):
    diameter = drawn(table)
    for low, high, share in sizes.sieve_classes(size_of(table)):
        caught = np.where((diameter >= low) & (diameter < high), diameter**3, 0.0)
        # standard error of a ratio of sums over independent grains; 4 of them fail once in 16,000 classes
        error = sqrt(np.var(caught - share * diameter**3) * len(diameter)) / np.sum(diameter**3)
        assert np.sum(caught) / np.sum(diameter**3) == pytest.approx(share, abs=4.0 * error)
        assert error < 0.01


def test_inside_a_class_mass_is_uniform_over_the_logarithm_of_the_diameter():
    diameter = drawn({"law": "sieve", "rows": ((1e-3, 2e-3, 1.0),)})
    mass, edges = np.histogram(np.log2(diameter / 1e-3), bins=4, range=(0.0, 1.0), weights=diameter**3)
    # the heaviest bin holds 13,000 grains, whose mass spreads by 15 %: 4 standard errors are 3.5 %
    assert mass / mass.sum() == pytest.approx(np.diff(edges), rel=0.035)


def test_a_lognormal_law_is_truncated_and_not_clipped():
    size, diameter = size_of(BROAD), drawn(BROAD, 20_000)
    a, b = (np.log(edge / size.median) / size.sigma_log for edge in (size.low, size.high))
    assert kstest(np.log(diameter / size.median) / size.sigma_log, truncnorm(a, b).cdf).pvalue > 1e-3
    assert size.low < diameter.min() < diameter.max() < size.high


@pytest.mark.parametrize("table", [COARSE, NARROW, BROAD, {"law": "monodisperse", "diameter": 1e-3}])
def test_the_mean_volume_is_that_of_the_sample(table: dict[str, Any]):
    cube = drawn(table) ** 3
    assert sizes.mean_cube(size_of(table)) == pytest.approx(
        cube.mean(), abs=4.0 * cube.std() / sqrt(MANY) + 1e-24
    )


@pytest.mark.parametrize("table", [COARSE, NARROW, BROAD])
def test_no_grain_lies_outside_the_stated_range(table: dict[str, Any]):
    low, high = sizes.size_range(size_of(table))
    diameter = drawn(table)
    assert low <= diameter.min() < 1.02 * low
    assert 0.9 * high < diameter.max() <= high


def test_the_nominal_diameter_of_a_sieve_curve_halves_the_mass():
    # 30 % below 2 mm, 90 % below 3 mm: half lies a third of the way up the second class, in logarithms
    assert sizes.nominal_diameter(size_of(NARROW)) == pytest.approx(2e-3 * 1.5 ** (20.0 / 60.0))


def test_coarse_graining_magnifies_every_class_and_keeps_the_masses_and_a_cut_shares_them_by_logarithm():
    plain, coarse = (sizes.sieve_classes(size_of(COARSE | more)) for more in ({"scale": 1.0}, {}))
    assert coarse[:, :2] == pytest.approx(4.0 * plain[:, :2])
    assert coarse[:, 2] == pytest.approx(plain[:, 2])
    cut = size_of({"law": "sieve", "rows": ((1e-3, 4e-3, 8.0), (4e-3, 8e-3, 4.0)), "low": 2e-3})
    assert sizes.sieve_classes(cut)[:, 2] == pytest.approx([0.5, 0.5])


def test_the_published_sieve_table_is_shipped_as_printed():
    assert sizes.shipped_tables() == ["hao2022"]
    rows = np.array(sizes.table_rows("hao2022"))
    assert rows[:, 2].tolist() == [52.96, 18.56, 8.53, 2.83, 16.93]
    assert rows[:, 2].sum() == pytest.approx(99.81)
    assert rows[1:, 0].tolist() == rows[:-1, 1].tolist() == [0.25e-3, 0.5e-3, 1e-3, 2e-3]
