"""The basis of mechanisms: one file each in `basis/`, on the interface of effects.

A mechanism is an effect whose first parameter is its dose: a dimensionless number, 0 where it does nothing,
on the scale that its file states. Strength multiplies the dose. A mechanism is no candidate of a discovery
and stands in no list of effects; it is asked for by name.
"""

from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import numpy as np

from taichi_erosion.core.effect import Effect
from taichi_erosion.core.effect_loading import MEMBER
from taichi_erosion.mechanisms import basis

DOSE = "dose"  # parameter of every mechanism
OF_WIND = ("bed_stress", "drag", "gustiness", "lift")  # that act through wind alone


@cache
def load_mechanisms() -> dict[str, Effect]:
    """All mechanisms by name."""
    names = sorted(module.name for module in iter_modules(basis.__path__))
    return {name: getattr(import_module(f"{basis.__name__}.{name}"), MEMBER) for name in names}


def mechanism_path(name: str) -> Path:
    """File of a mechanism; a scene or study can name it as it names any effect file."""
    return Path(next(iter(basis.__path__))) / f"{name}.py"


def physical_mechanisms(wind: bool) -> list[str]:
    """Mechanisms that can act in a scene with or without wind; instruments need none."""
    known = load_mechanisms()
    return [name for name in known if known[name].place != "instrument" and (wind or name not in OF_WIND)]


def dose_position(dose: Any) -> Any:
    """Place of a dose on a scale on which its range is even: sign(D) ln(1 + |D|) [1]."""
    return np.sign(dose) * np.log1p(np.abs(dose))


def dose_at(position: float) -> float:
    """Dose at a place on that scale [1]."""
    return float(np.sign(position) * np.expm1(abs(position)))


def dose_range(mechanism: Effect) -> tuple[float, float]:
    """Least and largest dose for which a mechanism is meant [1]."""
    return declared_dose(mechanism)["low"], declared_dose(mechanism)["high"]


def dose_meaning(mechanism: Effect) -> str:
    """What the dose of a mechanism counts."""
    return declared_dose(mechanism)["meaning"]


def declared_dose(mechanism: Effect) -> Mapping[str, Any]:
    """Unit, meaning and range of the dose."""
    return next(f for f in fields(mechanism.params) if f.name == DOSE).metadata
