"""Scales with near-normal noise: observables through their transform, parameters through their prior."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, inf, log

import numpy as np

from taichi_erosion.evidence.data.problem import Candidate, Floats, Observable, Parameter

EFFECTS = "effects."  # prefix of the strength of an effect that is calibrated with the parameters
STRENGTH = ".strength"
ROUNDING = 1e-14  # of a raised value, below which a value is 0 [1]


def to_scale(observable: Observable, value: Floats) -> Floats:
    """Comparison scale of values: y, ln y or ln(y + floor); NaN where it does not exist."""
    if observable.transform == "identity":
        return np.asarray(value, dtype=float)
    raised = np.asarray(value, dtype=float) + offset(observable)
    if raised.size and raised.min() > 0.0:
        return np.log(raised)
    return np.where(raised > 0.0, np.log(np.where(raised > 0.0, raised, 1.0)), np.nan)


def from_scale(observable: Observable, scaled: Floats) -> Floats:
    """Values in the observable's own unit."""
    if observable.transform == "identity":
        return np.asarray(scaled, dtype=float)
    raised = np.exp(np.clip(scaled, -700.0, 700.0))
    value = raised - offset(observable)
    return np.where(np.abs(value) <= ROUNDING * raised, 0.0, value)


def slope(observable: Observable, value: Floats) -> Floats:
    """Derivative dz/dy of the comparison scale, by which an sd in the observable's unit is multiplied."""
    if observable.transform == "identity":
        return np.ones_like(np.asarray(value, dtype=float))
    raised = np.asarray(value, dtype=float) + offset(observable)
    return np.where(raised > 0.0, 1.0 / np.where(raised > 0.0, raised, 1.0), np.nan)


def offset(observable: Observable) -> float:
    """Constant added before the logarithm, in the observable's unit."""
    return observable.floor if observable.transform == "log_floor" else 0.0


@dataclass(frozen=True)
class Axis:
    """One calibrated number as x, with prior N(0, 1) cut at [low, high].

    value = start exp(scale x) for a parameter; value = scale x for the strength of an adopted effect.
    """

    name: str
    start: float
    scale: float
    low: float
    high: float
    logarithmic: bool


def parameter_axis(parameter: Parameter) -> Axis:
    """Axis of a parameter; a start that is not positive gets a normal prior instead of a lognormal one."""
    if parameter.start <= 0.0:
        scale = max(0.25 * (parameter.high - parameter.low), 1e-300)  # the range as +-2 sd
        low, high = (parameter.low - parameter.start) / scale, (parameter.high - parameter.start) / scale
        return Axis(parameter.path, parameter.start, scale, low, high, False)
    scale = max(parameter.prior_sd_log, 1e-6)
    low = log(parameter.low / parameter.start) / scale if parameter.low > 0.0 else -inf
    high = log(parameter.high / parameter.start) / scale if parameter.high < inf else inf
    return Axis(parameter.path, parameter.start, scale, min(low, 0.0), max(high, 0.0), True)


def adopted_axis(candidate: Candidate) -> Axis:
    """Axis of the strength of an effect that already belongs to the model; half-normal prior."""
    name = f"{EFFECTS}{candidate.name}{STRENGTH}"
    most = candidate.maximum / max(candidate.prior_scale, 1e-300)
    return Axis(name, 0.0, candidate.prior_scale, 0.0, most, False)


def axis_value(axis: Axis, x: float) -> float:
    """The number itself."""
    return axis.start * exp(axis.scale * x) if axis.logarithmic else axis.start + axis.scale * x


def axis_position(axis: Axis, value: float) -> float:
    """Position on the axis of a number."""
    if axis.logarithmic:
        return log(value / axis.start) / axis.scale
    return (value - axis.start) / axis.scale


def position_of(
    axes: tuple[Axis, ...], parameters: Mapping[str, float], effects: Mapping[str, float]
) -> Floats:
    """Joint position of named parameters and adopted effects."""
    values = {**parameters, **{f"{EFFECTS}{name}{STRENGTH}": value for name, value in effects.items()}}
    return np.array([axis_position(axis, values[axis.name]) for axis in axes])


def split_setting(axes: tuple[Axis, ...], x: Floats) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters by path and adopted effects by name."""
    parameters, effects = {}, {}
    for axis, position in zip(axes, x, strict=True):
        value = axis_value(axis, float(position))
        if is_strength(axis.name) and not axis.logarithmic:
            effects[axis.name[len(EFFECTS) : -len(STRENGTH)]] = value
        else:
            parameters[axis.name] = value
    return parameters, effects


def is_strength(path: str) -> bool:
    """Whether a number is the strength of an effect."""
    return path.startswith(EFFECTS) and path.endswith(STRENGTH)


def effect_of(path: str) -> str | None:
    """Effect to which a parameter belongs, None for any other path."""
    return path.split(".")[1] if path.startswith(EFFECTS) else None


def strengths(candidates: tuple[Candidate, ...], acting: Mapping[str, float]) -> dict[str, float]:
    """Every candidate's strength, 0 unless it acts."""
    return {candidate.name: float(acting.get(candidate.name, 0.0)) for candidate in candidates}
