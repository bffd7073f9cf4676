"""A model as a study speaks of it: columns and observables by the names that the table has for them."""

from dataclasses import dataclass

import numpy as np

from taichi_erosion.evidence.plugin import Plugin
from taichi_erosion.evidence.problem import Floats, Integers, Model, Observable
from taichi_erosion.evidence.scales import slope


@dataclass(frozen=True)
class Spoken:
    """A model that calls conditions by other names than the table; what was not written down is left out."""

    model: Model
    names: dict[str, str]  # column -> what the model calls it
    observables: dict[str, str]  # likewise

    def __call__(
        self,
        observable: str,
        conditions: dict[str, Floats],
        parameters: dict[str, float],
        effects: dict[str, float],
        seeds: Integers,
    ) -> Floats:
        """Predictions [seed, row]."""
        known = self.known(conditions)
        return self.model(self.observables[observable], known, parameters, effects, seeds)

    def known(self, conditions: dict[str, Floats]) -> dict[str, Floats]:
        """Conditions that any row states, by the names of the model."""
        return {self.names[c]: v for c, v in conditions.items() if not bool(np.isnan(v).all())}


@dataclass(frozen=True)
class OwnErrors:
    """How far off a model function says it may be: the covariance of its errors, on the comparison scale."""

    plugin: Plugin
    spoken: Spoken
    seed: int  # of the value at which the scale is taken

    def __call__(
        self,
        observable: Observable,
        conditions: dict[str, Floats],
        parameters: dict[str, float],
        effects: dict[str, float],
    ) -> Floats:
        """Covariance [row, row]."""
        name, known = self.spoken.observables[observable.name], self.spoken.known(conditions)
        value = self.spoken(observable.name, conditions, parameters, effects, np.array([self.seed]))[0]
        steepness = slope(observable, value)
        own = self.plugin.own_covariance(name, known, parameters, effects)
        return own * np.outer(steepness, steepness)
