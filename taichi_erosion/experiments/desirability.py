"""Several responses wished for at once: one number between 0 and 1.

    maximise   d = ((y - low) / (high - low))^w,   0 below low, 1 above high
    minimise   d = ((high - y) / (high - low))^w
    target     d = 1 - |y - T| / (T - low) below and / (high - T) above T, to the power w
    D = (prod d_i^r_i)^(1 / sum r_i)

with w the weight and r the importance [1]; D = 0 as soon as one response lies outside its limits.

Reference: Derringer & Suich (1980), J. Quality Technology 12, 214, eq. (1)-(4).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan
from typing import Literal

import numpy as np

from taichi_erosion.core.errors import BadInput
from taichi_erosion.experiments.table import Floats

Aim = Literal["target", "maximise", "minimise"]


@dataclass(frozen=True)
class Goal:
    """What is wished of one response, in its unit; limits that are left out follow from runs and model."""

    response: str
    aim: Aim
    target: float = nan
    low: float = nan
    high: float = nan
    weight: float = 1.0
    importance: float = 1.0

    def __post_init__(self) -> None:
        """Refuse a goal that wishes for nothing."""
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
    """Share d before its power is taken: 1 where the wish is met, 0 at the limit, negative beyond it [1].

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
