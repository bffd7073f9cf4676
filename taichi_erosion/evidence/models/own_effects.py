"""Effects of the user's own files on a model function.

A model function has its own effects inside. Two kinds of files can be added to it: effects of the place
`instrument`, which change readings, and laws of a mechanism that the function declares, which give it the
dose of that mechanism row by row. Any other place acts within a simulation, which a function hides.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from math import isfinite
from pathlib import Path

import numpy as np

from taichi_erosion.core.effect import Effect
from taichi_erosion.core.effect_loading import checked_number, effect_in, failures_of
from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.foreign_code import EffectFile
from taichi_erosion.evidence.data.problem import (
    Bools,
    Candidate,
    Conditions,
    Floats,
    Integers,
    Mechanism,
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


@dataclass(frozen=True)
class DosedModel:
    """A model function with laws for the doses of its mechanisms; one of strength 0 is not called."""

    model: Model
    laws: Mapping[str, Effect]

    def __call__(
        self, observable: str, conditions: Conditions, parameters: Numbers, effects: Numbers, seeds: Integers
    ) -> Floats:
        """Values [seed, row]; rows of the same doses are asked together."""
        acting = {name: effects[name] for name in sorted(self.laws) if effects.get(name, 0.0) != 0.0}
        inside = {name: strength for name, strength in effects.items() if name not in self.laws}
        if not acting:
            return self.model(observable, conditions, parameters, inside, seeds)
        count = row_count(conditions)
        doses: dict[str, Floats] = {}
        for name, strength in acting.items():
            law = self.laws[name]
            before = doses.get(law.mechanism, np.zeros(count))
            doses[law.mechanism] = before + strength * row_doses(law, conditions)
        table = np.column_stack(list(doses.values()))
        _, kinds = np.unique(table, axis=0, return_inverse=True)
        values = np.empty((seeds.size, count))
        for kind in np.unique(kinds):
            rows = np.flatnonzero(kinds.reshape(-1) == kind)
            own = {name: column[rows] for name, column in conditions.items()}
            with_doses = inside | {name: float(column[rows[0]]) for name, column in doses.items()}
            values[:, rows] = self.model(observable, own, parameters, with_doses, seeds)
        return values


def row_doses(law: Effect, conditions: Conditions) -> Floats:
    """Dose of strength 1 in every row."""
    params, doses = law.params(), np.zeros(row_count(conditions))
    for row in range(doses.size):
        known = {name: float(column[row]) for name, column in conditions.items() if isfinite(column[row])}
        with failures_of(law, "dose"):
            doses[row] = law.dose(params, known)
    return doses


def read_through(
    effect: Effect, strength: float, conditions: Conditions, observable: str, values: Floats
) -> Floats:
    """Values [seed, row] as one instrument shows them."""
    params, read = effect.params(), values.copy()
    for row in range(row_count(conditions)):
        known = {name: float(column[row]) for name, column in conditions.items() if isfinite(column[row])}
        with failures_of(effect, "act"):
            shown = (effect.act(params, strength, known, observable, float(v)) for v in values[:, row])
            read[:, row] = [checked_number(effect, one) for one in shown]
    return read


def function_effects(
    path: Path, files: tuple[EffectFile, ...], mechanisms: tuple[Mechanism, ...]
) -> dict[str, Effect]:
    """Effects of some files by name. Raises BadInput for one that a model function cannot take."""
    found: dict[str, Effect] = {}
    places = {mechanism.name for mechanism in mechanisms}
    for file in files:
        effect = effect_in(file)
        if effect.place != "instrument" and effect.mechanism not in places:
            raise BadInput(
                f"{path}: effect '{effect.name}' of {file} has place '{effect.place}', which acts inside a "
                "simulation; a study with model = ... takes effects of place 'instrument', and laws of the "
                "mechanisms that its function declares"
            )
        if effect.name in found:
            raise BadInput(f"{file}: effect '{effect.name}' exists already in another file")
        found[effect.name] = effect
    return found


def with_effects(model: Model, effects: Mapping[str, Effect]) -> Model:
    """A model function with effects of files: laws of mechanisms inside, instruments around."""
    read = {name: effect for name, effect in effects.items() if effect.place == "instrument"}
    laws = {name: effect for name, effect in effects.items() if effect.place != "instrument"}
    dosed = DosedModel(model, laws) if laws else model
    return InstrumentedModel(dosed, read) if read else dosed


def function_candidate(effect: Effect, columns: Mapping[str, str]) -> Candidate:
    """An effect of a file as a candidate, with the priors of its file."""
    acts = partial(mask, effect, dict(columns))
    dose = partial(candidate_doses, effect, dict(columns)) if effect.mechanism else None
    signs = tuple(effect.expected.items())
    return Candidate(effect.name, effect.prior_scale, effect.most, acts, dose, signs)


def candidate_doses(law: Effect, columns: Mapping[str, str], conditions: Conditions) -> Floats:
    """Dose of strength 1 in every row of a table."""
    return row_doses(law, {columns[name]: column for name, column in conditions.items()})


def mask(effect: Effect, columns: Mapping[str, str], conditions: Conditions) -> Bools:
    """Rows of a table in which an effect can act."""
    known = {columns[name]: column for name, column in conditions.items()}
    return np.broadcast_to(np.asarray(effect.can_act(known), dtype=np.bool_), row_count(conditions))
