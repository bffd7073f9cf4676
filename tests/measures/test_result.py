"""Repeats become a mean and the spread of single repeats."""

import json
from math import nan

from taichi_erosion.measures.result import Measurement, as_record, no_measurement, pool_repeats


def angle(value, sd=nan, **more):
    return Measurement("repose_angle", value, sd, "deg", **more)


def test_repeats_are_pooled_with_the_sd_of_single_ones_and_their_flags_are_counted():
    flagged = angle(34.0, 0.1, details={"flags": ["curved"]})
    pooled = pool_repeats([angle(30.0, 0.1), angle(32.0, 0.1, details={"flags": []}), flagged])
    assert (pooled.value, pooled.sd, pooled.n, pooled.unit) == (32.0, 2.0, 3, "deg")
    assert pooled.details["flags"] == {"curved": 1}


def test_a_repeat_without_a_heap_is_left_out_and_told():
    pooled = pool_repeats([angle(30.0), no_measurement("repose_angle", "deg", "no grains"), angle(32.0)])
    assert (pooled.value, pooled.n) == (31.0, 2)
    assert pooled.notes == ("1 of 3 repeats gave no value", "no grains")


def test_a_record_is_strict_json():
    record = as_record(angle(nan, details={"nested": [1.0, float("inf"), (2.0,)]}))
    assert json.loads(json.dumps(record, allow_nan=False))["details"] == {"nested": [1.0, None, [2.0]]}
    assert record["value"] is None
