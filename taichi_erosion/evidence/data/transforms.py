"""Scales with near-normal noise: observables through their transform, parameters through their prior, rows by
whitening, and limits among them as ordinary rows.
"""

from dataclasses import dataclass
from math import exp, inf, log

import numpy as np
from scipy import special

from taichi_erosion.evidence.data.problem import Candidate, Floats, Observable, Parameter

EFFECTS = "effects."  # prefix of the strength of an effect that is calibrated with the parameters
STRENGTH = ".strength"
ROUNDING = 1e-14  # of a raised value, below which a value is 0 [1]


def to_scale(observable: Observable, value: Floats) -> Floats:
    """Comparison scale of values: y, ln y or ln(y + floor); NaN where it does not exist."""
    if observable.transform == "identity":
        return np.asarray(value, dtype=float)
    raised = np.asarray(value, dtype=float) + logarithm_offset(observable)
    if raised.size and raised.min() > 0.0:
        return np.log(raised)
    return np.where(raised > 0.0, np.log(np.where(raised > 0.0, raised, 1.0)), np.nan)


def from_scale(observable: Observable, scaled: Floats) -> Floats:
    if observable.transform == "identity":
        return np.asarray(scaled, dtype=float)
    raised = np.exp(np.clip(scaled, -700.0, 700.0))
    value = raised - logarithm_offset(observable)
    return np.where(np.abs(value) <= ROUNDING * raised, 0.0, value)


def slope(observable: Observable, value: Floats) -> Floats:
    """Derivative dz/dy of the comparison scale, by which an sd in the observable's unit is multiplied."""
    if observable.transform == "identity":
        return np.ones_like(np.asarray(value, dtype=float))
    raised = np.asarray(value, dtype=float) + logarithm_offset(observable)
    return np.where(raised > 0.0, 1.0 / np.where(raised > 0.0, raised, 1.0), np.nan)


def logarithm_offset(observable: Observable) -> float:
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
    most = candidate.maximum / max(candidate.prior_scale, 1e-300)
    return Axis(f"{EFFECTS}{candidate.name}{STRENGTH}", 0.0, candidate.prior_scale, 0.0, most, False)


def value_on_axis(axis: Axis, x: float) -> float:
    return axis.start * exp(axis.scale * x) if axis.logarithmic else axis.start + axis.scale * x


def axis_position(axis: Axis, value: float) -> float:
    return (log(value / axis.start) if axis.logarithmic else value - axis.start) / axis.scale


def split_numbers(axes: tuple[Axis, ...], x: Floats) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters by path and adopted effects by name."""
    parameters, effects = {}, {}
    for axis, position in zip(axes, x, strict=True):
        value = value_on_axis(axis, float(position))
        if is_strength_path(axis.name) and not axis.logarithmic:
            effects[axis.name[len(EFFECTS) : -len(STRENGTH)]] = value
        else:
            parameters[axis.name] = value
    return parameters, effects


def is_strength_path(path: str) -> bool:
    return path.startswith(EFFECTS) and path.endswith(STRENGTH)


def effect_of_path(path: str) -> str | None:
    """Effect to which a parameter belongs, None for any other path."""
    return path.split(".")[1] if path.startswith(EFFECTS) else None


@dataclass(frozen=True)
class Whitening:
    """Changes of the rows in independent errors of unit variance: R^-1/2 (v / s), with V = s R s.

    The symmetric root keeps every whitened row as near to its own row as can be, and a row that is correlated
    with no other one as it is.

    Reference: Kessy, Lewin & Strimmer (2018), Am. Stat. 72, 309 (ZCA-cor).
    """

    sd: Floats  # (n,), s
    root: Floats | None = None  # (n, n), R^-1/2; None: no rows are correlated

    def __call__(self, rows: Floats) -> Floats:
        """Whitened rows (n,) or (n, columns)."""
        columns = rows / (self.sd if rows.ndim == 1 else self.sd[:, np.newaxis])
        return columns if self.root is None else np.asarray(self.root @ columns, dtype=np.float64)


@dataclass(frozen=True)
class Working:
    """Censored rows as ordinary ones: same deviance, slope and curvature at this point."""

    residual: Floats  # (n,) or (n, columns)
    weight: Floats  # factor of every row of the Jacobian
    deviances: Floats  # (columns,), -2 ln likelihood without its constant

    @property
    def censored_deviance(self) -> float:
        return float(self.deviances)


def working_residuals(residual: Floats, reach: Floats) -> Working:
    """Working residuals of one whitened residual, or of columns of them.

    `reach` is 0 for an ordinary row, and says where a censored value lies: -inf below its limit z, +inf above
    it, h between z - h and z + h, in sd. With the ends a < b of (that range - m) / s its deviance is -2 ln P,
    P = Phi(b) - Phi(a); l = (phi(b) - phi(a)) / P is its score and w = l^2 + (b phi(b) - a phi(a)) / P its
    curvature.

    Reference: Tobin (1958), Econometrica 26, 24.
    """
    censored = reach != 0.0
    if not censored.any():
        return Working(residual, np.ones_like(residual), np.sum(residual**2, axis=0))
    u = residual[censored]
    log_share, score, curvature = censored_score(u, reach[censored].reshape(-1, *([1] * (u.ndim - 1))))
    weight, adjusted = np.ones_like(residual), residual.copy()
    weight[censored] = np.sqrt(curvature)
    adjusted[censored] = -score / np.sqrt(curvature)
    return Working(adjusted, weight, np.sum(residual[~censored] ** 2, axis=0) - 2.0 * log_share.sum(axis=0))


def censored_score(u: Floats, reach: Floats) -> tuple[Floats, Floats, Floats]:
    """Ln probability, score and curvature of censored values; both ends in the lower tail by symmetry."""
    low = np.where(reach == np.inf, u, np.where(reach == -np.inf, -np.inf, u - np.abs(reach)))
    high = np.where(reach == np.inf, np.inf, np.where(reach == -np.inf, u, u + np.abs(reach)))
    flip = low + high > 0.0
    a, b = np.where(flip, -high, low), np.where(flip, -low, high)
    log_upper = special.log_ndtr(b)
    log_share = log_upper + np.log1p(-np.exp(np.minimum(special.log_ndtr(a) - log_upper, -1e-12)))
    density_a, density_b = (np.exp(-0.5 * x**2 - 0.5 * np.log(2.0 * np.pi) - log_share) for x in (a, b))
    ends = [np.where(np.isfinite(x), x, 0.0) * d for x, d in ((a, density_a), (b, density_b))]
    score = density_b - density_a
    curvature = np.clip(score**2 + ends[1] - ends[0], 1e-12, 1.0)
    return log_share, np.where(flip, -score, score), curvature
