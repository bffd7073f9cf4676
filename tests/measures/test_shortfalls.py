"""Bounds of what a set-up needs for a measure: their tables, their closed forms, and when they speak."""

from csv import DictReader
from math import nan, radians, tan
from pathlib import Path
from typing import Any

import pytest

from taichi_erosion.measures import shortfalls
from taichi_erosion.measures.result import Measurement, Shortfall, pool
from taichi_erosion.measures.threshold import pool_beds

DOE = Path(__file__).parents[2] / "doe"
FUNNEL_GRAIN = 2.795e-3  # m, volume median of the grains of scenes/funnel_repose.toml
COLUMN_GRAIN = 1.5e-3  # m


def heaps(table: str, grain: float) -> list[dict[str, Any]]:
    """Dry heaps of a table: grains, angle, rows on the flank, height over diameter."""
    found: dict[tuple[str, str], dict[str, str]] = {}
    counts: dict[tuple[str, str], int] = {}
    with (DOE / table).open(encoding="utf-8", newline="") as file:
        for row in DictReader(file):
            found.setdefault((row["group"], row["label"]), {})[row["observable"]] = row["value"]
            counts[row["group"], row["label"]] = int(row["grains"])
    kept = []
    for case, values in found.items():
        if "adhesion" in case[0] or "energy" in case[0] or "grain size" in case[0]:
            continue
        height = float(values["pile_height"]) / grain
        rows = shortfalls.flank_rows(height, 1.0)
        angle = float(values["repose_angle"])
        found_of = {"soil": case[0], "grains": counts[case], "angle": angle, "rows": rows, "height": height}
        kept.append(found_of)
    return kept


FUNNELS = heaps("repose_sensitivity/results.csv", FUNNEL_GRAIN)
COLUMNS = heaps("heap_size/results.csv", COLUMN_GRAIN)


def test_poured_heaps_of_too_few_rows_read_a_third_of_the_angle_of_the_largest():
    largest = max(FUNNELS, key=lambda heap: heap["grains"])
    small = [heap for heap in FUNNELS if heap["rows"] < shortfalls.LEAST_ROWS]
    assert small
    assert all(heap["angle"] < largest["angle"] / 3.0 for heap in small)
    assert largest["rows"] == pytest.approx(shortfalls.POURED_ROWS, rel=0.02)


def test_the_stated_angles_of_poured_heaps_are_those_of_the_table():
    told = [(28.0, 5.0), (30.0, 7.0), (36.0, 10.0)]
    for angle, rows in told:
        near = [heap for heap in FUNNELS if abs(heap["rows"] - rows) < 0.5]
        assert any(heap["angle"] == pytest.approx(angle, abs=0.5) for heap in near)


def test_columns_of_enough_rows_have_the_angle_of_the_largest_of_their_soil():
    for soil in {heap["soil"] for heap in COLUMNS}:
        heaps = [heap for heap in COLUMNS if heap["soil"] == soil]
        largest = max(heaps, key=lambda heap: heap["grains"])
        enough = [heap for heap in heaps if heap["rows"] >= shortfalls.COLUMN_ROWS]
        fewer = [heap for heap in heaps if 3.0 < heap["rows"] < shortfalls.COLUMN_ROWS]
        assert len(enough) >= 2
        assert all(abs(heap["angle"] - largest["angle"]) < 1.25 for heap in enough)
        assert all(1.5 < heap["angle"] - largest["angle"] < 3.5 for heap in fewer)


def test_no_heap_of_the_tables_needed_more_grains_than_the_estimate():
    for heap in (*FUNNELS, *COLUMNS):
        factor = heap["grains"] * tan(radians(heap["angle"])) ** 2 / heap["height"] ** 3
        assert factor <= shortfalls.HEAP_FACTOR * 1.01  # the constant has two digits


@pytest.mark.parametrize("rows", [1.0, 3.0, 5.0, 8.0, 20.0])
def test_the_height_for_some_rows_has_as_many(rows):
    assert shortfalls.flank_rows(shortfalls.height_for(rows), 1.0) == pytest.approx(rows)


def test_a_flatter_or_larger_heap_needs_more_grains():
    assert shortfalls.grains_for(3.0, 20.0) > shortfalls.grains_for(3.0, 35.0)
    assert shortfalls.grains_for(6.0, 30.0) > 3.0 * shortfalls.grains_for(3.0, 30.0)


