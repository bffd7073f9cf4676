"""Gaussian process through simulated values, over calibrated numbers, conditions and strengths of effects.

    z = m + t(x, c) + b(x, c) + sum_k h_k(psi_k, x, c) + i(psi, x, c) + s eps

with x the calibrated numbers in prior sd, c the standardised conditions, psi_k the place of the strength of
effect k, t a plane, b a bend away from it, i what two effects do together beyond what each does by
itself, and s the scatter of one run. All are Gaussian processes:

    t: T^2 (1 + x x' + c c')        b: B^2 k(x; L) k(c; L_c)
    h_k: H_k^2 psi psi' k(psi; L_psi) k(x; 2 L) k(c; L_c)
    i: I^2 sum_{j<k} psi_j psi_j' psi_k psi_k' k(x; 2 L) k(c; L_c)

with k squared-exponential kernels. Each h_k vanishes at strength 0, so the bare model is one surface whatever
effects there are; a number of effect k itself is among the x of h_k and i alone. B, H_k, I and s are the
most probable ones under broad priors. All runs enter every prediction: its mean is far more certain than that
of the few runs at any one setting.

Reference: Rasmussen & Williams (2006), Gaussian Processes for Machine Learning, ch. 2, 5.4.2 (leave-one-out);
Sacks, Welch, Mitchell & Wynn (1989), Stat. Sci. 4, 409 (surfaces in place of simulations).

Errors of the emulators of one scene, which its observables share.

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
from functools import cached_property, partial
from itertools import combinations

import numpy as np
import scipy
from scipy import linalg

from taichi_erosion.evidence.data.heap_correlation import make_positive_definite
from taichi_erosion.evidence.data.problem import Bools, Floats, Integers

TREND = 2.0  # T, sd of the plane's slopes over that of the values [1]
LENGTH = 2.5  # L, in prior sd: priors are mostly left linear, their ends may bend
LENGTH_CONDITION = 2.0  # L_c, in sd of a condition
LENGTH_STRENGTH = 2.0  # L_psi, in places of strengths: from 0 to half of the expected strength it is 1.8
LENGTH_MISFIT = 0.75  # L_m, in places of strengths: lack of fit is local in strength
RUNS_WITHOUT_MISFIT = 8.0  # nu_0, prior runs without excess: a few errors are large by chance
PRIOR_LOG = {
    "bend": (-1.2, 1.0),
    "effect": (-2.1, 1.5),  # at the expected strength, whose place is 2.9: (-1.0, 1.5)
    "together": (-3.7, 1.0),  # at the expected strengths of both: (-1.6, 1.0)
    "scatter": (-1.6, 1.0),
}  # of ln(amplitude / sd z)
JITTER = 1e-8  # keeps matrices regular
STEPS_MOST = 200  # of the search for amplitudes
FARTHEST = 2.5  # of atanh r: |r| of at most 0.987
IMPOSSIBLE = 1e10  # negative ln probability of correlations that make no covariance


@dataclass(frozen=True)
class Points:
    x: Floats  # (n, p), calibrated numbers in prior sd
    c: Floats  # (n, q), standardised conditions
    psi: Floats  # (n, effects), places of strengths; 0 where an effect cannot act


@dataclass(frozen=True)
class ActiveInputs:
    """Conditions and calibrated numbers that enter the bare model (first row) and each effect.

    Numbers of an effect itself do nothing without it.
    """

    conditions: Bools  # (1 + effects, q)
    numbers: Bools  # (1 + effects, p)


@dataclass(frozen=True)
class GaussianProcess:
    training: Points
    reads: ActiveInputs
    amplitude: Floats  # (effects + 3,): bend, every effect, two together, scatter; over `width`
    centre: float
    width: float
    factor: Floats  # lower Cholesky factor of the covariance of the known values
    weights: Floats  # K^-1 (z - centre) / width

    def mean(self, at: Points) -> Floats:
        return self.centre + self.width * (self.prior_covariance(at, self.training) @ self.weights)

    def error_cov(self, at: Points) -> Floats:
        """Covariance of the errors: posterior covariance plus lack of fit."""
        cross = linalg.solve_triangular(self.factor, self.prior_covariance(self.training, at), lower=True)
        posterior = self.width**2 * (self.prior_covariance(at, at) - cross.T @ cross)
        return posterior + self.lack_of_fit_covariance(at)

    def lack_of_fit_covariance(self, at: Points) -> Floats:
        """Covariance of the lack of fit, alike under conditions that are near each other."""
        lack_of_fit = self.lack_of_fit_sd(at)
        return np.outer(lack_of_fit, lack_of_fit) * rbf_kernel(at.c, at.c, LENGTH_CONDITION)

    def lack_of_fit_sd(self, at: Points) -> Floats:
        """Lack of fit at the strengths of the inputs, as a standard deviation.

            l^2 = max(0, sum_i w_i (e_i^2 - v_i) / (nu_0 + sum_i w_i))
            w_i = k(psi, psi_i; L_m) prod_k min(1, psi_k^2 / psi_ik^2)    over the effects k of run i

        with e_i the error of run i predicted from all others and v_i the variance it should have: errors
        larger than that come from a shape that the kernels do not hold. That of an effect vanishes with it.
        """
        excess = self.width**2 * ((self.weights / self.precision) ** 2 - 1.0 / self.precision)
        weight = rbf_kernel(at.psi, self.training.psi, LENGTH_MISFIT)
        for psi, covariance in zip(at.psi.T, self.training.psi.T, strict=True):
            acts = covariance != 0.0
            weight[:, acts] *= np.minimum((psi[:, np.newaxis] / covariance[acts]) ** 2, 1.0)
        return np.sqrt(np.maximum(weight @ excess / (RUNS_WITHOUT_MISFIT + weight.sum(axis=1)), 0.0))

    @cached_property
    def precision(self) -> Floats:
        """Diagonal of K^-1: 1 over the variance of each known value, given all others."""
        return np.diag(linalg.cho_solve((self.factor, True), np.eye(self.weights.size)))

    @property
    def scatter(self) -> float:
        return float(self.width * self.amplitude[-1])

    def prior_covariance(self, one: Points, other: Points) -> Floats:
        parts = kernel_matrices(one, other, self.reads)
        return parts[0] + np.tensordot(self.amplitude[:-1] ** 2, parts[1:], axes=1)


def rbf_kernel(one: Floats, other: Floats, length: float) -> Floats:
    """Squared-exponential kernel of two sets of positions (n, d), (m, d)."""
    square = np.zeros((one.shape[0], other.shape[0]))
    for j in range(one.shape[1]):
        square += (one[:, j, np.newaxis] - other[np.newaxis, :, j]) ** 2
    return np.exp(-0.5 * square / length**2)


def kernel_matrices(one: Points, other: Points, reads: ActiveInputs) -> Floats:
    """Plane, bend, every effect and two together at amplitude 1: (effects + 3, n, m)."""
    bare, part = reads.conditions[0], reads.numbers[0]
    bare_one, bare_other, x_one, x_other = one.c[:, bare], other.c[:, bare], one.x[:, part], other.x[:, part]
    shape = (one.x.shape[0], other.x.shape[0])
    parts = np.zeros((len(reads.conditions) + 2, *shape))
    parts[0] = TREND**2 * (1.0 + x_one @ x_other.T + bare_one @ bare_other.T)
    parts[1] = rbf_kernel(x_one, x_other, LENGTH) * rbf_kernel(bare_one, bare_other, LENGTH_CONDITION)
    total, squares = np.zeros(shape), np.zeros(shape)
    for k, (read, numbers) in enumerate(zip(reads.conditions[1:], reads.numbers[1:], strict=True)):
        product = np.outer(one.psi[:, k], other.psi[:, k])
        if not product.any():
            continue
        total, squares = total + product, squares + product**2
        near = rbf_kernel(one.psi[:, [k]], other.psi[:, [k]], LENGTH_STRENGTH)
        wide = rbf_kernel(one.x[:, numbers], other.x[:, numbers], 2.0 * LENGTH)
        parts[k + 2] = product * near * wide * rbf_kernel(one.c[:, read], other.c[:, read], LENGTH_CONDITION)
    pairs = 0.5 * (total**2 - squares)  # sum over j < k of products
    if pairs.any():
        wide = rbf_kernel(one.x, other.x, 2.0 * LENGTH)
        parts[-1] = pairs * wide * rbf_kernel(one.c, other.c, LENGTH_CONDITION)
    return parts


def fit_gaussian_process(training: Points, values: Floats, reads: ActiveInputs) -> GaussianProcess:
    """Process through values that scatter, at the most probable amplitudes."""
    centre = float(values.mean())
    width = max(float(values.std()), 1e-9 * abs(centre), 1e-300)
    standard = (values - centre) / width
    parts = kernel_matrices(training, training, reads)
    count = len(reads.conditions) - 1
    names = ("bend", *["effect"] * count, "together", "scatter")
    middle, spread = np.array([PRIOR_LOG[name] for name in names]).T
    bounds = [(m - 4.0 * s, m + 4.0 * s) for m, s in zip(middle, spread, strict=True)]
    search = partial(scipy.optimize.minimize, jac=True, method="L-BFGS-B", options={"maxiter": STEPS_MOST})
    optimum = search(negative_log_evidence, middle, args=(parts, standard, middle, spread), bounds=bounds)
    amplitude = np.exp(optimum.x)
    factor = np.asarray(np.linalg.cholesky(training_covariance(parts, amplitude)), dtype=np.float64)
    weights = linalg.cho_solve((factor, True), standard)
    return GaussianProcess(training, reads, amplitude, centre, width, factor, weights)


def training_covariance(parts: Floats, amplitude: Floats) -> Floats:
    mixed = parts[0] + np.tensordot(amplitude[:-1] ** 2, parts[1:], axes=1)
    return mixed + (amplitude[-1] ** 2 + JITTER) * np.eye(parts.shape[1])


def negative_log_evidence(
    log_amplitude: Floats, parts: Floats, standard: Floats, middle: Floats, spread: Floats
) -> tuple[float, Floats]:
    """Negative ln of marginal likelihood times prior, and its slopes.

    -ln p = 1/2 z^T K^-1 z + 1/2 ln |K| + prior,    d/du = 1/2 tr((K^-1 - a a^T) dK/du),    a = K^-1 z
    """
    amplitude = np.exp(log_amplitude)
    factor = np.linalg.cholesky(training_covariance(parts, amplitude))
    inverse = linalg.cho_solve((factor, True), np.eye(standard.size))
    weights = inverse @ standard
    off = (log_amplitude - middle) / spread
    value = 0.5 * standard @ weights + np.sum(np.log(np.diag(factor))) + 0.5 * off @ off
    pull = inverse - np.outer(weights, weights)
    smooth = np.einsum("ij,kij->k", pull, parts[1:]) * amplitude[:-1] ** 2
    slopes = np.append(smooth, np.trace(pull) * amplitude[-1] ** 2)
    return float(value), slopes + off / spread


@dataclass(frozen=True)
class Values:
    """Values of several observables at points that they share."""

    points: Points
    place: Integers  # of the point of every value
    observable: Integers  # of every value


@dataclass(frozen=True)
class JointErrors:
    """Processes of the observables of one scene, with the correlations of their parts."""

    processes: tuple[GaussianProcess, ...]
    training_runs: tuple[Integers, ...]  # runs of the scene that train each process
    correlation: Floats  # (parts + 1, observables, observables); the last part is the scatter

    @cached_property
    def all_values(self) -> Values:
        """Training values of every process, one after the other."""
        runs = np.concatenate(self.training_runs)
        _, first, place = np.unique(runs, return_index=True, return_inverse=True)
        every = concatenate_points([process.training for process in self.processes])
        which = np.repeat(np.arange(len(self.training_runs)), [each.size for each in self.training_runs])
        return Values(Points(*(each[first] for each in vars(every).values())), place, which)

    @cached_property
    def training_value_covariance(self) -> Floats:
        which, run = self.all_values.observable, self.all_values.place
        scatter = np.array([process.amplitude[-1] for process in self.processes])
        alike = self.correlation[-1][np.ix_(which, which)] * np.outer(scatter[which], scatter[which])
        kernel = self.prior_cov(self.all_values, self.all_values) + alike * (run[:, np.newaxis] == run)
        return kernel + JITTER * np.eye(run.size)

    def prior_cov(self, one: Values, other: Values) -> Floats:
        parts = kernel_matrices(one.points, other.points, self.processes[0].reads)
        amplitude = np.array([part_amplitudes(process) for process in self.processes])
        total = np.zeros((one.place.size, other.place.size))
        for k, part in enumerate(parts):
            if part.any():
                size = self.correlation[k] * np.outer(amplitude[:, k], amplitude[:, k])
                size = size[np.ix_(one.observable, other.observable)]
                total += size * part[np.ix_(one.place, other.place)]
        return total

    def joint_error_covariance(self, queries: Sequence[tuple[int, Points]]) -> Floats:
        """Covariance of the errors over the points of some processes, one after the other."""
        at = concatenate_points([points for _, points in queries])
        sizes = [points.x.shape[0] for _, points in queries]
        which = np.repeat([place for place, _ in queries], sizes)
        values, weights = Values(at, np.arange(which.size), which), self.training_value_weights(queries)
        cross = self.prior_cov(values, self.all_values)
        covariance = self.prior_cov(values, values) - cross @ weights.T - weights @ cross.T
        covariance += weights @ self.training_value_covariance @ weights.T
        width = np.array([process.width for process in self.processes])[which]
        covariance *= np.outer(width, width)
        for (place, points), block in zip(queries, consecutive_slices(sizes), strict=True):
            covariance[block, block] += self.processes[place].lack_of_fit_covariance(points)
        return covariance

    def training_value_weights(self, queries: Sequence[tuple[int, Points]]) -> Floats:
        rows = consecutive_slices([points.x.shape[0] for _, points in queries])
        columns = consecutive_slices([each.size for each in self.training_runs])
        matrix = np.zeros((rows[-1].stop, columns[-1].stop))
        for (place, points), row in zip(queries, rows, strict=True):
            process = self.processes[place]
            cross = process.prior_covariance(process.training, points)
            matrix[row, columns[place]] = linalg.cho_solve((process.factor, True), cross).T
        return matrix


def joint_errors(processes: Sequence[GaussianProcess], training_runs: Sequence[Integers]) -> JointErrors:
    """Joint errors of the processes of one scene, each with the runs of it that train the process."""
    count = len(processes)
    correlation = np.tile(np.eye(count), (processes[0].amplitude.size + 1, 1, 1))
    for a, b in combinations(range(count), 2):
        _, first, second = np.intersect1d(training_runs[a], training_runs[b], return_indices=True)
        matrix = process_pair_correlations(processes[a], first, processes[b], second)
        correlation[:, a, b] = correlation[:, b, a] = matrix
    valid = np.array([make_positive_definite(each, 0.0) for each in correlation])
    return JointErrors(tuple(processes), tuple(training_runs), valid)


def process_pair_correlations(
    one: GaussianProcess, first: Integers, other: GaussianProcess, second: Integers
) -> Floats:
    """Most probable correlations of all parts and of the scatter of two processes, from runs of both."""
    runs = Points(*(each[first] for each in vars(one.training).values()))
    parts = kernel_matrices(runs, runs, one.reads)
    white, values = list[Floats](), list[Floats]()
    for process, at in ((one, first), (other, second)):
        root = linalg.cholesky(training_covariance(parts, process.amplitude), lower=True)
        white.append(np.asarray(linalg.solve_triangular(root, np.eye(at.size), lower=True), np.float64))
        values.append(white[-1] @ (process.factor @ (process.factor.T @ process.weights))[at])
    amplitude = part_amplitudes(one) * part_amplitudes(other)
    scatter = one.amplitude[-1] * other.amplitude[-1] * np.eye(first.size)
    shared = np.array([whitened_cross(white, a * part) for a, part in zip(amplitude, parts, strict=True)])
    shared = np.concatenate([shared, whitened_cross(white, scatter)[np.newaxis]])

    def pair_log_evidence(far: Floats) -> tuple[float, Floats]:
        """Of whitened values with the covariance ((1, M), (M^T, 1)); S = 1 - M M^T."""
        cross = np.tensordot(np.tanh(far), shared, axes=1)
        try:
            factor = np.linalg.cholesky(np.eye(first.size) - cross @ cross.T)
        except np.linalg.LinAlgError:
            return IMPOSSIBLE, np.zeros(far.size)
        mine = linalg.cho_solve((factor, True), values[0] - cross @ values[1])
        theirs = values[1] - cross.T @ mine
        value = 0.5 * (values[0] @ mine + values[1] @ theirs) + np.sum(np.log(np.diag(factor)))
        pull = -linalg.cho_solve((factor, True), cross) - np.outer(mine, theirs)
        slopes = np.tensordot(shared, pull, axes=2) / np.cosh(far) ** 2
        return float(value + 0.5 * far @ far), np.asarray(slopes + far, dtype=np.float64)

    bounds = [(-FARTHEST, FARTHEST)] * shared.shape[0]
    start = np.zeros(shared.shape[0])
    matrix = scipy.optimize.minimize(pair_log_evidence, start, jac=True, method="L-BFGS-B", bounds=bounds)
    return np.tanh(matrix.x)


def whitened_cross(white: Sequence[Floats], covariance: Floats) -> Floats:
    """Covariance of the whitened values of two processes; most parts reach few runs."""
    at = np.flatnonzero(covariance.any(axis=1))
    return (white[0][:, at] @ covariance[np.ix_(at, at)]) @ white[1][:, at].T


def part_amplitudes(process: GaussianProcess) -> Floats:
    """Amplitudes of all smooth parts, the plane's first."""
    return np.append(1.0, process.amplitude[:-1])


def concatenate_points(parts: Sequence[Points]) -> Points:
    return Points(*(np.concatenate(each) for each in zip(*(vars(p).values() for p in parts), strict=True)))


def consecutive_slices(sizes: Sequence[int]) -> list[slice]:
    """Places of parts of some sizes, one after the other."""
    ends = np.cumsum(sizes)
    return [slice(int(end) - size, int(end)) for end, size in zip(ends, sizes, strict=True)]
