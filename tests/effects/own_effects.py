"""The library of effects, with a constant pull and the scaffold's effect with a memory from outside of it."""

from dataclasses import replace
from pathlib import Path

from taichi_erosion.cli.new_effect import rendered
from taichi_erosion.core.effect import replica_effect
from taichi_erosion.core.foreign_code import EffectFile
from taichi_erosion.core.setup import Setup
from taichi_erosion.effects import load_library

CONSTANT_PULL = Path(__file__).with_name("constant_pull.py")
AGEING_TEXT = rendered("stateful_effect").replace("NAME", "ageing_pull")
OWN = [CONSTANT_PULL, EffectFile(Path(__file__).with_name("ageing_pull.py"), AGEING_TEXT)]
LIBRARY = load_library(OWN)


def acted_on(bare: Setup, known: dict[str, float], **parameters: dict[str, float]) -> Setup:
    """The setup with effects at full strength, each with its parameters, under known conditions."""
    effects = [(LIBRARY[name], LIBRARY[name].params(**given)) for name, given in sorted(parameters.items())]
    radius = float(bare.grains.radius.max())
    return replace(bare, effects=tuple(replica_effect(*each, 1.0, known, radius) for each in effects))
