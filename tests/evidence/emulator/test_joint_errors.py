"""Errors that emulators of one scene share: their covariance against draws, and several alike observables."""

import numpy as np
import pytest

from taichi_erosion.evidence.emulator import gaussian_process as module
from taichi_erosion.evidence.emulator.gaussian_process import (
    ActiveInputs,
    JointErrors,
    Points,
    fit_gaussian_process,
    joint_errors,
)

RUNS, SCATTER, DRAWS = 40, 0.15, 20000
READS = ActiveInputs(np.ones((2, 1), bool), np.ones((2, 1), bool))
ASKED = Points(np.array([[0.3], [-1.2]]), np.array([[0.5], [-0.4]]), np.array([[1.5], [3.0]]))


def points(random: np.random.Generator) -> Points:
    psi = np.where(np.arange(RUNS) < RUNS // 2, 0.0, random.uniform(0.5, 4.0, RUNS))
    columns = random.uniform(-2.0, 2.0, (RUNS, 1)), random.uniform(-1.5, 1.5, (RUNS, 1)), psi[:, np.newaxis]
    return Points(*columns)


@pytest.fixture(scope="module")
def joint() -> JointErrors:
    """Two observables that an effect moves in opposite senses, with correlated scatter; one lacks runs."""
    random = np.random.default_rng(5)
    at = points(random)
    smooth = 0.5 * at.x[:, 0] + 0.8 * np.tanh(at.psi[:, 0]) * (1.0 + 0.3 * at.c[:, 0])
    errors = random.standard_normal((RUNS, 2)) @ np.linalg.cholesky([[1.0, 0.9], [0.9, 1.0]]).T
    known = [np.arange(RUNS), np.delete(np.arange(RUNS), [3, 30, 35])]
    values = [smooth + SCATTER * errors[:, 0], -0.6 * smooth + SCATTER * errors[:, 1]]
    processes = [
        fit_gaussian_process(Points(at.x[own], at.c[own], at.psi[own]), value[own], READS)
        for own, value in zip(known, values, strict=True)
    ]
    return joint_errors(processes, known)


def test_observables_that_move_alike_have_errors_that_hang_together(joint):
    bend, effect, scatter = joint.correlation[1], joint.correlation[2], joint.correlation[-1]
    assert effect[0, 1] < -0.8
    assert scatter[0, 1] > 0.6
    assert abs(bend[0, 1]) <= 1.0
    found = joint.covariance([(0, ASKED), (1, ASKED)])
    assert np.linalg.eigvalsh(found)[0] > -1e-12
    assert abs(found[1, 3]) > 0.2 * np.sqrt(found[1, 1] * found[3, 3])


def test_the_covariance_is_that_of_drawn_errors(joint):
    random, which = np.random.default_rng(8), np.repeat([0, 1], 2)
    at = module.Values(ASKED, np.tile([0, 1], 2), which)
    cross = joint.smooth(at, joint.runs)
    whole = np.block([[joint.smooth(at, at), cross], [cross.T, joint.prior]])
    drawn = random.multivariate_normal(np.zeros(len(whole)), whole, DRAWS, method="eigh")
    asked = [(0, ASKED), (1, ASKED)]
    errors = drawn[:, :4] - drawn[:, 4:] @ joint.weights(asked).T
    width = np.array([process.width for process in joint.processes])[which]
    lack = np.zeros((4, 4))
    for place, own in ((0, slice(0, 2)), (1, slice(2, 4))):
        lack[own, own] = joint.processes[place].lack_of_fit_covariance(ASKED)
    found = joint.covariance(asked) - lack
    sd = np.sqrt(np.diag(found))
    error = 4.0 * np.outer(sd, sd) * np.sqrt(2.0 / DRAWS)
    assert np.all(np.abs(np.cov((errors * width).T) - found) < error)
