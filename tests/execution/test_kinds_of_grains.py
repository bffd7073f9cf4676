"""Several kinds of grains in one bed: numbers by mass, contacts of all pairs, measures and recordings."""

import tomllib
from copy import deepcopy
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from scene_tables import refusal

from taichi_erosion.execution import RunOptions, run_scene
from taichi_erosion.recording.pictures import KIND_COLOURS, resting_colours
from taichi_erosion.recording.readback import read_grains
from taichi_erosion.scene import load_scene, parse_scene, replica_setup, scene_hash
from taichi_erosion.scene.load import SCENES
from taichi_erosion.scene.schema.grains import contact_of_two_kinds

TWO = SCENES / "two_soils.toml"
SPEED = 0.3  # m s-1
HEAD_ON: dict[str, Any] = tomllib.loads("""
scene = { title = "two grains of two kinds meet" }
run = { precision = "f64", check_interval = 1e-4 }
gravity = { magnitude = 0.0 }
grains.count = 2
grains.kinds.light = { share = 1.0, size = { law = "monodisperse", diameter = 2e-3 } }
grains.kinds.heavy = { share = 3.0, size = { law = "monodisperse", diameter = 3e-3 } }
materials.light = { density = 1000.0, shear_modulus = 1e7, poisson_ratio = 0.3 }
materials.heavy = { density = 3000.0, shear_modulus = 2e7, poisson_ratio = 0.2 }
contact.light-light = { restitution = 0.4, friction_sliding = 0.0 }
contact.heavy-heavy = { restitution = 0.9, friction_sliding = 0.0 }
geometry.tube = { shape = "cylinder", radius = 0.05, length = 0.1, material = "light" }  # about the first
fill.law = "positions"
fill.grains = [
  { kind = "light", position = [0.0, 0.0, 0.0], velocity = [0.3, 0.0, 0.0] },
  { kind = "heavy", position = [2.6e-3, 0.0, 0.0] },
]
stages = [{ name = "meet", until = "time", duration_max = 2e-3 }]
""")


def test_shares_of_the_mass_become_numbers_of_grains_and_no_kind_lies_apart():
    setup = replica_setup(load_scene(TWO, ["grains.count=6000", "domain.period=[0.03, 0.03]"]), 1)
    grains = setup.grains
    of = {name: grains.mass[grains.material == k].sum() for k, name in enumerate(setup.materials)}
    assert of["aggregate"] / (of["sand"] + of["aggregate"]) == pytest.approx(0.3, rel=0.02)
    coarse = setup.grains.material == setup.materials.index("aggregate")
    np.testing.assert_allclose(setup.grains.radius[coarse], 1e-3)
    halves = np.array_split(coarse, 2)  # of the order in which they start, layer by layer
    assert halves[0].mean() == pytest.approx(halves[1].mean(), abs=0.02)  # sd of the difference: 0.007


def test_one_kind_among_kinds_is_the_bed_of_one_material():
    bed = "grains.size={law='monodisperse', diameter=1e-3}", "grains.material=sand", "measure={}"
    table = tomllib.loads(TWO.read_text(encoding="utf-8"))
    del table["grains"]["kinds"]
    plain = replica_setup(parse_scene(deepcopy(table), overrides=bed), 1).grains
    share = "grains.kinds.sand={share=1.0, size={law='monodisperse', diameter=1e-3}}"
    alone = replica_setup(parse_scene(table, overrides=[share, "measure={}"]), 1).grains
    assert plain.position.tobytes() == alone.position.tobytes()
    assert plain.mass.tobytes() == alone.mass.tobytes()


def test_a_pair_that_is_not_stated_has_geometric_means_and_a_stated_one_its_own():
    scene = load_scene(TWO)
    sand, loam = scene.contact["sand-sand"], scene.contact["aggregate-aggregate"]
    mixed = scene.contact_of_materials("sand", "aggregate")
    assert mixed.friction_sliding == pytest.approx(sqrt(sand.friction_sliding * loam.friction_sliding))
    assert mixed.friction_rolling == pytest.approx(sqrt(sand.friction_rolling * loam.friction_rolling))
    grain = loam.model_copy(update={"rolling_radius": "grain"})
    assert contact_of_two_kinds(grain, grain).friction_rolling == pytest.approx(2.0 * loam.friction_rolling)
    stated = load_scene(TWO, ["contact.aggregate-sand={restitution=0.2, friction_sliding=0.1}"])
    assert stated.contact_of_materials("sand", "aggregate").friction_sliding == 0.1
    assert scene_hash(stated) != scene_hash(scene)


def test_grains_of_two_kinds_part_with_the_mixed_restitution_and_keep_their_momentum(tmp_path: Path):
    path = tmp_path / "meet.toml"
    path.write_text(tomli_w.dumps(HEAD_ON), encoding="utf-8")
    run_scene(path, RunOptions(threads=1, record=tmp_path / "meet.rrd"))
    last = read_grains(tmp_path / "meet.rrd")[-1]
    light, heavy = last.state["velocity"][:, 0].tolist()
    assert last.state["kind"].tolist() == [1, 0]  # in alphabetical order
    assert (heavy - light) / SPEED == pytest.approx(sqrt(0.4 * 0.9), abs=0.003)
    mass = np.array([1000.0 * 2.0**3, 3000.0 * 3.0**3])
    assert mass @ [light, heavy] == pytest.approx(mass[0] * SPEED, rel=1e-4)


def test_a_bed_of_two_soils_is_measured_by_kind_and_drawn_in_two_colours(tmp_path: Path):
    small = "grains.count=250", "domain.period=[0.014, 0.014]", "measure.solid_fraction={}"
    document = run_scene(TWO, RunOptions(overrides=small, threads=1, record=tmp_path / "two.rrd"))
    last = read_grains(tmp_path / "two.rrd")[-1]
    coarse = last.state["kind"] == 0
    height = document["measures"]["centroid_height"]["value"]
    mass = last.state["mass"] if "mass" in last.state else last.radius**3
    expected = float(np.average(last.position[coarse, 2], weights=mass[coarse]))
    assert height == pytest.approx(expected, rel=1e-3)
    drawn = resting_colours(last.ident, last.state["kind"])
    assert np.median(drawn[~coarse], axis=0) == pytest.approx(KIND_COLOURS[1], abs=8)


def test_what_contradicts_several_kinds_is_refused():
    for order, told in (
        ("grains.material=sand", "stands in every kind"),
        ("grains.kinds.chalk={share=1.0, size={law='monodisperse', diameter=1e-3}}", "[materials]"),
        ("grains.kinds.sand.share=1e-9", "no grain of"),
        ("measure.centroid_height.kind=clay", "[grains.kinds]"),
        ("measure.solid_fraction.kind=sand", "all grains together"),
        ("grains.kinds={}", "grains.size is missing"),
        (
            "grains=[{material='sand', share=70.0}, {material='aggregate', share=30.0}]",
            "[grains.kinds.MATERIAL]",
        ),
    ):
        assert told in refusal(load_scene, TWO, [order]), order
