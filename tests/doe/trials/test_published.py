"""Published series: folds hold every source once, a vault nothing else; closed forms keep their limits."""

from collections import Counter

import numpy as np
import pytest

from doe.trials.published import models
from doe.trials.published.folds import Fold, folds, write_study
from taichi_erosion.core.setup import Floats
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.load_study import load_study

SEEDS = np.arange(3)


def test_there_are_more_than_six_series_of_two_sources_and_more():
    counts = Counter(fold.series for fold in folds())
    assert len(counts) >= 6
    assert min(counts.values()) >= 2


@pytest.mark.parametrize("fold", list(folds()), ids=lambda fold: f"{fold.series}_{fold.number}")
def test_the_vault_of_a_fold_is_one_source(fold: Fold, tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("doe.trials.published.folds.FOLDER", tmp_path)
    write_study(fold)
    problem = load_study(fold.study).problem
    assert set(problem.measurements_in_vault().source) == {fold.source}
    assert fold.source not in problem.visible_rows().source


def asked(observable: str, at: dict[str, list[float]], given: dict[str, float], **effects: float) -> Floats:
    conditions = {name: np.array(column) for name, column in at.items()}
    found = models.predict(observable, conditions, given, effects, SEEDS)
    assert (found == found[0]).all()
    return found[0]


def test_thresholds_and_flux_are_those_of_the_reduced_model_and_the_impact_threshold_a_share():
    at, given = {"diameter": [1e-4, 1e-3]}, {"threshold_coefficient": 0.09}
    for name, effects in (("threshold_u_star", {"dry_cohesion": 1.0}), ("flux", {"gusts": 0.5})):
        want = reduced.model_mean(name, {"diameter": np.array(at["diameter"])}, given, effects)
        assert asked(name, at, given, **effects) == pytest.approx(want)
    stated = given | {"threshold_ratio": 0.8}
    names = ("fluid_threshold_u_star", "impact_threshold_u_star")
    fluid, impact = (asked(name, at, stated, dry_cohesion=1.0) for name in names)
    assert impact == pytest.approx(0.8 * fluid)


def test_unstable_air_has_a_slower_wind_at_the_same_stress_and_neutral_air_has_not():
    at = {"activity": [0.0, 0.0], "stability": [0.0, -0.1]}
    neutral, unstable = asked("threshold_wind_speed", at, {"threshold_wind": 6.0}, unstable_air=1.0)
    assert neutral == pytest.approx(6.0)
    # the integral of (1 - (1 - 16 z)^(-1/4)) / z from 0 to 0.1 is Psi_m
    z = np.linspace(1e-7, 0.1, 200_001)
    shift = np.trapezoid((1.0 - (1.0 + 16.0 * z) ** -0.25) / z, z)
    log_height = np.log(30.0 * models.ANEMOMETER / models.OCEANO_DIAMETER)
    assert unstable == pytest.approx(6.0 * (1.0 - shift / log_height), rel=1e-4)


@pytest.mark.parametrize("effects", [{}, {"many_heights": 0.4}, {"low_hops": 1.0}])
def test_the_traps_of_a_whole_profile_hold_the_whole_flux(effects):
    edges = np.concatenate([[0.0], np.geomspace(1e-3, 1e4, 200)])
    at = {"trap_bottom": edges[:-1].tolist(), "trap_top": edges[1:].tolist()}
    density = asked("flux_density_share", at, {"layer_height": 0.08}, **effects)
    assert np.sum(density * np.diff(edges)) == pytest.approx(1.0, abs=1e-6)
