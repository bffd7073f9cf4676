"""Neighbour list: which grains may touch before the next rebuild, with the memory of those that do.

Half list: a pair stands once, with the grain whose cell comes first. Entries of a grain lie together from
`start` to `stop`, touching pairs first, so that the force loop meets them in runs. Every replica owns
`capacity` entries on each of two sides; each partition of its grains fills its own share of them, so
partitions never wait for each other.
"""

from dataclasses import dataclass
from typing import Any

from taichi_erosion.core.ti import ti

ENGAGED = 1  # bit of a label: the contact acts
MET = 2  # bit of a label: the two have touched, and an effect has held on to them since
MEMORY = ENGAGED | MET
ROW_SHIFT = 2  # of a label: above these bits stands the row of Materials


@dataclass(frozen=True, eq=False)
class Pairs:
    """Entries of all replicas, both sides."""

    capacity: int  # entries a replica and side
    owner: Any  # i32, rank of the owner
    neighbour: Any  # i32, rank of the partner
    label: Any  # i32, row of Materials above the bits ENGAGED and MET
    separation: Any  # vec3, origin of the owner minus origin of the partner [m]
    root_radius: Any  # square root of the effective radius [m^0.5]
    damping: Any  # normal damping constant over sqrt(a) [kg s-1 m-0.5]
    rolling_damping: Any  # rolling damping constant over sqrt(a) [N m s m-0.5]
    slip: Any  # vec3, tangential displacement since engagement [m]
    tilt: Any  # vec3, rolling angle since engagement [rad]
    start: Any  # i32 by grain place: first entry
    stop: Any  # i32 by grain place: one past the last entry


def allocate_pairs(replicas: int, grains: int, capacity: int) -> Pairs:
    """Fields of `capacity` entries a replica and side."""
    reals = {name: ti.field(float) for name in ("root_radius", "damping", "rolling_damping")}
    vectors = {name: ti.Vector.field(3, float) for name in ("separation", "slip", "tilt")}
    labels = {name: ti.field(ti.i32) for name in ("owner", "neighbour", "label")}
    # by themselves: the search for a pair in an old list reads nothing else
    ti.root.dense(ti.i, 2 * replicas * capacity).place(*labels.values())
    ti.root.dense(ti.i, 2 * replicas * capacity).place(
        vectors["separation"], *reals.values(), vectors["slip"], vectors["tilt"]
    )
    bounds = {name: ti.field(ti.i32) for name in ("start", "stop")}
    ti.root.dense(ti.i, 2 * replicas * grains).place(*bounds.values())
    return Pairs(capacity, **reals, **vectors, **labels, **bounds)


@ti.func
def entry_block(pairs: ti.template(), r, side):
    """First entry of one side of replica r."""
    return (2 * r + side) * pairs.capacity


@ti.func
def partition_entries(pairs: ti.template(), replicas: ti.template(), r, p):
    """First entry of partition p within a side."""
    return pairs.capacity // replicas.partitions[r] * p
