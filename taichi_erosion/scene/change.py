"""Changes of a scene for effects of place `scene`: each function returns a new scene; the old one stays."""

from collections.abc import Callable
from typing import Any

from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene.load import parse_scene
from taichi_erosion.scene.schema.geometry import Cylinder
from taichi_erosion.scene.schema.grains import Contact, Lattice, Layers, Material, Rain
from taichi_erosion.scene.schema.scene import Scene


def with_section(scene: Scene, name: str, **entries: Any) -> Scene:
    return scene.model_copy(update={name: getattr(scene, name).model_copy(update=entries)})


def with_contacts(scene: Scene, change: Callable[[Contact], Contact], walls: bool | None = None) -> Scene:
    """The scene with contacts of its grains changed where effects may act.

    `walls`: those with walls alone, or those of grains with each other alone; None: both.
    """
    grains, contacts = set(scene.grains.parts), dict(scene.contact)
    for pair, contact in scene.contact.items():
        ends = set(pair.split("-"))
        chosen = walls is None or walls == (not ends <= grains)
        if chosen and ends & grains and contact.acted_on:
            contacts[pair] = change(contact)
    return scene.model_copy(update={"contact": contacts})


def with_grain_material(scene: Scene, change: Callable[[Material], Material]) -> Scene:
    changed = {name: change(material) for name, material in scene.grain_materials.items()}
    return scene.model_copy(update={"materials": scene.materials | changed})


def with_shorter_step(scene: Scene, factor: float) -> Scene:
    """The scene with a stated time step multiplied by a factor below 1; a derived one stays derived."""
    if scene.run.time_step is None or factor >= 1.0:
        return scene
    return with_section(scene, "run", time_step=scene.run.time_step * factor)


def with_wider_fill(scene: Scene, factor: float, mean: float | None = None) -> Scene:
    """The scene with initial distances of grains multiplied, for largest grains that are larger by a factor.

    Coarse grains of rain leave out points of its net, whose pitch follows the cube root of their mean volume,
    larger by `mean` (left out: by the factor too). Its column is taller by the cube of `mean`; tubes that a
    stage removes are lengthened.
    """
    fill, mean = scene.fill, factor if mean is None else mean
    if factor <= 1.0 or not isinstance(fill, Rain | Lattice | Layers):
        return scene
    net = mean if isinstance(fill, Rain) else factor
    wider = {"pitch": fill.pitch * net, "jitter": fill.jitter * min(net, 1.0)}
    if not isinstance(fill, Lattice):
        wider["first_height"] = fill.first_height * net
    spread = with_section(scene, "fill", **wider)
    geometry, removed = dict(scene.geometry), {name for stage in scene.stages for name in stage.remove}
    for name, wall in scene.geometry.items() if isinstance(fill, Rain) else ():
        if name in removed and isinstance(wall, Cylinder):
            geometry[name] = wall.model_copy(update={"length": wall.length * max(factor, mean**3)})
    return spread.model_copy(update={"geometry": geometry})


def drag_partition(density: float, basal_ratio: float, drag_ratio: float, worst_spot: float) -> float:
    """Friction velocity on the ground between obstacles, over that of the wind [1].

    u*_ground / u* = ((1 - m s L) (1 + m b L))^(-1/2), at most 1

    with L the frontal area of the obstacles over the area of the ground [1], s their basal over their frontal
    area [1], b the drag coefficient of an obstacle over that of the ground [1], m the share of the mean
    stress that counts for the windiest spot [1]. Holds for m s L < 1; raises BadInput beyond.

    Reference: Raupach, Gillette & Leys (1993), J. Geophys. Res. 98, 3023, eq. (14).
    """
    open_share = 1.0 - worst_spot * basal_ratio * density
    if open_share <= 0.0:
        raise BadInput(f"obstacles with a frontal area of {density:g} over that of the ground cover it all")
    return min((open_share * (1.0 + worst_spot * drag_ratio * density)) ** -0.5, 1.0)


SAMPLE: dict[str, Any] = {  # small scene on which effects of place `scene` are checked
    "scene": {"kind": "collapse", "title": "sample"},
    "run": {"time_step": 1e-6},
    "grains": {"count": 50, "material": "sand", "size": {"law": "monodisperse", "diameter": 1e-3}},
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
    table = dict(SAMPLE)
    for name, entries in sections.items():
        table[name] = table.get(name, {}) | entries
    return parse_scene(table, "sample")
