"""Contact laws on the device: Hertz and JKR against closed forms, Mindlin's spring; rows of materials."""

from dataclasses import replace

import numpy as np
import pytest
from grain_worlds import contacts

from taichi_erosion.core.setup import ContactTable, Floats, Laws, Numerics, pair_row
from taichi_erosion.core.ti import ti
from taichi_erosion.grains.contact import compile_contact_laws, contact_force
from taichi_erosion.grains.laws.mindlin import tangential_force
from taichi_erosion.grains.materials import allocate_materials, upload_materials
from taichi_erosion.grains.materials import pair_row as device_row
from tests.verification.reference.contact import AdhesivePair, branch_force

pytestmark = pytest.mark.engine

RADIUS, MASS = 0.5e-3, 1e-6  # effective, m and kg
TABLE = contacts(friction=0.4, restitution=0.6)
YOUNG, SHEAR = TABLE.young_effective[0], TABLE.shear_effective[0]
ENERGY = 0.05  # J m-2
OVERLAP = 2e-6  # m


@ti.kernel
def evaluate(
    laws: ti.template(),
    materials: ti.template(),
    overlaps: ti.types.ndarray(dtype=ti.f64, ndim=1),
    displacements: ti.types.ndarray(dtype=ti.f64, ndim=1),
    found_out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    for n in range(overlaps.shape[0]):
        force, radius, cap, acts = laws.normal_force(materials, 0, overlaps[n], ti.sqrt(RADIUS), 1)
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
        found_out[n, 0], found_out[n, 1], found_out[n, 2] = force * acts, radius, cap
        found_out[n, 3], found_out[n, 4] = friction[0], after[0]
        found_out[n, 5], found_out[n, 6] = total[0], total[2]


@pytest.fixture
def contact(start_device):
    """Function that gives normal force, contact radius, cap, friction, spring after, force along x and z."""
    start_device(Numerics("cpu", 1, "f64"))

    def found(laws: Laws, table: ContactTable, overlaps: Floats, displacements: Floats) -> Floats:
        materials, numbers = allocate_materials(1, 2), np.zeros((len(overlaps), 7))
        upload_materials(materials, [table])
        evaluate(compile_contact_laws(laws), materials, overlaps, displacements, numbers)
        return numbers.T

    return found


def test_hertz_repels_with_the_power_of_three_halves_and_not_across_a_gap(contact):
    overlaps = np.array([-1e-6, 0.0, 1e-7, OVERLAP])
    normal, radius, cap, *_ = contact(Laws(), TABLE, overlaps, np.zeros(4))
    depth = np.maximum(overlaps, 0.0)
    force = 4.0 / 3.0 * YOUNG * np.sqrt(RADIUS) * depth**1.5
    assert normal == pytest.approx(force, rel=1e-13)
    assert radius == pytest.approx(np.sqrt(RADIUS * depth), rel=1e-13)
    assert cap == pytest.approx(force, rel=1e-13)  # the elastic force caps friction


def test_jkr_pulls_along_its_branch_until_the_neck_tears(contact):
    pair = AdhesivePair(YOUNG, RADIUS, MASS, ENERGY)
    reduced = np.array([-1.3, -1.1, -0.5, 0.0, 0.5, 3.0])  # the neck tears at -1.19
    sticky = replace(TABLE, surface_energy=np.full(3, ENERGY))
    normal = contact(Laws(normal="jkr"), sticky, reduced * pair.depth, np.zeros(6))[0]
    want = np.array([branch_force(r) for r in reduced]) * pair.force_scale
    # the device finds the contact radius by a fixed number of steps, right to 1e-9 of the force scale
    assert normal == pytest.approx(want, rel=1e-8, abs=1e-8 * pair.force_scale)
    assert normal.min() >= -3.0 * pair.force_scale  # pull-off force 3 pi gamma R*


def test_friction_is_mindlins_spring_up_to_coulombs_limit(contact):
    stiffness = 8.0 * SHEAR * np.sqrt(RADIUS * OVERLAP)
    limit = TABLE.friction_sliding[0] * 4.0 / 3.0 * YOUNG * np.sqrt(RADIUS) * OVERLAP**1.5
    displacements = np.array([0.0, 0.1, 0.99, 1.01, 50.0]) * limit / stiffness
    normal, _, _, friction, after, along, across = contact(Laws(), TABLE, np.full(5, OVERLAP), displacements)
    force = -np.minimum(stiffness * displacements, limit)
    assert friction == pytest.approx(force, rel=1e-12)
    assert after == pytest.approx(-force / stiffness, rel=1e-12)  # a sliding spring is shortened
    assert along == pytest.approx(force, rel=1e-12)
    assert across == pytest.approx(normal, rel=1e-12)


REPLICA = 2
MATERIALS = 4


@ti.kernel
def write_rows(materials: ti.template(), rows_out: ti.types.ndarray(dtype=ti.i32, ndim=2)):
    for i, j in ti.ndrange(materials.count, materials.count):
        rows_out[i, j] = device_row(materials, REPLICA, i, j)


def test_every_pair_of_materials_has_a_row_of_its_own_which_the_device_finds(start_device):
    start_device(Numerics("cpu", 1))
    materials = allocate_materials(REPLICA + 1, MATERIALS)
    rows = np.zeros((MATERIALS, MATERIALS), np.int32)
    write_rows(materials, rows)
    rows -= REPLICA * materials.rows
    assert rows.tolist() == [[pair_row(i, j, MATERIALS) for j in range(MATERIALS)] for i in range(MATERIALS)]
    assert np.array_equal(rows, rows.T)
    assert set(rows.ravel()) == set(range(MATERIALS * (MATERIALS + 1) // 2))
