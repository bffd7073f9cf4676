"""The rule by which a law of drag becomes the default, on measures whose answer is known."""

from math import log, nan

import numpy as np
import pytest

from doe.drag_law.claims import ALONE, HINDERED
from doe.drag_law.decide import becomes_default, judged
from doe.drag_law.measures import Measure, Numbers, stress_measure
from doe.drag_law.run import PAGE, tables
from taichi_erosion.report.markdown import fill_tables

BAND = (0.8, 1.2)


def measure(alone: list[float], hindered: list[float], error: float, largest: float | None = None) -> Measure:
    """Rows that are off by these ratios, with a relative error."""
    by_law = {
        law: Numbers(np.log(ratios), np.full(len(ratios), error))
        for law, ratios in ((ALONE, alone), (HINDERED, hindered))
    }
    rows = tuple(map(str, range(len(alone))))
    band = None if largest is not None else BAND
    return Measure("m", rows, by_law, lambda logs: logs, band, largest)


FAR, NEAR = [1.5, 1.5, 1.6], [1.1, 1.1, 1.05]


def test_a_measure_speaks_for_the_law_that_is_closer_where_errors_let_it():
    assert judged(measure(FAR, NEAR, 0.02)).speaks_for == HINDERED
    assert judged(measure(NEAR, FAR, 0.02)).speaks_for == ALONE
    assert judged(measure(FAR, NEAR, 0.6)).speaks_for == ""


def test_the_interval_of_a_difference_is_that_of_small_errors():
    # rms of one row is |misfit|, so both errors add as squares
    found, low, high = judged(measure([1.5], [1.1], 0.02)).difference
    assert found == pytest.approx(log(1.1) - log(1.5))
    assert high - low == pytest.approx(2 * 1.96 * 0.02 * 2**0.5, rel=0.1)


def test_a_row_fails_where_its_whole_interval_is_beyond_what_is_asked_for():
    one = judged(measure([1.25, 1.0], [1.5, 1.0], 0.05))
    assert (one.fails(ALONE), one.fails(HINDERED)) == (False, True)
    assert (one.within(ALONE), one.within(HINDERED)) == (1, 1)


def test_a_figure_that_is_asked_for_fails_where_its_interval_lies_above():
    one = judged(measure(FAR, NEAR, 0.02, largest=0.1))
    assert (one.fails(ALONE), one.fails(HINDERED)) == (True, False)


def test_the_default_changes_with_two_measures_ahead_and_nothing_lost():
    ahead, against = judged(measure(FAR, NEAR, 0.02)), judged(measure(NEAR, FAR, 0.02))
    neither = judged(measure(NEAR, NEAR, 0.02))
    assert becomes_default([ahead, ahead, neither])[0]
    assert not becomes_default([ahead, neither, neither])[0]
    assert not becomes_default([ahead, ahead, ahead, against])[0]  # a measure fails under it alone
    both_fail = judged(measure(FAR, [1.9, 1.9, 1.9], 0.02))
    assert becomes_default([ahead, ahead, ahead, both_fail])[0]


def test_a_missing_row_keeps_the_default():
    ahead = judged(measure(FAR, NEAR, 0.02))
    lacking = judged(measure(FAR, [nan, 1.1, 1.05], 0.02))
    assert lacking.known == 2
    changes, told = becomes_default([ahead, ahead, ahead, lacking])
    assert not changes
    assert told == "rows are missing of: m"


def test_stresses_are_compared_with_the_mean_of_their_sand():
    stress = stress_measure()
    misfits = stress.misfits(stress.simulated[ALONE].logs).reshape(4, -1)
    assert misfits.mean(axis=1) == pytest.approx(np.zeros(4), abs=1e-12)


def test_the_page_shows_the_tables_that_the_studies_make():
    text = PAGE.read_text(encoding="utf-8")
    assert fill_tables(text, tables()) == text
