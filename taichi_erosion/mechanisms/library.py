"""The basis of mechanisms: one file each in `basis/`, on the interface of effects.

A mechanism is an effect whose first parameter is its dose: a dimensionless number, 0 where it does nothing,
on the scale that its file states. Strength multiplies the dose. A mechanism is no candidate of a discovery
and stands in no list of effects; it is asked for by name.
"""

from dataclasses import fields
from functools import cache
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from taichi_erosion.core.effect import Effect
from taichi_erosion.core.effect_loading import MEMBER
from taichi_erosion.mechanisms import basis

DOSE = "dose"  # parameter of every mechanism


@cache
def load_mechanisms() -> dict[str, Effect]:
    """All mechanisms by name."""
    names = sorted(module.name for module in iter_modules(basis.__path__))
    return {name: getattr(import_module(f"{basis.__name__}.{name}"), MEMBER) for name in names}


def mechanism_path(name: str) -> Path:
    """File of a mechanism; a scene or study can name it as it names any effect file."""
    return Path(next(iter(basis.__path__))) / f"{name}.py"


def dose_range(mechanism: Effect) -> tuple[float, float]:
    """Least and largest dose for which a mechanism is meant [1]."""
    declared = next(f for f in fields(mechanism.params) if f.name == DOSE)
    return declared.metadata["low"], declared.metadata["high"]
