"""SIMD batch: up to sixteen contacts side by side, one per lane, evaluated by vector instructions.

Contacts are gathered lane by lane, the contact law runs over all lanes without branches that depend on
memory, and the results are scattered lane by lane. The columns are local arrays, which the compiler knows not
to overlap. Every lane does the arithmetic of a single contact: a result does not depend on which contacts
share a batch.
"""

from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.contact import contact_force
from taichi_erosion.grains.neighbour_list import ENGAGED

LANES = 16  # contacts of a batch on a CPU; 32 were no faster


def batch_struct_type(lanes: int) -> Any:
    """Struct of one batch in the run's precision; every member has one number, or one vector, per lane."""
    whole = ti.types.vector(lanes, ti.i32)
    real = ti.types.vector(lanes, float)
    vector = ti.types.struct(x=real, y=real, z=real)
    labels = ("entry", "owner", "partner", "engaged", "acts")
    scalars = ("radius_i", "radius_j", "root_radius", "damping", "rolling_damping", "overlap")
    geometry = ("offset", "velocity", "spin_i", "spin_j")
    displacements = ("tangential_displacement", "rolling_displacement")
    results = ("force", "moment", "torque_per_radius")
    members = dict.fromkeys(labels, whole) | dict.fromkeys(scalars, real)
    members |= dict.fromkeys((*geometry, *displacements, *results), vector)
    # a copy of the row of Materials of every lane, which the laws read as a table whose row is the lane:
    # gathering from the table inside the law costs more, 77 against 69 ns a grain in a bed of 2.9 contacts a
    # grain (Hertz, elastic-plastic rolling, one thread)
    columns = ("young", "shear", "shear_damping", "friction_sliding", "friction_rolling", "adhesion")
    return ti.types.struct(**members, materials=ti.types.struct(**dict.fromkeys(columns, real)))


@ti.func
def lane(columns: ti.template(), n):
    return ti.Vector([columns.x[n], columns.y[n], columns.z[n]])


@ti.func
def set_lane_vector(columns_out: ti.template(), n, vector):
    columns_out.x[n] = vector[0]
    columns_out.y[n] = vector[1]
    columns_out.z[n] = vector[2]


@ti.func
def load_materials_row(world: ti.template(), batch_out: ti.template(), n, row):
    materials, lanes_out = ti.static((world.materials, batch_out.materials))
    lanes_out.young[n] = materials.young[row]
    lanes_out.shear[n] = materials.shear[row]
    lanes_out.shear_damping[n] = materials.shear_damping[row]
    lanes_out.friction_sliding[n] = materials.friction_sliding[row]
    lanes_out.friction_rolling[n] = materials.friction_rolling[row]
    if ti.static(world.laws.adhesive):
        lanes_out.adhesion[n] = materials.adhesion[row]


@ti.func
def load_entry_to_lane(world: ti.template(), entries: ti.template(), batch_out: ti.template(), n):
    """Load constants and history of the entry in lane n; `entries` is a neighbour list or a wall list."""
    e = batch_out.entry[n]
    batch_out.root_radius[n] = entries.root_radius[e]
    batch_out.damping[n] = entries.damping[e]
    batch_out.rolling_damping[n] = entries.rolling_damping[e]
    if ti.static(world.laws.adhesive):
        batch_out.engaged[n] = entries.label[e] & ENGAGED
    set_lane_vector(batch_out.tangential_displacement, n, entries.tangential_displacement[e])
    set_lane_vector(batch_out.rolling_displacement, n, entries.rolling_displacement[e])


@ti.func
def store_history(entries_out: ti.template(), batch: ti.template(), n):
    e = batch.entry[n]
    entries_out.label[e] = entries_out.label[e] | ENGAGED
    entries_out.tangential_displacement[e] = lane(batch.tangential_displacement, n)
    entries_out.rolling_displacement[e] = lane(batch.rolling_displacement, n)


@ti.func
def evaluate_contact_law(laws: ti.template(), batch_out: ti.template(), n, dt, normal, overlap, lever):
    """Contact law in lane n; the `lever` of the forces is the distance of the centre over the radius [1]."""
    root = batch_out.root_radius[n]
    elastic, contact_radius, cap_force, acts = laws.normal_force(
        batch_out.materials, n, overlap, root, batch_out.engaged[n]
    )
    spin_i, spin_j = lane(batch_out.spin_i, n), lane(batch_out.spin_j, n)
    arms = batch_out.radius_i[n] * spin_i + batch_out.radius_j[n] * spin_j
    spin = spin_i - spin_j
    contact = laws.contact_type(
        normal=normal,
        velocity=lane(batch_out.velocity, n) - lever * arms.cross(normal),
        rolling_velocity=spin - ti.math.dot(spin, normal) * normal,
        root_radius=root,
        damping=batch_out.damping[n],
        rolling_damping=batch_out.rolling_damping[n],
        elastic=elastic,
        contact_radius=contact_radius,
        root_contact_radius=ti.sqrt(contact_radius),
        cap_force=cap_force,
    )
    tangential = lane(batch_out.tangential_displacement, n)
    rolling = lane(batch_out.rolling_displacement, n)
    force, friction, moment, tangential_after, rolling_after = contact_force(
        laws, batch_out.materials, n, contact, tangential, rolling, dt
    )
    batch_out.overlap[n] = overlap
    batch_out.acts[n] = acts
    set_lane_vector(batch_out.force, n, force)
    set_lane_vector(batch_out.moment, n, moment)
    set_lane_vector(batch_out.torque_per_radius, n, lever * ti.math.cross(normal, friction))
    set_lane_vector(batch_out.tangential_displacement, n, tangential_after)
    set_lane_vector(batch_out.rolling_displacement, n, rolling_after)
