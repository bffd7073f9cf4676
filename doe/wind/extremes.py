"""Thresholds for another area, time and criterion than those of a patch: extreme-value statistics of motion.

A wind u* moves grains at a mean rate n(u*) per area and time, each by itself, so that in an area A watched
for a time t

    P(at least N grains) = gamma(N, L) / Gamma(N),    L = A t n(u*),

the Poisson law (gamma is the lower incomplete function). Two rates are offered, whose difference shows how
far the answer rests on the one chosen:

    weibull     n = (u*/c)^k                     the weakest of many, with a power law as its tail
    lognormal   n = n_0 Phi((ln u* - m) / s)     needs and gusts normal in ln u*; n_0 attempts [m-2 s-1]

c, k, or m, s, follow from beds that were searched for their thresholds: each lies in a bracket, in which the
criterion of the search came to be met. The threshold of another criterion is the wind in which half of all
trials meet it. Beds and gusts of one trial count as independent of those of another, and a grain that has
moved as replaced. Where the wind is steady its time does not count: the caller then gives both watches one
time. Extrapolation over many powers of ten of A t is only as good as the law.

Reference: Weibull (1939), Ing. Vetensk. Akad. Handl. 151 (weakest link); Coles (2001), An Introduction to
Statistical Modeling of Extreme Values, Springer (profile likelihood, 2.6.6); Diplas et al. (2008), Science
322, 717 (turbulent peaks that entrain).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import exp, log

import numpy as np
import scipy

from taichi_erosion.core.setup import Floats
from taichi_erosion.measures.result import Measurement, no_measurement
from taichi_erosion.measures.threshold import CONFIDENCE, UNIT, Bracket

LEAST_BEDS = 3  # two numbers are fitted
HALF = 0.5  # share of trials that meet a criterion at its threshold [1]
SHAPES = np.geomspace(2.0, 200.0, 60)  # d ln n / d ln u* at the threshold of a patch [1]
STEP = 0.01  # of ln u*, on which the likelihood is known [1]
REACH = 2.5  # of ln u*, about the brackets, in which thresholds are looked for [1]
LEAST_CHANCE = 1e-300  # keeps logarithms finite [1]

# (threshold of the criterion asked for [ln u*], slopes [n], winds [ln u*]) -> ln L of the patch [n, winds]
Rate = Callable[[float, Floats, Floats], Floats]


@dataclass(frozen=True)
class Watch:
    """A criterion of motion: `count` grains in `area` [m2] within `time` [s]."""

    area: float
    time: float
    count: int = 1

    @property
    def size(self) -> float:
        """Area times time [m2 s]."""
        return self.area * self.time

    @property
    def middle(self) -> float:
        """Mean number of grains at which half of all trials meet the criterion [1]."""
        return float(scipy.special.gammaincinv(self.count, HALF))


def weibull_rate(patch: Watch, asked: Watch) -> Rate:
    """Mean number of grains in the patch, its logarithm, under n = (u*/c)^k with the slopes k."""
    known = log(asked.middle * patch.size / asked.size)
    return lambda threshold, slopes, winds: known + np.multiply.outer(slopes, winds - threshold)


def lognormal_rate(patch: Watch, asked: Watch, attempts: float) -> Rate:
    """The same under n = n_0 Phi((ln u* - m) / s); `attempts` is n_0 [m-2 s-1].

    A slope is d ln n / d ln u* where half of all patches move. Raises ValueError where a criterion asks for
    more than half of all attempts.
    """
    ends = [log(one.middle / (attempts * one.size)) for one in (asked, patch)]
    if max(ends) >= log(HALF):
        raise ValueError("a criterion asks for more grains than half of the attempts")
    normal = scipy.special.ndtri_exp(np.array(ends))
    # d ln Phi / dz at the criterion of the patch
    steepness = exp(-0.5 * normal[1] ** 2 - ends[1]) / np.sqrt(2.0 * np.pi)

    def rate(threshold: float, slopes: Floats, winds: Floats) -> Floats:
        z = normal[0] + np.multiply.outer(slopes / steepness, winds - threshold)
        return log(attempts * patch.size) + scipy.special.log_ndtr(z)

    return rate


def best_slope(rate: Rate, ends: Floats, count: int, threshold: float) -> tuple[float, float]:
    """Most likely slope [1] with the threshold given, and the logarithm of its likelihood; `ends` [n, 2]."""
    low, high = (
        scipy.special.gammainc(count, np.exp(np.minimum(rate(threshold, SHAPES, ends[:, side]), 700.0)))
        for side in (0, 1)
    )
    likely = np.log(np.maximum(high - low, LEAST_CHANCE)).sum(axis=1)
    best = int(np.argmax(likely))
    return float(SHAPES[best]), float(likely[best])


def criterion_threshold(
    name: str, brackets: Sequence[Bracket], patch: Watch, asked: Watch, attempts: float | None = None
) -> Measurement:
    """Friction velocity at which half of all trials of another criterion move grains [m s-1].

    `brackets` are those of beds on patches searched by the criterion `patch`; with `attempts` [m-2 s-1] the
    law is the log-normal one, else Weibull's. Thresholds are looked for within `REACH` of the brackets, where
    an interval without an end is cut. `details` hold the slope d ln n / d ln u* [1] and the interval
    from the profile of the likelihood, with the limit n ln(1 + t^2 / (n - 2)) of n beds and two numbers.
    """
    if len(brackets) < LEAST_BEDS:
        return no_measurement(name, UNIT, f"fewer than {LEAST_BEDS} beds")
    ends = np.log([[bracket.low, bracket.high] for bracket in brackets])
    rate = weibull_rate(patch, asked) if attempts is None else lognormal_rate(patch, asked, attempts)
    winds = np.arange(ends.min() - REACH, ends.max() + REACH, STEP)
    likely = np.array([best_slope(rate, ends, patch.count, float(wind))[1] for wind in winds])
    count = len(brackets)
    quantile = float(scipy.special.stdtrit(count - 2, 0.5 + 0.5 * CONFIDENCE))
    inside = winds[likely >= likely.max() - 0.5 * count * log(1.0 + quantile**2 / (count - 2))]
    middle = float(winds[np.argmax(likely)])
    slope, _ = best_slope(rate, ends, patch.count, middle)
    low, high = exp(float(inside[0])), exp(float(inside[-1]))
    found = {"low": low, "high": high, "confidence": CONFIDENCE}
    # as of beds whose mean has this interval
    sd = np.sqrt(count) * (high - low) / (2.0 * quantile)
    return Measurement(name, exp(middle), float(sd), UNIT, count, details={"interval": found, "slope": slope})
