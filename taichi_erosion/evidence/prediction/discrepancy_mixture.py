"""Joint normal distribution of fitted and new rows, with the discrepancy that the residuals show.

About the calibrated model m(x_0) every row is, on the comparison scale,

    z = m(x_0) + J (x - x_0) + S s + F e + delta(c) + eps

with calibrated numbers x and instruments' errors s, both N(0, 1), errors F e of the model itself (an
emulator), a discrepancy of each observable,

    delta ~ GP(0, (a t)^2 exp(-d^2 / 2 l^2)),    d^2 summed over the conditions, in sd of each

in units of the typical error t of a row, and eps of variance f^2 v, correlated within one heap. The
amplitude a (0 with prior probability 0.2) and the length l of each observable and the factor f are drawn from
their posterior by Gibbs sampling on a grid; the prediction is the mixture of the normal distributions given
each draw.

Reference: Kennedy & O'Hagan (2001), J. R. Stat. Soc. B 63, 425.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy import linalg, special

from taichi_erosion.evidence.data.measurement_noise import NoiseLevelPrior
from taichi_erosion.evidence.data.problem import Floats, Integers

AMPLITUDES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)  # a: sd of the discrepancy over the typical error of a row
LENGTHS = (0.35, 0.7, 1.4)  # l, in sd of a condition
NOTHING = 0.2  # prior probability of a = 0
BURN_IN, SWEEPS = 4, 40  # of the sampler, over all observables
HALVINGS = 60  # of the bracket of a quantile
REACH = 12.0  # sd about all means within which quantiles lie

Choice = tuple[float, float]  # amplitude and length of one observable's discrepancy
State = tuple[tuple[Choice, ...], int]  # of every observable; index of the noise factor


@dataclass(frozen=True)
class JointRows:
    """Fitted rows (n), then new rows (m), about the calibrated model; `residual` holds J x_0 too."""

    residual: Floats  # (n,) z - m(x_0) + J x_0
    variance: Floats  # (n,) of the fitted rows
    mean: Floats  # (m,) m(x_0) - J x_0 at the new rows
    parts: Mapping[str, Floats]  # name -> factor (n + m, k) of a covariance: J, S, F
    axes: Floats  # (n + m, conditions), standardised
    which: Integers  # (n + m,) observable of each row
    typical: Floats  # (observables,) t
    noise: NoiseLevelPrior = field(repr=False)  # of f
    covariance: Floats | None = None  # (n, n) covariance of fitted rows of one heap, diagonal 0; None: none

    @property
    def fitted(self) -> int:
        """Number of fitted rows."""
        return self.residual.size

    @cached_property
    def fixed(self) -> dict[str, Floats]:
        """Covariances (n + m, n + m) of all parts but the discrepancy."""
        return {name: factor @ factor.T for name, factor in self.parts.items()}

    @cached_property
    def base(self) -> Floats:
        """Sum of these covariances."""
        return np.asarray(sum(self.fixed.values(), np.zeros((self.which.size, self.which.size))))

    @cached_property
    def kernels(self) -> dict[float, Floats]:
        """Correlations of the discrepancies by length, 0 between observables."""
        same = self.which[:, np.newaxis] == self.which[np.newaxis, :]
        square = np.sum((self.axes[:, np.newaxis, :] - self.axes[np.newaxis, :, :]) ** 2, axis=2)
        return {length: np.where(same, np.exp(-0.5 * square / length**2), 0.0) for length in LENGTHS}

    def discrepancy(self, choices: Sequence[Choice]) -> Floats:
        """Covariance (n + m, n + m) of the discrepancies."""
        total = np.zeros((self.which.size, self.which.size))
        for index, (amplitude, length) in enumerate(choices):
            own = np.flatnonzero(self.which == index)
            if amplitude > 0.0 and own.size:
                place = np.ix_(own, own)
                total[place] = (amplitude * self.typical[index]) ** 2 * self.kernels[length][place]
        return total

    def error(self, factor: int) -> Floats:
        """Covariance of the scatter of the fitted rows at one noise factor."""
        whole = np.diag(self.variance)
        return np.asarray(
            self.noise.factor[factor] ** 2 * (whole if self.covariance is None else whole + self.covariance)
        )


def log_likelihood(rows: JointRows, state: State) -> float:
    """Ln probability of the fitted rows at one choice of discrepancies and noise factor."""
    n, (choices, factor) = rows.fitted, state
    covariance = (rows.base + rows.discrepancy(choices))[:n, :n] + rows.error(factor)
    triangle = linalg.cholesky(covariance, lower=True, check_finite=False)
    white = linalg.solve_triangular(triangle, rows.residual, lower=True, check_finite=False)
    return float(-0.5 * white @ white - np.sum(np.log(np.diag(triangle))))


def choices_of_one() -> tuple[list[Choice], Floats]:
    """Amplitudes and lengths of one observable's discrepancy, and ln of their prior."""
    found = [(amplitude, length) for amplitude in AMPLITUDES for length in LENGTHS]
    prior = np.full(len(found), np.log1p(-NOTHING) - np.log(len(found)))
    return [(0.0, LENGTHS[0]), *found], np.append(np.log(NOTHING), prior)


