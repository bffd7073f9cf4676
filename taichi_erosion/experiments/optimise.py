"""Settings of the factors that best meet goals for one or several responses, by the fitted models.

Goals are combined into one number between 0 and 1, the overall desirability D:

    maximise   d = ((y - low) / (high - low))^w,   0 below low, 1 above high
    minimise   d = ((high - y) / (high - low))^w
    target     d = 1 - |y - T| / (T - low) below and / (high - T) above T, to the power w
    D = (prod d_i^r_i)^(1 / sum r_i)

with w the weight and r the importance [1]; D = 0 as soon as one response lies outside its limits. The search
starts from a grid and climbs D. A target that the surface does reach is met along a whole line or face of the
design, not in a point: well separated points of it are listed, the most certain prediction first. A target
that it does not reach is reported as out of reach, with the nearest value.

References: Derringer & Suich (1980), J. Quality Technology 12, 214, eq. (1)-(4); Myers, Montgomery &
Anderson-Cook (2016), Response Surface Methodology, 4th ed., ch. 6 and 7.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import isfinite, nan
from typing import Literal

import numpy as np
from scipy.optimize import minimize

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.design import grid_points, sobol_points
from taichi_erosion.experiments.design_table import Floats, to_natural
from taichi_erosion.experiments.fit import Fit

Aim = Literal["target", "maximise", "minimise"]


@dataclass(frozen=True)
class Goal:
    """Goal of one response, in its unit; limits that are left out follow from runs and model."""

    response: str
    aim: Aim
    target: float = nan
    low: float = nan
    high: float = nan
    weight: float = 1.0
    importance: float = 1.0

    def __post_init__(self) -> None:
        """Refuse a goal without a target, a weight or an importance."""
        if (self.aim == "target") != isfinite(self.target):
            raise BadInput(f"goal {self.response}: a target is stated with aim = 'target', and only then")
        if not (self.weight > 0.0 and self.importance > 0.0):
            raise BadInput(f"goal {self.response}: weight and importance must be above 0")


def completed(goal: Goal, smallest: float, largest: float) -> Goal:
    """The goal with its missing limits, for a response between the smallest and the largest.

    To maximise or minimise they are these two; around a target, it and their distance either way.
    """
    spread = max(largest - smallest, abs(goal.target) * np.finfo(float).eps)
    defaults = (goal.target - spread, goal.target + spread) if goal.aim == "target" else (smallest, largest)
    low = goal.low if isfinite(goal.low) else defaults[0]
    high = goal.high if isfinite(goal.high) else defaults[1]
    middle = goal.target if goal.aim == "target" else 0.5 * (low + high)
    if not low < middle < high:
        raise BadInput(
            f"goal {goal.response}: needs low < high with the target between, got {low:g}, {high:g}"
        )
    return replace(goal, low=low, high=high)


def single_share(goal: Goal, value: Floats, softness: float = 0.0) -> Floats:
    """Share d before its power is taken: 1 where the goal is met, 0 at the limit, negative beyond it [1].

    `softness` rounds off the tip at a target, |s| -> sqrt(s^2 + softness^2), so that a search by gradients
    finds it.
    """
    if goal.aim == "maximise":
        return np.minimum((value - goal.low) / (goal.high - goal.low), 1.0)
    if goal.aim == "minimise":
        return np.minimum((goal.high - value) / (goal.high - goal.low), 1.0)
    width = np.where(value < goal.target, goal.target - goal.low, goal.high - goal.target)
    return 1.0 - np.sqrt(((value - goal.target) / width) ** 2 + softness**2)


def desirability(goals: Sequence[Goal], values: Floats) -> Floats:
    """D of predicted responses, values [points, goals]."""
    shares = np.column_stack([single_share(goal, values[:, k]) for k, goal in enumerate(goals)])
    return combined(goals, shares)


def combined(goals: Sequence[Goal], shares: Floats) -> Floats:
    """Weighted geometric mean of the shares, 0 where one of them is not above 0."""
    importance = np.array([goal.importance for goal in goals])
    powers = np.array([goal.weight for goal in goals]) * importance / importance.sum()
    return np.prod(np.maximum(shares, 0.0) ** powers, axis=1)


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
    met: bool  # every target is met at the best optimum
    sentences: tuple[str, ...]


def optimise(fits: Sequence[Fit], goals: Sequence[Goal]) -> Optimisation:
    """Best settings within the design, coded levels from -1 to +1; fits share their factors."""
    known = {fit.response: fit for fit in fits}
    if not goals:
        raise BadInput("optimise: no goal; name a response and its aim")
    for goal in goals:
        if goal.response not in known:
            raise BadInput(f"goal {goal.response}: no such response; there are: {', '.join(known)}")
    models = [known[goal.response] for goal in goals]
    reach = {fit.response: reachable(fit) for fit in models}
    limited = [with_limits(goal, fit, reach[fit.response]) for goal, fit in zip(goals, models, strict=True)]
    optima = local_optima(models, limited)
    met = all(
        goal.aim != "target" or abs(single_share(goal, fit.predict(optima[0].coded[None, :])) - 1.0) < MET
        for goal, fit in zip(limited, models, strict=True)
    )
    return Optimisation(tuple(optima), reach, met, tuple(explain(limited, optima, reach, met)))


def with_limits(goal: Goal, fit: Fit, reach: Reach) -> Goal:
    """The goal with limits that hold all runs and all that the model predicts."""
    smallest, largest = float(fit.values.min()), float(fit.values.max())
    return completed(goal, min(smallest, reach.low), max(largest, reach.high))


def local_optima(fits: Sequence[Fit], goals: Sequence[Goal]) -> list[Optimum]:
    """Distinct local optima, the most desirable first, the most certain first among equals."""
    ends = starts(len(fits[0].factors))
    for softness in SOFTNESS:
        loss = partial(shortfall, fits, goals, softness=softness)
        found = np.array([descend(loss, end) for end in ends])
        ends = found[np.unique(np.round(found / ALIKE), axis=0, return_index=True)[1]]
    overall = desirability(goals, predictions(fits, ends))
    certainty = sum((fit.leverage(ends) for fit in fits), np.zeros(len(ends)))
    missing = shortfall(fits, goals, ends)
    kept: list[int] = []
    for place in np.lexsort((certainty, np.round(missing / MET), -np.round(overall / MET))):
        if all(np.max(np.abs(ends[place] - ends[other])) > SEPARATE for other in kept):
            kept.append(int(place))
    return [as_optimum(fits, ends[place], float(overall[place])) for place in kept[:MOST_OPTIMA]]


def starts(count: int) -> Floats:
    """Coded points from which the search starts: corners, midpoints and centre, and points in between."""
    small = 3**count <= MOST_GRID_STARTS
    spread = sobol_points(count, SPREAD_STARTS if small else MANY_STARTS, SOBOL_SEED)
    return np.concatenate([grid_points(count) if small else np.zeros((1, count)), spread])


def descend(loss: Callable[[Floats], Floats], start: Floats) -> Floats:
    """Nearest minimum in the cube of a smooth function of many points, [points, factors] -> [points]."""
    shifts = NUDGE * np.concatenate([np.eye(len(start)), -np.eye(len(start))])

    def slope(coded: Floats) -> Floats:
        above, below = np.split(loss(coded + shifts), 2)
        return (above - below) / (2.0 * NUDGE)

    def value(coded: Floats) -> float:
        return float(loss(coded[None, :])[0])

    limits = [(-1.0, 1.0)] * len(start)
    # a method without linear algebra: threads of a library would cost more than these few numbers
    found = minimize(value, start, jac=slope, bounds=limits, method="TNC", options=PRECISION)
    return np.asarray(found.x)


def shortfall(fits: Sequence[Fit], goals: Sequence[Goal], coded: Floats, softness: float = 0.0) -> Floats:
    """Objective to minimise, [points]: 1 - D inside all limits, 1 and the excess over them outside."""
    values = predictions(fits, coded)
    shares = np.column_stack([single_share(goal, values[:, k], softness) for k, goal in enumerate(goals)])
    return 1.0 - combined(goals, shares) + np.sum(np.maximum(-shares, 0.0), axis=1)


def predictions(fits: Sequence[Fit], coded: Floats) -> Floats:
    """Predicted responses, [points, fits]."""
    return np.column_stack([fit.predict(coded) for fit in fits])


def as_optimum(fits: Sequence[Fit], coded: Floats, worth: float) -> Optimum:
    """A point with everything that is predicted there."""
    predicted = {}
    for fit in fits:
        low, high = fit.interval(coded[None, :])[0]
        predicted[fit.response] = Prediction(float(fit.predict(coded[None, :])[0]), float(low), float(high))
    return Optimum(coded, settings_at(fits[0], coded), predicted, worth)


def settings_at(fit: Fit, coded: Floats) -> dict[str, float]:
    """Natural values of a coded point, by path."""
    return {
        f.path: float(value) for f, value in zip(fit.factors, to_natural(fit.factors, coded), strict=True)
    }


def reachable(fit: Fit) -> Reach:
    """Range of the predictions in the cube."""
    begin, ends = starts(len(fit.factors)), []
    for sign in (1.0, -1.0):

        def signed(points: Floats, sign: float = sign) -> Floats:
            return sign * fit.predict(points)

        best = begin[np.argsort(signed(begin))[:BEST_STARTS]]
        found = np.array([descend(signed, start) for start in best])
        ends.append(found[np.argmin(signed(found))])
    low, high = (float(fit.predict(end[None, :])[0]) for end in ends)
    return Reach(low, high, settings_at(fit, ends[0]), settings_at(fit, ends[1]))


def explain(
    goals: Sequence[Goal], optima: Sequence[Optimum], reach: dict[str, Reach], met: bool
) -> list[str]:
    """What a reader must know before trying an optimum."""
    targets = [goal for goal in goals if goal.aim == "target"]
    said = [sentence for goal in targets if (sentence := out_of_reach(goal, reach[goal.response]))]
    if targets and not said and not met:
        said.append("each target can be reached alone, but no point reaches all of them together")
    if targets and met and len(optima) > 1 and optima[1].desirability > 1.0 - MET:
        said.append(
            "many settings reach the target (a line or face of the design); the first is the most certain"
        )
    if optima[0].desirability <= 0.0:
        said.append("no point is inside all limits: the listed points are the nearest ones")
    return said


def out_of_reach(goal: Goal, reach: Reach) -> str:
    """The sentence for a target that the model reaches nowhere, empty where it does."""
    if reach.low <= goal.target <= reach.high:
        return ""
    nearest, where = (reach.high, reach.at_high) if goal.target > reach.high else (reach.low, reach.at_low)
    place = ", ".join(f"{path} = {value:.4g}" for path, value in where.items())
    return (
        f"{goal.response}: the target {goal.target:g} is outside the range of this model in the design "
        f"({reach.low:.4g} to {reach.high:.4g}); the nearest value is {nearest:.4g} at {place}"
    )
