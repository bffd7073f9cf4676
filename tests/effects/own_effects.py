"""The library of effects, with a constant pull and the scaffold's effect with a memory from outside of it."""

from pathlib import Path

from taichi_erosion.cli.new_effect import rendered
from taichi_erosion.core.foreign_code import EffectFile
from taichi_erosion.effects import load_library

CONSTANT_PULL = Path(__file__).with_name("constant_pull.py")
AGEING_TEXT = rendered("stateful_effect").replace("NAME", "ageing_pull")
OWN = [CONSTANT_PULL, EffectFile(Path(__file__).with_name("ageing_pull.py"), AGEING_TEXT)]
LIBRARY = load_library(OWN)
