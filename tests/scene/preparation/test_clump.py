"""Mass, inertia and placement of rigid grains made of spheres."""

from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from scene_tables import changed
from scipy.spatial.transform import Rotation

from taichi_erosion.core.setup import Setup
from taichi_erosion.scene import build_setup, parse_scene
from taichi_erosion.scene.preparation.clump import quadrature, template_spheres
from taichi_erosion.scene.schema.grains import Clump

DENSITY = 2130.0
# the surface cells of a sphere 160 (or 80) cells across miss its volume by a few parts in 1e4
COUNTING = 2e-3


def sphere_mass(radius: float) -> float:
    return 4.0 / 3.0 * pi * radius**3


def clumped(template: str, **grains: Any) -> Setup:
    table = changed("grains.clump", {"template": template})
    table["grains"] |= grains
    return build_setup(parse_scene(table), 3)


def test_one_sphere_has_two_fifths_of_mass_times_radius_squared():
    body = quadrature((((0.3, -0.2, 0.1), 0.5),))
    assert body.volume == pytest.approx(sphere_mass(0.5), rel=COUNTING)
    assert body.inertia == pytest.approx(0.4 * sphere_mass(0.5) * 0.25 * np.ones(3), rel=COUNTING)
    assert body.centre == pytest.approx([0.3, -0.2, 0.1], abs=1e-6)
    assert body.reach == pytest.approx(0.5, rel=1e-6)


def test_two_touching_spheres_obey_the_parallel_axis_theorem():
    r = 0.4
    body = quadrature((((r, 0.0, 0.0), r), ((-r, 0.0, 0.0), r)))
    mass = sphere_mass(r)
    assert body.volume == pytest.approx(2.0 * mass, rel=COUNTING)
    assert body.inertia == pytest.approx(2.0 * mass * r**2 * np.array([0.4, 1.4, 1.4]), rel=COUNTING)
    assert np.abs(body.offset[:, 0]) == pytest.approx([r, r], rel=1e-4)


def test_overlapping_spheres_count_their_common_volume_once():
    r, half = 0.5, 0.25
    body = quadrature((((half, 0.0, 0.0), r), ((-half, 0.0, 0.0), r)))
    lens = pi * (4.0 * r + 2.0 * half) * (2.0 * r - 2.0 * half) ** 2 / 12.0
    assert body.volume == pytest.approx(2.0 * sphere_mass(r) - lens, rel=COUNTING)


def test_turning_a_body_leaves_its_principal_moments():
    centres, radii = [[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.0, 0.4, 0.2]], (0.5, 0.3, 0.25)
    turned = Rotation.from_euler("xyz", (0.4, -0.7, 1.1)).apply(centres).tolist()
    first, other = (
        quadrature(tuple(zip(map(tuple, each), radii, strict=True))) for each in (centres, turned)
    )
    assert other.inertia == pytest.approx(first.inertia, rel=COUNTING)


@pytest.mark.parametrize(("template", "count"), [("pair", 2), ("tripod", 3), ("tetrahedron", 4)])
def test_a_shipped_template_touches_itself_and_has_the_volume_of_its_sphere(template: Any, count: int):
    spheres = template_spheres(Clump(template=template))
    centres, radii = np.array([c for c, _ in spheres]), np.array([r for _, r in spheres])
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)[np.triu_indices(count, 1)]
    assert apart == pytest.approx(2.0 * radii[0])
    assert sum(sphere_mass(r) for r in radii) == pytest.approx(pi / 6.0)
    assert quadrature(spheres).volume == pytest.approx(pi / 6.0, rel=COUNTING)


def test_the_principal_frame_turned_back_is_the_template():
    spheres = template_spheres(Clump(template="tetrahedron"))
    body = quadrature(spheres)
    turned_back = body.rotation.apply(body.offset) + body.centre
    assert turned_back == pytest.approx(np.array([c for c, _ in spheres]), abs=1e-4)


def test_spheres_of_a_clump_stand_where_its_body_holds_them():
    setup = clumped("tripod")
    clumps, grains = setup.clumps, setup.grains
    assert clumps is not None
    assert clumps.body.tolist() == np.repeat(np.arange(60), 3).tolist()
    assert np.linalg.norm(clumps.orientation, axis=1) == pytest.approx(1.0)
    turned = Rotation.from_quat(clumps.orientation[clumps.body], scalar_first=True)
    assert grains.position == pytest.approx(clumps.position[clumps.body] + turned.apply(clumps.offset))
    assert grains.mass == pytest.approx(clumps.mass[clumps.body])
    diameter = grains.radius[::3] * 2.0 * 3.0 ** (1.0 / 3.0)
    assert clumps.mass == pytest.approx(DENSITY * pi / 6.0 * diameter**3, rel=COUNTING)


def test_clumps_of_one_layer_never_start_inside_each_other():
    setup = clumped("pair", count=200)
    grains, clumps = setup.grains, setup.clumps
    assert clumps is not None
    for time in np.unique(grains.release_time):
        here = np.flatnonzero(grains.release_time == time)
        apart = np.linalg.norm(grains.position[here, None] - grains.position[here], axis=2)
        gap = apart - grains.radius[here, None] - grains.radius[here]
        other_body = clumps.body[here, None] != clumps.body[here]
        assert gap[other_body].min() >= 0.0


def test_random_orientations_favour_no_direction():
    setup = clumped("pair", count=3000)
    assert setup.clumps is not None
    arm = setup.grains.position[::2] - setup.clumps.position
    cosine = arm[:, 2] / np.linalg.norm(arm, axis=1)
    # the square of a uniform cosine has mean 1/3 and standard deviation 0.298
    assert np.mean(cosine**2) == pytest.approx(1.0 / 3.0, abs=4.0 * 0.298 / sqrt(3000))


def test_an_explicitly_placed_clump_lies_as_its_template():
    placed = {"position": [0.0, 0.0, 0.01], "spin": [0.0, 0.0, 2.0]}
    table = changed("fill", {"law": "positions", "grains": [placed]})
    table["grains"] |= {"count": 1, "clump": {"template": "tripod"}}
    grains = build_setup(parse_scene(table), 1).grains
    assert grains.position[:, 2] == pytest.approx(0.01, abs=1e-8)
    arm = grains.position - [0.0, 0.0, 0.01]
    assert grains.velocity == pytest.approx(np.cross([0.0, 0.0, 2.0], arm), abs=1e-6)
