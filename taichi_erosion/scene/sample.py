"""A small scene without a story, on which effects that change scenes are checked."""

from typing import Any

from taichi_erosion.scene.load import parse_scene
from taichi_erosion.scene.schema import Scene

SAMPLE: dict[str, Any] = {
    "scene": {"kind": "collapse", "title": "sample"},
    "run": {"time_step": 1e-6},
    "grains": {
        "count": 50,
        "material": "sand",
        "size": {"law": "monodisperse", "diameter": 1e-3},
    },
    "materials": {
        "sand": {"density": 2500.0, "young_modulus": 1e7, "poisson_ratio": 0.25},
        "steel": {"density": 7850.0, "young_modulus": 1e7, "poisson_ratio": 0.25},
    },
    "contact": {
        "sand-sand": {"restitution": 0.6, "friction_sliding": 0.5, "friction_rolling": 0.1},
        "sand-steel": {"restitution": 0.5, "friction_sliding": 0.4, "friction_rolling": 0.2},
    },
    "geometry": {
        "plate": {"shape": "plane", "material": "steel"},
        "tube": {"shape": "cylinder", "material": "steel", "radius": 5e-3, "length": 0.03},
    },
    "fill": {"law": "rain", "pitch": 1.2e-3, "jitter": 5e-5, "radius": 4e-3, "first_height": 1e-3},
    "stages": [
        {"name": "settle", "duration_max": 0.1},
        {"name": "collapse", "duration_max": 0.1, "remove": ["tube"]},
    ],
}


def sample_scene(**sections: dict[str, Any]) -> Scene:
    """The sample with entries of sections changed."""
    table = dict(SAMPLE)
    for name, entries in sections.items():
        table[name] = table.get(name, {}) | entries
    return parse_scene(table, "sample")
