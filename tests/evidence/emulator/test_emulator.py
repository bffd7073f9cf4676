"""Scatter of runs that observables of one scene share."""

from typing import Any, cast

import numpy as np
import pytest

from taichi_erosion.evidence.data.problem import Observable
from taichi_erosion.evidence.emulator.emulator import (
    EmulatorInputs,
    ObservableEmulator,
    run_replicates,
    scatter_correlation,
)
from taichi_erosion.evidence.emulator.gaussian_process import ActiveInputs, Points, fit_gaussian_process

RUNS, SCATTER = 80, 0.1


def emulators(rho: float, seed: int, one_scene: bool = True) -> dict[str, ObservableEmulator]:
    """Height and width of runs over two numbers and a condition; width falls where height rises."""
    random = np.random.default_rng(seed)
    x, c = random.standard_normal((RUNS, 2)), random.uniform(-1.5, 1.5, (RUNS, 1))
    smooth = 0.6 * x[:, 0] - 0.3 * x[:, 1] + 0.4 * c[:, 0] + 0.1 * x[:, 0] * c[:, 0]
    errors = random.standard_normal((RUNS, 2)) @ np.linalg.cholesky([[1.0, rho], [rho, 1.0]]).T
    points = Points(x, c, np.zeros((RUNS, 0)))
    active = ActiveInputs(conditions=np.ones((1, 1), bool), numbers=np.ones((1, 2), bool))
    scene, found = cast(Any, object()), {}
    for k, (name, sign) in enumerate((("height", 1.0), ("width", -0.7))):
        process = fit_gaussian_process(points, sign * smooth + SCATTER * errors[:, k], active)
        inputs = EmulatorInputs(scene if one_scene else cast(Any, object()), (), {}, ())
        found[name] = ObservableEmulator(inputs, Observable(name), process, process.scatter, np.arange(RUNS))
    return found


@pytest.mark.parametrize("rho", [0.8, 0.0])
def test_runs_of_one_scene_are_replicates_whose_contrasts_tell_the_correlation_of_the_scatter(rho):
    assert scatter_correlation(*emulators(rho, 0).values())[1] > RUNS / 2
    found = [run_replicates(emulators(rho, seed)) for seed in range(3)]
    assert found[0].names == ("height", "width")
    np.testing.assert_allclose([each.sd for each in found], SCATTER, rtol=0.3)
    error = (1.0 - rho**2) / np.sqrt(3 * RUNS / 2)  # of the mean of three samples
    assert np.mean([each.correlation[0, 1] for each in found]) == pytest.approx(rho, abs=3.0 * error)
    assert run_replicates(emulators(rho, 0, one_scene=False)) is None
