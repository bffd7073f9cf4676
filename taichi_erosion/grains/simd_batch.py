"""Batches: a few touching pairs side by side in columns, so that the processor strikes several at a time.

Pairs are gathered one by one, the contact law runs over the columns without branches that memory depends on,
and what it gives is dealt out one by one. The columns are local arrays: the compiler knows that nothing else
lies in them, and uses vector instructions. Every lane does the arithmetic of a single contact, so a result
does not depend on which pairs happen to share a batch.
"""

from typing import Any

from taichi_erosion.core.ti import ti
from taichi_erosion.grains.contact import contact_force, make_contact
from taichi_erosion.grains.neighbour_list import ENGAGED, ROW_SHIFT

LANES = 16  # pairs of a batch; 32 were no faster


def batch_type() -> Any:
    """Struct of one batch in the run's precision; member by member, lane by lane."""
    whole = ti.types.vector(LANES, ti.i32)
    one = ti.types.vector(LANES, float)
    three = ti.types.struct(x=one, y=one, z=one)
    labels = ("entry", "owner", "partner", "engaged", "acts")
    scalars = ("radius_i", "radius_j", "root_radius", "damping", "rolling_damping", "overlap")
    columns = ("young", "shear", "shear_damping", "friction_sliding", "friction_rolling", "adhesion")
    vectors = (
        "offset",
        "velocity",
        "spin_i",
        "spin_j",
        "tangential_displacement",
        "rolling_displacement",
        "force",
        "moment",
        "torque_per_radius",
    )
    members = dict.fromkeys(labels, whole) | dict.fromkeys((*scalars, *columns), one)
    return ti.types.struct(**members, **dict.fromkeys(vectors, three))


@ti.func
def lane(columns: ti.template(), n):
    """Vector in lane n."""
    return ti.Vector([columns.x[n], columns.y[n], columns.z[n]])


@ti.func
def set_lane(columns_out: ti.template(), n, vector):
    """Write a vector to lane n."""
    columns_out.x[n] = vector[0]
    columns_out.y[n] = vector[1]
    columns_out.z[n] = vector[2]


@ti.func
def load_entry(world: ti.template(), entries: ti.template(), batch_out: ti.template(), n):
    """Write constants and memory of the entry in lane n; `entries` are those of pairs or of walls."""
    (materials,) = ti.static((world.materials,))
    e = batch_out.entry[n]
    row = entries.label[e] >> ROW_SHIFT
    batch_out.root_radius[n] = entries.root_radius[e]
    batch_out.damping[n] = entries.damping[e]
    batch_out.rolling_damping[n] = entries.rolling_damping[e]
    batch_out.young[n] = materials.young[row]
    batch_out.shear[n] = materials.shear[row]
    batch_out.shear_damping[n] = materials.shear_damping[row]
    batch_out.friction_sliding[n] = materials.friction_sliding[row]
    batch_out.friction_rolling[n] = materials.friction_rolling[row]
    if ti.static(world.laws.adhesive):
        batch_out.adhesion[n] = materials.adhesion[row]
        batch_out.engaged[n] = entries.label[e] & ENGAGED
    set_lane(batch_out.tangential_displacement, n, entries.tangential_displacement[e])
    set_lane(batch_out.rolling_displacement, n, entries.rolling_displacement[e])


@ti.func
def evaluate_contact(laws: ti.template(), batch_out: ti.template(), n, dt, normal, overlap, lever):
    """Contact law in lane n; the `lever` of the forces is the distance of the centre over the radius [1]."""
    root = batch_out.root_radius[n]
    elastic = laws.normal_force(batch_out, n, overlap, root, batch_out.engaged[n])
    spin_i, spin_j = lane(batch_out.spin_i, n), lane(batch_out.spin_j, n)
    arms = batch_out.radius_i[n] * spin_i + batch_out.radius_j[n] * spin_j
    velocity = lane(batch_out.velocity, n) - lever * arms.cross(normal)
    constants = (root, batch_out.damping[n], batch_out.rolling_damping[n])
    contact = make_contact(laws, normal, velocity, spin_i - spin_j, constants, elastic)
    force, tangential, moment, tangential_displacement, rolling_displacement = contact_force(
        laws,
        batch_out,
        n,
        contact,
        lane(batch_out.tangential_displacement, n),
        lane(batch_out.rolling_displacement, n),
        dt,
    )
    batch_out.overlap[n] = overlap
    batch_out.acts[n] = elastic[3]
    set_lane(batch_out.force, n, force)
    set_lane(batch_out.moment, n, moment)
    set_lane(batch_out.torque_per_radius, n, lever * ti.math.cross(normal, tangential))
    set_lane(batch_out.tangential_displacement, n, tangential_displacement)
    set_lane(batch_out.rolling_displacement, n, rolling_displacement)
