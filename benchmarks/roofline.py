"""Roofline: the share of a device's memory bandwidth that a step with one thread per grain uses.

    share = B s / b,    B = g + e (entries / grains) + c (contacts / grains)

with s the speed [grain-steps s-1], b the bandwidth of a copy on the same device [byte s-1], and g, e, c the
bytes that a step moves for each grain, list entry and contact if every stage reads and writes each of its
numbers once and caches hold whatever several threads need. A step cannot move less; rebuilds, walls and
exchanges with air are left out.

Reference: Williams, Waterman & Patterson (2009), Commun. ACM 52(4), 65.
"""

from math import prod
from typing import Any

from taichi_erosion.core.transfer import NUMBER_BYTES, download, inner_shape
from taichi_erosion.simulation import Simulation

RATES = ("force", "torque")
EVALUATED = ("shift", "velocity", "spin", "radius")  # of a grain, read by the stage of pairs
MOVED = ("shift", "velocity", "spin")  # read and written by the stage of motion
CONSTANT = ("radius", "mass_inverse", "skin_squared")
LISTED = ("owner", "neighbour", "label", "separation")
DISPLACEMENTS = ("tangential_displacement", "rolling_displacement")
CONTACT = ("root_radius", "damping", "rolling_damping")
BOUNDS = ("start", "stop")
SUMMED = ("force", "torque", "back")  # of a contact, written by one stage and read by the next


def number_bytes(owner: Any, names: tuple[str, ...]) -> int:
    """Bytes of one place of some fields of a record."""
    chosen = [getattr(owner, name) for name in names]
    return sum(NUMBER_BYTES[field.dtype.to_string()] * prod(inner_shape(field)) for field in chosen)


def step_bytes(sim: Simulation, contacts: int) -> float:
    """Least bytes that a step of all replicas moves; `contacts` are pairs of grains that touch."""
    grains, pairs, buffers = sim.world.grains, sim.world.pairs, sim.buffers
    assert buffers is not None
    summed = 4 * number_bytes(grains, RATES)  # read and written by the sum and by the motion
    moved = 2 * number_bytes(grains, MOVED) + number_bytes(grains, CONSTANT)
    bounds = number_bytes(pairs, BOUNDS) + number_bytes(buffers, BOUNDS)
    grain = number_bytes(grains, EVALUATED) + summed + moved + bounds
    entry = number_bytes(pairs, LISTED) + 2 * number_bytes(buffers, ("level",))
    entry += number_bytes(buffers, ("partner_entry",))
    contact = number_bytes(pairs, CONTACT) + 2 * number_bytes(pairs, DISPLACEMENTS)
    contact += 2 * number_bytes(buffers, SUMMED)
    fields = [sim.world.replicas.released, buffers.listed]
    released, listed = (column.sum() for column in download(fields, 0, len(sim.setups)))
    return float(released * grain + listed * entry + contacts * contact)
