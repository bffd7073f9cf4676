"""Changes of a scene that several effects need; each gives a new scene and leaves the old one as it is."""

from collections.abc import Callable
from typing import Any

from taichi_erosion.scene.schema import Scene
from taichi_erosion.scene.schema_geometry import Cylinder
from taichi_erosion.scene.schema_grains import Contact, Lattice, Layers, Material, Rain


def with_section(scene: Scene, name: str, **entries: Any) -> Scene:
    """The scene with entries of one section changed."""
    return scene.model_copy(update={name: getattr(scene, name).model_copy(update=entries)})


def with_contacts(scene: Scene, change: Callable[[Contact], Contact]) -> Scene:
    """The scene with every contact of its grains changed on which effects act, with walls too."""
    grain = scene.grains.material
    contacts = {
        pair: change(contact) if grain in pair.split("-") and contact.acted_on else contact
        for pair, contact in scene.contact.items()
    }
    return scene.model_copy(update={"contact": contacts})


def with_grain_material(scene: Scene, change: Callable[[Material], Material]) -> Scene:
    """The scene with the material of its grains changed."""
    name = scene.grains.material
    return scene.model_copy(update={"materials": scene.materials | {name: change(scene.materials[name])}})


def with_shorter_step(scene: Scene, factor: float) -> Scene:
    """The scene with a stated time step multiplied by a factor below 1; one that follows the grains stays."""
    if scene.run.time_step is None or factor >= 1.0:
        return scene
    return with_section(scene, "run", time_step=scene.run.time_step * factor)


def with_wider_fill(scene: Scene, factor: float) -> Scene:
    """The scene with grains that start farther apart, so that larger ones find room.

    Distances of places grow by the factor. Layers of rain then hold fewer grains and the column is taller by
    the factor cubed; tubes that some stage removes again grow with it.
    """
    fill = scene.fill
    if factor <= 1.0 or not isinstance(fill, Rain | Lattice | Layers):
        return scene
    wider = {"pitch": fill.pitch * factor}
    if not isinstance(fill, Lattice):
        wider["first_height"] = fill.first_height * factor
    spread = fill.model_copy(update=wider)
    if not isinstance(fill, Rain):
        return scene.model_copy(update={"fill": spread})
    removed = {name for stage in scene.stages for name in stage.remove}
    geometry = {
        name: wall.model_copy(update={"length": wall.length * factor**3})
        if name in removed and isinstance(wall, Cylinder)
        else wall
        for name, wall in scene.geometry.items()
    }
    return scene.model_copy(update={"fill": spread, "geometry": geometry})