def flags(found) -> list[tuple[str, bool]]:
    return [(each.flag, each.blocks) for each in found]


def test_a_heap_is_told_its_size_by_its_rows_and_by_how_it_was_made():
    assert flags(shortfalls.heap_shortfalls(1.4, 1000, True, 33.5, 11.0)) == [("small_heap", True)]
    assert flags(shortfalls.heap_shortfalls(5.1, 3000, True, 33.5, 29.7)) == [("growing_angle", False)]
    assert flags(shortfalls.heap_shortfalls(4.1, 3000, False, 33.5, 29.7)) == [("growing_angle", False)]
    assert flags(shortfalls.heap_shortfalls(5.1, 3000, False, 33.5, 29.7)) == []
    assert flags(shortfalls.heap_shortfalls(12.0, 40_000, True, 33.5, 36.0)) == []


@pytest.mark.parametrize("poured", [True, False])
def test_the_advice_is_for_the_rows_that_are_told_and_for_the_measured_angle(poured):
    (known,) = shortfalls.heap_shortfalls(1.4, 500, poured, 33.5, 3.6)
    (unknown,) = shortfalls.heap_shortfalls(1.4, 500, poured, nan, nan)
    assert known.needed == shortfalls.LEAST_ROWS
    assert known.grains == shortfalls.grains_for(shortfalls.LEAST_ROWS, 33.5)
    assert unknown.grains == shortfalls.grains_for(shortfalls.LEAST_ROWS, shortfalls.USUAL_ANGLE)
    assert known.sentence.endswith(
        f"1.4 of 3 rows of grains on its flank; use at least {known.grains:,} grains (500 now)"
    )


def test_a_heap_flatter_than_its_angle_is_advised_the_grains_of_its_own_shape():
    (flat,) = shortfalls.heap_shortfalls(2.0, 90_000, False, 60.0, 60.0)
    assert shortfalls.flank_rows(shortfalls.height_for(2.0), 1.0) == pytest.approx(2.0)
    larger = (shortfalls.height_for(3.0) / shortfalls.height_for(2.0)) ** 3
    assert 90_000 * larger <= flat.grains <= 1.1 * 90_000 * larger  # two digits, rounded up


def test_heaps_of_the_tables_with_the_advised_grains_have_the_rows_that_were_lacking():
    checked = 0
    for heaps, poured in ((FUNNELS, True), (COLUMNS, False)):
        for heap in heaps:
            found = shortfalls.heap_shortfalls(heap["rows"], heap["grains"], poured, nan, heap["angle"])
            for lacking in found:
                larger = [h for h in heaps if h["soil"] == heap["soil"] and h["grains"] >= lacking.grains]
                checked += len(larger)
                assert all(each["rows"] >= lacking.needed for each in larger), lacking
    assert checked >= 3


def test_few_hops_are_told_and_no_hop_is_no_transport():
    assert flags(shortfalls.hop_shortfalls(12)) == [("few_hops", False)]
    assert flags(shortfalls.hop_shortfalls(0)) == flags(shortfalls.hop_shortfalls(50)) == []


def test_a_threshold_of_few_beds_is_told():
    beds = [
        Measurement("fluid_threshold", 0.3, 0.01, "m s-1", details={"low": 0.29 + k, "high": 0.31 + k})
        for k in (0.0, 0.01, 0.02, 0.03, 0.04)
    ]
    assert flags(pool_beds(beds).shortfalls) == []
    assert (
        flags(pool_beds(beds[:2]).shortfalls)
        == flags(pool_beds(beds[:1]).shortfalls)
        == [("few_beds", False)]
    )
    assert flags(pool_beds([Measurement("flux", 1.0, 0.1, "kg m-1 s-1")]).shortfalls) == []


def test_a_shortfall_of_half_of_the_repeats_is_one_of_the_result():
    lacking = Shortfall("small_heap", "too small", 1.0, 3.0, True, 900)
    good = Measurement("repose_angle", 30.0, 1.0, "deg")
    bad = Measurement("repose_angle", 10.0, 1.0, "deg", shortfalls=(lacking,))
    assert pool([good, bad]).shortfalls == (lacking,)
    assert pool([good, good, bad]).shortfalls == ()
