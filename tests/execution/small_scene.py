"""A scene file of a few grains that runs in a second, and a run of it in a process of its own."""

import os
import subprocess
import sys
import tomllib
from copy import deepcopy
from pathlib import Path
from typing import Any

import tomli_w

PATIENCE = 600.0  # s; the cores may be busy
WET = "conditions.moisture=0.02", "effects.liquid_bridge.strength=1", "effects.liquid_bridge.wet_fraction=0.5"
TAPPED = ("effects.packing_preparation.strength=1",)
SCENE: dict[str, Any] = tomllib.loads("""
scene = { kind = "repose", title = "few grains" }
run = { replicas = 2, seed = 3 }
grains = { count = 30, material = "soil", size = { law = "monodisperse", diameter = 2e-3 } }
materials.soil = { density = 2130.0, shear_modulus = 1e6, poisson_ratio = 0.29 }
materials.steel = { density = 7850.0, young_modulus = 2e9, poisson_ratio = 0.3 }
laws = { rolling = "elastic_plastic" }
contact.soil-soil = { restitution = 0.4, friction_sliding = 0.6, friction_rolling = 0.3 }
contact.soil-steel = { restitution = 0.25, friction_sliding = 0.4, friction_rolling = 0.3 }
geometry.plate = { shape = "plane", material = "steel" }
geometry.tube = { shape = "cylinder", material = "steel", radius = 6e-3, length = 0.1 }
fill = { law = "rain", pitch_d = 1.2, jitter_d = 0.05, radius = 4.5e-3, first_height = 2e-3 }
stages = [
  { name = "settle", until = "time", duration_max = 0.06 },
  { name = "collapse", until = "time", duration_max = 0.06, remove = ["tube"] },
]
measure.column_height = { stage = "settle", plate = "plate" }
record = { every = 0.01 }
""")
for at_the_end in ("pile_height", "runout_radius", "repose_angle"):
    SCENE["measure"][at_the_end] = {"stage": "collapse", "plate": "plate"}


def write_scene(folder: Path, **sections: dict[str, Any]) -> Path:
    """Write the scene with entries of sections changed; a section with a law is replaced as a whole."""
    table = deepcopy(SCENE)
    for name, entries in sections.items():
        table[name] = entries if "law" in entries else table.get(name, {}) | entries
    path = folder / "few.toml"
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    return path


def start(scene: Path, *words: str) -> subprocess.Popen[str]:
    """A run in a process of its own."""
    program = [sys.executable, "-m", "taichi_erosion", "run", str(scene), *words]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen(
        program, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=scene.parent
    )
