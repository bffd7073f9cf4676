"""Errors that emulators of one scene share: their covariance against draws, and several alike observables."""

from typing import Any, cast

import numpy as np
import pytest

from taichi_erosion.evidence.data.problem import Observable
from taichi_erosion.evidence.emulator import emulator, gaussian_process

RUNS, SCATTER, DRAWS = 40, 0.15, 20000
READS = gaussian_process.ActiveInputs(np.ones((2, 1), bool), np.ones((2, 1), bool))
AT = gaussian_process.Points(np.array([[0.3], [-1.2]]), np.array([[0.5], [-0.4]]), np.array([[1.5], [3.0]]))


@pytest.fixture(scope="module")
def joint() -> gaussian_process.JointErrors:
    """Two observables that an effect moves in opposite senses, with correlated scatter; one lacks runs."""
    random = np.random.default_rng(5)
    psi = np.where(np.arange(RUNS) < RUNS // 2, 0.0, random.uniform(0.5, 4.0, RUNS))
    x, c = random.uniform(-2.0, 2.0, (RUNS, 1)), random.uniform(-1.5, 1.5, (RUNS, 1))
    at = gaussian_process.Points(x, c, psi[:, np.newaxis])
    smooth = 0.5 * at.x[:, 0] + 0.8 * np.tanh(at.psi[:, 0]) * (1.0 + 0.3 * at.c[:, 0])
    errors = random.standard_normal((RUNS, 2)) @ np.linalg.cholesky([[1.0, 0.9], [0.9, 1.0]]).T
    known = [np.arange(RUNS), np.delete(np.arange(RUNS), [3, 30, 35])]
    values = [smooth + SCATTER * errors[:, 0], -0.6 * smooth + SCATTER * errors[:, 1]]
    points = [gaussian_process.Points(at.x[own], at.c[own], at.psi[own]) for own in known]
    seen = [value[own] for own, value in zip(known, values, strict=True)]
    processes = map(gaussian_process.fit_gaussian_process, points, seen, [READS] * 2)
    return gaussian_process.joint_errors(list(processes), known)


def test_observables_that_move_alike_have_errors_that_hang_together(joint):
    bend, effect, scatter = joint.correlation[1], joint.correlation[2], joint.correlation[-1]
    assert effect[0, 1] < -0.8
    assert scatter[0, 1] > 0.6
    assert abs(bend[0, 1]) <= 1.0
    found = joint.joint_error_covariance([(0, AT), (1, AT)])
    assert np.linalg.eigvalsh(found)[0] > -1e-12
    assert abs(found[1, 3]) > 0.2 * np.sqrt(found[1, 1] * found[3, 3])


def test_the_covariance_is_that_of_drawn_errors(joint):
    random, which = np.random.default_rng(8), np.repeat([0, 1], 2)
    at = gaussian_process.Values(AT, np.tile([0, 1], 2), which)
    cross = joint.prior_cov(at, joint.all_values)
    whole = np.block([[joint.prior_cov(at, at), cross], [cross.T, joint.training_value_covariance]])
    drawn = random.multivariate_normal(np.zeros(len(whole)), whole, DRAWS, method="eigh")
    asked = [(0, AT), (1, AT)]
    errors = drawn[:, :4] - drawn[:, 4:] @ joint.training_value_weights(asked).T
    width = np.array([process.width for process in joint.processes])[which]
    lack = np.zeros((4, 4))
    for place, own in ((0, slice(0, 2)), (1, slice(2, 4))):
        lack[own, own] = joint.processes[place].lack_of_fit_covariance(AT)
    found = joint.joint_error_covariance(asked) - lack
    sd = np.sqrt(np.diag(found))
    error = 4.0 * np.outer(sd, sd) * np.sqrt(2.0 / DRAWS)
    assert np.all(np.abs(np.cov((errors * width).T) - found) < error)


MANY, SMALL = 80, 0.1  # runs, and their scatter


def emulators(rho: float, seed: int, one_scene: bool = True) -> dict[str, emulator.ObservableEmulator]:
    """Height and width of runs over two numbers and a condition; width falls where height rises."""
    random = np.random.default_rng(seed)
    x, c = random.standard_normal((MANY, 2)), random.uniform(-1.5, 1.5, (MANY, 1))
    smooth = 0.6 * x[:, 0] - 0.3 * x[:, 1] + 0.4 * c[:, 0] + 0.1 * x[:, 0] * c[:, 0]
    errors = random.standard_normal((MANY, 2)) @ np.linalg.cholesky([[1.0, rho], [rho, 1.0]]).T
    points = gaussian_process.Points(x, c, np.zeros((MANY, 0)))
    active = gaussian_process.ActiveInputs(conditions=np.ones((1, 1), bool), numbers=np.ones((1, 2), bool))
    scene, found = cast(Any, object()), {}
    for k, (name, sign) in enumerate((("height", 1.0), ("width", -0.7))):
        process = gaussian_process.fit_gaussian_process(points, sign * smooth + SMALL * errors[:, k], active)
        inputs = emulator.EmulatorInputs(scene if one_scene else cast(Any, object()), (), {}, ())
        found[name] = emulator.ObservableEmulator(
            inputs, Observable(name), process, process.scatter, np.arange(MANY)
        )
    return found


@pytest.mark.parametrize("rho", [0.8, 0.0])
def test_contrasts_of_runs_tell_the_correlation_of_the_scatter(rho):
    found = np.array([emulator.scatter_correlation(*emulators(rho, seed).values()) for seed in range(3)])
    error = (1.0 - rho**2) / np.sqrt(found[:, 1].sum())  # of the mean of three samples
    assert np.all(found[:, 1] > MANY / 2)
    assert abs(found[:, 0].mean() - rho) < 3.0 * error


def test_runs_of_one_scene_are_replicates_of_two_observables():
    found = emulator.replicate_scatter(emulators(0.8, 0))
    assert found.names == ("height", "width")
    np.testing.assert_allclose(found.sd, SMALL, rtol=0.3)
    assert found.correlation[0, 1] == pytest.approx(0.8, abs=0.15)  # 59 degrees of freedom: sd 0.05
    assert emulator.replicate_scatter(emulators(0.8, 0, one_scene=False)) is None
