"""The comparison of physics with other codes: sound starts, measures that know a stack, honest errors."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from benchmarks.peers import physics
from benchmarks.peers.cases import SOIL, Floats
from benchmarks.peers.physics_cases import (
    BED_COUNT,
    BED_SIDE,
    PILE_COUNT,
    TUBE_RADIUS,
    falling_bed,
    falling_column,
    sticky_energy,
)
from benchmarks.peers.physics_measures import Rest, bed_numbers, depth, stack_numbers, touching
from benchmarks.peers.physics_pair import pair_numbers
from taichi_erosion.verification import adhesion
from taichi_erosion.verification.reference import jkr

STACK = 5


def stack() -> Rest:
    """Grains one above the other on the floor, each overlap the one that carries what lies above."""
    height, below = [], 0.5 * SOIL.diameter - depth(STACK, 0.5)
    for above in range(STACK - 1, -1, -1):
        height.append(below)
        below += SOIL.diameter - (depth(above, 0.25) if above else 0.0)
    middle = np.full(STACK, 0.5 * BED_SIDE)
    still = np.zeros((STACK, 3))
    return Rest(np.stack([middle, middle, np.array(height)], axis=1), still, still)


def test_a_stack_in_equilibrium_carries_its_weight_by_normal_forces_alone():
    found = dict(bed_numbers(stack()))
    assert found["load of the floor over the weight"] == pytest.approx(1.0)
    for cut in (0.25, 0.5, 0.75):
        assert found[f"weight above {cut:g} H that normal forces carry"] == pytest.approx(1.0)
    assert found["stress across over along the vertical, normal forces"] == pytest.approx(0.0)
    assert found["contacts of a grain with grains"] == pytest.approx(2.0 * (STACK - 1) / STACK)
    assert found["kinetic energy of a grain, 1e-6 m g d"] == 0.0


def test_two_grains_of_the_stack_rest_at_hertz_depths():
    place = stack().position
    place[:, 2] = [0.5 * SOIL.diameter - depth(2.0, 0.5), 0.0, 0.0, 0.0, 0.0]
    place[1, 2] = place[0, 2] + SOIL.diameter - depth(1.0, 0.25)
    found = dict(stack_numbers(Rest(place[:2], place[:2], place[:2])))
    assert list(found.values()) == pytest.approx([1.0, 1.0])


def test_grains_touch_across_the_sides_of_the_periodic_box():
    d = SOIL.diameter
    contacts = touching(np.array([[0.2 * d, d, d], [BED_SIDE - 0.7 * d, d, d], [4 * d, 4 * d, d]]))
    assert contacts.overlap == pytest.approx([0.1 * d])
    assert abs(contacts.normal[0]) == pytest.approx([1.0, 0.0, 0.0])


def closest(position: Floats) -> float:
    """Least distance of two grains [d]."""
    return float(KDTree(position).query(position, k=2)[0][:, 1].min()) / SOIL.diameter


def test_no_grains_overlap_each_other_or_the_tube_before_they_fall():
    bed, column = falling_bed(1).position, falling_column(1).position
    assert (len(bed), len(column)) == (BED_COUNT, PILE_COUNT)
    assert min(closest(bed), closest(column)) > 1.0
    assert np.hypot(*column[:, :2].T).max() < TUBE_RADIUS - 0.5 * SOIL.diameter
    # across the sides of the period
    along_x, along_y = np.array([BED_SIDE, 0.0, 0.0]), np.array([0.0, BED_SIDE, 0.0])
    assert closest(np.concatenate([bed, bed + along_x, bed + along_y])) > 1.0


def test_sticky_grains_hang_on_by_twice_their_weight():
    weight = SOIL.density * np.pi / 6.0 * SOIL.diameter**3 * SOIL.gravity
    assert 3.0 * np.pi * sticky_energy() * 0.25 * SOIL.diameter == pytest.approx(2.0 * weight)


def test_landmarks_of_the_closed_form_are_found_on_its_own_curve():
    apart = np.linspace(jkr.overlap_at(jkr.CUBE_TEAR), 4.0, 2001)[::-1]
    overlap = np.concatenate([np.linspace(0.0, 4.0, 500), apart])
    force = np.array([jkr.branch_force(float(one)) for one in overlap])
    found = list(dict(pair_numbers(overlap, force)).values())
    tear = -jkr.overlap_at(jkr.CUBE_TEAR)
    assert found == pytest.approx([-8.0 / 3.0, 3.0, tear, 0.0], abs=1e-3)
    assert adhesion.TEAR_AT == -tear


def test_differences_are_given_in_standard_errors():
    ours, theirs = np.array([1.0, 2.0, 3.0, 4.0]), np.array([2.1, 3.0, 4.0, 4.9])
    error = np.sqrt((ours.var(ddof=1) + theirs.var(ddof=1)) / 4.0)
    assert physics.apart(theirs, ours, paired=False) == pytest.approx(1.0 / error)
    # the same beds: only what a bed does differently counts
    assert physics.apart(theirs, ours, paired=True) == pytest.approx(
        1.0 / (np.std([1.1, 1, 1, 0.9], ddof=1) / 2)
    )
    assert np.isnan(physics.apart(theirs[:1], ours[:1], paired=False))


def test_the_table_of_the_page_is_that_of_the_results():
    assert physics.page_table(physics.read_rows()) in physics.PAGE.read_text(encoding="utf-8")
