"""Raw scenes for the tests: one that is right, and hundreds that are wrong in one place each.

Mistakes that scene.schema.json refuses too are a sample of each kind: a range, a choice or a needed key that
changes is seen there (test_paths.py).
"""

import tomllib
from collections.abc import Callable, Iterator
from copy import deepcopy
from datetime import date
from math import inf, nan
from pathlib import Path
from typing import Any

import pytest

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import parse_scene

SCENES = Path(__file__).parents[2] / "scenes"
TUNNEL = SCENES / "tunnel_section.toml"
ABSENT = object()  # stands for a key that is taken away
TABLES = "grains grains.size contact.soil-soil geometry.plate stages.1.move measured effects".split()
WORDS = "fill.law laws.normal geometry.plate.shape run.precision stages.0.until".split()
NUMBERS = (
    "conditions.moisture run.replicas run.seed gravity.magnitude grains.count grains.size.median "
    "grains.size.low materials.soil.density materials.soil.shear_modulus contact.soil-soil.restitution "
    "geometry.plate.radius fill.radius stages.0.duration_max record.every measured.repose_angle.n"
).split()
NEEDED = (
    "materials.soil materials.soil.shear_modulus contact.soil-soil contact.steel-soil "
    "grains.size.law grains.size.median fill fill.law stages.0.name"
).split()
ABSURD = {  # values that are numbers, but not here
    "run.seed": (-1, 2**70, 0.5),
    "run.time_step": (-1e-5, 1e-3),
    "run.time_step_fraction": (0.5, 5.0),
    "gravity.direction": ([0.0, 0.0, 0.0], [0.0, 1.0], [nan, 0.0, 1.0], "down"),
    "grains.count": (0, 2.5, 10**30),
    "grains.size.median": (5e-3, 1e-9),
    "grains.size.low": (2.5e-3, 1e-6),
    "grains.size.high": (1.5e-3, 0.5),
    "materials.soil.shear_modulus": (1e3, 2.05e13),
    "contact.soil-soil.surface_energy": (-1.0, 3.302),
    "geometry.plate.centre": ([0.0, 0.0], [0.0, 0.0, inf], [1e9, 0.0, 0.0], 0.0),
    "geometry.plate.axis": ([0.0, 0.0, 0.0],),
    "geometry.funnel.rim_radius": (1e-3,),
    "fill.radius": (1e-4, 0.0),
    "stages.0.duration_min": (2.0,),
}
WRONG_NAMES = {
    "geometry.plate.material": "glass",
    "stages.0.remove": ["funnel"],  # a later stage still moves it
    "stages.1.move": {"lid": {}},
    "stages.1.name": "pour",
    "measure.repose_angle.stage": "end",
    "measure.repose_angle.plate": "floor",
    "grains.sise": {},
    "contact.soil": {"restitution": 0.5, "friction_sliding": 0.5},
    "contact.soil-steel": {"restitution": 0.5, "friction_sliding": 0.5},
    "contact.soil-sand": {"restitution": 0.5, "friction_sliding": 0.5},
    "materials.wet soil": {"density": 1.0, "shear_modulus": 1e7, "poisson_ratio": 0.3},
    "materials.soil.young_modulus": 1e7,
    "grains.size": {"law": "sieve"},
    "effects.plain_pull": {"strength": nan},
}
WHOLE_SIZES = (
    {"law": "sieve", "table": "nobody2000"},
    {"law": "sieve", "table": "hao2022"},  # from 75 um: too small to be poured beside grains of 4 mm
    {"law": "sieve", "rows": []},
    {"law": "sieve", "rows": [[2e-3, 1e-3, 5.0]]},
    {"law": "sieve", "rows": [[1e-3, 2e-3, 0.0]]},
    {"law": "sieve", "rows": [[1e-3, 3e-3, 1.0], [2e-3, 4e-3, 1.0]]},
    {"law": "sieve", "table": "hao2022", "low": 5e-3, "high": 6e-3},
    {"law": "sieve", "table": "hao2022", "low": 2e-3, "high": 1e-3},
)
WHOLE_FILLS = (
    {"law": "positions", "grains": [{"position": [0.0, 0.0, 0.1]}]},
    {"law": "rain", "pitch": 1e-3, "radius": 0.02, "first_height": 0.01},
    {"law": "rain", "pitch_d": 1.0, "radius": 0.02, "first_height": 0.01},
    {"law": "lattice", "pitch": 4e-3, "radius": 5e-3, "length": 5e-3},
)
GOOD = """
scene = { kind = "repose", title = "small pour" }
conditions = { moisture = 0.01 }
run = { replicas = 2, seed = 7 }
gravity = { magnitude = 9.81 }
grains = { count = 60, material = "soil", size = { law = "lognormal", median = 2e-3, sigma_log = 0.2 } }
materials.soil = { density = 2130.0, shear_modulus = 1e7, poisson_ratio = 0.29 }
materials.steel = { density = 7850.0, young_modulus = 1.8e11, poisson_ratio = 0.3 }
laws = { rolling = "elastic_plastic" }
contact.soil-soil = { restitution = 0.6, friction_sliding = 0.61, friction_rolling = 0.69 }
contact.steel-soil = { restitution = 0.25, friction_sliding = 0.34, friction_rolling = 0.41 }
geometry.plate = { shape = "disc", material = "steel", radius = 0.1 }
geometry.funnel = { shape = "funnel", material = "steel", outlet = [0.0, 0.0, 0.05], outlet_radius = 0.01 }
fill = { law = "pour", centre = [0.0, 0.0, 0.09], radius = 0.02, speed = 2.0 }
stages = [
  { name = "pour", duration_max = 1.0 },
  { name = "lift", duration_max = 1.0, move = { funnel = { velocity = [0.0, 0.0, 0.1] } } },
  { name = "rest", duration_max = 1.0, remove = ["funnel"] },
]
measure.repose_angle = { stage = "rest", plate = "plate" }
measured.repose_angle = { value = 33.52, sd = 0.68, n = 10 }
record = { every = 0.01 }
effects.plain_pull = { strength = 1.0 }
"""


