"""The library of effects with two from outside: the constant pull of the scaffold, and that with a memory."""

from dataclasses import replace
from pathlib import Path

from taichi_erosion.cli.effects import effect_file_text
from taichi_erosion.core.effect import replica_effect
from taichi_erosion.core.effect_file import EffectFile
from taichi_erosion.core.setup import Setup
from taichi_erosion.effect_library import load_library

OWN = [
    EffectFile(Path(__file__).with_name(f"{name}.py"), effect_file_text(scaffold).replace("NAME", name))
    for scaffold, name in (("pair_effect", "constant_pull"), ("stateful_effect", "ageing_pull"))
]
LIBRARY = load_library(OWN)


def acted_on(bare: Setup, known: dict[str, float], **parameters: dict[str, float]) -> Setup:
    """The setup with effects at full strength, each with its parameters, under known conditions."""
    effects = [(LIBRARY[name], LIBRARY[name].params(**given)) for name, given in sorted(parameters.items())]
    radius = float(bare.grains.radius.max())
    return replace(bare, effects=tuple(replica_effect(*each, 1.0, known, radius) for each in effects))
