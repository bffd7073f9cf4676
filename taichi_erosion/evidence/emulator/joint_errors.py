"""Errors of the emulators of one scene, which its observables share.

One run gives all observables of a scene: what scatters in one scatters in others, and a shape that the runs
do not show, such as where a pull saturates, is the same in all of them. Their emulators err together, and
several observables are no independent witnesses of one strength. With the parts k of `gaussian_process`

    cov(f_a, f_b) = sum_k r_kab A_ka A_kb K_k,    cov(eps_a, eps_b) = r_sab s_a s_b  in one run
    e_a = f_a - W_a (f_a(X) + eps_a),    W_a = cov(f_a, f_a(X)) (cov(f_a(X), f_a(X)) + s_a^2)^-1

are the covariances of two observables a and b, and the error of the emulator of a, whose mean is of its own
runs X alone. Correlations r are the most probable ones of every pair of observables under the prior
atanh r ~ N(0, 1); among all observables the nearest matrix without negative eigenvalues. Lack of fit is
uncorrelated between observables.

Reference: Goulard & Voltz (1992), Math. Geol. 24, 269 (linear model of coregionalisation); Conti & O'Hagan
(2010), J. Stat. Plan. Inference 140, 640 (emulators of several outputs).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy import linalg, optimize

from taichi_erosion.evidence.data.problem import Floats, Integers
from taichi_erosion.evidence.emulator.gaussian_process import (
    JITTER,
    GaussianProcess,
    Points,
    kernel_parts,
    total_covariance,
)

FARTHEST = 2.5  # of atanh r: |r| of at most 0.987
IMPOSSIBLE = 1e10  # negative ln probability of correlations that make no covariance


@dataclass(frozen=True)
class JointErrors:
    """Processes of the observables of one scene, with the correlations of their parts."""

    processes: tuple[GaussianProcess, ...]
    known: tuple[Integers, ...]  # runs of the scene that train each process
    correlation: Floats  # (parts + 1, observables, observables); the last part is the scatter

    @cached_property
    def runs(self) -> Points:
        """Training runs of every process, one after the other."""
        return stacked([process.training for process in self.processes])

    @cached_property
    def prior(self) -> Floats:
        """Covariance of the values of all training runs of all processes."""
        which = np.repeat(np.arange(len(self.known)), [each.size for each in self.known])
        run = np.concatenate(self.known)
        scatter = np.array([process.amplitude[-1] for process in self.processes])
        alike = self.correlation[-1][np.ix_(which, which)] * np.outer(scatter[which], scatter[which])
        found = self.smooth(self.runs, which, self.runs, which) + alike * (run[:, np.newaxis] == run)
        return found + JITTER * np.eye(run.size)

    def smooth(self, one: Points, first: Integers, other: Points, second: Integers) -> Floats:
        """Prior covariance of points of observables `first` and `second`, by their places here."""
        parts = kernel_parts(one, other, self.processes[0].reads)
        amplitude = np.array([part_amplitudes(process) for process in self.processes])
        total = np.zeros(parts.shape[1:])
        for k, part in enumerate(parts):
            if part.any():
                weight = self.correlation[k] * np.outer(amplitude[:, k], amplitude[:, k])
                total += weight[np.ix_(first, second)] * part
        return total

    def covariance(self, asked: Sequence[tuple[int, Points]]) -> Floats:
        """Covariance of the errors over the points of some processes, one after the other."""
        at = stacked([points for _, points in asked])
        sizes = [points.x.shape[0] for _, points in asked]
        which = np.repeat([place for place, _ in asked], sizes)
        of_runs = np.repeat(np.arange(len(self.known)), [each.size for each in self.known])
        weights = self.weights(asked)
        cross = self.smooth(at, which, self.runs, of_runs)
        found = self.smooth(at, which, at, which) - cross @ weights.T - weights @ cross.T
        found += weights @ self.prior @ weights.T
        width = np.array([process.width for process in self.processes])[which]
        found *= np.outer(width, width)
        for (place, points), own in zip(asked, slices(sizes), strict=True):
            found[own, own] += self.processes[place].lack_of_fit_covariance(points)
        return found

    def weights(self, asked: Sequence[tuple[int, Points]]) -> Floats:
        """Weights of all training values in the emulated values of some points."""
        rows = slices([points.x.shape[0] for _, points in asked])
        columns = slices([each.size for each in self.known])
        found = np.zeros((rows[-1].stop, columns[-1].stop))
        for (place, points), row in zip(asked, rows, strict=True):
            process = self.processes[place]
            cross = process.covariance(process.training, points)
            found[row, columns[place]] = linalg.cho_solve((process.factor, True), cross).T
        return found


def joint_errors(processes: Sequence[GaussianProcess], known: Sequence[Integers]) -> JointErrors:
    """Joint errors of the processes of one scene, of which `known` says the training runs."""
    count = len(processes)
    correlation = np.tile(np.eye(count), (processes[0].amplitude.size + 1, 1, 1))
    for a, b in combinations(range(count), 2):
        _, first, second = np.intersect1d(known[a], known[b], return_indices=True)
        found = pair_correlations(processes[a], first, processes[b], second)
        correlation[:, a, b] = correlation[:, b, a] = found
    return JointErrors(tuple(processes), tuple(known), np.array([possible(each) for each in correlation]))


def pair_correlations(
    one: GaussianProcess, first: Integers, other: GaussianProcess, second: Integers
) -> Floats:
    """Most probable correlations of all parts and of the scatter of two processes, from runs of both."""
    runs = Points(*(each[first] for each in vars(one.training).values()))
    parts, size = kernel_parts(runs, runs, one.reads), first.size
    own = [total_covariance(parts, process.amplitude) for process in (one, other)]
    values = np.concatenate([one.known_values()[first], other.known_values()[second]])
    amplitude = part_amplitudes(one) * part_amplitudes(other)
    scatter = one.amplitude[-1] * other.amplitude[-1] * np.eye(size)
    shared = np.array([*(a * part for a, part in zip(amplitude, parts, strict=True)), scatter])

    def negative_log_evidence(far: Floats) -> tuple[float, Floats]:
        cross = np.tensordot(np.tanh(far), shared, axes=1)
        try:
            factor = np.linalg.cholesky(np.block([[own[0], cross], [cross, own[1]]]))
        except np.linalg.LinAlgError:
            return IMPOSSIBLE, np.zeros(far.size)
        inverse = linalg.cho_solve((factor, True), np.eye(2 * size))
        weights = inverse @ values
        value = 0.5 * values @ weights + np.sum(np.log(np.diag(factor))) + 0.5 * far @ far
        pull = (inverse - np.outer(weights, weights))[:size, size:]
        slopes = np.tensordot(shared, pull, axes=2) / np.cosh(far) ** 2
        return float(value), slopes + far

    bounds = [(-FARTHEST, FARTHEST)] * shared.shape[0]
    start = np.zeros(shared.shape[0])
    found = optimize.minimize(negative_log_evidence, start, jac=True, method="L-BFGS-B", bounds=bounds)
    return np.tanh(found.x)


def part_amplitudes(process: GaussianProcess) -> Floats:
    """Amplitudes of all smooth parts, the plane's first."""
    return np.append(1.0, process.amplitude[:-1])


def possible(correlation: Floats) -> Floats:
    """The nearest correlation matrix: without negative eigenvalues, and scaled to a diagonal of 1."""
    values, vectors = np.linalg.eigh(correlation)
    if values[0] >= 0.0:
        return correlation
    raised = (vectors * np.maximum(values, 0.0)) @ vectors.T
    sd = np.sqrt(np.diag(raised))
    return raised / np.outer(sd, sd)


def stacked(parts: Sequence[Points]) -> Points:
    """Points one after the other."""
    return Points(*(np.concatenate(each) for each in zip(*(vars(p).values() for p in parts), strict=True)))


def slices(sizes: Sequence[int]) -> list[slice]:
    """Places of parts of some sizes, one after the other."""
    ends = np.cumsum(sizes)
    return [slice(int(end) - size, int(end)) for end, size in zip(ends, sizes, strict=True)]
