"""Contact laws on the device: Hertz and JKR against closed forms, Mindlin's spring and its limit."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import contacts

from taichi_erosion.core.setup import Laws, Numerics
from taichi_erosion.core.ti import ti
from taichi_erosion.grains.contact import compile_contact_laws, contact_force
from taichi_erosion.grains.laws.mindlin import tangential_force
from taichi_erosion.grains.materials import allocate_materials, upload_materials
from tests.verification.reference.contact import AdhesivePair, branch_force

pytestmark = pytest.mark.engine

RADIUS, MASS = 0.5e-3, 1e-6  # effective, m and kg
TABLE = contacts(friction=0.4, restitution=0.6)
YOUNG, SHEAR = TABLE.young_effective[0], TABLE.shear_effective[0]
ENERGY = 0.05  # J m-2
OVERLAP = 2e-6  # m
F64 = Numerics("cpu", 1, "f64")


@ti.kernel
def normal_forces(
    # in
    laws: ti.template(),
    materials: ti.template(),
    overlaps: ti.types.ndarray(dtype=ti.f64, ndim=1),
    # out
    found_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    for n in range(overlaps.shape[0]):
        force, radius, cap, acts = laws.normal_force(materials, 0, overlaps[n], ti.sqrt(RADIUS), 1)
        found_out[n, 0], found_out[n, 1], found_out[n, 2] = force * acts, radius, cap


@ti.kernel
def slid(
    # in
    laws: ti.template(),
    materials: ti.template(),
    displacements: ti.types.ndarray(dtype=ti.f64, ndim=1),
    # out
    found_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    for n in range(displacements.shape[0]):
        force, radius, cap, acts = laws.normal_force(materials, 0, OVERLAP, ti.sqrt(RADIUS), 1)
        still = ti.Vector([0.0, 0.0, 0.0])
        contact = laws.contact_type(
            normal=ti.Vector([0.0, 0.0, 1.0]),
            velocity=still,
            rolling_velocity=still,
            root_radius=ti.sqrt(RADIUS),
            damping=materials.damping[0] * ti.sqrt(MASS),
            rolling_damping=0.0,
            elastic=force * acts,
            contact_radius=radius,
            root_contact_radius=ti.sqrt(radius),
            cap_force=cap,
        )
        before = ti.Vector([displacements[n], 0.0, 0.0])
        friction, after = tangential_force(materials, 0, contact, before, 0.0)
        total = contact_force(laws, materials, 0, contact, before, 0.0 * before, 0.0)[0]
        found_out[n, 0], found_out[n, 1] = friction[0], after[0]
        found_out[n, 2], found_out[n, 3] = total[0], total[2]


def materials_of(table):
    materials = allocate_materials(1, 2)
    upload_materials(materials, [table])
    return materials


def test_hertz_repels_with_the_power_of_three_halves_and_not_across_a_gap(start_device):
    start_device(F64)
    overlaps, found = np.array([-1e-6, 0.0, 1e-7, OVERLAP]), np.zeros((4, 3))
    normal_forces(compile_contact_laws(Laws()), materials_of(TABLE), overlaps, found)
    depth = np.maximum(overlaps, 0.0)
    force = 4.0 / 3.0 * YOUNG * np.sqrt(RADIUS) * depth**1.5
    assert found[:, 0] == pytest.approx(force, rel=1e-13)
    assert found[:, 1] == pytest.approx(np.sqrt(RADIUS * depth), rel=1e-13)
    assert found[:, 2] == pytest.approx(force, rel=1e-13)  # the elastic force caps friction


def test_jkr_pulls_along_its_branch_until_the_neck_tears(start_device):
    start_device(F64)
    pair = AdhesivePair(YOUNG, RADIUS, MASS, ENERGY)
    reduced = np.array([-1.3, -1.1, -0.5, 0.0, 0.5, 3.0])  # the neck tears at -1.19
    sticky = replace(TABLE, surface_energy=np.full(3, ENERGY))
    found = np.zeros((len(reduced), 3))
    normal_forces(compile_contact_laws(Laws(normal="jkr")), materials_of(sticky), reduced * pair.depth, found)
    want = np.array([branch_force(r) for r in reduced]) * pair.force_scale
    # the device finds the contact radius by a fixed number of steps, right to 1e-9 of the force scale
    assert found[:, 0] == pytest.approx(want, rel=1e-8, abs=1e-8 * pair.force_scale)
    assert found[:, 0].min() >= -3.0 * pair.force_scale  # pull-off force 3 pi gamma R*


def test_friction_is_mindlins_spring_up_to_coulombs_limit(start_device):
    start_device(F64)
    laws, materials = compile_contact_laws(Laws()), materials_of(TABLE)
    stiffness = 8.0 * SHEAR * np.sqrt(RADIUS * OVERLAP)
    normal = 4.0 / 3.0 * YOUNG * np.sqrt(RADIUS) * OVERLAP**1.5
    limit = TABLE.friction_sliding[0] * normal
    displacements = np.array([0.0, 0.1, 0.99, 1.01, 50.0]) * limit / stiffness
    found = np.zeros((5, 4))
    slid(laws, materials, displacements, found)
    force = -np.minimum(stiffness * displacements, limit)
    assert found[:, 0] == pytest.approx(force, rel=1e-12)
    assert found[:, 1] == pytest.approx(-force / stiffness, rel=1e-12)  # a sliding spring is shortened
    assert found[:, 2] == pytest.approx(force, rel=1e-12)
    assert found[:, 3] == pytest.approx(np.full(5, normal), rel=1e-12)