def sampled_states(rows: JointRows, seed: int) -> dict[State, float]:
    """Discrepancies and noise factors with their posterior shares, by Gibbs sampling."""
    random, known = np.random.default_rng(seed), {}
    options, prior = choices_of_one()

    def log_weights(states: Sequence[State]) -> Floats:
        for state in states:
            if state not in known:
                known[state] = log_likelihood(rows, state)
        return np.array([known[state] for state in states])

    def drawn(log_weight: Floats) -> int:
        weight = np.exp(log_weight - log_weight.max())
        return int(random.choice(weight.size, p=weight / weight.sum()))

    choices = [options[0]] * rows.typical.size
    factor = int(np.argmin(np.abs(np.log(rows.noise.factor))))
    counts: dict[State, float] = {}
    for sweep in range(BURN_IN + SWEEPS):
        for index in np.unique(rows.which[: rows.fitted]):
            states = [((*choices[:index], each, *choices[index + 1 :]), factor) for each in options]
            choices[index] = options[drawn(prior + log_weights(states))]
        states = [(tuple(choices), k) for k in range(rows.noise.factor.size)]
        factor = drawn(rows.noise.log_weight + log_weights(states))
        if sweep >= BURN_IN:
            state = tuple(choices), factor
            counts[state] = counts.get(state, 0.0) + 1.0 / SWEEPS
    return counts


@dataclass(frozen=True)
class Mixture:
    """Normal distributions of some rows, one for each draw (k, m), with their weights (k,)."""

    weight: Floats
    mean: Floats
    variance: Floats

    def quantile(self, share: float) -> Floats:
        """Value (m,) below which the share of the mixture lies, by bisection."""
        sd = np.sqrt(self.variance)
        low, high = (self.mean - REACH * sd).min(axis=0), (self.mean + REACH * sd).max(axis=0)
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            below = self.weight @ special.ndtr((middle - self.mean) / np.where(sd > 0.0, sd, 1e-300))
            low, high = np.where(below < share, middle, low), np.where(below < share, high, middle)
        return np.asarray(0.5 * (low + high))

    def sd(self) -> Floats:
        """Standard deviation (m,) of the mixture."""
        mean = self.weight @ self.mean
        return np.sqrt(self.weight @ (self.variance + (self.mean - mean) ** 2))

    def widened(self, variance: Floats) -> "Mixture":
        """The same with independent errors of this variance, (m,) or (k, m)."""
        return Mixture(self.weight, self.mean, self.variance + variance)


@dataclass(frozen=True)
class JointPrediction:
    """What is known of the new rows, and of each fitted row from the others."""

    whole: Mixture  # of the new rows, errors of their measurement left out
    parts: Mapping[str, Mixture]  # the same for each source alone; they are correlated
    left_out: Mixture  # of each fitted value, from all other rows, its own error in it
    factor: Floats  # (k,) noise factor of each draw
    observables: int  # with fitted rows

    @property
    def discrepancy_odds(self) -> float:
        """Bayes factor of a discrepancy in any observable against none, as far as the draws resolve it."""
        spread = np.max(self.parts["discrepancy"].variance, axis=1, initial=0.0)
        share = float(np.clip(self.whole.weight @ (spread > 0.0), 0.5 / SWEEPS, 1.0 - 0.5 / SWEEPS))
        none = NOTHING**self.observables
        return share / (1.0 - share) * none / (1.0 - none)


def joint_prediction(rows: JointRows, seed: int) -> JointPrediction:
    """Predictive distributions, averaged over discrepancies and noise factors."""
    states = sampled_states(rows, seed)
    weight = np.array(list(states.values()))
    given = [given_state(rows, state) for state in states]
    names = [*rows.parts, "discrepancy"]
    moments = {key: [np.array([each[key][k] for each in given]) for k in (0, 1)] for key in given[0]}
    mixtures = {key: Mixture(weight, mean, variance) for key, (mean, variance) in moments.items()}
    factor = np.array([rows.noise.factor[factor] for _, factor in states])
    parts = {name: mixtures[name] for name in names}
    count = np.unique(rows.which[: rows.fitted]).size
    return JointPrediction(mixtures["whole"], parts, mixtures["left out"], factor, count)


def given_state(rows: JointRows, state: State) -> dict[str, tuple[Floats, Floats]]:
    """Mean and variance of the new rows, whole and part by part, and of each fitted row left out.

    With precision Q a row left out has mean y_i - (Q y)_i / Q_ii and variance 1 / Q_ii.
    """
    n, (choices, factor) = rows.fitted, state
    covariances = {**rows.fixed, "discrepancy": rows.discrepancy(choices)}
    total = np.asarray(sum(covariances.values()))
    precision = np.linalg.inv(total[:n, :n] + rows.error(factor))
    solved = precision @ rows.residual

    def conditional(covariance: Floats) -> tuple[Floats, Floats]:
        cross = covariance[n:, :n]
        spread = np.diag(covariance)[n:] - np.einsum("ij,jk,ik->i", cross, precision, cross)
        return cross @ solved, np.maximum(spread, 0.0)

    found = {name: conditional(covariance) for name, covariance in covariances.items()}
    mean, variance = conditional(total)
    own = np.diag(precision)
    found["whole"] = rows.mean + mean, variance
    found["left out"] = rows.residual - solved / own, np.asarray(1.0 / own, dtype=np.float64)
    return found
