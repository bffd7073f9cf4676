"""Batches: a few touching pairs side by side in columns, so that the processor strikes several at a time.

Pairs are gathered one by one, the contact law runs over the columns without branches that memory depends on,
and what it gives is dealt out one by one. The columns are local arrays: the compiler knows that nothing else
lies in them, and uses vector instructions. Every lane does the arithmetic of a single contact, so a result
does not depend on which pairs happen to share a batch.
"""

from typing import Any

from taichi_erosion.core.ti import ti

LANES = 16  # pairs of a batch; 32 were no faster


def batch_type() -> Any:
    """Struct of one batch in the run's precision; member by member, lane by lane."""
    whole = ti.types.vector(LANES, ti.i32)
    one = ti.types.vector(LANES, float)
    three = ti.types.struct(x=one, y=one, z=one)
    labels = ("entry", "owner", "partner", "engaged", "acts")
    scalars = ("radius_i", "radius_j", "root_radius", "damping", "rolling_damping", "overlap")
    columns = ("young", "shear", "shear_damping", "friction_sliding", "friction_rolling", "adhesion")
    vectors = ("offset", "velocity", "spin_i", "spin_j", "slip", "tilt", "force", "moment", "twist")
    members = dict.fromkeys(labels, whole) | dict.fromkeys((*scalars, *columns), one)
    return ti.types.struct(**members, **dict.fromkeys(vectors, three))


@ti.func
def lane(columns: ti.template(), n):
    """Vector in lane n."""
    return ti.Vector([columns.x[n], columns.y[n], columns.z[n]])


@ti.func
def put(columns_out: ti.template(), n, vector):
    """Write a vector to lane n."""
    columns_out.x[n] = vector[0]
    columns_out.y[n] = vector[1]
    columns_out.z[n] = vector[2]
