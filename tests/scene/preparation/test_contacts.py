"""Contact parameters follow from materials and pairs; laws and gravity from their sections."""

from typing import Any

import pytest
from scene_tables import changed, good_table, softened

from taichi_erosion.core.errors import BadInput
from taichi_erosion.core.setup import pair_row
from taichi_erosion.effect_library import load_library
from taichi_erosion.scene import laws, parse_scene, replica_setup, scene_hash
from taichi_erosion.scene.change import with_contacts
from taichi_erosion.scene.preparation.contacts import contact_table, effective_young_modulus
from taichi_erosion.scene.preparation.limits import step_report
from taichi_erosion.simulation.scene_setup import device_effects

SOIL, STEEL = 0, 1  # materials come in alphabetical order


def contacts_of(table: dict[str, Any]):
    return replica_setup(parse_scene(table), 1).contacts


def test_effective_moduli_are_those_of_two_springs_in_series():
    contacts, soil, wall = contacts_of(good_table()), pair_row(SOIL, SOIL, 2), pair_row(STEEL, SOIL, 2)
    young, steel, steel_shear = 2.0 * 1e7 * 1.29, 1.8e11, 1.8e11 / 2.6
    assert contacts.young_effective[soil] == pytest.approx(young / (2.0 * (1.0 - 0.29**2)))
    assert contacts.shear_effective[soil] == pytest.approx(1e7 / (2.0 * (2.0 - 0.29)))
    softness = (1.0 - 0.29**2) / young + (1.0 - 0.3**2) / steel
    assert 1.0 / contacts.young_effective[wall] == pytest.approx(softness)
    shear_softness = (2.0 - 0.29) / 1e7 + (2.0 - 0.3) / steel_shear
    assert 1.0 / contacts.shear_effective[wall] == pytest.approx(shear_softness)


def test_a_pair_is_the_same_in_either_order_of_names():
    table = good_table()
    table["contact"]["soil-steel"] = table["contact"].pop("steel-soil")
    assert scene_hash(parse_scene(table)) == scene_hash(parse_scene(good_table()))
    first, other = contacts_of(good_table()), contacts_of(table)
    assert all((a == b).all() for a, b in zip(vars(first).values(), vars(other).values(), strict=True))
    row = pair_row(SOIL, STEEL, 2)
    frictions = (first.friction_sliding[row], first.friction_rolling[row])
    assert (first.restitution[row], *frictions) == (0.25, 0.34, 0.41)


def test_sticking_velocity_softening_scales_the_surface_energy_by_stiffness_to_two_fifths():
    soils, wall = pair_row(SOIL, SOIL, 2), pair_row(SOIL, STEEL, 2)
    assert contacts_of(softened("bond_number", 0.02)).surface_energy[soils] == 0.02
    # 1000 times softer between grains: a factor 0.063; at a wall the effective modulus counts
    table = softened("sticking_velocity", 0.02)
    found = contacts_of(table).surface_energy
    assert found[soils] == pytest.approx(0.02 * 1000.0**-0.4)
    materials = parse_scene(table).materials
    stiff = parse_scene(changed("materials.soil.shear_modulus", 1e10)).materials["soil"]
    soft, hard = (effective_young_modulus(soil, materials["steel"]) for soil in (materials["soil"], stiff))
    assert found[wall] == pytest.approx(0.02 * (soft / hard) ** 0.4)


@pytest.mark.parametrize(
    ("rule", "scale", "same"),
    [("cohesive_stress", 8.0, "tensile_strength"), ("bond_number", 64.0, "bond_number")],
)
def test_larger_grains_keep_the_stress_of_adhesion_or_its_bond_number(rule: str, scale: float, same: str):
    numbers, pulls = [], []
    for diameter, order in ((2.5e-4, None), (2e-3, {"rule": rule, "factor": 8.0})):
        table = changed("grains.coarse_graining", order) | {"conditions": {"moisture": 0.02}}
        table |= {"effects": {name: {"strength": 1.0} for name in ("liquid_bridge", "dry_adhesion")}}
        table["grains"]["size"] = {"law": "monodisperse", "diameter": diameter}
        table["laws"]["normal"] = "jkr"
        table["contact"]["soil-soil"]["surface_energy"] = 1e-4
        scene = parse_scene(table, overrides=["run.force_time_step=true"])
        numbers.append(step_report(scene)["adhesion"])
        pulls.append([effect.constants["pull"] for effect in device_effects(scene, load_library(), diameter)])
    true, large = numbers
    assert large["surface_energy"] == pytest.approx(scale * 1e-4)
    equal = {name for name in ("tensile_strength", "bond_number") if large[name] == pytest.approx(true[name])}
    assert equal == {same}
    assert pulls[1] == pytest.approx([scale * pull for pull in pulls[0]])


def test_effects_reach_and_change_every_contact_but_those_that_say_no():
    table = good_table()
    table["contact"]["steel-soil"]["effects"] = False
    effects = contacts_of(table).effects
    assert (effects[pair_row(SOIL, SOIL, 2)], effects[pair_row(SOIL, STEEL, 2)]) == (1.0, 0.0)
    bare = parse_scene(table)
    rough = with_contacts(bare, lambda contact: contact.model_copy(update={"friction_sliding": 2.0}))
    assert rough.contact["soil-soil"].friction_sliding == 2.0
    assert rough.contact["steel-soil"] == bare.contact["steel-soil"]


def test_rolling_friction_over_the_radius_of_a_grain_counts_twice_over_the_effective_radius():
    # between equal grains R* = R / 2, so the torque mu R F is 2 mu R* F
    table = changed("contact.soil-soil.rolling_radius", "grain")
    found = contacts_of(table).friction_rolling
    assert found[pair_row(SOIL, SOIL, 2)] == pytest.approx(2.0 * 0.69)
    assert found[pair_row(SOIL, STEEL, 2)] == 0.41
    soil = "soil-soil: friction_rolling 1.38, which is 0.69 in EDEM (equal grains)"
    steel = "steel-soil: friction_rolling 0.41, which is 0.41 in EDEM"
    assert step_report(parse_scene(table))["rolling"] == [soil, steel]
    with pytest.raises(BadInput, match=r"contact\.steel-soil\.rolling_radius: at a wall"):
        parse_scene(changed("contact.steel-soil.rolling_radius", "grain"))


def test_an_effect_adds_the_same_rolling_friction_in_either_convention():
    effect = load_library()["rolling_resistance"]
    bare = parse_scene(good_table()), parse_scene(changed("contact.soil-soil.rolling_radius", "grain"))
    before, after = (
        [contact_table(scene).friction_rolling[pair_row(SOIL, SOIL, 2)] for scene in scenes]
        for scenes in (bare, [effect.act(effect.params(), 1.0, {}, scene) for scene in bare])
    )
    assert after[0] - before[0] == pytest.approx(0.14)
    assert after[1] - before[1] == pytest.approx(0.14)


def test_gravity_starts_along_its_direction_and_laws_are_those_of_the_scene():
    table = changed("gravity", {"magnitude": 1.62, "direction": [0.0, 3.0, -4.0]})
    assert replica_setup(parse_scene(table), 1).gravity == pytest.approx((0.0, 0.6 * 1.62, -0.8 * 1.62))
    chosen = laws(parse_scene(softened("bond_number", 0.02)))
    assert (chosen.normal, chosen.rolling, chosen.friction_cap) == ("jkr", "elastic_plastic", "thornton")
