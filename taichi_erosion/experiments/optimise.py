"""Settings of the factors that best meet goals for one or several responses, by the fitted models.

Goals are combined into one number between 0 and 1, the overall desirability D:

    d = 1 - |y - T| / (high - low),   D = (prod d_i)^(1 / n)

with T the target, low and high the smallest and the largest value of all runs and of the model in the design.
The search starts from a grid and climbs D. A target that the surface does reach is met along a whole line or
face of the design, not in a point: well separated points of it are listed, the most certain prediction first.
A target that it does not reach is reported as out of reach, with the nearest value.

References: Derringer & Suich (1980), J. Quality Technology 12, 214, eq. (1)-(4); Myers, Montgomery &
Anderson-Cook (2016), Response Surface Methodology, 4th ed., ch. 6 and 7.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import nan

import numpy as np
from scipy.optimize import minimize
from scipy.stats import qmc

from taichi_erosion.core.setup import Floats
from taichi_erosion.experiments.design import factorial_points, settings_at
from taichi_erosion.experiments.fit import Fit

SOFTNESS = (1e-1, 1e-3, 1e-6)  # the tip at a target becomes sharper from search to search [1]
PRECISION = {"ftol": 1e-16, "xtol": 1e-9, "gtol": 1e-10, "maxfun": 200}  # of a function of order 1
NUDGE = 1e-5  # coded step of the central differences; exact for quadratics but for rounding [1]
SPREAD_STARTS, MANY_STARTS = 8, 128  # of a Sobol sequence, with the grid and in its place [1]
MOST_GRID_STARTS = 81
BEST_STARTS = 6  # from which the range of one model is sought [1]
SOBOL_SEED = 0  # the starts between the grid points are the same in every search
ALIKE = 1e-3  # searches that have come this close in coded levels go on as one [1]
SEPARATE = 0.25  # optima closer than this in coded levels are one [1]
MET = 1e-6  # desirability short of 1 that is rounding of the search [1]
MOST_OPTIMA = 20


@dataclass(frozen=True)
class Goal:
    """Target of one response, in its unit, and the limits between which its share is counted."""

    response: str
    target: float
    low: float = nan
    high: float = nan


def goal_desirability(goal: Goal, value: Floats, softness: float = 0.0) -> Floats:
    """Share d: 1 at the target, 0 at the limit, negative beyond it [1].

    `softness` rounds off the tip at a target, |s| -> sqrt(s^2 + softness^2), so that a search by gradients
    finds it.
    """
    return 1.0 - np.sqrt(((value - goal.target) / (goal.high - goal.low)) ** 2 + softness**2)


def desirability(shares: Floats) -> Floats:
    return np.prod(np.maximum(shares, 0.0) ** (1.0 / shares.shape[1]), axis=1)


@dataclass(frozen=True)
class Prediction:
    """A response at a point, with the 95 % interval of its true mean."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Optimum:
    """One point worth trying."""

    coded: Floats  # [factors]
    settings: dict[str, float]  # natural values by path
    predictions: dict[str, Prediction]  # by response
    desirability: float


@dataclass(frozen=True, eq=False)
class Reach:
    """Smallest and largest prediction inside the design, and where."""

    low: float
    high: float
    at_low: dict[str, float]
    at_high: dict[str, float]


@dataclass(frozen=True, eq=False)
class Optimisation:
    """The optima, best first; the range of every model; and sentences about the goals."""

    optima: tuple[Optimum, ...]
    reach: dict[str, Reach]
    is_met: bool  # every target is met at the best optimum
    sentences: tuple[str, ...]


def optimise(fits: Sequence[Fit], goals: Sequence[Goal]) -> Optimisation:
    """Best settings within the design, coded levels from -1 to +1; fits share their factors."""
    by_response = {fit.response: fit for fit in fits}
    models = [by_response[goal.response] for goal in goals]
    reach = {fit.response: prediction_range(fit) for fit in models}
    limited = []
    for goal, fit in zip(goals, models, strict=True):  # limits that hold all runs and all that is predicted
        low = min(float(fit.values.min()), reach[fit.response].low)
        high = max(float(fit.values.max()), reach[fit.response].high)
        least = abs(goal.target) * np.finfo(float).eps  # where the response is the same everywhere
        limited.append(replace(goal, low=low, high=max(high, low + least)))
    optima = local_optima(models, limited)
    shares = goal_shares(models, limited, optima[0].coded[None, :])
    is_met = bool(np.all(np.abs(shares - 1.0) < MET))
    return Optimisation(tuple(optima), reach, is_met, tuple(optimum_cautions(limited, optima, reach, is_met)))


