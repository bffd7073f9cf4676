"""Effects of the user's own files on a model function: those of place `instrument`, which change readings.

A model function has its own effects inside. Any other place acts within a simulation, which a function hides.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path

import numpy as np

from taichi_erosion.core.effect import Effect
from taichi_erosion.core.effect_file import EffectFile
from taichi_erosion.core.effect_loading import effect_in, failures_of
from taichi_erosion.core.errors import BadInput
from taichi_erosion.evidence.data.problem import (
    Bools,
    Candidate,
    Conditions,
    Floats,
    Integers,
    Model,
    Numbers,
    row_count,
)


@dataclass(frozen=True)
class InstrumentedModel:
    """A model function whose values are read through instrument effects; one of strength 0 is not called."""

    model: Model
    effects: Mapping[str, Effect]

    def __call__(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
    ) -> Floats:
        """Values [seed, row] after the instruments, in order of name."""
        inside = {name: strength for name, strength in effects.items() if name not in self.effects}
        values = np.array(self.model(observable, conditions, parameters, inside, seeds))
        for name in sorted(self.effects):
            if strength := effects.get(name, 0.0):
                values = read_through(self.effects[name], strength, conditions, observable, values)
        return values


def read_through(
    effect: Effect, strength: float, conditions: Conditions, observable: str, values: Floats
) -> Floats:
    """Values [seed, row] as one instrument shows them."""
    params, read = effect.params(), values.copy()
    for row in range(row_count(conditions)):
        known = {name: float(column[row]) for name, column in conditions.items() if isfinite(column[row])}
        with failures_of(effect, "act"):
            read[:, row] = [effect.act(params, strength, known, observable, float(v)) for v in values[:, row]]
    return read


def instruments(path: Path, files: tuple[EffectFile, ...]) -> dict[str, Effect]:
    """Effects of some files by name. Raises BadInput for one that a model function cannot take."""
    found: dict[str, Effect] = {}
    for file in files:
        effect = effect_in(file)
        if effect.place != "instrument":
            raise BadInput(
                f"{path}: effect '{effect.name}' of {file} has place '{effect.place}', which acts inside a "
                "simulation; a study with model = ... takes effects of place 'instrument' alone"
            )
        if effect.name in found:
            raise BadInput(f"{file}: effect '{effect.name}' exists already in another file")
        found[effect.name] = effect
    return found


def instrument_candidate(effect: Effect, columns: Mapping[str, str]) -> Candidate:
    """An instrument effect as a candidate, with the priors of its file."""
    return Candidate(effect.name, effect.prior_scale, effect.most, partial(mask, effect, dict(columns)))


def mask(effect: Effect, columns: Mapping[str, str], conditions: Conditions) -> Bools:
    """Rows of a table in which an effect can act."""
    known = {columns[name]: column for name, column in conditions.items()}
    return np.broadcast_to(np.asarray(effect.can_act(known), dtype=np.bool_), row_count(conditions))
