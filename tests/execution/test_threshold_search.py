"""The order in which winds blow over a bed, against beds whose thresholds are known."""

from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from measures.heaps import snapshot_of

from taichi_erosion.core.snapshot import AirProfile
from taichi_erosion.execution import threshold_search
from taichi_erosion.execution.threshold_search import ThresholdSearch, does_bed_move, record_grain_motion
from taichi_erosion.scene import Scene, load_scene

SCENE = Path(__file__).parents[2] / "scenes" / "wind_threshold.toml"
FIRST = 0.1  # m s-1


@pytest.fixture(scope="module")
def scene() -> Scene:
    words = [
        "threshold.rise=0.05",
        "threshold.fall=0.05",
        "threshold.levels=3",
        "threshold.share=0.01",
        f"threshold.first={FIRST}",
    ]
    return load_scene(SCENE, [*words, "measure.impact_threshold={}"])


def trial(friction_velocity: float, grains: int = 1) -> threshold_search.Trial:
    start = np.zeros((grains, 3))
    nothing = np.zeros(grains, dtype=bool)
    return threshold_search.Trial(
        friction_velocity, 0.0, start, start, nothing, nothing, flux=[friction_velocity**2]
    )


def searched(scene: Scene, rolls: float, ramp: float, leaves: float, rests: float) -> ThresholdSearch:
    """Search in a bed that rolls, leaves the ramp, leaves from rest and comes to rest at given winds."""
    search, shares = ThresholdSearch(scene, {}, trial(FIRST)), [0.0]
    for number in range(200):
        now = search.trial.friction_velocity
        shares.append(search.share_done(number * scene.threshold.hold))
        assert shares[-2] <= shares[-1] <= 1.0
        moved = now >= {"ramp": ramp, "hold": leaves, "start": 0.0, "fall": rests}[search.phase]
        search.trial.rolling = np.full(search.grains_needed, now >= rolls)
        next_wind = threshold_search.NEXT_WIND[search.phase](search, moved)
        if next_wind is None:
            assert "impact_threshold" not in search.brackets or shares[-1] > 0.8
            return search
        search.trial = trial(next_wind)
    raise AssertionError("the search does not end")


@pytest.mark.parametrize("leaves", [0.13, 0.2, 0.29])
def test_the_brackets_hold_the_thresholds_and_are_as_narrow_as_asked(scene: Scene, leaves: float):
    search = searched(scene, rolls=0.12, ramp=0.2, leaves=leaves, rests=0.1)
    fluid, impact = search.brackets["fluid_threshold"], search.brackets["impact_threshold"]
    rolling = search.brackets["rolling_onset"]
    assert fluid.low < leaves <= fluid.high
    assert 1.0 < fluid.high / fluid.low <= 1.05 ** (1.0 / 2**3) * (1.0 + 1e-6)
    assert impact.low < 0.1 <= impact.high
    assert impact.low / impact.high == pytest.approx(0.95)
    assert rolling.low < 0.12 <= rolling.high


def test_a_bed_that_rolls_in_the_first_wind_has_no_onset_of_rolling(scene: Scene):
    assert "rolling_onset" not in searched(scene, rolls=0.0, ramp=0.2, leaves=0.2, rests=0.1).brackets


def test_a_bed_that_moves_in_any_wind_has_no_threshold_and_the_search_ends(scene: Scene):
    assert set(searched(scene, rolls=0.12, ramp=0.2, leaves=0.0, rests=0.1).brackets) == {"rolling_onset"}


def test_where_transport_is_named_only_its_end_is_looked_for(scene: Scene):
    named = scene.threshold.model_copy(update={"transport": 0.2})
    search = ThresholdSearch(scene.model_copy(update={"threshold": named}), {}, trial(0.2))
    search.phase, winds = "start", []
    search.trial.flux = [0.2**2 - 0.09**2]
    while (
        next_wind := threshold_search.NEXT_WIND[search.phase](search, search.trial.friction_velocity >= 0.1)
    ) is not None:
        winds.append(next_wind)
        search.trial = trial(next_wind)
        search.trial.flux = [next_wind**2 - 0.09**2]
    assert winds == pytest.approx([0.2 * 0.95**k for k in range(1, len(winds) + 1)])
    assert set(search.brackets) == {"impact_threshold", "impact_threshold_linear"}
    assert search.brackets["impact_threshold"].low < 0.1 <= search.brackets["impact_threshold"].high
    assert search.brackets["impact_threshold_linear"].middle == pytest.approx(0.09, rel=1e-6)


