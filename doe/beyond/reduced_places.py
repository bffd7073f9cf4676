"""The reduced wind-erosion model with places for mechanisms, beside its listed effects.

Effects that are named after a mechanism come with their dose D (see `mechanisms/`); what one does to
threshold, flux and angle follows the scaling of `reduced.py`, its size is plausible:

    contact_pull          u*t x sqrt(1 + D), angle + 9 D / (1 + D) deg       pull over weight
    sliding_friction      angle of mu_s (1 + D), u*t x (1 + D)^1/4
    rolling_friction      angle + 15 mu_r D deg, u*t x (1 + D)^1/8
    restitution           flux x (1 + D)^1/2, angle - 2 D deg
    grain_weight          u*t x sqrt(1 + D)
    drag                  u*t / sqrt(1 + D), flux x (1 + D)^1/2
    lift                  u*t / sqrt(1 + 0.3 D)
    vertical_force        u*t x sqrt(1 - D), angle - 3 D deg
    bed_stress            u* x sqrt(1 + D)
    gustiness             u*t / (1 + 2 D), flux x (1 + 3 D^2)
    wall_sliding_friction angle + 4 D deg

Use it as `model = "reduced_places:predict"` in a study beside this file.
"""

from collections.abc import Callable

import numpy as np

from taichi_erosion.evidence.data.problem import Conditions, Floats, Integers, Numbers, row_count
from taichi_erosion.evidence.models import reduced
from taichi_erosion.evidence.models.reduced import Shift

Place = Callable[[float, Numbers], Shift]  # (dose, parameters)
LEAST = 0.01  # smallest factor [1]


def log_factor(dose: float) -> float:
    """Ln of a factor that is 1 + dose, at least LEAST."""
    return float(np.log(max(1.0 + dose, LEAST)))


PLACES: dict[str, Place] = {
    "contact_pull": lambda dose, _: Shift(threshold=0.5 * log_factor(dose), repose=9.0 * dose / (1.0 + dose)),
    "sliding_friction": lambda dose, given: Shift(
        threshold=0.25 * log_factor(dose), repose=angle_gained(given["friction_sliding"], dose)
    ),
    "rolling_friction": lambda dose, given: Shift(
        threshold=0.125 * log_factor(dose),
        repose=reduced.DEGREES_PER_ROLLING * given["friction_rolling"] * dose,
    ),
    "restitution": lambda dose, _: Shift(flux=0.5 * log_factor(dose), repose=-2.0 * dose),
    "grain_weight": lambda dose, _: Shift(threshold=0.5 * log_factor(dose)),
    "drag": lambda dose, _: Shift(threshold=-0.5 * log_factor(dose), flux=0.5 * log_factor(dose)),
    "lift": lambda dose, _: Shift(threshold=-0.5 * log_factor(0.3 * dose)),
    "vertical_force": lambda dose, _: Shift(threshold=0.5 * log_factor(-dose), repose=-3.0 * dose),
    "bed_stress": lambda dose, _: Shift(threshold=-0.5 * log_factor(dose), flux=1.5 * log_factor(dose)),
    "gustiness": lambda dose, _: Shift(threshold=-log_factor(2.0 * dose), flux=np.log1p(3.0 * dose**2)),
    "wall_sliding_friction": lambda dose, _: Shift(repose=4.0 * dose),
}


def angle_gained(friction: float, dose: float) -> float:
    """Angle of friction gained by a dose [deg]."""
    return float(np.degrees(np.arctan(friction * (1.0 + dose)) - np.arctan(friction)))


def predict(
    observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
) -> Floats:
    """The model of the study contract: one observable, n conditions, r seeds -> (r, n), paired by seed."""
    value = expected(observable, conditions, parameters, effects)
    kick = reduced.SCATTER[observable] * reduced.paired_normal_numbers(observable, conditions, seeds)
    return value + kick if observable == "repose_angle" else value * np.exp(kick)


def expected(observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers) -> Floats:
    """The model without its scatter."""
    given = {**reduced.PARAMETERS, **parameters}
    at = reduced.DEFAULT_COLUMNS | conditions
    acting = {name: size for name, size in effects.items() if size != 0.0}
    shifts = [
        PLACES[name](size, given) if name in PLACES else reduced.EFFECTS[name](size, at)
        for name, size in acting.items()
    ]
    return reduced.mean_with_shifts(observable, row_count(conditions), at, given, shifts)


predict_mechanisms = {  # doses at which the model has values
    "contact_pull": (-0.9, 10.0),
    "sliding_friction": (-0.9, 4.0),
    "rolling_friction": (-0.9, 19.0),
    "restitution": (-0.9, 1.5),
    "grain_weight": (-0.9, 9.0),
    "drag": (-0.9, 4.0),
    "lift": (-2.0, 10.0),
    "vertical_force": (-5.0, 0.9),
    "bed_stress": (-0.9, 3.0),
    "gustiness": (0.0, 1.0),
    "wall_sliding_friction": (-1.0, 4.0),
}
