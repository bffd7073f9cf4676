"""Sizes of grains follow their law; mass, inertia and placement of rigid grains made of spheres."""

from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter
from scene_tables import changed
from scipy.spatial.transform import Rotation
from scipy.stats import kstest, truncnorm

from taichi_erosion.core.setup import Setup
from taichi_erosion.scene import parse_scene, replica_setup
from taichi_erosion.scene.preparation import sizes
from taichi_erosion.scene.preparation.fill import random_stream
from taichi_erosion.scene.preparation.sizes import spheres_of_clump, union_body
from taichi_erosion.scene.schema.grains import Clump, Size

MANY = 200_000
COARSE = {"law": "sieve", "table": "hao2022", "low": 0.25e-3, "high": 2e-3, "scale": 4.0}
NARROW = {"law": "sieve", "rows": ((1e-3, 2e-3, 30.0), (2e-3, 3e-3, 60.0), (4e-3, 5e-3, 10.0))}
BROAD = {"law": "lognormal", "median": 1e-3, "sigma_log": 0.4, "low": 0.4e-3, "high": 2e-3}


def size_of(table: dict[str, Any]) -> Any:
    return TypeAdapter(Size).validate_python(table)


def drawn(table: dict[str, Any], count: int = MANY, seed: int = 1) -> np.ndarray:
    return sizes.sample_diameters(size_of(table), count, random_stream(seed, "diameters"))


@pytest.mark.parametrize("table", [COARSE, NARROW])
def test_the_mass_on_each_sieve_is_that_of_the_table(table: dict[str, Any]):
    diameter = drawn(table)
    for low, high, share in sizes.sieve_size_classes(size_of(table)):
        caught = np.where((diameter >= low) & (diameter < high), diameter**3, 0.0)
        # standard error of a ratio of sums over independent grains; 4 of them fail once in 16,000 classes
        error = sqrt(np.var(caught - share * diameter**3) * len(diameter)) / np.sum(diameter**3)
        assert np.sum(caught) / np.sum(diameter**3) == pytest.approx(share, abs=4.0 * error)
        assert error < 0.01


def test_inside_a_class_mass_is_uniform_over_the_logarithm_of_the_diameter():
    diameter = drawn({"law": "sieve", "rows": ((1e-3, 2e-3, 1.0),)})
    mass, edges = np.histogram(np.log2(diameter / 1e-3), bins=4, range=(0.0, 1.0), weights=diameter**3)
    # the heaviest bin holds 13,000 grains, whose mass spreads by 15 %: 4 standard errors are 3.5 %
    assert mass / mass.sum() == pytest.approx(np.diff(edges), rel=0.035)


def test_a_lognormal_law_is_truncated_and_not_clipped():
    size, diameter = size_of(BROAD), drawn(BROAD, 20_000)
    a, b = (np.log(edge / size.median) / size.sigma_log for edge in (size.low, size.high))
    assert kstest(np.log(diameter / size.median) / size.sigma_log, truncnorm(a, b).cdf).pvalue > 1e-3


@pytest.mark.parametrize("table", [COARSE, NARROW, BROAD, {"law": "monodisperse", "diameter": 1e-3}])
def test_mean_volume_and_range_are_those_of_the_sample(table: dict[str, Any]):
    diameter = drawn(table)
    low, high = sizes.size_range(size_of(table))
    assert low <= diameter.min() < 1.02 * low
    assert 0.9 * high < diameter.max() <= high
    cube = diameter**3
    error = 4 * cube.std() / MANY**0.5 + 1e-24
    assert sizes.mean_cubed_diameter(size_of(table)) == pytest.approx(cube.mean(), abs=error)


def test_the_nominal_diameter_of_a_sieve_curve_halves_the_mass():
    # 30 % below 2 mm, 90 % below 3 mm: half lies a third of the way up the second class, in logarithms
    assert sizes.nominal_diameter(size_of(NARROW)) == pytest.approx(2e-3 * 1.5 ** (20.0 / 60.0))


def test_coarse_graining_magnifies_every_class_and_keeps_the_masses_and_a_cut_shares_them_by_logarithm():
    plain, coarse = (sizes.sieve_size_classes(size_of(COARSE | more)) for more in ({"scale": 1.0}, {}))
    assert (coarse[:, :2], coarse[:, 2]) == (pytest.approx(4.0 * plain[:, :2]), pytest.approx(plain[:, 2]))
    cut = size_of({"law": "sieve", "rows": ((1e-3, 4e-3, 8.0), (4e-3, 8e-3, 4.0)), "low": 2e-3})
    assert sizes.sieve_size_classes(cut)[:, 2] == pytest.approx([0.5, 0.5])


