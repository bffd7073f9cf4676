"""What is compared: numbers from the places of grains at rest, read the same way for every code.

Normal forces follow from the overlaps by Hertz' law,

    F = (4/3) E* sqrt(R*) d^(3/2),

so nothing rests on what a code says of its own forces; what friction carries is the rest of the weight.

Reference: Johnson (1985), Contact Mechanics, eqs (4.22)-(4.23).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from benchmarks.peers.cases import SOIL, Floats, Soil
from benchmarks.peers.physics_cases import BED_SIDE, mass, weight, young_effective
from taichi_erosion.core.snapshot import Snapshot
from taichi_erosion.measures.heap import angle_of_repose_outline, centroid_height, pile_height, radius_90

QUANTILES = (0.1, 0.5, 0.9)
CUTS = (0.25, 0.5, 0.75)  # heights at which stress is looked at, over the height of the bed [1]
CLOSE = 1.001  # distance of grains that count as neighbours over d; a neck of two weights tears at 1.0005
TALL = 1.0  # m, a period along z that nothing reaches across

Numbers = Iterator[tuple[str, float]]


@dataclass(frozen=True)
class Rest:
    """Grains at the end of a run."""

    position: Floats  # [n, 3] m
    velocity: Floats  # [n, 3] m s-1
    spin: Floats  # [n, 3] rad s-1


@dataclass(frozen=True)
class Contacts:
    """Touching pairs of a periodic bed."""

    pair: NDArray[np.int64]  # [c, 2] grains
    normal: Floats  # [c, 3] from the first to the second [1]
    overlap: Floats  # [c] m
    force: Floats  # [c] N, normal


def hertz(overlap: Floats, radius: float) -> Floats:
    """Normal force [N] at an overlap [m] and an effective radius [m]."""
    return 4.0 / 3.0 * young_effective(SOIL) * np.sqrt(radius) * np.maximum(overlap, 0.0) ** 1.5


def touching(position: Floats) -> Contacts:
    """All touching pairs of a bed that is periodic along x and y."""
    period = np.array([BED_SIDE, BED_SIDE, TALL])
    lifted = (position + np.array([0.0, 0.0, 0.5 * TALL])) % period
    pair = KDTree(lifted, boxsize=period).query_pairs(SOIL.diameter, output_type="ndarray")
    apart = lifted[pair[:, 1]] - lifted[pair[:, 0]]
    apart -= np.round(apart / period) * period
    distance = np.linalg.norm(apart, axis=1)
    overlap = SOIL.diameter - distance
    return Contacts(pair, apart / distance[:, None], overlap, hertz(overlap, 0.25 * SOIL.diameter))


def bed_numbers(rest: Rest) -> Numbers:
    """Packing, overlaps and stress of a bed."""
    contacts, height = touching(rest.position), rest.position[:, 2]
    yield "contacts of a grain with grains", 2.0 * len(contacts.overlap) / len(height)
    for share in QUANTILES:
        yield (
            f"overlap, quantile {share:g}, 1e-4 d",
            1e4 * float(np.quantile(contacts.overlap, share)) / SOIL.diameter,
        )
    yield "mean height of the grains, d", float(height.mean()) / SOIL.diameter
    load = hertz(0.5 * SOIL.diameter - height, 0.5 * SOIL.diameter).sum()
    yield "load of the floor over the weight", float(load) / (weight(SOIL) * len(height))
    for cut in CUTS:
        yield f"weight above {cut:g} H that normal forces carry", carried(contacts, height, cut)
    yield "stress across over along the vertical, normal forces", stress_ratio(contacts)
    yield "kinetic energy of a grain, 1e-6 m g d", 1e6 * kinetic(rest)


def carried(contacts: Contacts, height: Floats, cut: float) -> float:
    """Vertical part of the normal forces between grains above and below a plane, over the weight above [1].

    The rest is carried by friction: at rest both together carry all of it.
    """
    level = cut * float(height.max())
    above = height > level
    first, second = above[contacts.pair[:, 0]], above[contacts.pair[:, 1]]
    upward = contacts.force * contacts.normal[:, 2] * (second.astype(float) - first.astype(float))
    return float(upward.sum()) / (weight(SOIL) * np.count_nonzero(above))


def stress_ratio(contacts: Contacts) -> float:
    """(s_xx + s_yy) / (2 s_zz) of the normal forces, s the sum of F n n over contacts [1]."""
    squares = (contacts.force[:, None] * contacts.normal**2).sum(axis=0)
    return float((squares[0] + squares[1]) / (2.0 * squares[2]))


def kinetic(rest: Rest) -> float:
    """Kinetic energy of a grain over its weight times its diameter [1]."""
    turning = 0.4 * (0.5 * SOIL.diameter) ** 2 * (rest.spin**2).sum(axis=1)
    energy = 0.5 * mass(SOIL) * ((rest.velocity**2).sum(axis=1) + turning)
    return float(energy.mean()) / (weight(SOIL) * SOIL.diameter)


def heap_numbers(rest: Rest, soil: Soil, flank: bool) -> Numbers:
    """Shape of a heap, with its angle where it has a flank, by the measures of this program; how it rests."""
    count = len(rest.position)
    still = np.zeros(count, np.int32)
    state = Snapshot(
        time=0.0,
        step=0,
        position=rest.position,
        velocity=rest.velocity,
        spin=rest.spin,
        radius=np.full(count, 0.5 * soil.diameter),
        mass=np.full(count, mass(soil)),
        contacts=still,
        ident=np.arange(count, dtype=np.int32),
        waiting=0,
    )
    if flank:
        yield "angle of repose, deg", angle_of_repose_outline(state).value
    lengths = {
        "height": pile_height,
        "mean height of the grains": centroid_height,
        "radius of 90 %": radius_90,
    }
    for name, measure in lengths.items():
        yield f"{name}, d", measure(state).value / soil.diameter
    moving = 0.5 * float((rest.velocity**2).sum(axis=1).mean()) / (soil.gravity * soil.diameter)
    yield "energy of translation of a grain, 1e-7 m g d", 1e7 * moving


def close_numbers(rest: Rest, soil: Soil) -> Numbers:
    """Grains that touch, stretched necks among them, as far as places tell."""
    pairs = KDTree(rest.position).query_pairs(CLOSE * soil.diameter, output_type="ndarray")
    yield f"grains within {CLOSE:g} d of a grain", 2.0 * len(pairs) / len(rest.position)


def stack_numbers(rest: Rest) -> Numbers:
    """Overlaps of a grain on the floor and one on top of it, over those of Hertz' formula."""
    height = rest.position[:, 2]
    floor, pair = 0.5 * SOIL.diameter - height[0], SOIL.diameter - (height[1] - height[0])
    yield "overlap with the floor over Hertz' formula", float(floor) / depth(2.0, 0.5)
    yield "overlap of two grains over Hertz' formula", float(pair) / depth(1.0, 0.25)


def depth(weights: float, radius: float) -> float:
    """Overlap [m] under some weights of a grain, effective radius [d]."""
    stiffness = float(hertz(np.array([1.0]), radius * SOIL.diameter)[0])
    return (weights * weight(SOIL) / stiffness) ** (2.0 / 3.0)
