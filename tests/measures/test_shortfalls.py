"""Bounds of what a set-up needs for a measure: their tables, their closed forms, and when they speak."""

from math import nan
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from taichi_erosion.measures import shortfalls
from taichi_erosion.measures.result import Measurement, Shortfall, pool_repeats
from taichi_erosion.measures.threshold import pool_beds

DOE = Path(__file__).parents[2] / "doe"
FUNNEL_GRAIN = 2.795e-3  # m, volume median of the grains of scenes/funnel_repose.toml
COLUMN_GRAIN = 1.5e-3  # m


def heaps(table: str, grain: float) -> pd.DataFrame:
    """Dry heaps of a table: soil, grains, angle, rows on the flank, height over diameter."""
    rows = pd.read_csv(DOE / table).rename(columns={"group": "soil"})
    rows = rows[~rows["soil"].str.contains("adhesion|energy|grain size")]
    cases = rows.pivot_table("value", ["soil", "label", "grains"], "observable", sort=False).reset_index()
    height = cases["pile_height"] / grain
    on_flank = [shortfalls.grain_rows_on_flank(each, 1.0) for each in height]
    return cases.rename(columns={"repose_angle": "angle"}).assign(rows=on_flank, height=height)


FUNNELS = heaps("repose_sensitivity/results.csv", FUNNEL_GRAIN)
COLUMNS = heaps("heap_size/results.csv", COLUMN_GRAIN)


def test_poured_heaps_of_too_few_rows_read_a_third_of_the_angle_of_the_largest():
    largest = FUNNELS.loc[FUNNELS["grains"].idxmax()]
    small = FUNNELS[FUNNELS["rows"] < shortfalls.LEAST_ROWS]
    assert len(small)
    assert small["angle"].max() < largest["angle"] / 3.0
    assert largest["rows"] == pytest.approx(shortfalls.POURED_ROWS, rel=0.02)


def test_columns_of_enough_rows_have_the_angle_of_the_largest_of_their_soil():
    for _, heaps in COLUMNS.groupby("soil"):
        excess = heaps["angle"] - heaps.loc[heaps["grains"].idxmax(), "angle"]
        enough = heaps["rows"] >= shortfalls.COLUMN_ROWS
        assert enough.sum() >= 2
        assert (excess[enough].abs() < 1.25).all()
        assert excess[~enough & (heaps["rows"] > 3.0)].between(1.5, 3.5).all()


@pytest.mark.parametrize("heaps", [FUNNELS, COLUMNS], ids=["funnels", "columns"])
def test_no_heap_of_the_tables_needed_more_grains_than_the_estimate(heaps):
    factor = heaps["grains"] * np.tan(np.radians(heaps["angle"])) ** 2 / heaps["height"] ** 3
    assert factor.max() <= shortfalls.HEAP_FACTOR * 1.01  # the constant has two digits


def flags(found) -> list[tuple[str, bool]]:
    return [(each.flag, each.blocks) for each in found]


@pytest.mark.parametrize(
    ("rows", "grains", "poured", "told"),
    [
        (1.4, 1000, True, [("small_heap", True)]),
        (5.1, 3000, True, [("growing_angle", False)]),
        (4.1, 3000, False, [("growing_angle", False)]),
        (5.1, 3000, False, []),
        (12.0, 40_000, True, []),
    ],
)
def test_a_heap_is_told_its_size_by_its_rows_and_by_how_it_was_made(rows, grains, poured, told):
    assert flags(shortfalls.heap_shortfalls(rows, grains, poured, 33.5, 30.0)) == told


def test_heaps_of_the_tables_with_the_advised_grains_have_the_rows_that_were_lacking():
    checked = 0
    for heaps, poured in ((FUNNELS, True), (COLUMNS, False)):
        for heap in heaps.itertuples():
            for lacking in shortfalls.heap_shortfalls(heap.rows, heap.grains, poured, nan, heap.angle):
                larger = heaps[(heaps["soil"] == heap.soil) & (heaps["grains"] >= lacking.grains)]
                checked += len(larger)
                assert (larger["rows"] >= lacking.needed).all(), lacking
    assert checked >= 3


def test_few_hops_and_few_beds_are_told_and_no_hop_is_no_transport():
    assert flags(shortfalls.hop_shortfalls(12)) == [("few_hops", False)]
    assert flags(shortfalls.surface_shortfalls(6.0, 5.0, 28.0)) == [("unsteady_surface", True)]
    assert flags(shortfalls.surface_shortfalls(6.0, 30.0, nan)) == []
    assert flags(shortfalls.hop_shortfalls(0)) == flags(shortfalls.hop_shortfalls(50)) == []
    ends = [{"low": 0.29 + 0.01 * k, "high": 0.31 + 0.01 * k} for k in range(5)]
    beds = [Measurement("fluid_threshold", 0.3, 0.01, "m s-1", details=each) for each in ends]
    for count, told in ((5, []), (2, [("few_beds", False)]), (1, [("few_beds", False)])):
        assert flags(pool_beds(beds[:count]).shortfalls) == told
    assert flags(pool_beds([Measurement("flux", 1.0, 0.1, "kg m-1 s-1")]).shortfalls) == []


def test_a_shortfall_of_half_of_the_repeats_is_one_of_the_result():
    lacking = Shortfall("small_heap", "too small", 1.0, 3.0, True, 900)
    good = Measurement("repose_angle", 30.0, 1.0, "deg")
    bad = Measurement("repose_angle", 10.0, 1.0, "deg", shortfalls=(lacking,))
    assert pool_repeats([good, bad]).shortfalls == (lacking,)
    assert pool_repeats([good, good, bad]).shortfalls == ()
