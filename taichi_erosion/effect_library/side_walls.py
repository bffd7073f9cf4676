"""Side walls: two walls along the apparatus carry part of the load.

    walls at y = -w/2 and y = w/2,    friction strength mu

with w the width in nominal diameters [1] and mu the friction of grains on the walls over that of grains on
each other [1]. The walls stop grains from spreading sidewards and rub on those that pass; a heap or a flow
between them stands steeper the narrower they are, and a wind erodes less beside them. Strength multiplies
the friction: near 0 the walls are smooth, and only without the effect are there none. They consist of the
material of the grains. Holds for fills narrower than w, without wind: a patch is periodic across.

Reference: Courrech du Pont, Gondret, Perrin & Rabaud (2003), Europhys. Lett. 61, 492 (angle against width);
Nowak, Samadani & Kudrolli (2005), Nature Physics 1, 50 (walls of a drum).
"""

from dataclasses import dataclass

from taichi_erosion.core.effect import Check, Checks, Conditions, Probe, effect_of, quantity
from taichi_erosion.core.errors import BadInput
from taichi_erosion.scene import Scene
from taichi_erosion.scene.change import sample_scene
from taichi_erosion.scene.preparation.sizes import nominal_diameter
from taichi_erosion.scene.schema.geometry import Plane

SIDES = {"side_left": 1.0, "side_right": -1.0}  # names of the walls, and where they face along y
PANE = "pane"  # their material


@dataclass(frozen=True)
class Params:
    width: float = quantity(20.0, "1", "distance of the walls, in nominal diameters", low=3.0, high=1e4)
    friction: float = quantity(0.6, "1", "friction on the walls over that of grains", low=0.0, high=2.0)


def change(params: Params, strength: float, conditions: Conditions, scene: Scene) -> Scene:
    """The scene between two walls."""
    if strength == 0.0:
        return scene
    if scene.wind is not None:
        raise BadInput("effects.side_walls: a patch under wind is periodic across and has no sides")
    grain = scene.grains.material
    contact = scene.contact_of_materials(grain, grain) if grain else None
    if grain is None or contact is None or PANE in scene.materials:
        raise BadInput(f"effects.side_walls: needs one kind of grains and no material named '{PANE}'")
    friction = strength * params.friction * contact.friction_sliding
    half = 0.5 * params.width * nominal_diameter(scene.grains)
    fill = getattr(scene.fill, "radius", None) or 0.0
    if fill > half:
        raise BadInput(f"effects.side_walls: walls {2 * half:.3g} m apart cut a fill {2 * fill:.3g} m wide")
    walls = {
        name: Plane(shape="plane", material=PANE, point=(0.0, -face * half, 0.0), normal=(0.0, face, 0.0))
        for name, face in SIDES.items()
    }
    rubbing = {f"{grain}-{PANE}": contact.model_copy(update={"friction_sliding": friction})}
    materials = scene.materials | {PANE: scene.materials[grain]}
    update = {"materials": materials, "contact": scene.contact | rubbing, "geometry": scene.geometry | walls}
    return scene.model_copy(update=update)


def checks(probe: Probe) -> Checks:
    scene = probe(Params(width=30.0, friction=0.8), {}, scene=sample_scene(), strength=0.5)
    left, right = scene.geometry["side_left"], scene.geometry["side_right"]
    yield Check("the walls are 30 diameters apart", right.point[1] - left.point[1], 0.03)
    yield Check("and face each other", left.normal[1] - right.normal[1], 2.0)
    yield Check("friction is that of the grains, reduced", scene.contact["sand-pane"].friction_sliding, 0.2)
    yield Check("other contacts stay", scene.contact["sand-sand"].friction_sliding, 0.5)


EFFECT = effect_of(
    __name__, "side walls close together", "scene", change, most=2.0, expected={"repose_angle": 1, "flux": -1}
)