def test_a_grain_that_crosses_the_edge_of_the_patch_has_not_rolled(scene: Scene):
    search = ThresholdSearch(scene, {}, trial(0.2, grains=2))
    search.trial.start = search.trial.last = np.array([[1e-6, 0.0, 0.0], [1e-4, 0.0, 0.0]])
    far = 1.1 * search.diameter
    moved = np.array([[scene.wind.length - 1e-6, 0.0, 0.0], [1e-4, far, 0.0]])
    record_grain_motion(search, snapshot_of(moved))
    assert search.trial.rolling.tolist() == [False, True]
    assert not search.trial.risen.any()
    record_grain_motion(search, snapshot_of(moved + np.array([[0.0, 0.0, far], [0.0, 0.0, 0.0]])))
    assert search.trial.risen.tolist() == [True, False]
    # what once rolled has rolled, also after the wind has brought it back
    record_grain_motion(search, snapshot_of(search.trial.start))
    assert search.trial.rolling.tolist() == [False, True]


def test_a_bed_is_at_rest_early_only_in_a_steady_wind_and_moves_with_the_grains_asked_for(scene: Scene):
    search = ThresholdSearch(scene, {}, trial(0.2))
    search.phase, search.trial.largest_motion = "hold", 0.0
    half = 0.5 * scene.threshold.hold
    assert does_bed_move(search, half, steady=True) is False
    assert does_bed_move(search, half, steady=False) is None
    assert does_bed_move(search, scene.threshold.hold, steady=False) is False
    search.trial.largest_motion = search.diameter
    assert does_bed_move(search, half, steady=True) is None
    # it moves when as many grains left as are asked for: one percent of 25 by 8 diameters are two, not three
    search = ThresholdSearch(load_scene(SCENE.with_name("quartz_wind.toml")), {}, trial(0.2, grains=10))
    search.phase = "hold"
    search.trial.risen = np.arange(10) < 1
    assert does_bed_move(search, 0.0, steady=True) is None
    search.trial.risen = np.arange(10) < 2
    assert does_bed_move(search, 0.0, steady=True) is True


def test_grains_that_left_are_carried_off_before_they_land(scene: Scene, monkeypatch: pytest.MonkeyPatch):
    assert scene.wind is not None
    search, height, beds = ThresholdSearch(scene, {}, trial(0.2, grains=4)), scene.wind.height, []
    search.trial.risen = np.array([True, False, False, True])
    search.trial.last = np.outer([1.0, 0.9, 0.2, 0.01], [0.0, 0.0, height])
    order, ones = np.array([2, 3, 0, 1]), np.ones((4, 3))
    bed = {"ident": order, "origin": search.trial.last[order], "velocity": ones, "spin": ones.copy()}
    air = AirProfile(np.array([0.0, height, 2.0 * height]), np.full((2, 2), 3.0), *np.zeros((4, 2)))
    monkeypatch.setattr(threshold_search, "export_bed", lambda *_: bed)
    monkeypatch.setattr(threshold_search, "air_profile", lambda *_: air)
    monkeypatch.setattr(threshold_search, "import_bed", lambda *words: beds.append(words[2]))
    threshold_search.lift_grains_that_left_bed(cast(Any, None), 0, search)
    assert beds[0]["origin"][:, 2] == pytest.approx(height * np.array([0.2, 0.9, 0.6, 0.9]))
    assert beds[0]["velocity"].tolist() == [[1, 1, 1], [3, 0, 0], [3, 0, 0], [1, 1, 1]]
    search.trial.last = beds[0]["origin"][np.argsort(order)]
    threshold_search.lift_grains_that_left_bed(cast(Any, None), 0, search)
    assert len(beds) == 1
