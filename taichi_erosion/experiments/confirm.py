"""Test of confirmation runs against a measurement, and the power of that test.

    t = (mean - wanted) / se
    se^2 = s_1^2 / n_1 + s_2^2 / n_2          Welch, with
    df   = se^4 / ((s_1^2 / n_1)^2 / (n_1 - 1) + (s_2^2 / n_2)^2 / (n_2 - 1))
    power(D) = P(|t'| > t(0.975, df)),        t' non-central with D / se

s_2 and n_2 belong to the measurement; where it is a bare number they count as exact. A test that does not
reject is weak evidence if its power is small: `least_detectable_difference` is found four times in five.

References: Welch (1947), Biometrika 34, 28; Cohen (1988), Statistical Power Analysis, ch. 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan, sqrt

import numpy as np
from scipy import stats
from scipy.integrate import tanhsinh
from scipy.optimize import brentq
from scipy.special import chdtri, ndtr

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import Floats

SIGNIFICANCE = 0.05  # of the two-sided test [1]
WANTED_POWER = 0.8  # Cohen's convention [1]


@dataclass(frozen=True)
class Sample:
    """Mean of n repeats of spread sd; n infinite: an exact number."""

    mean: float
    sd: float = 0.0
    n: float = inf


@dataclass(frozen=True)
class Confirmation:
    """The test, in the response's unit; NaN where the runs show no spread to test with."""

    runs: Sample
    wanted: Sample
    difference: float
    low: float  # 95 % interval of the difference
    high: float
    t: float
    df: float
    p: float
    power: float  # to notice a difference of `resolve`
    resolve: float
    detectable: float  # difference noticed with a power of 0.8


def welch_test(values: Sequence[float], target: Sample | float) -> Confirmation:
    """Welch's test of fresh runs against a number or a measurement.

    The difference that would matter is the standard deviation of a single measurement, or of a run where that
    is exact.
    """
    finite = np.asarray(values, dtype=float)
    finite = finite[np.isfinite(finite)]
    if len(finite) < 2:
        raise BadInput(f"confirm: {len(finite)} run(s) with a result; needs at least 2")
    runs = Sample(float(finite.mean()), float(finite.std(ddof=1)), len(finite))
    goal = target if isinstance(target, Sample) else Sample(float(target))
    matter = goal.sd or runs.sd
    difference = runs.mean - goal.mean
    first, second = runs.sd**2 / runs.n, goal.sd**2 / goal.n
    spread, df = nan, nan  # without any scatter there is no test
    if first + second > 0.0:
        spread = sqrt(first + second)
        df = (first + second) ** 2 / (first**2 / (runs.n - 1.0) + second**2 / (goal.n - 1.0))
    reach = critical_t(df) * spread
    t = difference / spread
    return Confirmation(
        runs=runs,
        wanted=goal,
        difference=difference,
        low=difference - reach,
        high=difference + reach,
        t=t,
        df=df,
        p=2.0 * float(stats.t.sf(abs(t), df)),
        power=power(matter, spread, df),
        resolve=matter,
        detectable=least_detectable_difference(spread, df),
    )


def critical_t(df: float) -> float:
    return float(stats.t.isf(0.5 * SIGNIFICANCE, df))


def power(difference: float, spread: float, df: float) -> float:
    """Chance that a true difference is noticed.

    1 - P(|Z + shift| < limit s) with Z normal and s^2 = chi^2 / df, integrated over the probability of s: the
    series of the non-central t fails for few degrees of freedom.
    """
    shift, limit = abs(difference) / spread, critical_t(df)

    def power_deficit(probability: Floats) -> Floats:
        s = np.sqrt(chdtri(df, probability) / df)
        return ndtr(limit * s - shift) - ndtr(-limit * s - shift)

    return 1.0 - float(tanhsinh(power_deficit, 0.0, 1.0).integral)


def least_detectable_difference(spread: float, df: float) -> float:
    """Smallest true difference that is noticed with the wanted power."""
    if spread != spread:
        return nan
    enough = 1.0
    while power(enough, 1.0, df) < WANTED_POWER:
        enough *= 2.0
    root = brentq(lambda errors: power(errors, 1.0, df) - WANTED_POWER, 0.0, enough, full_output=False)
    return spread * float(np.asarray(root))
