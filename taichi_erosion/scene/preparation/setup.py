"""Setup of one replica from a scene."""

from dataclasses import replace

import numpy as np
import scipy

from taichi_erosion.core.setup import ClumpTable, Floats, GrainTable, Integers, Laws, Setup, Surface
from taichi_erosion.scene.preparation.air import HEADROOM, air_over_patch, coupling_of_patch
from taichi_erosion.scene.preparation.contacts import contact_table, materials_used
from taichi_erosion.scene.preparation.fill import InitialBodies, initial_bodies, random_stream, saved_bed
from taichi_erosion.scene.preparation.limits import time_step
from taichi_erosion.scene.preparation.sizes import Body, bounding_radius_ratio, spheres_of_clump, union_body
from taichi_erosion.scene.preparation.walls import domain_box, has_open_domain, primitive_table, wall_motions
from taichi_erosion.scene.schema.grains import Bed, Positions
from taichi_erosion.scene.schema.scene import Scene

SPHERE_IN_CUBE = np.pi / 6.0  # volume of a sphere over d^3 [1]


def laws(scene: Scene) -> Laws:
    """Choice for every contact slot."""
    chosen = Laws(**scene.laws.model_dump())
    return chosen if scene.wind is None else replace(chosen, drag=scene.wind.drag)


def replica_setup(scene: Scene, seed: int) -> Setup:
    """Everything that defines one replica; the same scene and seed give the same bits."""
    body = union_body(spheres_of_clump(scene.grains.clump)) if scene.grains.clump else None
    start = initial_bodies(scene, seed, bounding_radius_ratio(scene.grains))
    names = materials_used(scene)
    material = np.array([names.index(name) for name in scene.grains.parts], dtype=np.int32)[start.kind]
    density = np.array([each.density for each in scene.grain_materials.values()])[start.kind]
    clumps = clump_table(scene, seed, start, body, density) if body else None
    grains = (
        clump_spheres(start, body, clumps, material) if body and clumps else spheres(start, density, material)
    )
    walls = sorted(scene.geometry)
    primitives = primitive_table(scene, walls)
    setup = Setup(
        grains=grains,
        materials=tuple(names),
        contacts=contact_table(scene),
        primitives=primitives,
        surfaces=tuple(Surface(name, names.index(scene.geometry[name].material)) for name in walls),
        time_step=time_step(scene),
        gravity=scene.gravity.vector,
        clumps=clumps,
        period=(*(scene.domain.period or (0.0, 0.0)), 0.0),
        domain=domain_box(scene, grains.position, float(grains.radius.max())),
        removes_outside=has_open_domain(scene, primitives),
        tables=tuple(dict.fromkeys(each.table for each in wall_motions(scene) if each.table)),
        has_servos=any(each.servo for each in wall_motions(scene)),
        overlap_limit=scene.run.overlap_limit,
        skin=scene.run.skin,
        bed=saved_bed(scene, scene.fill, seed) if isinstance(scene.fill, Bed) else None,
    )
    if (wind := scene.wind) is None:
        return setup
    below = -10.0 * float(grains.radius.max())
    domain = (0.0, 0.0, below), (wind.length, wind.width, HEADROOM * wind.height)
    air, coupling = air_over_patch(scene, wind, setup.time_step, seed), coupling_of_patch(scene, wind, seed)
    return replace(setup, domain=domain, period=(wind.length, wind.width, 0.0), air=air, coupling=coupling)


def spheres(start: InitialBodies, density: Floats, material: Integers) -> GrainTable:
    return GrainTable(
        position=start.position,
        velocity=start.velocity,
        spin=start.spin,
        radius=0.5 * start.diameter,
        mass=density * SPHERE_IN_CUBE * start.diameter**3,
        material=material,
        release_time=start.release_time,
    )


def append_grains_by_release(before: GrainTable, old_count: int, new: GrainTable) -> GrainTable:
    """A table of whose grains some have begun, and new ones: the others by the time of their release."""
    times = np.concatenate([np.full(old_count, -np.inf), before.release_time[old_count:], new.release_time])
    rows = np.argsort(times, kind="stable")
    pairs = zip(vars(before).values(), vars(new).values(), strict=True)
    return GrainTable(*(np.concatenate(pair)[rows] for pair in pairs))


def clump_table(scene: Scene, seed: int, start: InitialBodies, body: Body, density: Floats) -> ClumpTable:
    """Rigid bodies at random orientation; explicitly placed ones keep the orientation of their template."""
    count, size = len(start.diameter), len(body.radius)
    turned = scipy.spatial.transform.Rotation.random(count, rng=random_stream(seed, "orientations"))
    if isinstance(scene.fill, Positions):
        turned = scipy.spatial.transform.Rotation.from_quat(np.tile((0.0, 0.0, 0.0, 1.0), (count, 1)))
    shift = turned.apply(body.centre) if isinstance(scene.fill, Positions) else np.zeros((count, 3))
    return ClumpTable(
        body=np.repeat(np.arange(count, dtype=np.int32), size),
        offset=(start.diameter[:, None, None] * body.offset).reshape(-1, 3),
        mass=density * body.volume * start.diameter**3,
        inertia=density[:, None] * np.outer(start.diameter**5, body.inertia),
        position=start.position + start.diameter[:, None] * shift,
        orientation=(turned * body.rotation).as_quat(canonical=True, scalar_first=True),  # w >= 0
    )


def clump_spheres(start: InitialBodies, body: Body, clumps: ClumpTable, material: Integers) -> GrainTable:
    """Contact spheres of all clumps, with the velocity of their body."""
    turned = scipy.spatial.transform.Rotation.from_quat(clumps.orientation[clumps.body], scalar_first=True)
    arm = turned.apply(clumps.offset)
    spin = start.spin[clumps.body]
    return GrainTable(
        position=clumps.position[clumps.body] + arm,
        velocity=np.asarray(start.velocity[clumps.body] + np.cross(spin, arm), dtype=np.float64),
        spin=spin,
        radius=np.outer(start.diameter, body.radius).ravel(),
        mass=clumps.mass[clumps.body],
        material=material[clumps.body],
        release_time=start.release_time[clumps.body],
    )
