"""What a laboratory reads in place of the true value: effects of instruments, applied to measured values."""

from collections.abc import Mapping
from dataclasses import replace
from math import isfinite

from taichi_erosion.measures.result import Measurement
from taichi_erosion.scene import Scene
from taichi_erosion.simulation.scene_setup import Library, checked_params, conditions_of


def as_read(
    measurements: Mapping[str, Measurement], scene: Scene, library: Library
) -> dict[str, Measurement]:
    """Measurements as the instruments of the scene show them, in the order of the effects' names."""
    read = dict(measurements)
    for effect in (library[name] for name in sorted(scene.effects)):
        params, strength = checked_params(scene, effect)
        if effect.place != "instrument" or strength == 0.0:
            continue
        for name, true in read.items():
            value = effect.act(params, strength, conditions_of(scene), name, true.value)
            if isfinite(true.value) and value != true.value:
                read[name] = reading(true, value, effect.name)
    return read


def reading(true: Measurement, value: float, instrument: str) -> Measurement:
    """A measurement with another value; its spread grows by the same factor."""
    factor = abs(value / true.value) if true.value else 1.0
    note = f"{true.value:.6g} {true.unit} before {instrument}"
    return replace(true, value=value, sd=true.sd * factor, notes=(*true.notes, note))
