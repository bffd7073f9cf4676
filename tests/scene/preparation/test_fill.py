"""Grains start apart, where and how fast the scene says."""

from dataclasses import replace
from math import pi, sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
import trimesh
from scene_tables import changed, complaint, good_table
from scipy.spatial import KDTree

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import GrainTable, Setup
from taichi_erosion.effect_library import load_library
from taichi_erosion.scene import parse_scene, replica_setup, scene_hash, step_report
from taichi_erosion.scene.change import SAMPLE, with_section
from taichi_erosion.scene.preparation.fill import initial_bodies, pour_with_inlets_open
from taichi_erosion.scene.preparation.setup import append_grains_by_release
from taichi_erosion.simulation.scene_setup import effective_scene

RAIN = {"law": "rain", "pitch_d": 1.15, "jitter_d": 0.05, "radius_d": 8.4}
RAIN |= {"first_height_d": 0.7, "speed_sd": 0.5}
LATTICE = {"law": "lattice", "axis": [0.0, 1.0, 0.0], "radius": 0.03, "length": 0.02}
LATTICE |= {"pitch_d": 1.1, "jitter_d": 0.04}
DIAMETER = 1.5e-3


def grains_of(table: dict[str, Any], seed: int = 1) -> GrainTable:
    return replica_setup(parse_scene(table), seed).grains


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
    return GrainTable(*(column[here] for column in vars(replace(grains, position=moved)).values()))


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
    inner = np.mean(np.hypot(*grains_of(table).position[:, :2].T) < (0.02 - 1e-4) / sqrt(2.0))
    assert inner == pytest.approx(0.5, abs=4.0 * 0.5 / sqrt(4000))


def test_rain_is_the_apparatus_of_laboratory_c():
    grains = grains_of(equal_grains(RAIN, 1800))
    position = grains.position / DIAMETER
    assert np.hypot(*position[:, :2].T).max() <= 8.4
    assert position[:, 2].min() >= 0.65
    # three standard errors of a standard deviation from 5400 numbers are 3 %
    assert grains.velocity.std() == pytest.approx(0.5 * sqrt(9.81 * DIAMETER), rel=0.03)
    assert smallest_gap(grains) >= 0.05 * DIAMETER
    mean = np.bincount(np.round((position[:, 2] - 0.7) / 1.15).astype(int))[:-1].mean()
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
    law = {"law": "lognormal", "median": DIAMETER, "low": 1e-3, "high": 1.6e-3}
    sizes = (law | {"sigma_log": spread} for spread in (0.1, 0.2))
    first, other = (grains_of(table | {"grains": table["grains"] | {"size": size}}) for size in sizes)
    assert np.array_equal(first.position, other.position)
    assert not np.array_equal(first.radius, other.radius)


GROWN = ("sheltering", "sieve_diameter", "grain_shape")


@pytest.mark.parametrize(
    ("name", "strength"), [*(("size_distribution", x) for x in (0.3, 1.9)), *((x, 1.0) for x in GROWN)]
)
def test_coarse_and_spread_grains_start_clear_and_as_low_as_equal_ones(name: str, strength: float):
    table = SAMPLE | {"grains": SAMPLE["grains"] | {"count": 300}}
    equal = replica_setup(parse_scene(table), 3).grains
    scene = effective_scene(parse_scene(table | {"effects": {name: {"strength": strength}}}), load_library())
    grains = replica_setup(scene, 3).grains
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


SHAPES: dict[str, dict[str, Any]] = {
    "disc": {"centre": [-0.02, 0.0, 0.2], "radius": 0.01, "rate": 2000.0},
    "line": {"centre": [0.04, -0.01, 0.21], "end": [0.04, 0.03, 0.21], "speed": 0.5, "begin": 0.3},
    "rectangle": {"centre": [0.0, 0.02, 0.22], "size": [0.05, 0.012], "mass_rate": 0.02, "share": 2.0},
}
KINDS = {
    "soil": {"share": 1.0, "size": {"law": "monodisperse", "diameter": 1.5e-3}},
    "steel": {"share": 3.0, "size": {"law": "monodisperse", "diameter": 1e-3}},
}


def table_of_inlets(inlets: dict[str, dict[str, Any]], **grains: Any) -> dict[str, Any]:
    table = changed("fill", {"law": "pour", "inlets": inlets})
    table["geometry"] = {"plate": table["geometry"]["plate"]}
    table["stages"] = table["stages"][:1]
    table["measure"], table["measured"] = {}, {}
    table["grains"] = table["grains"] | {"count": 2000} if not grains else {"count": 2000, **grains}
    table["contact"]["steel-steel"] = {"restitution": 0.5, "friction_sliding": 0.5}
    return table


def build_inlets(inlets: dict[str, dict[str, Any]], **grains: Any) -> Setup:
    return replica_setup(parse_scene(table_of_inlets(inlets, **grains)), 1)


def test_several_inlets_share_the_grains_each_in_its_shape_from_its_time_on_at_its_rate():
    grains = build_inlets(SHAPES).grains
    x, y, z = grains.position.T
    radius, time = grains.radius, grains.release_time
    assert np.all(np.diff(time) >= 0.0)
    disc, line = z == 0.2, z == 0.21
    rectangle = ~(disc | line)
    assert [disc.sum(), line.sum(), rectangle.sum()] == [500, 500, 1000]
    assert np.all(np.hypot(x + 0.02, y)[disc] + radius[disc] <= 0.01)
    assert np.all(np.abs(x[rectangle]) + radius[rectangle] <= 0.025)
    assert np.all(np.abs(y[rectangle] - 0.02) + radius[rectangle] <= 0.006)
    assert 0.5e-4 < np.abs(x[line] - 0.04).max() < 1.5e-4  # a tenth of a radius beside it
    assert np.ptp(y[line]) > 0.035
    assert time[line].min() == 0.3
    assert disc.sum() / time[disc].max() == pytest.approx(2000.0, rel=0.1)
    assert grains.mass[rectangle].sum() / time[rectangle].max() == pytest.approx(0.02, rel=0.1)
    assert grains.velocity[line] == pytest.approx(np.tile((0.0, 0.0, -0.5), (500, 1)))
    for now in np.unique(time[line])[:8]:
        assert smallest_gap(at_time(grains, now)) >= 0.0


