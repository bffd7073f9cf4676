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

from taichi_erosion.core.transfer import NUMPY_TYPES, download, element_shape
from taichi_erosion.simulation import Simulation

EVALUATED = ("shift", "velocity", "spin", "radius")  # of a grain, read by the stage of pairs
MOVED = ("shift", "velocity", "spin")  # read and written by the stage of motion
CONSTANT = ("radius", "mass_inverse", "skin_squared")
RATES = ("force", "torque")  # written and read by the stage of motion
LISTED = ("owner", "neighbour", "label", "separation")
DISPLACEMENTS = ("tangential_displacement", "rolling_displacement")
CONTACT = ("root_radius", "damping", "rolling_damping")
BOUNDS = ("start", "stop")
SUMMED = ("force", "torque", "back")  # of an entry, read by the stage of motion; written for a contact


def number_bytes(owner: Any, names: tuple[str, ...]) -> int:
    """Bytes of one place of some fields of a record."""
    chosen = [getattr(owner, name) for name in names]
    return sum(NUMPY_TYPES[str(field.dtype)]().itemsize * prod(element_shape(field)) for field in chosen)


def step_bytes(sim: Simulation, contacts: int) -> float:
    """Least bytes that a step of all replicas moves; `contacts` are pairs of grains that touch."""
    grains, pairs, buffers = sim.world.grains, sim.world.pairs, sim.buffers
    assert buffers is not None
    moved = 2 * number_bytes(grains, MOVED) + number_bytes(grains, CONSTANT) + 2 * number_bytes(grains, RATES)
    bounds = 2 * number_bytes(pairs, BOUNDS) + number_bytes(buffers, ("partners",))
    grain = number_bytes(grains, EVALUATED) + moved + bounds
    entry = number_bytes(pairs, LISTED) + number_bytes(buffers, ("acts", "partner_entry", *SUMMED, "force"))
    contact = number_bytes(pairs, CONTACT) + 2 * number_bytes(pairs, DISPLACEMENTS)
    contact += number_bytes(buffers, SUMMED)
    released = download([sim.world.replicas.released], 0, len(sim.setups))[0].sum()
    listed = download([buffers.partners], 0, len(sim.setups) * grains.capacity)[0].sum()
    return float(released * grain + listed * entry + contacts * contact)
