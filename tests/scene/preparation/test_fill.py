"""Grains start apart, where and how fast the scene says."""

from dataclasses import replace
from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from scene_tables import changed, good_table
from scipy.spatial import KDTree

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import GrainTable
from taichi_erosion.effects import load_library
from taichi_erosion.scene import build_setup, parse_scene
from taichi_erosion.scene.change import SAMPLE, with_section
from taichi_erosion.scene.preparation.fill import initial_bodies
from taichi_erosion.simulation.scene_setup import effective_scene

RAIN = {"law": "rain", "pitch_d": 1.15, "jitter_d": 0.05, "radius_d": 8.4}
RAIN |= {"first_height_d": 0.7, "speed_sd": 0.5}
LATTICE = {"law": "lattice", "axis": [0.0, 1.0, 0.0], "radius": 0.03, "length": 0.02}
LATTICE |= {"pitch_d": 1.1, "jitter_d": 0.04}
DIAMETER = 1.5e-3


def grains_of(table: dict[str, Any], seed: int = 1) -> GrainTable:
    return build_setup(parse_scene(table), seed).grains


def equal_grains(fill: dict[str, Any], count: int) -> dict[str, Any]:
    table = changed("fill", fill)
    table["grains"] |= {"count": count, "size": {"law": "monodisperse", "diameter": DIAMETER}}
    return table


def smallest_gap(grains: GrainTable) -> float:
    """Least distance between surfaces of neighbouring grains [m]."""
    pairs = KDTree(grains.position).query_pairs(2.0 * grains.radius.max() * 1.3, output_type="ndarray")
    apart = np.linalg.norm(grains.position[pairs[:, 0]] - grains.position[pairs[:, 1]], axis=1)
    return float((apart - grains.radius[pairs].sum(axis=1)).min())


def at_time(grains: GrainTable, time: float) -> GrainTable:
    """Grains in free fall at the release of the last layer before `time`."""
    fallen = np.maximum(time - grains.release_time, 0.0)[:, None]
    here = grains.release_time <= time
    moved = grains.position + grains.velocity * fallen - 0.5 * 9.81 * fallen**2 * np.array([0.0, 0.0, 1.0])
    columns = vars(replace(grains, position=moved)).values()
    return GrainTable(*(column[here] for column in columns))


def test_layers_of_a_pour_start_apart_at_once_as_soon_as_the_one_before_has_fallen_clear():
    grains = grains_of(changed("grains.count", 600))
    times = np.unique(grains.release_time)
    assert len(times) > 5
    for time in times:
        assert smallest_gap(at_time(grains, time)) >= 0.0
    gaps = np.diff(times)
    clear = 2.0 * grains.radius.max()
    assert np.all(np.diff(grains.release_time) >= 0.0)
    assert np.all(2.0 * gaps + 0.5 * 9.81 * gaps**2 >= clear)
    assert np.all(2.0 * gaps + 0.5 * 9.81 * gaps**2 <= 1.1 * clear)


def test_a_pour_keeps_its_rate_speed_plane_and_disc():
    table = changed("fill.rate", 2000.0)
    table["grains"]["count"] = 1000
    grains = grains_of(table)
    # the last layer has no interval after it, and 1000 grains come in about 25 layers
    assert len(grains.radius) / grains.release_time[-1] == pytest.approx(2000.0, rel=0.1)
    assert grains.velocity == pytest.approx(np.tile((0.0, 0.0, -2.0), (1000, 1)))
    assert grains.position[:, 2] == pytest.approx(0.09)
    assert np.all(np.hypot(*grains.position[:, :2].T) + grains.radius <= 0.02)


def test_a_layer_covers_the_stated_share_of_the_disc():
    grains = grains_of(changed("grains.count", 1000))
    _, layer = np.unique(grains.release_time, return_inverse=True)
    covered = np.bincount(layer, grains.radius**2)[:-1] / 0.02**2
    # a layer ends before the grain that would exceed the share
    assert covered.max() <= 0.25
    assert covered.min() > 0.25 - (grains.radius.max() / 0.02) ** 2


def test_poured_places_are_uniform_over_the_disc():
    table = changed("grains.count", 4000)
    table["grains"]["size"] = {"law": "monodisperse", "diameter": 2e-4}
    grains = grains_of(table)
    inner = np.mean(np.hypot(*grains.position[:, :2].T) < (0.02 - 1e-4) / sqrt(2.0))
    assert inner == pytest.approx(0.5, abs=4.0 * 0.5 / sqrt(4000))