def good_table() -> dict[str, Any]:
    table = tomllib.loads(GOOD)
    table["grains"]["size"] |= {"low": 1e-3, "high": 3e-3}
    table["geometry"]["funnel"] |= {"rim_radius": 0.04, "cone_height": 0.04}
    return table


def places(table: dict[str, Any], path: str) -> tuple[Any, Any]:
    """The table or list that holds a path, and the last key."""
    *above, last = path.split(".")
    holder: Any = table
    for key in above:
        holder = holder[int(key)] if isinstance(holder, list) else holder[key]
    return holder, int(last) if isinstance(holder, list) else last


def changed(path: str, value: Any) -> dict[str, Any]:
    """The good scene with one value replaced, added or taken away."""
    table = good_table()
    holder, key = places(table, path)
    if value is ABSENT:
        del holder[key]
    else:
        holder[key] = deepcopy(value)
    return table


def wrong_places() -> Iterator[tuple[str, Any]]:
    for path in NUMBERS:
        yield from ((path, value) for value in ("much", True, nan, inf, -inf, [1.0], {}, date(2026, 1, 1)))
    for path in NEEDED:
        yield path, ABSENT
    for path in TABLES:
        yield from ((path, value) for value in (3.0, "table"))
    for path in WORDS:
        yield from ((path, value) for value in ("anything", 1, ["hertz"]))
    for path, values in ABSURD.items():
        yield from ((path, value) for value in values)
    yield from WRONG_NAMES.items()
    yield from (("grains.size", size) for size in WHOLE_SIZES)
    yield from (("fill", fill) for fill in WHOLE_FILLS)


def softened(rule: str, energy: float) -> dict[str, Any]:
    """A scene with JKR, whose soil is softened by a rule; `energy` is that of its surface [J m-2]."""
    table = changed("materials.soil.softening", {"rule": rule, "true_modulus": 1e10})
    table["laws"]["normal"] = "jkr"
    table["contact"]["soil-soil"]["surface_energy"] = energy
    table["contact"]["steel-soil"]["surface_energy"] = energy
    return table


def refusal(read: Callable[..., Any], *given: Any, **known: Any) -> str:
    """The one line in which what a function reads is refused."""
    with pytest.raises(BadInput) as caught:
        read(*given, **known)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def complaint(table: dict[str, Any], **known: Any) -> str:
    """The line in which a bad scene is refused."""
    return refusal(parse_scene, table, "scenes/bad.toml", **known)