def local_optima(fits: Sequence[Fit], goals: Sequence[Goal]) -> list[Optimum]:
    """Distinct local optima, the most desirable first, the most certain first among equals."""
    ends = start_points(len(fits[0].factors))
    for softness in SOFTNESS:
        loss = partial(goal_loss, fits, goals, softness=softness)
        ends = np.array([nearest_minimum(loss, end) for end in ends])
        ends = ends[np.unique(np.round(ends / ALIKE), axis=0, return_index=True)[1]]
    overall, missing = desirability(goal_shares(fits, goals, ends)), goal_loss(fits, goals, ends)
    certainty = sum((fit.leverage(ends) for fit in fits), np.zeros(len(ends)))
    indices: list[int] = []
    for place in np.lexsort((certainty, np.round(missing / MET), -np.round(overall / MET))):
        if all(np.max(np.abs(ends[place] - ends[other])) > SEPARATE for other in indices):
            indices.append(int(place))
    optima = []
    for place in indices[:MOST_OPTIMA]:
        point = ends[place]
        predicted = dict[str, Prediction]()
        for fit in fits:
            numbers = *fit.predict(point[None, :]), *fit.mean_interval(point[None, :])[0]
            predicted[fit.response] = Prediction(*map(float, numbers))
        optima.append(Optimum(point, settings_at(fits[0].factors, point), predicted, float(overall[place])))
    return optima


def start_points(count: int) -> Floats:
    """Coded points from which the search starts: corners, midpoints, centre; a Sobol sequence between."""
    small = 3**count <= MOST_GRID_STARTS
    sobol = qmc.Sobol(d=count, rng=np.random.default_rng(SOBOL_SEED))
    between = 2.0 * sobol.random(SPREAD_STARTS if small else MANY_STARTS) - 1.0
    return np.concatenate([factorial_points(count) if small else np.zeros((1, count)), between])


def nearest_minimum(loss: Callable[[Floats], Floats], start: Floats) -> Floats:
    """Nearest minimum in the cube of a smooth function of many points, [points, factors] -> [points]."""
    shifts = NUDGE * np.concatenate([np.eye(len(start)), -np.eye(len(start))])

    def slope(coded: Floats) -> Floats:
        above, below = np.split(loss(coded + shifts), 2)
        return (above - below) / (2.0 * NUDGE)

    def value(coded: Floats) -> float:
        return float(loss(coded[None, :])[0])

    limits = [(-1.0, 1.0)] * len(start)
    # a method without linear algebra: threads of a library would cost more than these few numbers
    return np.asarray(minimize(value, start, jac=slope, bounds=limits, method="TNC", options=PRECISION).x)


def goal_shares(fits: Sequence[Fit], goals: Sequence[Goal], coded: Floats, softness: float = 0.0) -> Floats:
    """Share d of every goal at coded points, [points, goals]."""
    pairs = zip(goals, fits, strict=True)
    return np.column_stack([goal_desirability(goal, fit.predict(coded), softness) for goal, fit in pairs])


def goal_loss(fits: Sequence[Fit], goals: Sequence[Goal], coded: Floats, softness: float = 0.0) -> Floats:
    """Objective to minimise, [points]: 1 - D inside all limits, 1 and the excess over them outside."""
    desirabilities = goal_shares(fits, goals, coded, softness)
    return 1.0 - desirability(desirabilities) + np.sum(np.maximum(-desirabilities, 0.0), axis=1)


def prediction_range(fit: Fit) -> Reach:
    begin = start_points(len(fit.factors))
    ends = []
    for sign in (1.0, -1.0):

        def signed_response(points: Floats, sign: float = sign) -> Floats:
            return sign * fit.predict(points)

        best = begin[np.argsort(signed_response(begin))[:BEST_STARTS]]
        predictions = np.array([nearest_minimum(signed_response, start) for start in best])
        ends.append(predictions[np.argmin(signed_response(predictions))])
    low, high = (float(fit.predict(end[None, :])[0]) for end in ends)
    return Reach(low, high, *(settings_at(fit.factors, end) for end in ends))


def optimum_cautions(
    goals: Sequence[Goal], optima: Sequence[Optimum], reach: dict[str, Reach], is_met: bool
) -> Iterator[str]:
    """What a reader must know before trying an optimum."""
    pairs = [(goal, reach[goal.response]) for goal in goals]
    outside = [(goal, ends) for goal, ends in pairs if not ends.low <= goal.target <= ends.high]
    for goal, ends in outside:
        nearest, where = (ends.high, ends.at_high) if goal.target > ends.high else (ends.low, ends.at_low)
        place = ", ".join(f"{path} = {value:.4g}" for path, value in where.items())
        yield (
            f"{goal.response}: the target {goal.target:g} is outside the range of this model in the design "
            f"({ends.low:.4g} to {ends.high:.4g}); the nearest value is {nearest:.4g} at {place}"
        )
    if not outside and not is_met:
        yield "each target can be reached alone, but no point reaches all of them together"
    if is_met and len(optima) > 1 and optima[1].desirability > 1.0 - MET:
        yield "many settings reach the target (a line or face of the design); the first is the most certain"
    if optima[0].desirability <= 0.0:
        yield "no point is inside all limits: the listed points are the nearest ones"