def test_the_published_sieve_table_is_shipped_as_printed():
    rows = np.array(sizes.read_sieve_table("hao2022"))
    assert rows[:, 2].tolist() == [52.96, 18.56, 8.53, 2.83, 16.93]
    assert rows[:, 2].sum() == pytest.approx(99.81)
    assert rows[1:, 0].tolist() == rows[:-1, 1].tolist() == [0.25e-3, 0.5e-3, 1e-3, 2e-3]


DENSITY = 2130.0
# the surface cells of a sphere 160 (or 80) cells across miss its volume by a few parts in 1e4
COUNTING = 2e-3


def sphere_mass(radius: float) -> float:
    return 4.0 / 3.0 * pi * radius**3


def clumped(template: str, **grains: Any) -> Setup:
    table = changed("grains.clump", {"template": template})
    table["grains"] |= grains
    return replica_setup(parse_scene(table), 3)


def test_two_touching_spheres_obey_the_parallel_axis_theorem():
    r = 0.4
    body = union_body((((r, 0.0, 0.3), r), ((-r, 0.0, 0.3), r)))
    mass = sphere_mass(r)
    assert body.volume == pytest.approx(2.0 * mass, rel=COUNTING)
    assert body.inertia == pytest.approx(2.0 * mass * r**2 * np.array([0.4, 1.4, 1.4]), rel=COUNTING)
    assert body.centre == pytest.approx([0.0, 0.0, 0.3], abs=1e-6)
    assert np.abs(body.offset[:, 0]) == pytest.approx([r, r], rel=1e-4)
    assert body.reach == pytest.approx(2.0 * r, rel=1e-4)


def test_overlapping_spheres_count_their_common_volume_once():
    r, half = 0.5, 0.25
    body = union_body((((half, 0.0, 0.0), r), ((-half, 0.0, 0.0), r)))
    lens = pi * (4.0 * r + 2.0 * half) * (2.0 * r - 2.0 * half) ** 2 / 12.0
    assert body.volume == pytest.approx(2.0 * sphere_mass(r) - lens, rel=COUNTING)


def test_turning_a_body_leaves_its_principal_moments():
    centres, radii = [[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.0, 0.4, 0.2]], (0.5, 0.3, 0.25)
    turned = Rotation.from_euler("xyz", (0.4, -0.7, 1.1)).apply(centres).tolist()
    one, other = (union_body(tuple(zip(map(tuple, each), radii, strict=True))) for each in (centres, turned))
    assert other.inertia == pytest.approx(one.inertia, rel=COUNTING)


@pytest.mark.parametrize(("template", "count"), [("pair", 2), ("tripod", 3), ("tetrahedron", 4)])
def test_a_shipped_template_touches_itself_and_has_the_volume_of_its_sphere(template: Any, count: int):
    spheres = spheres_of_clump(Clump(template=template))
    centres, radii = np.array([c for c, _ in spheres]), np.array([r for _, r in spheres])
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)[np.triu_indices(count, 1)]
    assert apart == pytest.approx(2.0 * radii[0])
    assert sum(sphere_mass(r) for r in radii) == pytest.approx(pi / 6.0)
    assert union_body(spheres).volume == pytest.approx(pi / 6.0, rel=COUNTING)


def test_spheres_of_a_clump_stand_where_its_body_holds_them():
    setup = clumped("tripod")
    clumps, grains = setup.clumps, setup.grains
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
    for time in np.unique(grains.release_time):
        here = np.flatnonzero(grains.release_time == time)
        apart = np.linalg.norm(grains.position[here, None] - grains.position[here], axis=2)
        gap = apart - grains.radius[here, None] - grains.radius[here]
        assert gap[(clumps.body[here, None] != clumps.body[here])].min() >= 0.0


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
    table["grains"] |= {"count": 1, "clump": {"template": "tetrahedron"}}
    grains = replica_setup(parse_scene(table), 1).grains
    centres, radii = map(np.array, zip(*spheres_of_clump(Clump(template="tetrahedron")), strict=True))
    arm = grains.position - [0.0, 0.0, 0.01]
    assert arm == pytest.approx(centres * (grains.radius / radii)[:, None], abs=2e-7)
    assert grains.velocity == pytest.approx(np.cross([0.0, 0.0, 2.0], arm), abs=1e-6)