def test_grains_that_come_later_pass_the_inlets_then_open_among_those_that_wait():
    scene = parse_scene(table_of_inlets(SHAPES))
    before, few = replica_setup(scene, 1).grains, scene.grains.model_copy(update={"count": 40})
    now = float(before.release_time[700])
    fill = pour_with_inlets_open(scene, now, (), "line", now)
    new = replica_setup(scene.model_copy(update={"fill": fill, "grains": few}), 2).grains
    joined = append_grains_by_release(before, 700, new)
    assert np.array_equal(joined.radius[:700], before.radius[:700])
    assert np.all(np.diff(joined.release_time[700:]) >= 0.0)
    late = np.isin(joined.radius, new.radius)
    assert (late.sum(), set(joined.position[late][:, 2])) == (40, {0.21})
    assert now < joined.release_time[late].min() < now + 0.02


def test_a_kind_passes_the_inlets_that_let_it_pass():
    both = {"centre": [0.05, 0.0, 0.2], "radius": 0.02}
    inlets = {"sand": {"centre": [-0.05, 0.0, 0.2], "radius": 0.02, "kind": "soil"}, "both": both}
    setup = build_inlets(inlets, kinds=KINDS)
    steel = setup.grains.material == setup.materials.index("steel")
    left = setup.grains.position[:, 0] < 0.0
    assert not np.any(steel & left)
    assert (~steel & left).sum() == pytest.approx(0.5 * (~steel).sum(), abs=1)


def test_an_inlet_that_cannot_keep_its_rate_is_told():
    warnings = step_report(parse_scene(table_of_inlets({"thin": SHAPES["line"] | {"rate": 1e5}})))["warnings"]
    assert any(line.startswith("fill.inlets.thin: about") for line in warnings)
    quiet = step_report(parse_scene(table_of_inlets(SHAPES)))["warnings"]
    assert not any(line.startswith("fill.inlets") for line in quiet)


@pytest.mark.parametrize(
    ("inlet", "told"),
    [
        ({"centre": [0.0, 0.0, 0.1], "end": [0.1, 0.0, 0.2]}, "must be horizontal"),
        ({"centre": [0.0, 0.0, 0.1]}, "one of radius (disc), size (rectangle), end (line)"),
        ({"centre": [0.0, 0.0, 0.1], "radius": 0.01, "end": [0.1, 0.0, 0.1]}, "one of radius"),
        ({"centre": [0.0, 0.0, 0.1], "radius": 0.01, "rate": 10.0, "mass_rate": 0.1}, "leave one out"),
        ({"centre": [0.0, 0.0, 0.1], "size": [0.1, 1e-3]}, "fill.inlets.a.size = 0.0005 m is smaller"),
        ({"centre": [0.0, 0.0, 0.1], "radius": 0.02, "kind": "soil"}, "is not among [grains.kinds]"),
    ],
)
def test_an_inlet_without_a_shape_or_room_is_refused(inlet: dict[str, Any], told: str):
    assert told in complaint(table_of_inlets({"a": inlet}))


def test_a_kind_that_no_inlet_lets_pass_is_refused():
    inlet = {"centre": [0.0, 0.0, 0.2], "radius": 0.02, "kind": "soil"}
    with pytest.raises(BadInput, match="none of them lets 'steel' pass"):
        parse_scene(table_of_inlets({"sand": inlet}, kinds=KINDS))


def test_a_closed_mesh_lets_whole_grains_in_as_a_box_would_at_its_rate(tmp_path: Path):
    box = trimesh.creation.box((30.0, 20.0, 10.0))
    box.export(tmp_path / "box.stl")
    trimesh.Trimesh(box.vertices, box.faces[:-1]).export(tmp_path / "open.stl")
    box.invert()  # in place
    box.export(tmp_path / "turned.stl")
    mesh = {"scale": 1e-3, "translate": [0.0, 0.0, 0.2]}
    files = {n: mesh | {"file": f"{n}.stl"} for n in ("box", "turned")}
    table = table_of_inlets({n: {"mesh": file, "rate": 2e3} for n, file in files.items()})
    scene = parse_scene(table, "s.toml", tmp_path)
    grains, name = replica_setup(scene, 1).grains, scene_hash(scene)
    share = (grains.position - mesh["translate"]) / ([15e-3, 10e-3, 5e-3] - grains.radius[:, None])
    assert np.abs(share).max() <= 1.0 + 1e-9
    for column in share.T:
        assert scipy.stats.kstest(column, scipy.stats.uniform(-1.0, 2.0).cdf).pvalue > 1e-3
    assert len(share) / grains.release_time.max() == pytest.approx(4e3, rel=0.1)
    (tmp_path / "box.stl").write_bytes((tmp_path / "open.stl").read_bytes())
    assert scene_hash(scene) != name  # it follows the content of the file
    table["fill"]["inlets"] = {"open": {"mesh": {"file": "open.stl"}}}
    with pytest.raises(BadInput, match=r"fill\.inlets\.open\.mesh.file = 'open.stl' has no inside"):
        parse_scene(table, "s.toml", tmp_path)
