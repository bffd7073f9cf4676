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
def test_contrasts_of_runs_tell_the_correlation_of_the_scatter(rho):
    found = np.array([scatter_correlation(*emulators(rho, seed).values()) for seed in range(3)])
    error = (1.0 - rho**2) / np.sqrt(found[:, 1].sum())  # of the mean of three samples
    assert np.all(found[:, 1] > RUNS / 2)
    assert abs(found[:, 0].mean() - rho) < 3.0 * error


def test_runs_of_one_scene_are_replicates_of_two_observables():
    found = run_replicates(emulators(0.8, 0))
    assert found.names == ("height", "width")
    np.testing.assert_allclose(found.sd, SCATTER, rtol=0.3)
    assert found.correlation[0, 1] == pytest.approx(0.8, abs=0.15)  # 59 degrees of freedom: sd 0.05
    assert run_replicates(emulators(0.8, 0, one_scene=False)) is None
