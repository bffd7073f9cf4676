"""A bed or a pile in YADE: `yade -jN -n -x yade_case.py CASE WARM_UP STEPS`, in the folder of the cases.

Hertz with Mindlin's tangential history and a bending moment of constant stiffness. What is found is the last
line of the output, as JSON. YADE knows periods along all three axes only: the cell is three times as high as
the bed, which lies in its middle.
"""

import json
import sys
import time
from typing import Any

import numpy as np
from yade import geom, utils  # pyright: ignore[reportMissingImports]
from yade.wrapper import (  # pyright: ignore[reportMissingImports]
    Bo1_Facet_Aabb,
    Bo1_Sphere_Aabb,
    Bo1_Wall_Aabb,
    ForceResetter,
    FrictMat,
    Ig2_Facet_Sphere_ScGeom,
    Ig2_Sphere_Sphere_ScGeom,
    Ig2_Wall_Sphere_ScGeom,
    InsertionSortCollider,
    InteractionLoop,
    Ip2_FrictMat_FrictMat_MindlinPhys,
    Law2_ScGeom_MindlinPhys_Mindlin,
    NewtonIntegrator,
    Omega,
    Sphere,
)

ROLLING_STIFFNESS = 3e-6  # N m, of the bending moment, which YADE takes as it is; 0.1 would blow the bed up
BED_SKIN, PILE_SKIN = 0.05e-3, 0.15e-3  # m around every grain: half of what the other codes give a pair
FACETS = 48  # flat sides of the cone
FLANKS_ONLY = 4  # YADE's number for a cone without lids


def material(case: Any, friction: str) -> Any:
    """Grains or walls of one friction."""
    angle = float(np.arctan(case[friction]))
    return FrictMat(
        young=float(case["young"]),
        poisson=float(case["poisson"]),
        frictionAngle=angle,
        density=float(case["density"]),
    )


def fill(scene: Any, case: Any) -> None:
    """Grains, floor and funnel."""
    grain, wall = (scene.materials.append(material(case, name)) for name in ("friction", "friction_wall"))
    radius, lift = 0.5 * float(case["diameter"]), 0.0
    if "period" in case:
        lift = float(case["position"][:, 2].max()) + 2.0 * radius
        scene.periodic = True
        scene.cell.setBox(*map(float, case["period"]), 3.0 * lift)
    else:
        names = ("funnel_bottom", "funnel_height", "orifice_radius")
        bottom, height, orifice = (float(case[name]) for name in names)
        middle = (0.0, 0.0, bottom + 0.5 * height)
        cone = geom.facetCone(
            middle,
            orifice + height,
            orifice,
            height,
            segmentsNumber=FACETS,
            wallMask=FLANKS_ONLY,
            material=wall,
        )
        scene.bodies.append(cone)
    places = case["position"] + (0.0, 0.0, lift)
    scene.bodies.append([utils.sphere(tuple(map(float, place)), radius, material=grain) for place in places])
    scene.bodies.append(utils.wall((0, 0, lift), axis=2, sense=1, material=wall))


def engines(case: Any) -> list[Any]:
    """What YADE does every step."""
    skin = BED_SKIN if "period" in case else PILE_SKIN
    restitution = float(case["restitution"])
    law = Ip2_FrictMat_FrictMat_MindlinPhys(
        en=restitution, es=restitution, krot=ROLLING_STIFFNESS, eta=float(case["friction_rolling"])
    )
    bounds = [Bo1_Sphere_Aabb(), Bo1_Wall_Aabb(), Bo1_Facet_Aabb()]
    shapes = [Ig2_Sphere_Sphere_ScGeom(), Ig2_Wall_Sphere_ScGeom(), Ig2_Facet_Sphere_ScGeom()]
    return [
        ForceResetter(),
        InsertionSortCollider(bounds, verletDist=skin, allowBiggerThanPeriod=True, label="collider"),
        InteractionLoop(shapes, [law], [Law2_ScGeom_MindlinPhys_Mindlin(includeMoment=True)]),
        NewtonIntegrator(gravity=(0, 0, -float(case["gravity"])), damping=0),
    ]


def contacts(scene: Any) -> int:
    """Contacts between grains."""
    bodies = scene.bodies
    ends = [(bodies[pair.id1].shape, bodies[pair.id2].shape) for pair in scene.interactions if pair.isReal]
    return sum(isinstance(first, Sphere) and isinstance(second, Sphere) for first, second in ends)


def main(name: str, warm_up: str, steps: str) -> None:
    """Time one window."""
    scene = Omega()
    with np.load(f"{name}.npz") as arrays:
        case = dict(arrays)
    fill(scene, case)
    scene.engines = engines(case)
    scene.dt = float(case["time_step"])
    scene.run(max(int(warm_up), 1), True)
    before, start = scene.engines[1].numAction, time.perf_counter()
    scene.run(int(steps), True)
    seconds, count = time.perf_counter() - start, len(case["position"])
    figures = {
        "grain_steps_per_s": count * int(steps) / seconds,
        "contacts_per_grain": 2.0 * contacts(scene) / count,
        "rebuilds": scene.engines[1].numAction - before,
    }
    sys.stdout.write("\n" + json.dumps(figures) + "\n")


main(*sys.argv[1:])