def test_rain_is_the_apparatus_of_laboratory_c():
    grains = grains_of(equal_grains(RAIN, 1800))
    position = grains.position / DIAMETER
    assert np.hypot(*position[:, :2].T).max() <= 8.4
    assert position[:, 2].min() >= 0.65
    # three standard errors of a standard deviation from 5400 numbers are 3 %
    assert grains.velocity.std() == pytest.approx(0.5 * sqrt(9.81 * DIAMETER), rel=0.03)
    assert smallest_gap(grains) >= 0.05 * DIAMETER
    layer = np.round((position[:, 2] - 0.7) / 1.15).astype(int)
    mean = np.bincount(layer)[:-1].mean()
    # a random disc of radius R holds pi R^2 / pitch^2 points of a square net, 168 of them
    assert mean == pytest.approx(pi * 8.4**2 / 1.15**2, rel=0.05)


def test_layers_of_rain_are_turned_against_each_other():
    grains = grains_of(equal_grains(RAIN, 1000))
    layer = np.round((grains.position[:, 2] / DIAMETER - 0.7) / 1.15).astype(int)
    angles = []
    for k in range(4):
        place = grains.position[layer == k, :2]
        pairs = KDTree(place).query_pairs(1.3 * DIAMETER, output_type="ndarray")
        bond = place[pairs[:, 0]] - place[pairs[:, 1]]
        angles.append(np.angle(np.mean(np.exp(4j * np.arctan2(bond[:, 1], bond[:, 0])))) / 4.0)
    # four angles drawn from a quarter turn come within 1 degree of each other once in 20,000 times
    assert np.ptp(angles) > np.radians(1.0)


def test_a_lattice_fills_a_drum_from_below_inside_its_walls():
    grains = grains_of(equal_grains(LATTICE, 500))
    assert np.hypot(grains.position[:, 0], grains.position[:, 2]).max() <= 0.03
    assert np.abs(grains.position[:, 1]).max() <= 0.01
    assert smallest_gap(grains) >= 0.0
    assert grains.position[:, 2].max() < 0.0


@pytest.mark.parametrize("fill", [good_table()["fill"], RAIN, LATTICE], ids=["pour", "rain", "lattice"])
def test_the_same_seed_repeats_every_bit_and_another_seed_nothing(fill: dict[str, Any]):
    table = equal_grains(fill | ({"pitch_d": 1.3} if "pitch_d" in fill else {}), 300)
    broad = {"law": "lognormal", "median": 1.4e-3, "sigma_log": 0.1, "low": 1e-3, "high": 1.5e-3}
    table["grains"]["size"] = broad
    first, again, other = (grains_of(table, seed) for seed in (5, 5, 6))
    for name in ("position", "velocity", "radius", "release_time"):
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert not np.any(first.radius == other.radius)
    assert not np.any(np.all(first.position == other.position, axis=1))


def test_changing_the_sizes_leaves_the_places_of_rain_alone():
    table = equal_grains(RAIN | {"pitch": 2e-3}, 300)
    del table["fill"]["pitch_d"]
    sizes = (
        {"law": "lognormal", "median": DIAMETER, "sigma_log": s, "low": 1e-3, "high": 1.6e-3}
        for s in (0.1, 0.2)
    )
    first, other = (grains_of(table | {"grains": table["grains"] | {"size": size}}) for size in sizes)
    assert np.array_equal(first.position, other.position)
    assert not np.array_equal(first.radius, other.radius)


@pytest.mark.parametrize(
    ("name", "strength"),
    [
        ("size_distribution", 0.3),
        ("size_distribution", 1.9),
        ("sheltering", 1.0),
        ("sieve_diameter", 1.0),
        ("grain_shape", 1.0),
    ],
)
def test_coarse_and_spread_grains_start_clear_of_tube_plate_and_each_other_and_as_low_as_equal_ones(
    name: str, strength: float
):
    table = SAMPLE | {"grains": SAMPLE["grains"] | {"count": 300}}
    equal = build_setup(parse_scene(table), 3).grains
    scene = effective_scene(parse_scene(table | {"effects": {name: {"strength": strength}}}), load_library())
    grains = build_setup(scene, 3).grains
    net = scene.fill.pitch / parse_scene(table).fill.pitch  # wider for larger grains of one size alone
    assert np.all(np.hypot(*grains.position[:, :2].T) + grains.radius <= 5e-3)
    assert np.all(grains.position[:, 2] >= grains.radius)
    assert grains.position[:, 2].max() <= 1.5 * max(net, 1.0) ** 3 * equal.position[:, 2].max()
    assert grains.position[:, 2].max() + grains.radius.max() < scene.geometry["tube"].length
    assert scene.grains.clump is not None or smallest_gap(grains) >= 0.0


def test_a_grain_that_fits_nowhere_between_the_walls_is_refused():
    scene = parse_scene(SAMPLE)
    tube = scene.geometry["tube"].model_copy(update={"radius": 0.4e-3, "length": 1.0})
    narrow = with_section(scene, "fill", radius=0.35e-3).model_copy(update={"geometry": {"tube": tube}})
    with pytest.raises(BadInput, match="finds no place between walls"):
        initial_bodies(narrow, 1, 0.5)
